"""The figures of a design, drawn from curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, pi

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from vctune.analysis.in_hands import RatioInAnyHand, RatioInHand
from vctune.analysis.phases import sensor_miss
from vctune.document.records.contact_json import ContactRecord
from vctune.document.records.design_json import BoxRecord, DesignRecord, OptimalityRecord
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.numbers.keys import KEYS, WORLD, labelled
from vctune.model.problem import Band, Problem
from vctune.report.figures.diagram import loop_figure
from vctune.report.figures.hands_figure import any_hand_figure, hands_figure
from vctune.report.figures.labels import label_curves
from vctune.report.figures.panels import (
    compared,
    demanded,
    draw_impedance,
    draw_nyquist,
    draw_part,
    draw_ratio,
    draw_required,
    least_view,
)
from vctune.report.figures.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    RED,
    STYLE,
    WIDTH,
    canvas,
    decades,
    shade,
    stamp,
)
from vctune.report.page.contents import IN_WORDS
from vctune.report.page.summary import doubt
from vctune.report.typography import quantity

MAP_LEVELS = 4
"""Number of times that the code halves the map of what may be rendered, to a sixteenth. It takes about a second."""


@dataclass(frozen=True, slots=True)
class Design:
    """The data of the figures.

    Attributes
    ----------
    problem, gains, coupling, record : a problem, its design and the record of the design
    least : the least ratios in the problem's hands (`vctune.analysis.in_hands.least_ratios`); if empty, the functions
        compute them
    """

    problem: Problem
    gains: Gains
    coupling: AnyCoupling
    record: DesignRecord
    least: Sequence[RatioInHand | RatioInAnyHand] = ()


def figures(design: Design) -> dict[str, Figure]:
    """Return all figures of a design by name, in the order of the page."""
    with rc_context(STYLE):
        contact, found = design.record.contact, design.record.optimality
        drawn = {
            **_in_hands(design),
            **({"llewellyn": _llewellyn(design)} if design.problem.passive else {}),
            **({"latency": _latency(contact, design.problem)} if contact is not None else {}),
            **_rendered(design),
            "impedance": _impedance(design),
            "transparency": _transparency(design),
            **({"nyquist": _nyquist(design)} if design.gains.closed or design.problem.device.kind.banded else {}),
            **({"optimality": _optimality(found, design.problem)} if found is not None else {}),
        }
        for figure in drawn.values():
            if words := doubt(design.record, design.problem):
                stamp(figure, words)
        return {**drawn, "loop": loop_figure(design.problem.device, design.gains, design.coupling)}


def _in_hands(design: Design) -> dict[str, Figure]:
    """Return the figure of the hands that the criterion requires, or of any hand on an impedance display; else none."""
    hands = design.problem.hands_met
    if design.problem.any_hand:
        return {"any-hand": any_hand_figure(design.problem, design.gains, design.coupling)}
    if hands is None:
        return {}
    before_passive = [] if design.problem.worlds else [each for each in design.least if isinstance(each, RatioInHand)]
    return {"hands": hands_figure(design.problem, hands, design.gains, design.coupling, before_passive)}


def _rendered(design: Design) -> dict[str, Figure]:
    """Return the coarse map of what may be rendered, if the problem states lossless environments without lateness."""
    problem = design.problem
    if problem.worlds is None or not problem.worlds.lossless:
        return {}
    from vctune.report.figures.region_figure import world_figure
    from vctune.study.world_region import world_plane, world_region

    plane = world_plane(problem, WORLD[2], WORLD[0], MAP_LEVELS)
    return {"z-width": world_figure(problem, world_region(problem, design.gains, design.coupling, plane))}


def _latency(contact: ContactRecord, problem: Problem) -> Figure:
    """Draw the parts of a servo's latency as bars, with the drag that each requires at rest and its key."""
    figure = canvas(WIDTH, 0.75 + 0.42 * len(contact.parts), left=1.2, right=1.75, top=0.1)
    axes = figure.subplots()
    for row, part in enumerate(contact.parts):
        late = quantity(part.latency_s, "s", 3)
        asks = f"{late}: {quantity(part.drag, problem.units.damping, 3)}"
        axes.barh(row, 1e3 * part.latency_s, height=0.62, color=BLUE, alpha=0.75)
        axes.annotate(asks, (1e3 * part.latency_s, row), (5, 6), textcoords="offset points", va="center", fontsize=8)
        key = part.key.removeprefix("device.")
        axes.annotate(key, (1e3 * part.latency_s, row), (5, -5), textcoords="offset points", va="center", fontsize=6.5)
    axes.set_yticks(range(len(contact.parts)), [part.part for part in contact.parts])
    axes.invert_yaxis()
    longest = max(part.latency_s for part in contact.parts)
    axes.set(xlabel=f"latency, ms; {quantity(contact.latency_s, 's', 3)} in all", xlim=(0, 1.04e3 * longest))
    axes.grid(visible=False, axis="y")
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def _llewellyn(design: Design) -> Figure:
    problem, proof = design.problem, design.record.certificate
    assert proof is not None, "a design is judged"
    shown = problem, design.gains, design.coupling
    curves = demanded(*shown)
    figure = canvas(WIDTH, 4.6, left=0.8, top=0.35, gaps=(0, 0.42))
    upper, lower = figure.subplots(2, 1, height_ratios=(3, 2))
    draw_required(upper, *shown, curves)
    draw_ratio(lower, *shown, (proof.min_ratio, proof.worst_hz), curves)
    for axes in (upper, lower):
        if proof.proved_band_hz:
            _edges(axes, proof.proved_band_hz)
    upper.set_xlabel("")
    label_curves(upper)
    label_curves(lower)
    return figure


def _edges(axes: Axes, proved: list[float | None]) -> None:
    for number, edge in enumerate(edge for edge in proved if edge):
        label = "proved band" if number == 0 else "_"
        axes.axvline(edge, color=GREEN, linewidth=1, linestyle="--", label=label)


def _nyquist(design: Design) -> Figure:
    left, right, up = least_view(design.problem)
    width = WIDTH - 0.72 - 0.15
    figure = canvas(WIDTH, width * 2 * up / (right - left) + 0.5 + 0.2, left=0.72, top=0.2)
    label_curves(draw_nyquist(figure.subplots(), design.problem, design.gains))
    return figure


def _transparency(design: Design) -> Figure:
    problem = design.problem
    cases = compared(problem, design.gains, design.coupling)
    names, terms = design.record.transparency, problem.device.kind.terms
    assert names is not None, "a design is judged"
    symbols = {"admittance": names.free_motion, "tracking": names.missed, "coupling": names.given_way}
    titles = {term: f"{IN_WORDS[term]}: {symbol}" for term, symbol in symbols.items()}
    parts = {term: titles[term] for term in terms} | ({"error": "all together"} if len(terms) > 2 else {})
    rows = len(parts) // 2
    figure = canvas(WIDTH, {1: 2.4, 2: 4.0}[rows], left=0.85, top=0.55, gaps=(0.42, 0.42))
    panels = figure.subplots(rows, 2, squeeze=False)
    at = dict(zip(parts, panels.ravel(), strict=True))
    for part, axes in at.items():
        draw_part(axes, problem, cases, part)
        axes.set_title(parts[part], fontsize=8)
        axes.set_label(part)
    for axes in panels[:, 0]:
        axes.set_ylabel("share of the ideal")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    miss = sensor_miss(problem.device, 2 * pi * cases["designed"][0].hz)
    if miss is not None:
        at["tracking"].semilogy(cases["designed"][0].hz, miss, "-.", linewidth=1.2, color=ORANGE, label="|1 - F_s|")
        at["tracking"].legend(loc="lower right", fontsize=8, handles=at["tracking"].lines[-1:])
    for axes in at.values():
        decades(axes)
    for axes in panels[:-1].ravel():
        axes.set_xlabel("")
    figure.legend(
        handles,
        labels,
        loc="upper center",
        ncols=4,
        fontsize=7.5,
        columnspacing=0.7,
        handlelength=1.4,
        handletextpad=0.4,
    )
    return figure


def _impedance(design: Design) -> Figure:
    figure = canvas(WIDTH, 3.5, left=0.78, top=0.25)
    axes = figure.subplots()
    draw_impedance(axes, design.problem, design.gains, design.coupling)
    _promised(axes, design)
    decades(axes)
    label_curves(axes, 3)
    return figure


def _promised(axes: Axes, design: Design) -> None:
    """Shade the band on which stability is proved, or hatch the band of a failed proof, and mark the transparency band.

    A proved claim in hands holds at every frequency, so the shade then covers the whole axis.
    """
    problem, proof = design.problem, design.record.certificate
    assert proof is not None, "a design is judged"
    everywhere = Band(0.0, inf)
    if design.record.status != "certified":
        shade(axes, problem.stability.band if problem.passive else everywhere, RED, "asked for, not proved", "//")
    elif proof.proved_band_hz is not None:
        low, high = proof.proved_band_hz
        shade(axes, Band(2 * pi * (low or 0.0), inf if high is None else 2 * pi * high), GREY, "proved stable")
    else:
        shade(axes, everywhere, GREY, "proved stable")
    shade(axes, problem.transparency.band, BLUE, "transparency band")


def _optimality(found: OptimalityRecord, problem: Problem) -> Figure:
    """Draw the bound and the best design against the number of searched boxes, and the gains of the open boxes."""
    boxes, bound, error = (
        [np.nan if (value := getattr(row, key)) is None else value for row in found.history]
        for key in ("boxes", "lower_bound", "error")
    )
    figure = canvas(WIDTH, 3.2, left=0.7, right=0.2, top=0.65, gaps=(0.45, 0))
    axes, *others = figure.subplots(1, 2 if found.open else 1, squeeze=False)[0]
    axes.step(boxes, error, "--", where="post", color=GREEN, label="best design known")
    axes.step(boxes, bound, where="post", color=BLUE, label="no design is below")
    axes.set(xlabel="boxes searched", ylabel=found.of, yscale="log")
    label_curves(axes, 1)
    for panel in others:
        _draw_boxes(panel, found.open, problem)
        panel.set_title(f"{len(found.open)} of {found.history[-1].open} open boxes")
    return figure


def _draw_boxes(axes: Axes, boxes: list[BoxRecord], problem: Problem) -> None:
    units = problem.units
    row, label = (2, "b_c/k_c, s") if problem.device.kind.inverse else (1, labelled(KEYS[1], units))
    for box in boxes:
        (x, y), (x_end, y_end) = ((edge[0], edge[row]) for edge in (box.low, box.high))
        axes.add_patch(Rectangle((x, y), x_end - x, y_end - y, facecolor=ORANGE, alpha=0.4, edgecolor=ORANGE))
    axes.autoscale_view()
    axes.set(xlabel=labelled(KEYS[0], units), ylabel=label)
