"""The page of a design: figures and numbers of design.json in one self-contained HTML file."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Literal

from matplotlib import rc_context

from vctune.analysis.demands import transparency_error
from vctune.design.records.design import DesignRecord
from vctune.document.reading import parse_problem
from vctune.document.schema.number_units import unit_of
from vctune.document.text.output_files import write_together
from vctune.model.gains import Gains
from vctune.model.numbers.units import OF_KEYS, in_full
from vctune.model.problem import Problem
from vctune.proof.claims.registry import CLAIMS
from vctune.report.curves import no_coupling, requirements
from vctune.report.design_figures import IN_WORDS, design_figures
from vctune.report.experiments import HEADINGS, measured_rows, simulation_figure
from vctune.report.paths import report_paths
from vctune.report.style import STYLE, quantity, svg
from vctune.report.tables import asked, dynamics, found
from vctune.report.templates import page_files, words
from vctune.simulation.simulation_record import SimulationRecord

LITTLE_USE = 0.75  # Share of the error without a loop at or above which a design is of little use
MOST = 3  # Greatest number of active constraints on the first screen
# Names of active constraints, by a part of the formula
NAMES = {
    "damping ratio": "Calm in the stated hands",
    "|S|": "Robustness of the velocity loop",
    "|1 - S|": "Robustness against unmodelled dynamics",
    "walls in a hand": "Stability at walls",
    "in a hand": "Stability in the stated hands",
    "any passive hand": "Stability in any passive hand",
    " R": "Stability in any passive hand",
}
Kind = Literal["good", "doubtful", "bad"]


@dataclass(frozen=True, slots=True)
class Summary:
    """The verdict on a design for the first screen."""

    kind: Kind
    word: str  # the verdict
    sentence: str  # the proved claim, or the reason why nothing is proved
    measure: str  # quality of the design; "" without a design
    next: str  # advice on the next step
    shakes: str  # how it rings, and whether it buzzes; "" without a design
    doubt: str  # text across each figure; "" for a design that is certified and does not buzz


def summary(record: DesignRecord, problem: Problem) -> Summary:
    """Return the verdict on a design. A design is of little use if it is idle, has no error, or hardly reduces the
    error of the device without a loop."""
    proof, error = record.certificate, record.transparency.error if record.transparency is not None else None
    # the error of an admittance display without a velocity loop and without a coupling
    alone = (
        transparency_error(problem, Gains(0.0, 0.0), no_coupling(problem)).error if problem.device.kind.banded else inf
    )
    kind: Kind = "bad" if record.status in ("infeasible", "violated") else "doubtful"
    word: str = record.status
    if record.status == "infeasible" and record.proved:
        word = "infeasible, proved"
    doubt = f"{word}: not for use"
    if proof is None:
        reason = record.reason or ("no design meets the constraints" if kind == "bad" else "no design was found")
        sentence = f"{reason[0].upper()}{reason[1:]}."
    elif record.status == "violated":
        sentence = f"Not for use: {record.reason}."
    elif record.status == "undecided":
        sentence = f"Not proved, so not for use: {record.reason}."
    else:
        useless = record.idle or error is None or error >= LITTLE_USE * alone or bool(record.relaxations)
        doubt = "buzzes" if record.buzz is not None and record.buzz.moving else ""
        but = "of little use" if useless else doubt
        kind = "doubtful" if but else "good"
        word = f"certified, {but}" if but else "certified"
        widths = problem.uncertainty.half_widths if problem.uncertainty is not None else ()
        ranges = problem.uncertainty.ranges if problem.uncertainty is not None else ()
        divided = {problem.device.delay_key} if problem.device.divided else set()
        known = ["any division of the servo's latency into delay and lag"] if divided else []
        known += [
            f"{key} ± {100 * width:.3g} %".replace("_hz", "").replace("_", " ")
            for key, width in widths
            if width and key not in divided
        ]
        known += [
            f"{key} {in_full(ends.min)} to {in_full(ends.max)} {unit_of(tuple(key.split('.')), problem.units)}".strip()
            for key, ends in ranges
        ]
        devices = f"; for every device within {', '.join(known)}" if known else ""
        sentence = f"Proved {record.promise}{devices}."
    measure = words("measure", record, problem, alone)
    told = [f"It rings with a {record.ringing.told(problem.units)} (estimated)."] if record.ringing else []
    told += [f"Simulated, {record.buzz.told(problem.units)}."] if record.buzz else []
    return Summary(kind, word, sentence, measure, words("next", record, problem, kind), " ".join(told), doubt)


def limits(record: DesignRecord) -> list[tuple[str, str, str]]:
    """Return the active constraints, the most expensive first, then the worst hand and the best change of the
    device: each in words, with its formula and frequencies, and with the effect of weakening it."""
    prices: dict[str, float] = {}
    for each in record.active:
        prices[each.demand] = prices.get(each.demand, 0.0) + (each.multiplier or 0.0)
    dearest, found = sorted(prices, key=lambda demand: -prices[demand]), list[tuple[str, str, str]]()
    for formula, demand in zip(record.limits[:MOST], dearest, strict=False):
        name = next((name for part, name in NAMES.items() if part in demand), "Constraint")
        weaker = f"with this limit 1 % weaker: error {-prices[demand]:+.2g} %" if prices[demand] else ""
        found.append((name, formula, weaker))
    hands = record.certificate.hands if record.certificate is not None else None
    if found and hands is not None:
        world = hands.worst_world.row(None, record.units) if hands.worst_world else None
        beyond = f", with {'a ' * world.unit.endswith('spring')}{world.value} {world.unit}" if world else ""
        found.append(("Worst hand", hands.worst_hand.in_words(record.units) + beyond, ""))
    of_device = [price for price in record.prices or [] if price.key.startswith("device.")]
    best = min(of_device, key=lambda price: price.change, default=None)
    if best is not None and best.worth != "no difference":
        when_free = f", felt when free {best.worth_free}" if best.worth_free else ""
        found.append(("Best change of the device", f"{best.key} better by 1 %: error {best.worth}{when_free}", ""))
    return found


def _bounds(record: DesignRecord, problem: Problem) -> dict[str, str]:
    """Return the bound on which a free variable lies, in words, by the variable's name."""
    found: dict[str, str] = {}
    for key in record.at_bound:
        table, _, name = key.partition(".")
        range_, value = getattr(problem.bounds, name), getattr(getattr(record, table), name)
        upper = abs(value - range_.max) < abs(value - range_.min) if range_.max < inf else value == inf
        side, edge = ("upper", range_.max) if upper else ("lower", range_.min)
        found[name] = f"{side} bound, {quantity(edge, problem.units.of(OF_KEYS[key]))}"
    return found


def write_report(record: DesignRecord, folder: Path, simulation: SimulationRecord | None = None) -> None:
    """Write report.html and the figures of a design from only its record. Delete the figures of an earlier design."""
    files = report_files(record, folder, simulation)
    write_together(files, [path for path in report_paths(folder) if path not in files])


def report_files(record: DesignRecord, folder: Path, simulation: SimulationRecord | None = None) -> dict[Path, str]:
    """Return the files of `write_report`. The page is the last one."""
    problem = parse_problem(record.problem.text, record.problem.name, record.problem.name)
    required = requirements(problem, *record.design) if record.design is not None else []
    head = summary(record, problem)
    shown = design_figures(problem, record, required, head.doubt)
    if simulation is not None:
        with rc_context(STYLE):
            shown.append(simulation_figure(simulation))

    def put(text: str) -> str:
        text = problem.units.translated(text)
        for key in ("safety_factor", "max_sensitivity"):  # words for the problem's numbers
            text = re.sub(rf"(?<![.\w]){key}\b", f"{getattr(problem.stability, key):g}", text)
        return text

    groups, proof = record.groups(), record.certificate
    return page_files(
        folder,
        "page.html.j2",
        shown,
        put,
        record=record,
        problem=problem,
        summary=head,
        asked=asked(problem),
        chosen=[row for title in ("gains", "coupling") for row in groups.get(title, [])],
        terms=IN_WORDS,
        limits=limits(record),
        labels=CLAIMS,
        claims=[(claim, *found(claim.id, record, problem, required)) for claim in (proof.claims if proof else [])],
        dynamics=dynamics(problem.device),
        bounded=_bounds(record, problem),
        digest=record.to_json()["sha256"],
        groups=groups,
        measured=measured_rows(simulation) if simulation else [],
        headings=HEADINGS,
    )


def simulation_files(simulation: SimulationRecord, folder: Path) -> dict[Path, str]:
    """Return only the figure of a simulation."""
    with rc_context(STYLE):
        shown = simulation_figure(simulation)
    return {folder / f"{shown.name}.svg": svg(shown.figure, shown.name)}
