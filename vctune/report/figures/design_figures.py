"""The figures of a design, drawn from curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf, pi

import numpy as np

from vctune.analysis.in_hands import RatioInAnyHand, RatioInHand
from vctune.analysis.phases import sensor_miss
from vctune.document.records.contact_json import ContactRecord
from vctune.document.records.design_json import BoxRecord, DesignRecord, OptimalityRecord
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.numbers.keys import KEYS, labelled
from vctune.model.problem import Band, Problem
from vctune.report.figures.hands_figure import any_hand_figure, hands_figure
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
from vctune.report.figures.style import WIDTH, decades, shade, stamp
from vctune.report.page.contents import IN_WORDS
from vctune.report.page.summary import doubt
from vctune.report.svg.drawing import Drawing
from vctune.report.svg.elements import BLUE, GREEN, GREY, ORANGE, RED, text
from vctune.report.svg.labels import label_curves, legend
from vctune.report.svg.panel import Panel
from vctune.report.typography import quantity

ROOM_FOR_WORDS = 2.1  # End of the latency axis, as a multiple of the longest latency


@dataclass(frozen=True, slots=True)
class Design:
    """The data of the figures."""

    problem: Problem  # a problem, its design and the record of the design
    gains: Gains
    coupling: AnyCoupling
    record: DesignRecord
    least: Sequence[RatioInHand | RatioInAnyHand] = ()


def figures(design: Design) -> dict[str, Drawing]:
    """Return all figures of a design by name, in the order of the page."""
    contact, found = design.record.contact, design.record.optimality
    drawn = {
        **_in_hands(design),
        **({"llewellyn": _llewellyn(design)} if design.problem.passive else {}),
        **({"latency": _latency(contact, design.problem)} if contact is not None else {}),
        "impedance": _impedance(design),
        "transparency": _transparency(design),
        **({"nyquist": _nyquist(design)} if design.gains.closed or design.problem.device.kind.banded else {}),
        **({"optimality": _optimality(found, design.problem)} if found is not None else {}),
    }
    if words := doubt(design.record, design.problem):
        for drawing in drawn.values():
            stamp(drawing, words)
    return drawn


def _in_hands(design: Design) -> dict[str, Drawing]:
    """Return the figure for the hands that the criterion requires, or for any passive hand on an impedance display."""
    hands = design.problem.hands_met
    if design.problem.any_hand:
        return {"any-hand": any_hand_figure(design.problem, design.gains, design.coupling)}
    if hands is None:
        return {}
    before_passive = [] if design.problem.worlds else [each for each in design.least if isinstance(each, RatioInHand)]
    return {"hands": hands_figure(design.problem, hands, design.gains, design.coupling, before_passive)}


def _latency(contact: ContactRecord, problem: Problem) -> Drawing:
    """Draw the parts of a servo's latency as bars, each with its key and the drag that it requires at rest."""
    drawing = Drawing(WIDTH, 0.75 + 0.42 * len(contact.parts), left=1.2, top=0.1)
    (panel,), end = drawing.divide(), 1e3 * ROOM_FOR_WORDS * max(part.latency_s for part in contact.parts)
    panel.set(xlabel=f"latency, ms; {quantity(contact.latency_s, 's', 3)} in all", xlim=(0.0, end))
    panel.set(ylim=(len(contact.parts) - 0.5, -0.5))
    panel.set_yticks(range(len(contact.parts)), [part.part for part in contact.parts])
    for row, part in enumerate(contact.parts):
        wide, low, high = 1e3 * part.latency_s, row - 0.31, row + 0.31
        panel.fill([0, wide, wide, 0, 0], [low, low, high, high, low], facecolor=BLUE, alpha=0.75, linewidth=0)
        left, top, width, height = panel.box
        x, y = left + width * wide / end + 5, top + height * (row + 0.5) / len(contact.parts)
        asks = f"{quantity(part.latency_s, 's', 3)}: {quantity(part.drag, problem.units.damping, 3)}"
        panel.over += [text(x, y - 6, asks, size=8, va="center")]
        panel.over += [text(x, y + 5, part.key.removeprefix("device."), size=6.5, va="center")]
    return drawing


def _llewellyn(design: Design) -> Drawing:
    problem, proof = design.problem, design.record.certificate
    assert proof is not None, "a design is judged"
    shown = problem, design.gains, design.coupling
    curves = demanded(*shown)
    drawing = Drawing(WIDTH, 4.6, left=0.8, top=0.35)
    upper, lower = drawing.divide(2, 1, (0, 0.42), (3, 2))
    draw_required(upper, *shown, curves)
    draw_ratio(lower, *shown, (proof.min_ratio, proof.worst_hz), curves)
    for panel in (upper, lower):
        if proof.proved_band_hz:
            _edges(panel, proof.proved_band_hz)
    upper.set(xlabel="")
    label_curves(upper)
    label_curves(lower)
    return drawing


def _edges(panel: Panel, proved: list[float | None]) -> None:
    for number, edge in enumerate(edge for edge in proved if edge):
        label = "proved band" if number == 0 else "_"
        panel.axvline(edge, color=GREEN, linewidth=1, linestyle="--", label=label)


def _nyquist(design: Design) -> Drawing:
    left, right, up = least_view(design.problem)
    width = WIDTH - 0.72 - 0.15
    drawing = Drawing(WIDTH, width * 2 * up / (right - left) + 0.5 + 0.2, left=0.72, top=0.2)
    (panel,) = drawing.divide()
    draw_nyquist(panel, design.problem, design.gains)
    label_curves(panel)
    return drawing


def _transparency(design: Design) -> Drawing:
    problem = design.problem
    cases = compared(problem, design.gains, design.coupling)
    names, terms = design.record.transparency, problem.device.kind.terms
    assert names is not None, "a design is judged"
    symbols = {"admittance": names.admittance_label, "tracking": names.tracking_label, "coupling": names.coupling_label}
    titles = {term: f"{IN_WORDS[term]}: {symbol}" for term, symbol in symbols.items()}
    parts = {term: titles[term] for term in terms} | ({"error": "all together"} if len(terms) > 2 else {})
    rows = len(parts) // 2
    drawing = Drawing(WIDTH, {1: 2.4, 2: 4.0}[rows], left=0.85, top=0.55)
    panels = drawing.divide(rows, 2, (0.42, 0.42))
    at = dict(zip(parts, panels, strict=True))
    for part, panel in at.items():
        draw_part(panel, problem, cases, part)
        panel.name, panel.title = part, parts[part]
    for panel in panels[::2]:
        panel.set(ylabel="share of the ideal")
    words, wide, _ = legend(panels[0].marks, 4, 7.5)
    drawing.over.append(f'<g transform="translate({(drawing.width - wide) / 2:.1f} 5)">{words}</g>')
    miss = sensor_miss(problem.device, 2 * pi * cases["designed"][0].hz)
    if miss is not None:
        panel = at["tracking"]
        panel.semilogy(cases["designed"][0].hz, miss, "-.", linewidth=1.2, color=ORANGE, label="|1 - F_s|")
        words, wide, high = legend(panel.marks[-1:], 1)
        left, top, width, height = panel.box
        place = f"{left + width - wide - 4:.1f} {top + height - high - 4:.1f}"
        panel.over.append(f'<g transform="translate({place})">{words}</g>')
    for panel in panels:
        decades(panel)
    for panel in panels[:-2]:
        panel.set(xlabel="")
    return drawing


def _impedance(design: Design) -> Drawing:
    drawing = Drawing(WIDTH, 3.5, left=0.78, top=0.25)
    (panel,) = drawing.divide()
    draw_impedance(panel, design.problem, design.gains, design.coupling)
    _promised(panel, design)
    decades(panel)
    label_curves(panel, 3)
    return drawing


def _promised(panel: Panel, design: Design) -> None:
    """Shade the band on which stability is proved, or hatch the band of a failed proof, and mark the transparency
    band."""
    problem, proof = design.problem, design.record.certificate
    assert proof is not None, "a design is judged"
    everywhere = Band(0.0, inf)
    if design.record.status != "certified":
        shade(panel, problem.stability.band if problem.passive else everywhere, RED, "required, not proved", "//")
    elif proof.proved_band_hz is not None:
        low, high = proof.proved_band_hz
        shade(panel, Band(2 * pi * (low or 0.0), inf if high is None else 2 * pi * high), GREY, "proved stable")
    else:
        shade(panel, everywhere, GREY, "proved stable")
    shade(panel, problem.transparency.band, BLUE, "transparency band")


def _optimality(found: OptimalityRecord, problem: Problem) -> Drawing:
    """Draw the bound and the best design against the number of searched boxes, and the open boxes."""
    boxes, bound, error = (
        [np.nan if (value := getattr(row, key)) is None else value for row in found.history]
        for key in ("boxes", "lower_bound", "error")
    )
    drawing = Drawing(WIDTH, 3.2, left=0.7, right=0.2, top=0.65)
    first, *others = drawing.divide(1, 2 if found.open else 1, (0.45, 0.0))
    steps = [*pairwise(range(len(boxes)))]
    after = [boxes[0], *(boxes[k] for _, k in steps for _ in (0, 1))]
    for values, style in (
        (error, {"linestyle": "--", "color": GREEN, "label": "best design known"}),
        (bound, {"color": BLUE, "label": "no design is below"}),
    ):
        first.plot(after, [*(values[k] for k, _ in steps for _ in (0, 1)), values[-1]], **style)
    first.set(xlabel="boxes searched", ylabel=found.of, yscale="log")
    label_curves(first, 1)
    for panel in others:
        _draw_boxes(panel, found.open, problem)
        panel.title = f"{len(found.open)} of {found.history[-1].open} open boxes"
    return drawing


def _draw_boxes(panel: Panel, boxes: list[BoxRecord], problem: Problem) -> None:
    units = problem.units
    row, label = (2, "b_c/k_c, s") if problem.device.kind.inverse else (1, labelled(KEYS[1], units))
    for box in boxes:
        (x, y), (X, Y) = ((edge[0], edge[row]) for edge in (box.low, box.high))
        panel.fill([x, X, X, x, x], [y, y, Y, Y, y], facecolor=ORANGE, alpha=0.4, edgecolor=ORANGE)
    panel.set(xlabel=labelled(KEYS[0], units), ylabel=label)
