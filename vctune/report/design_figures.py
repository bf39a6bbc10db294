"""The figures of a design's page, each with its title, its finding and how to read it."""

from __future__ import annotations

from dataclasses import replace
from math import ceil, inf, pi
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure

from vctune.analysis.feel import FREE_HZ, WALL_HZ, feel, stiffness_in_contact
from vctune.design.records.design import DesignRecord
from vctune.design.records.felt import weighed
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.numbers.units import Units
from vctune.model.problem import Band, Problem
from vctune.proof.claims.any_hand import ANY_HAND
from vctune.proof.claims.band import PASSIVE
from vctune.proof.claims.hands import HANDS
from vctune.report.curves import Required, requirements
from vctune.report.panels import draw_error, draw_impedance, draw_nyquist, draw_ratio, draw_required
from vctune.report.style import BLUE, GREY, RED, STYLE, WIDTH, in_place, legend_above, place, quantity, shade
from vctune.report.tables import margins_in_words, peak_in_words
from vctune.report.templates import Shown, words

# Names of the terms of the error in words
IN_WORDS = {"admittance": "does not yield", "tracking": "does not follow", "coupling": "gives way"}
NAMES = {HANDS.id: "hands", ANY_HAND.id: "any-hand", PASSIVE.id: "llewellyn"}  # File of the requirement of each claim
DrawnDesign = tuple[Problem, Gains, AnyCoupling]


def design_figures(problem: Problem, record: DesignRecord, required: list[Required], doubt: str) -> list[Shown]:
    """Return all figures of a design, in the order of the page; `doubt` is stamped on each unless it is ""."""
    if record.design is None:
        return _missed(problem, record, doubt)
    design = problem, *record.design
    with rc_context(STYLE):
        shown = [_requirement(design, record, each) for each in required]
        shown += [_impedance(design, record), _transparency(design, record)]
        if record.inner_loop is not None:
            shown.append(_nyquist(design, record))
        for each in shown if doubt else ():
            _stamp(each.figure, doubt)
    return shown


def _missed(problem: Problem, record: DesignRecord, doubt: str) -> list[Shown]:
    """Return the figures of the nearest miss of a problem without a design: what its coupling offers and lacks."""
    if record.nearest is None:
        return []
    design = problem, record.nearest.gains, record.nearest.coupling
    with rc_context(STYLE):
        shown = [_requirement(design, record, each) for each in requirements(*design)]
        for each in shown:
            _stamp(each.figure, doubt)
    return [replace(each, title=f"The nearest miss: {each.title[0].lower()}{each.title[1:]}") for each in shown]


def _stamp(figure: Figure, words: str) -> None:
    """Write across each pair of axes why a design is not for use. The text remains visible in print and in grey."""
    for axes in figure.axes:
        columns = len({each.get_position().x0 for each in figure.axes})
        size = 85 * figure.get_figwidth() / columns / len(words)
        place: Any = {"transform": axes.transAxes, "rotation": 20, "ha": "center", "va": "center"}
        axes.text(0.5, 0.5, words, **place, fontsize=min(21.0, size), color=RED, weight="bold", alpha=0.45)


def _requirement(design: DrawnDesign, record: DesignRecord, drawn: Required) -> Shown:
    hands, figure = drawn.claim == HANDS.id, Figure(figsize=(WIDTH, 5.0))
    upper, lower = figure.subplots(2, 1, sharex=True)
    draw_required(upper, *design, drawn)
    draw_ratio(lower, *design, drawn)
    upper.set_xlabel("")
    rows = [legend_above(upper, 1 if hands else 2), legend_above(lower, 2)]  # hands in words are long
    place(figure, [[upper], [lower]], (3, 2), rows)
    title = f"Coupling against the requirement of {'the worst hand' if hands else 'any passive hand'}"
    where = in_place(drawn.min_ratio, drawn.worst_hz) + (f", in the hand of {drawn.where}" if drawn.where else "")
    finding = "" if drawn.min_ratio is None else f"The ratio is least {where}."
    reading = words("requirement", drawn, design[0], record.status == "certified")
    return Shown(NAMES[drawn.claim], title, finding, reading, figure)


def _impedance(design: DrawnDesign, record: DesignRecord) -> Shown:
    problem, proof, units, band = design[0], record.certificate, record.units, Band(0.0, inf)
    figure = Figure(figsize=(WIDTH, 3.6))
    axes = figure.subplots()
    draw_impedance(axes, *design)
    certified = record.status == "certified"
    if certified:
        only_band = proof is not None and proof.hands is None and proof.any_hand is None
        shade(axes, problem.stability.band if only_band else band, GREY, "proved stable")
    else:
        shade(axes, problem.stability.band if problem.passive else band, RED, "required, not proved", "//")
    shade(axes, problem.transparency.band, BLUE, "transparency band")
    rows = legend_above(axes, 3 if problem.device.units == "linear" else 2)  # units of torque are long
    place(figure, [[axes]], [1], [rows])
    here = feel(problem.device, *design[1:])
    finding = f"In free motion the handle feels like {_felt(here.mass[0], here.damping[0], units)} at {FREE_HZ[0]:g} Hz"
    if problem.worlds is not None and record.felt is not None and record.felt.mass_1hz is not None:
        felt = _felt(record.felt.mass_1hz, record.felt.damping_1hz, units)
        finding = f"With {record.felt.behind} behind the handle feels like {felt} at {FREE_HZ[0]:g} Hz"
    elif problem.device.kind.own_loop:
        limp = record.felt is not None and record.felt.limp  # then it holds no force at rest
        stiffness = here.stiffness if limp else stiffness_in_contact(problem.device, *design[1:])
        finding += f"; a wall feels like {quantity(stiffness, units.stiffness, 3)}"
        finding += f" at {WALL_HZ:g} Hz" if limp else ", its stiffness in contact"
    title = "What the hand feels, beside what it should feel"
    return Shown("impedance", title, f"{finding}.", words("impedance", problem, certified), figure)


def _felt(mass: float | None, damping: float | None, units: Units) -> str:
    """Return what is felt at 1 Hz in words, the resistance if it is the greater part; a negative mass is a spring."""
    if mass is not None and damping is not None and abs(damping) > 2 * pi * FREE_HZ[0] * abs(mass):
        return str(quantity(damping, units.damping, 3))
    if mass is None or mass >= 0:
        return str(quantity(mass, units.mass, 3))
    return " ".join(weighed(mass, units))


def _transparency(design: DrawnDesign, record: DesignRecord) -> Shown:
    terms, kind = record.transparency, design[0].device.kind
    assert terms is not None, "a design is judged"
    titles = {term: f"{IN_WORDS[term]}: {terms.labels[term]}" for term in kind.terms}
    titles |= {"error": "all that is counted" if terms.apart else "all together"} if len(titles) > 2 else {}
    rows = len(titles) // 2
    figure = Figure(figsize=(WIDTH, 0.9 + 1.7 * rows))
    panels = figure.subplots(rows, 2, squeeze=False, sharex=True)
    for number, (axes, (part, title)) in enumerate(zip(panels.flat, titles.items(), strict=True)):
        draw_error(axes, *design, part)
        axes.set(title=title, ylabel="" if number % 2 else "share of the ideal")
        if number < len(titles) - 2:
            axes.set_xlabel("")
    lines = dict(pair for axes in figure.axes for pair in zip(*axes.get_legend_handles_labels()[::-1], strict=True))
    columns = 2 if len(lines) > 3 else 3
    figure.legend(lines.values(), lines.keys(), loc="upper center", ncols=columns)
    place(figure, panels.tolist(), [1] * rows, [1 + ceil(len(lines) / columns), *[1] * (rows - 1)])
    counted = [term for term in kind.terms if term not in (terms.apart or ())]
    size, most = max((getattr(terms, term) or 0.0, terms.labels[term]) for term in counted)
    shares = f"{quantity(size, digits=3)} of {quantity(terms.error, digits=3)}"
    finding = f"The largest term of the error is {most}: {shares}."
    reading = words("transparency", design[0], any("sensor, " in label for label in lines))
    return Shown("transparency", "Which term makes the error", finding, reading, figure)


def _nyquist(design: DrawnDesign, record: DesignRecord) -> Shown:
    figure, loop = Figure(figsize=(WIDTH, 4.0)), record.inner_loop
    assert loop is not None, "a display with a loop of its own"
    axes = figure.subplots()
    draw_nyquist(axes, *design[:2])
    place(figure, [[axes]], [1], [legend_above(axes, 2)])
    finding = "; ".join([f"|S| is greatest {peak_in_words(loop)}", *margins_in_words(loop)])
    return Shown("nyquist", "How far the velocity loop stays from -1", f"{finding}.", words("nyquist"), figure)
