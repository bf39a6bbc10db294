"""The panels of a design's figures. Each function draws one panel on the axes of a report or on your own axes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import cos, degrees, inf, log10, pi, sin

import numpy as np

from vctune.analysis.feel import NO_LOOP, impedance_at_handle
from vctune.analysis.margins import loop_margins
from vctune.analysis.responses import Loop
from vctune.design.prepared import pose
from vctune.model.gains import AnyCoupling, Coupling, Gains, series_coupling
from vctune.model.loop.limits import high_frequency_limit, low_frequency_limit
from vctune.model.problem import Problem
from vctune.report.figures.curves import Llewellyn, Transparency, handle_impedance, llewellyn, transparency
from vctune.report.figures.style import around_one, decades, frequency_axis, shade
from vctune.report.svg.elements import BLUE, GREEN, GREY, ORANGE, RED
from vctune.report.svg.panel import Axes
from vctune.report.typography import quantity


@dataclass(frozen=True, slots=True)
class Demanded:
    """The curves of Re Z_c, R and their ratio of an admittance display, at the frequencies of the page's curves."""

    own: Llewellyn  # curves of the nominal device
    bare: Llewellyn | None  # curves without the least operator; None if the problem has none
    others: list[Llewellyn]


def demanded(problem: Problem, gains: Gains, coupling: AnyCoupling) -> Demanded:
    """Return the curves that `draw_required` and `draw_ratio` draw."""
    virtual, bare = series_coupling(coupling), None
    if problem.device.operator is not None:
        bare = llewellyn(replace(problem, device=problem.device.bare), gains, virtual)
    others = [llewellyn(case, gains, virtual) for case in pose(problem).cases[1:]]
    return Demanded(llewellyn(problem, gains, virtual), bare, others)


def draw_required(
    axes: Axes, problem: Problem, gains: Gains, coupling: AnyCoupling, curves: Demanded | None = None
) -> Axes:
    """Draw Re Z_c of the coupling and the R that any passive hand requires, over frequency.

    Parameters
    ----------
    axes : axes of Matplotlib, or a panel
    problem : problem of an admittance display
    gains, coupling : the design
    curves : curves of the design (`demanded`); None to compute them

    Returns
    -------
    Axes
        The given axes.
    """
    curves = curves or demanded(problem, gains, coupling)
    own = curves.own
    axes.semilogy(own.hz, own.coupling, color=BLUE, label="coupling, Re Z_c")
    axes.semilogy(own.hz, own.required, "--", color=ORANGE, label="required, R")
    axes.set(ylabel=f"resistance, {problem.units.damping}")
    if curves.bare is not None:
        axes.semilogy(curves.bare.hz, curves.bare.required, ":", color=ORANGE, label="R without operator")
    for number, there in enumerate(curves.others):
        label = "of uncertain devices" if number == 0 else None
        axes.semilogy(there.hz, there.required, "--", color=ORANGE, linewidth=0.6, label=label)
    _on_band(axes, problem, own)
    _asymptotes(axes, problem, gains, series_coupling(coupling))
    decades(axes)
    return axes


def draw_ratio(
    axes: Axes,
    problem: Problem,
    gains: Gains,
    coupling: AnyCoupling,
    least: tuple[float | None, float | None] = (None, None),
    curves: Demanded | None = None,
) -> Axes:
    """Draw Re Z_c / R over frequency, on an axis around 1.

    Parameters
    ----------
    axes : axes of Matplotlib, or a panel
    problem : problem of an admittance display
    gains, coupling : the design
    least : the least ratio and its frequency, Hz, which the function marks; None for no mark
    curves : curves of the design (`demanded`); None to compute them

    Returns
    -------
    Axes
        The given axes.
    """
    curves = curves or demanded(problem, gains, coupling)
    axes.plot(curves.own.hz, curves.own.ratio, color=BLUE, label="ratio Re Z_c / R")
    if curves.bare is not None:
        axes.plot(curves.bare.hz, curves.bare.ratio, ":", color=BLUE, label="without operator")
    for number, there in enumerate(curves.others):
        label = "of uncertain devices" if number == 0 else None
        axes.plot(there.hz, there.ratio, color=BLUE, linewidth=0.6, label=label)
    around_one(axes, problem.stability.safety_factor, *least)
    _on_band(axes, problem, curves.own)
    return axes


def _on_band(axes: Axes, problem: Problem, curves: Llewellyn) -> None:
    frequency_axis(axes, curves.hz[0], curves.hz[-1])
    shade(axes, problem.stability.band, BLUE, "requested band")


def _asymptotes(axes: Axes, problem: Problem, gains: Gains, coupling: Coupling) -> None:
    """Draw the finite limits of R: for omega -> 0 if K_p > 0, and for omega -> inf with hold "lag"."""
    device = problem.device
    if gains.position > 0:
        limit = low_frequency_limit(device, gains, coupling).required
        if 0 < limit < inf:
            axes.axhline(limit, color=ORANGE, linewidth=1, linestyle=":", label="R for ω → 0")
    if device.hold == "lag" and device.delay == 0 and device.ideal and device.damping > 0 < gains.velocity:
        limit = high_frequency_limit(device, gains, coupling).required
        axes.axhline(limit, color=ORANGE, linewidth=1, linestyle="-.", label="R for ω → ∞")


def least_view(problem: Problem) -> tuple[float, float, float]:
    """Return the left edge, the right edge and half the height of the area that a Nyquist plot shows."""
    return -1.2 - 1 / problem.stability.max_sensitivity, 1.1, 1.1


def draw_nyquist(axes: Axes, problem: Problem, gains: Gains) -> Axes:
    """Draw the sampled velocity loop L up to Nyquist, its margins, and the circle in which |S| exceeds its limit.

    Parameters
    ----------
    axes : axes of Matplotlib, or a panel
    problem : problem with a velocity loop, not of a servo
    gains : gains of the velocity loop

    Returns
    -------
    Axes
        The given axes.
    """
    limit, curve = problem.stability.max_sensitivity, Loop(problem.device, gains).L.at()
    margins = loop_margins(problem.device, gains)
    left, right, up = least_view(problem)
    axes.plot(curve.values.real, curve.values.imag, color=BLUE, label="L up to Nyquist")
    angle = np.linspace(0, 2 * pi, 361)
    axes.plot(np.cos(angle), np.sin(angle), color=GREY, linewidth=1, linestyle="--", label="unit circle")
    axes.fill(
        -1 + np.cos(angle) / limit, np.sin(angle) / limit,
        facecolor="none", edgecolor=RED, hatch="///", linewidth=1, label=f"|S| > {limit:g}",
    )  # fmt: skip
    axes.plot(-1, 0, "+", color=RED, markersize=10, label="-1")
    if margins.gain < inf:
        axes.plot(-1 / margins.gain, 0, "o", color=ORANGE, label=f"gain margin\n{20 * log10(margins.gain):.3g} dB")
    if margins.phase < inf:
        label = f"phase margin {degrees(margins.phase):.3g}°,\ndelay margin {quantity(margins.delay, 's', 3)}"
        axes.plot(-cos(margins.phase), -sin(margins.phase), "s", color=GREEN, label=label)
    axes.set(
        xlim=(left, right), ylim=(-up, up), aspect="equal", xlabel="Re L, dimensionless", ylabel="Im L, dimensionless"
    )
    return axes


def draw_error(axes: Axes, problem: Problem, gains: Gains, coupling: AnyCoupling, part: str = "error") -> Axes:
    """Draw the transparency error or one of its terms over frequency, for a design.

    For an admittance display, the function also draws it without a coupling, and without a coupling and a loop.

    Parameters
    ----------
    axes : axes of Matplotlib, or a panel
    problem : problem with the device and its band
    gains, coupling : the design
    part : "error", or a term: "admittance", "tracking" or "coupling"

    Returns
    -------
    Axes
        The given axes.
    """
    draw_part(axes, problem, compared(problem, gains, coupling), part)
    axes.set(ylabel="transparency error" if part == "error" else f"term of the error: {part}")
    return axes


Cases = dict[str, tuple[Transparency, str, float]]  # Curves by name, each with its line style and width


def compared(problem: Problem, gains: Gains, coupling: AnyCoupling) -> Cases:
    """Return the transparency of a design and, for an admittance display, of the two cases to compare it with."""
    cases: Cases = {"designed": (transparency(problem, gains, coupling), "-", 1.8)}
    if problem.device.kind.banded:
        nothing = Coupling(1e-18, 1e-18, 0.0)
        cases |= {
            "no coupling": (transparency(problem, gains, nothing), "--", 1.2),
            "uncontrolled": (transparency(problem, Gains(0.0, 0.0), nothing), ":", 1.2),
        }
    return cases


def draw_part(axes: Axes, problem: Problem, cases: Cases, part: str) -> None:
    """Draw one part of the transparency for several cases. A curve that is 0 everywhere is left out."""
    for name, (curves, line, width) in cases.items():
        values, colour = getattr(curves, part), BLUE if name == "designed" else GREY
        if values.max() > 1e-12:
            axes.semilogy(curves.hz, values, line, linewidth=width, color=colour, label=name)
    hz = cases["designed"][0].hz
    frequency_axis(axes, hz[0], hz[-1])
    shade(axes, problem.transparency.band, BLUE, "transparency band")


def draw_impedance(axes: Axes, problem: Problem, gains: Gains, coupling: AnyCoupling) -> Axes:
    """Draw the impedance that the hand feels with several environments, and the ideal one, over frequency.

    For a device with a mechanism, that is, not a servo, the function also draws the bare device.

    Parameters
    ----------
    axes : axes of Matplotlib, or a panel
    problem : problem with the device and its bands
    gains, coupling : the design

    Returns
    -------
    Axes
        The given axes.
    """
    hz, felt = handle_impedance(problem, gains, coupling)
    for number, (name, (impedance, ideal)) in enumerate(felt.items()):
        colour, every, dashes = (BLUE, GREEN, ORANGE, RED)[number], (0.025 * number, 0.1), ("", "--", "-.", "")[number]
        axes.semilogy(hz, impedance, marker="os^D"[number], markevery=every, markersize=4, color=colour, label=name)
        if np.isfinite(ideal).all() and ideal.max() > 0:
            axes.semilogy(
                hz, ideal, color=colour, linewidth=1, linestyle=dashes, label="_ideal" if number > 1 else "ideal"
            )
    if problem.device.servo is None:
        bare = np.abs(impedance_at_handle(problem.device, NO_LOOP[0], 2 * pi * hz, None))
        axes.semilogy(hz, bare, ":", color=GREY, linewidth=1.2, label="bare device")
    frequency_axis(axes, hz[0], hz[-1])
    axes.set(ylabel=f"impedance at the handle, {problem.units.damping}")
    return axes
