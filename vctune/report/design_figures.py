"""The figures of a design's page, each with its title, its finding and how to read it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, pi

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vctune.analysis.feel import FREE_HZ, WALL_HZ, feel
from vctune.document.records.design_json import DesignRecord
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.problem import Band, Problem
from vctune.report.curves import Requirement, requirements
from vctune.report.panels import draw_error, draw_impedance, draw_nyquist, draw_ratio, draw_required, nyquist_view
from vctune.report.style import BLUE, GREEN, GREY, RED, STYLE, WIDTH, canvas, decades, legend_above, shade, stamp
from vctune.report.tables import in_place, margins_in_words, peak_in_words
from vctune.report.typography import quantity

# Names of the terms of the error in words
IN_WORDS = {"admittance": "does not yield", "tracking": "does not follow", "coupling": "gives way"}
NAMES = {"hands": "hands", "any_hand": "any-hand", "passive": "llewellyn"}  # File of the requirement of each claim


@dataclass(frozen=True, slots=True)
class Shown:
    """A figure of a page and its texts."""

    name: str  # of its file
    title: str
    finding: str  # sentence with the numbers that the figure shows; "" without any
    reading: str  # what is drawn, and how it should look
    figure: Figure


@dataclass(frozen=True, slots=True)
class Design:
    """The data of the figures."""

    problem: Problem
    gains: Gains
    coupling: AnyCoupling
    record: DesignRecord


def design_figures(problem: Problem, record: DesignRecord, doubt: str) -> list[Shown]:
    """Return all figures of a design, in the order of the page; `doubt` is stamped on each unless it is ""."""
    if record.design is None:
        return []
    design = Design(problem, *record.design, record)
    with rc_context(STYLE):
        shown = [_requirement(design, each) for each in requirements(problem, design.gains, design.coupling)]
        shown += [_impedance(design), _transparency(design)]
        if design.gains.closed or problem.device.kind.banded:
            shown.append(_nyquist(design))
        for each in shown:
            if doubt:
                stamp(each.figure, doubt)
    put = problem.units.translated
    return [
        replace(each, title=put(each.title), finding=put(each.finding), reading=put(each.reading)) for each in shown
    ]


def _requirement(design: Design, drawn: Requirement) -> Shown:
    proof, problem = design.record.certificate, design.problem
    assert proof is not None, "a design is judged"
    # the numbers of the proof, where it speaks of the same ratio
    if drawn.claim == "hands" and proof.hands is not None and problem.worlds is None:
        drawn = replace(drawn, least=proof.hands.min_ratio, least_hz=proof.hands.worst_hz)
        drawn = replace(drawn, where=proof.hands.worst_hand.in_words(design.record.units))
    if drawn.claim == "any_hand" and proof.any_hand is not None:
        drawn = replace(drawn, least=proof.any_hand.min_ratio, least_hz=proof.any_hand.worst_hz)
    if drawn.claim == "passive" and (proof.hands is None or proof.hands.min_ratio != proof.min_ratio):
        drawn = replace(drawn, least=proof.min_ratio, least_hz=proof.worst_hz)
    columns = 1 if drawn.claim == "hands" else 2  # hands in words are long
    rows = -(-(2 + (drawn.band is not None) + bool(proof.proved_band_hz) + len(drawn.others)) // columns)
    figure = canvas(WIDTH, 4.4 + 0.17 * rows, left=0.78, top=0.1 + 0.17 * rows, gaps=(0.0, 0.55))
    upper, lower = figure.subplots(2, 1, height_ratios=(3, 2))
    draw_required(upper, *(problem, design.gains, design.coupling), drawn)
    draw_ratio(lower, *(problem, design.gains, design.coupling), drawn)
    upper.set_xlabel("")
    edges = [edge for edge in proof.proved_band_hz or [] if edge] if drawn.claim == "passive" else []
    for axes in (upper, lower):
        for number, edge in enumerate(edges):
            axes.axvline(edge, color=GREEN, linewidth=1, linestyle="--", label="_" if number else "proved band")
        legend_above(axes, columns if axes is upper else 2)
    return Shown(NAMES[drawn.claim], *_said(design, drawn, edges=bool(edges)), figure)


def _said(design: Design, drawn: Requirement, *, edges: bool) -> tuple[str, str, str]:
    """Return title, finding and reading of a requirement."""
    problem, hands = design.problem, drawn.claim == "hands"
    title = f"Coupling against the requirement of {'the worst hand' if hands else 'any passive hand'}"
    parts = [f"{drawn.name}, solid, must lie above R, dashed, and their ratio above the safety factor"]
    parts += ["on the shaded band"] if drawn.band else ["up to the Nyquist frequency"]
    reading = f"{' '.join(parts)}. "
    if drawn.claim == "passive":
        reading += (
            "On the proved band, between the green lines, in the frequency model, no passive hand and no passive "
            "environment can make the handle unstable." if edges else "Nothing is proved on a band of this figure."
        )  # fmt: skip
    else:
        which = "No hand of the box" if hands else "No passive hand"
        reading += f"{which} with an environment that is passive as it runs then makes the motion grow."
        if problem.device.servo is not None:
            reading += " R is what the late response of a hand or a contact takes, whatever the design."
    if drawn.others:
        reading += " Thin lines show R " + {
            "hands": "in the hands where the ratio has a minimum.",
        }.get(drawn.claim, "of the stated device or without the least operator, as named.")
    if hands and problem.worlds is not None:
        reading += (
            " The curves are for any passive environment, which is more than the claim covers. Where the ratio is "
            "below 1, the loop is stable only because the problem limits its environments."
        )
    if problem.uncertainty is not None:
        reading += " R is that of the worst device in the vertices and the middle of the box of devices."
    if drawn.least is None:
        return title, "", reading
    where = f", in the hand of {drawn.where}" if drawn.where else ""
    return title, f"The ratio is least {in_place(drawn.least, drawn.least_hz)}{where}.", reading


def _impedance(design: Design) -> Shown:
    problem, proof, kind = design.problem, design.record.certificate, design.problem.device.kind
    assert proof is not None, "a design is judged"
    columns = 3 if problem.device.units == "linear" else 2  # units of torque are long
    figure = canvas(WIDTH, 3.6, left=0.78, top={3: 0.66, 2: 0.83}[columns])
    axes = figure.subplots()
    draw_impedance(axes, problem, design.gains, design.coupling)
    everywhere, certified = Band(0.0, inf), design.record.status == "certified"
    promised = "Grey shows where stability is proved."
    if not certified:
        shade(axes, problem.stability.band if problem.passive else everywhere, RED, "required, not proved", "//")
        promised = "Hatched is where stability is required and not proved."
    elif proof.proved_band_hz is not None and proof.hands is None and proof.any_hand is None:
        low, high = proof.proved_band_hz
        proved = Band(2 * pi * (low or 0.0), inf if high is None else 2 * pi * high)
        shade(axes, proved, GREY, "proved stable")
    else:
        shade(axes, everywhere, GREY, "proved stable")
    shade(axes, problem.transparency.band, BLUE, "transparency band")
    decades(axes)
    legend_above(axes, columns)
    here = feel(problem.device, design.gains, design.coupling)
    finding = (
        f"In free motion the handle feels like {quantity(here.mass[0], problem.units.mass, 3)} at {FREE_HZ[0]:g} Hz"
    )
    if kind.own_loop:
        finding += f"; a wall feels like {quantity(here.stiffness, problem.units.stiffness, 3)} at {WALL_HZ:g} Hz"
    reading = "In the transparency band each line with marks should lie on the thin line of its ideal. "
    reading += (
        "The dotted line is the bare device; between free and rigid the device can render everything. "
        if problem.device.servo is None
        else "No environment feels lighter than the free arm, whose drag the contacts require. "
    )
    return Shown(
        "impedance", "What the hand feels, beside what it should feel", f"{finding}.", reading + promised, figure
    )


def _transparency(design: Design) -> Shown:
    problem, terms, kind = design.problem, design.record.transparency, design.problem.device.kind
    assert terms is not None, "a design is judged"
    symbols = {"admittance": terms.admittance_label, "tracking": terms.tracking_label, "coupling": terms.coupling_label}
    titles = {term: f"{IN_WORDS[term]}: {symbols[term]}" for term in kind.terms}
    titles |= {"error": "all together"} if len(titles) > 2 else {}
    rows = len(titles) // 2
    figure = canvas(WIDTH, {1: 2.6, 2: 4.3}[rows], left=0.72, right=0.1, top=0.75, gaps=(0.28, 0.42))
    panels = [*figure.subplots(rows, 2, squeeze=False).flat]
    for (part, title), axes in zip(titles.items(), panels, strict=True):
        draw_error(axes, problem, design.gains, design.coupling, part)
        axes.set_title(title, fontsize=8)
        axes.set_ylabel("share of the ideal" if axes in panels[::2] else "")
        decades(axes)
    for axes in panels[:-2]:
        axes.set_xlabel("")
    lines = dict(pair for axes in panels for pair in zip(*axes.get_legend_handles_labels()[::-1], strict=True))
    figure.legend(
        lines.values(), lines.keys(), loc="upper center", ncols=2 if len(lines) > 3 else 3, columnspacing=1.1,
        borderaxespad=0.2, handlelength=1.9,
    )  # fmt: skip
    sizes = {symbols[term]: getattr(terms, term) for term in kind.terms}
    most = max(sizes, key=lambda name: sizes[name] or 0.0)
    finding = f"The largest term of the error is {most}: {quantity(sizes[most], digits=3)}"
    finding += f" of {quantity(terms.error, digits=3)}."
    reading = "All terms should be small in the shaded band."
    if kind.banded:
        reading += " Grey lines show the same loop without a coupling, dashed, and the device without a loop, dotted."
    if any("sensor, " in label for label in lines):
        reading += " The force sensor alone loses |1 - F_s|, which no gain affects and the error does not include."
    if problem.device.servo is not None:
        reading += " How well the motion follows its command depends only on the servo; vctune designs the coupling."
    return Shown("transparency", "Which term makes the error", finding, reading, figure)


def _nyquist(design: Design) -> Shown:
    left, right, up = nyquist_view(design.problem)
    width = WIDTH - 0.72 - 0.15
    figure = canvas(WIDTH, width * 2 * up / (right - left) + 0.5 + 0.66, left=0.72, top=0.66)
    axes: Axes = figure.subplots()
    draw_nyquist(axes, design.problem, design.gains)
    legend_above(axes, 2)
    loop = design.record.inner_loop
    assert loop is not None, "a display with a loop of its own"
    finding = "; ".join([f"|S| is greatest {peak_in_words(loop)}", *margins_in_words(loop)])
    return Shown(
        "nyquist", "How far the velocity loop stays from -1", f"{finding}.",
        "The curve must pass -1 without encircling it and stay out of the hatched circle, where |S| exceeds its limit. "
        "The margins are where it crosses the axis and the dashed unit circle.", figure,
    )  # fmt: skip
