"""The figures of a design's page, each with its title, its finding and how to read it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vctune.analysis.feel import FREE_HZ, WALL_HZ, feel
from vctune.document.records.certificate_json import CertificateRecord
from vctune.document.records.design_json import DesignRecord
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.problem import Band, Problem
from vctune.report.curves import Required, requirements
from vctune.report.panels import draw_error, draw_impedance, draw_nyquist, draw_ratio, draw_required
from vctune.report.style import BLUE, GREY, RED, STYLE, WIDTH, canvas, decades, legend_above, shade, stamp
from vctune.report.tables import margins_in_words, peak_in_words
from vctune.report.typography import in_place, quantity, words

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
class _Design:
    """The data of the figures: what the `draw_*` functions take, and the record."""

    taken: tuple[Problem, Gains, AnyCoupling]
    record: DesignRecord
    proof: CertificateRecord

    @property
    def problem(self) -> Problem:
        """The problem."""
        return self.taken[0]


def design_figures(problem: Problem, record: DesignRecord, doubt: str) -> list[Shown]:
    """Return all figures of a design, in the order of the page; `doubt` is stamped on each unless it is ""."""
    if record.design is None or record.certificate is None:
        return []
    design = _Design((problem, *record.design), record, record.certificate)
    with rc_context(STYLE):
        shown = [_requirement(design, each) for each in requirements(*design.taken)]
        shown += [_impedance(design), _transparency(design)]
        if record.design[0].closed or problem.device.kind.banded:
            shown.append(_nyquist(design))
        for each in shown:
            if doubt:
                stamp(each.figure, doubt)
    put = problem.units.translated
    return [
        replace(each, title=put(each.title), finding=put(each.finding), reading=put(each.reading)) for each in shown
    ]


def _requirement(design: _Design, drawn: Required) -> Shown:
    proof, hands = design.proof, drawn.claim == "hands"
    # the numbers of the proof, where it speaks of the same ratio
    if hands and proof.hands is not None and design.problem.worlds is None:
        where = proof.hands.worst_hand.in_words(design.record.units)
        drawn = replace(drawn, least=proof.hands.min_ratio, least_hz=proof.hands.worst_hz, where=where)
    if drawn.claim == "any_hand" and proof.any_hand is not None:
        drawn = replace(drawn, least=proof.any_hand.min_ratio, least_hz=proof.any_hand.worst_hz)
    if drawn.claim == "passive" and (proof.hands is None or proof.hands.min_ratio != proof.min_ratio):
        drawn = replace(drawn, least=proof.min_ratio, least_hz=proof.worst_hz)
    columns = 1 if hands else 2  # hands in words are long
    rows = -(-(2 + (drawn.band is not None) + len(drawn.others)) // columns)
    figure = canvas(WIDTH, 4.4 + 0.17 * rows, left=0.78, top=0.1 + 0.17 * rows, gaps=(0.0, 0.55))
    upper, lower = figure.subplots(2, 1, height_ratios=(3, 2))
    draw_required(upper, *design.taken, drawn)
    draw_ratio(lower, *design.taken, drawn)
    upper.set_xlabel("")
    for axes in (upper, lower):
        legend_above(axes, columns if axes is upper else 2)
    title = f"Coupling against the requirement of {'the worst hand' if hands else 'any passive hand'}"
    where = f", in the hand of {drawn.where}" if drawn.where else ""
    finding = "" if drawn.least is None else f"The ratio is least {in_place(drawn.least, drawn.least_hz)}{where}."
    reading = words("requirement", drawn, design.problem, design.record.status == "certified")
    return Shown(NAMES[drawn.claim], title, finding, reading, figure)


def _impedance(design: _Design) -> Shown:
    problem, proof, units = design.problem, design.proof, design.problem.units
    columns = 3 if problem.device.units == "linear" else 2  # units of torque are long
    figure = canvas(WIDTH, 3.6, left=0.78, top={3: 0.66, 2: 0.83}[columns])
    axes = figure.subplots()
    draw_impedance(axes, *design.taken)
    certified, band = design.record.status == "certified", Band(0.0, inf)
    if certified:
        if proof.hands is None and proof.any_hand is None:
            band = problem.stability.band
        shade(axes, band, GREY, "proved stable")
    else:
        shade(axes, problem.stability.band if problem.passive else band, RED, "required, not proved", "//")
    shade(axes, problem.transparency.band, BLUE, "transparency band")
    decades(axes)
    legend_above(axes, columns)
    here = feel(problem.device, *design.taken[1:])
    finding = f"In free motion the handle feels like {quantity(here.mass[0], units.mass, 3)} at {FREE_HZ[0]:g} Hz"
    if problem.device.kind.own_loop:
        finding += f"; a wall feels like {quantity(here.stiffness, units.stiffness, 3)} at {WALL_HZ:g} Hz"
    title = "What the hand feels, beside what it should feel"
    return Shown("impedance", title, f"{finding}.", words("impedance", problem, certified), figure)


def _transparency(design: _Design) -> Shown:
    problem, terms, kind = design.problem, design.record.transparency, design.problem.device.kind
    assert terms is not None, "a design is judged"
    titles = {term: f"{IN_WORDS[term]}: {terms.labels[term]}" for term in kind.terms}
    titles |= {"error": "all together"} if len(titles) > 2 else {}
    rows = len(titles) // 2
    figure = canvas(WIDTH, {1: 2.6, 2: 4.3}[rows], left=0.72, right=0.1, top=0.75, gaps=(0.28, 0.42))
    panels = [*figure.subplots(rows, 2, squeeze=False).flat]
    for (part, title), axes in zip(titles.items(), panels, strict=True):
        draw_error(axes, *design.taken, part)
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
    size, most = max((getattr(terms, term) or 0.0, terms.labels[term]) for term in kind.terms)
    shares = f"{quantity(size, digits=3)} of {quantity(terms.error, digits=3)}"
    finding = f"The largest term of the error is {most}: {shares}."
    reading = words("transparency", problem, any("sensor, " in label for label in lines))
    return Shown("transparency", "Which term makes the error", finding, reading, figure)


def _nyquist(design: _Design) -> Shown:
    high = 2.2 / (2.3 + 1 / design.problem.stability.max_sensitivity)  # of the axes, as a share of their width
    figure = canvas(WIDTH, (WIDTH - 0.72 - 0.15) * high + 0.5 + 0.66, left=0.72, top=0.66)
    axes: Axes = figure.subplots()
    draw_nyquist(axes, *design.taken[:2])
    legend_above(axes, 2)
    loop = design.record.inner_loop
    assert loop is not None, "a display with a loop of its own"
    finding = "; ".join([f"|S| is greatest {peak_in_words(loop)}", *margins_in_words(loop)])
    return Shown("nyquist", "How far the velocity loop stays from -1", f"{finding}.", words("nyquist"), figure)
