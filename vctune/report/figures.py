"""Figures from curves. Each returns a matplotlib figure whose ink is `INK`, so that a page can recolour it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import cos, inf, pi, radians, sin
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from vctune.analysis.margins import loop_margins
from vctune.design.cases import cases_of
from vctune.document.problem import Band, Problem
from vctune.model.limits import high_frequency_limit, low_frequency_limit
from vctune.model.quantities import Coupling, Gains
from vctune.report.curves import (
    Transparency,
    handle_impedance,
    llewellyn,
    nyquist,
    transparency,
)

INK = "#010203"
FLOOR = 1e-12
BLUE, ORANGE, GREEN, RED, GREY = "#3b82d0", "#e08a1e", "#2f9e62", "#d6453d", "#8a8f98"
STYLE: Any = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 10,
    "text.color": INK,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.facecolor": "none",
    "figure.facecolor": "none",
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.grid": True,
    "grid.color": GREY,
    "grid.alpha": 0.3,
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.labelcolor": INK,
    "lines.linewidth": 1.6,
}


@dataclass(frozen=True, slots=True)
class Design:
    """What the figures show: a problem, its gains and coupling, and the numbers of design.json."""

    problem: Problem
    gains: Gains
    coupling: Coupling
    record: dict[str, Any]


def figures(design: Design) -> dict[str, Figure]:
    """Return every figure that the design has, by name, in the order of the page."""
    with rc_context(STYLE):
        drawn = {
            "llewellyn": _llewellyn(design),
            "nyquist": _nyquist(design),
            "transparency": _transparency(design),
            "impedance": _impedance(design),
        }
        if design.record["solver"].get("rounds"):
            drawn["convergence"] = _convergence(design.record["solver"]["rounds"])
        if design.record.get("optimality"):
            drawn["optimality"] = _optimality(design.record["optimality"])
    return drawn


def _llewellyn(design: Design) -> Figure:
    problem, proof = design.problem, design.record["certificate"]
    curves = llewellyn(problem, design.gains, design.coupling)
    figure = Figure(figsize=(8, 5.4), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    upper.loglog(curves.hz, curves.coupling, color=BLUE, label="Re Z_c")
    upper.loglog(curves.hz, curves.required, color=ORANGE, label="required R")
    upper.set_ylabel("N s/m")
    lower.loglog(curves.hz, curves.ratio, color=GREEN, label="ratio Re Z_c / R")
    if problem.device.operator is not None:
        bare = llewellyn(replace(problem, device=problem.device.bare), design.gains, design.coupling)
        upper.loglog(bare.hz, bare.required, color=ORANGE, linestyle=":", label="R without operator")
        lower.loglog(bare.hz, bare.ratio, color=GREEN, linestyle=":", label="ratio without operator")
    for number, case in enumerate(cases_of(problem)[1:]):
        there, label = llewellyn(case, design.gains, design.coupling), "of uncertain devices" if number == 0 else None
        upper.loglog(there.hz, there.required, color=ORANGE, linewidth=0.6, label=label)
        lower.loglog(there.hz, there.ratio, color=GREEN, linewidth=0.6, label=label)
    lower.axhline(1.0, color=RED, linewidth=1, label="1: the limit")
    lower.axhline(problem.stability.safety_factor, color=RED, linewidth=1, linestyle=":", label="safety factor")
    if np.isfinite(curves.ratio).any():
        lower.set_ylim(max(np.nanmin(curves.ratio[curves.ratio > 0], initial=1.0) / 2, 1e-3), 1e3)
    lower.set_ylabel("ratio")
    lower.set_xlabel("frequency, Hz")
    for axes in (upper, lower):
        _shade(axes, problem.stability.band, BLUE, "requested band")
        if proof["proved_band_hz"]:
            _edges(axes, proof["proved_band_hz"])
        axes.set_xlim(curves.hz[0], curves.hz[-1])
    _asymptotes(design, upper)
    if proof["worst_hz"] and proof["min_ratio"] and curves.hz[0] <= proof["worst_hz"] <= curves.hz[-1]:
        lower.plot(proof["worst_hz"], proof["min_ratio"], "o", color=RED, label="least ratio")
    upper.legend(loc="best", ncols=2)
    lower.legend(loc="best", ncols=2)
    return figure


def _shade(axes: Axes, band: Band, colour: str, label: str) -> None:
    low, high = axes.get_xlim()
    axes.axvspan(max(band.min / (2 * pi), low), min(band.max / (2 * pi), high), color=colour, alpha=0.1, label=label)


def _edges(axes: Axes, proved: list[float | None]) -> None:
    for edge, label in zip(proved, ("proved band", None), strict=True):
        if edge:
            axes.axvline(edge, color=GREEN, linewidth=1, linestyle="--", label=label)


def _asymptotes(design: Design, axes: Axes) -> None:
    """Draw 1.6's limits of R where they are numbers: omega -> 0 with K_p > 0, omega -> inf with hold "lag"."""
    device, gains = design.problem.device, design.gains
    if gains.position > 0 and device.damping > 0:
        limit = low_frequency_limit(device, gains, design.coupling).required
        if 0 < limit < inf:
            axes.axhline(limit, color=ORANGE, linewidth=1, linestyle=":", label="R for ω → 0")
    if device.hold == "lag" and device.delay == 0 and device.damping > 0 and gains.velocity > 0:
        limit = high_frequency_limit(device, gains, design.coupling).required
        axes.axhline(limit, color=ORANGE, linewidth=1, linestyle="-.", label="R for ω → ∞")


def _nyquist(design: Design) -> Figure:
    problem, limit = design.problem, design.problem.stability.max_sensitivity
    curve = nyquist(problem, design.gains)
    margins = loop_margins(problem.device, design.gains)
    figure = Figure(figsize=(6.2, 5.6), layout="constrained")
    axes = figure.subplots()
    axes.plot(curve.L.real, curve.L.imag, color=BLUE, label="L of the sampled loop up to Nyquist")
    angle = np.linspace(0, 2 * pi, 361)
    axes.plot(np.cos(angle), np.sin(angle), color=GREY, linewidth=1, linestyle="--", label="unit circle")
    axes.plot(-1 + np.cos(angle) / limit, np.sin(angle) / limit, color=RED, linewidth=1, label=f"|S| = {limit:g}")
    axes.plot(-1, 0, "+", color=RED, markersize=10)
    if margins.gain < inf:
        axes.plot(-1 / margins.gain, 0, "o", color=ORANGE, label=f"gain margin {20 * np.log10(margins.gain):.3g} dB")
    if margins.phase < inf:
        axes.plot(
            -cos(margins.phase), -sin(margins.phase), "s", color=GREEN, label=_phase_label(margins.phase, margins.delay)
        )
    reach = 1.2 * max(2.0, 1 + 1 / limit)
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xlabel="Re L", ylabel="Im L")
    axes.legend(loc="upper right")
    return figure


def _phase_label(phase: float, delay: float) -> str:
    return f"phase margin {phase / radians(1):.3g}°, delay margin {delay:.3g} s"


def _transparency(design: Design) -> Figure:
    problem = design.problem
    cases = {
        "designed": (transparency(problem, design.gains, design.coupling), "-", 1.8),
        "no coupling": (transparency(problem, design.gains, Coupling(1e-18, 1e-18, 0.0)), "--", 1.2),
        "uncontrolled": (transparency(problem, Gains(0.0, 0.0), Coupling(1e-18, 1e-18, 0.0)), ":", 1.2),
    }
    figure = Figure(figsize=(8, 6.4), layout="constrained")
    panels = figure.subplots(2, 2, sharex=True).ravel()
    parts = (("admittance", "|Z_0 G_hh|"), ("tracking", "|1 - G_he|"), ("coupling", "|Z_c| / Z_0"), ("error", "e(f)"))
    for axes, (part, title) in zip(panels, parts, strict=True):
        for name, (curves, line, width) in cases.items():
            _draw_part(axes, curves, part, name, line, width)
        axes.set_title(title, fontsize=10)
        _shade(axes, problem.transparency.band, BLUE, "transparency band")
    panels[0].legend(loc="best")
    for axes in panels[2:]:
        axes.set_xlabel("frequency, Hz")
    return figure


def _draw_part(axes: Axes, curves: Transparency, part: str, name: str, line: str, width: float) -> None:
    values = getattr(curves, part)
    if values.max() > 1e-12:
        axes.loglog(curves.hz, values, line, linewidth=width, color=BLUE if name == "designed" else GREY, label=name)
        axes.set_xlim(curves.hz[0], curves.hz[-1])


def _impedance(design: Design) -> Figure:
    hz, felt = handle_impedance(design.problem, design.gains, design.coupling)
    figure = Figure(figsize=(8, 4.6), layout="constrained")
    axes = figure.subplots()
    for colour, (name, (impedance, ideal)) in zip((BLUE, GREEN, ORANGE, RED), felt.items(), strict=True):
        axes.loglog(hz, impedance, color=colour, label=name)
        if np.isfinite(ideal).all() and ideal.max() > 0:
            axes.loglog(hz, ideal, color=colour, linewidth=1, linestyle="--", label=f"{name}, ideal")
    axes.set(xlim=(hz[0], hz[-1]), xlabel="frequency, Hz", ylabel="|impedance at the handle|, N s/m")
    axes.legend(loc="best", ncols=2)
    return figure


def _convergence(rounds: list[dict[str, Any]]) -> Figure:
    figure = Figure(figsize=(8, 3.6), layout="constrained")
    inner, outer = figure.subplots(1, 2)
    primal = [value for r in rounds for value in r["primal"]]
    dual = [value for r in rounds for value in r["dual"]]
    inner.semilogy(np.maximum(primal, FLOOR), color=BLUE, label="primal infeasibility")
    inner.semilogy(np.maximum(dual, FLOOR), color=GREY, label="dual infeasibility")
    inner.set(xlabel="IPOPT iteration")
    inner.legend(loc="best")
    seconds = [1e3 * r["seconds"] for r in rounds]
    outer.semilogy(seconds, [max(r["violation"], FLOOR) for r in rounds], "o-", color=RED)
    outer.set(xlabel="run time of the polish, ms", ylabel=f"greatest violation anywhere ({FLOOR:g}: none)")
    for time, r in zip(seconds, rounds, strict=True):
        outer.annotate(
            f"error {r['error']:.5g}", (time, max(r["violation"], FLOOR)), xytext=(4, 4), textcoords="offset points"
        )
    return figure


def _optimality(found: dict[str, Any]) -> Figure:
    """Draw the bound and the best design against run time, and the boxes that are still open, by their gains."""
    seconds, bound, error = (
        [row[key] if row[key] is not None else np.nan for row in found["history"]]
        for key in ("seconds", "lower_bound", "error")
    )
    figure = Figure(figsize=(8, 3.6), layout="constrained")
    axes, *others = figure.subplots(1, 2 if found["open"] else 1, squeeze=False)[0]
    axes.step(seconds, error, where="post", color=GREEN, label="best design known")
    axes.step(seconds, bound, where="post", color=BLUE, label="no design is below")
    axes.set(xlabel="seconds", ylabel="transparency error", yscale="log")
    axes.legend(loc="lower right")
    for boxes in others:
        _draw_boxes(boxes, found["open"])
        boxes.set_title(f"{len(found['open'])} of {found['history'][-1]['open']} open boxes", fontsize=10)
    return figure


def _draw_boxes(axes: Axes, boxes: list[dict[str, list[float]]]) -> None:
    for box in boxes:
        (x, y, *_), (x_end, y_end, *_) = box["low"], box["high"]
        axes.add_patch(Rectangle((x, y), x_end - x, y_end - y, facecolor=ORANGE, alpha=0.4, edgecolor=ORANGE))
    axes.autoscale_view()
    axes.set(xlabel="K_v, N s/m", ylabel="K_p, N/m")
