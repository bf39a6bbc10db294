"""Make the record of a solved problem, in SI units and hertz. See document/README.md, section 3."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from math import degrees, pi
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vctune.analysis.demands import response, transparency_error
from vctune.analysis.extrema import Floats
from vctune.analysis.feel import feel
from vctune.analysis.in_worlds import binding_world
from vctune.design.felt_record import CONTACT, contact_record, first_command, in_hand_record
from vctune.design.judging.judge import Judgement, LeastRatio
from vctune.design.nlp.solution import Polished
from vctune.design.nlp.working_set import CONSTRAINT_KINDS, ConstraintPoint, points_as_one
from vctune.design.prepared import problems_beside
from vctune.design.rest_record import REST, rest_record
from vctune.design.result import Solved
from vctune.design.shake_record import SHAKES, notes, shaken
from vctune.design.variables import design_of, keys_for, near, point, ranges
from vctune.document.doubts import file_doubts
from vctune.document.reading import ProblemFile
from vctune.document.records.certificate_json import (
    AnyHandRecord,
    CertificateRecord,
    ClaimRecord,
    DeviceRecord,
    HandsRecord,
    InnerLoopRecord,
    PerturbationRecord,
    WallRecord,
    WallsRecord,
    WholeSampleRecord,
    WorldRecord,
)
from vctune.document.records.design_json import (
    ActiveRecord,
    DesignRecord,
    NearestRecord,
    OptimalityRecord,
    UncertaintyRecord,
)
from vctune.document.records.gains_json import ProblemRecord, TransparencyRecord, stated_units
from vctune.document.records.part import made
from vctune.document.records.rows_json import FeltRecord
from vctune.document.text.errors import Note
from vctune.model.device import Device
from vctune.model.display import ADMITTANCE
from vctune.model.gains import AnyCoupling, Gains, series_coupling
from vctune.model.hands import Hand, Hands
from vctune.model.loop.llewellyn import llewellyn_excess, modulus_excess
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.units import finite_hertz, hertz
from vctune.model.problem import Problem
from vctune.model.rest import greatest_at_rest, stiffness_read
from vctune.model.servo import numbers_to_state
from vctune.proof.claims.any_hand import ANY_HAND
from vctune.proof.claims.delays import delay_in_samples
from vctune.proof.claims.registry import BEFORE_WALL, CLAIMS, IN_HANDS
from vctune.proof.claims.rest import RESTS
from vctune.proof.claims.walls import WALLS
from vctune.proof.outcome import Outcome, worst_verdict
from vctune.running import OutOfTimeError, unlimited
from vctune.version import versions

if TYPE_CHECKING:
    from vctune.design.bound.search import Optimality


def design_record(file: ProblemFile, solved: Solved, ipopt: str | None = None) -> dict[str, Any]:
    """Return the JSON object of a solved problem. Every number in the object is finite or null.

    Parameters
    ----------
    file : ProblemFile
        The problem and its text.
    solved : Solved
        Its result.
    ipopt : str, optional
        Version of IPOPT if the result needed it (`vctune.design.nlp.nlp.ipopt_version`).

    Returns
    -------
    dict
        The object of design.json, in SI units and hertz.
    """
    return record_of(file, solved, ipopt).to_json()


@np.errstate(all="ignore")
def record_of(file: ProblemFile, solved: Solved, ipopt: str | None = None, date: str | None = None) -> DesignRecord:
    """Return the record of a solved problem, from which `design_record` makes the JSON object."""
    judgement, problem = solved.judgement, solved.problem
    parts: dict[str, Any] = dict.fromkeys(("gains", "coupling", "transparency", "certificate", "inner_loop"))
    touched, warned = list[tuple[str, str]](), list[Note]()
    if judgement is not None:
        parts["felt"] = in_hand_record(problem, judgement)
        try:
            parts["contact"] = contact_record(problem, judgement)
        except OutOfTimeError:
            solved = replace(solved, cut=(*solved.cut, CONTACT))
        try:
            parts["ringing"], parts["buzz"] = shaken(problem, judgement)
        except OutOfTimeError:
            solved = replace(solved, cut=(*solved.cut, SHAKES))
        try:
            parts["rest"] = rest_record(problem, judgement, parts.get("buzz"))
        except OutOfTimeError:
            solved = replace(solved, cut=(*solved.cut, REST))
        with unlimited():
            parts |= _judged(problem, judgement)
            touched, warned = _touched(problem, judgement), warnings(problem, judgement)
        warned += notes(parts.get("ringing"), parts.get("buzz"), problem.units)
    also = {
        "date": date,
        "prices": solved.prices,
        "rule": "euler" if problem.device.rule == "euler" else None,
        "tried": solved.tried or None,
        "nearest": _nearest(solved),
        **{name: parts.pop(name, None) for name in ("contact", "felt", "rest", "ringing", "buzz", "uncertainty")},
    }
    said = [*solved.cut_short, *file_doubts(file, Path(file.source).name), *warned]
    return DesignRecord(
        problem=ProblemRecord(name=problem.name, sha256=file.sha256, text=file.text, **stated_units(problem.device)),
        status=solved.status.value,
        reason=solved.reason,
        active=active(solved),
        proved=solved.infeasibility.proved if solved.infeasibility else None,
        idle=judgement is not None and judgement.idle,
        repairs=solved.repairs,
        at_bound=[key for key, _ in touched],
        warnings=[note.line for note in said],
        solver=solver_record(solved),
        optimality=optimality_record(problem, solved.optimality) if solved.optimality else None,
        versions=versions(ipopt),
        **parts,
        **_present(also),
    )


def _nearest(solved: Solved) -> NearestRecord | None:
    if solved.infeasibility is None or solved.infeasibility.nearest is None:
        return None
    gains, coupling = solved.infeasibility.nearest
    return NearestRecord(gains=gains, coupling=coupling)


def _present(parts: dict[str, Any]) -> dict[str, Any]:
    """Return the parts that exist: a record does not write the others."""
    return {name: part for name, part in parts.items() if part is not None}


def _touched(problem: Problem, judgement: Judgement) -> list[tuple[str, str]]:
    """Return the dotted keys of the free variables that lie on a bound, with the side."""
    values, found = point(judgement.gains, judgement.coupling), list[tuple[str, str]]()
    for key, value, bounds in zip(keys_for(problem), values, ranges(problem), strict=True):
        sides = () if bounds.fixed else (("upper", bounds.max), ("lower", bounds.min))
        found += [(key, side) for side, edge in sides if near(value, edge, bounds)]
    return found


def at_greatest_rest(problem: Problem, judgement: Judgement, key: str) -> bool:
    """Return whether the demand of rest limits a design, and not a bound of the file."""
    stiff = key in ("coupling.stiffness", "gains.position")
    greatest = greatest_at_rest(problem.device) if problem.stability.rest and stiff else None
    return greatest is not None and stiffness_read(judgement.gains, judgement.coupling) == greatest


def warnings(problem: Problem, judgement: Judgement) -> list[Note]:
    """Return warnings about a design."""
    return [Note(code, said) for code, said in _warned(problem, judgement)]


def _warned(problem: Problem, judgement: Judgement) -> Iterator[tuple[Any, str]]:
    for key, side in _touched(problem, judgement):
        of_spring = key == "coupling.damping" and problem.device.kind.inverse and problem.bounds.damping.min == 0
        at_rest = side == "upper" and at_greatest_rest(problem, judgement, key)
        if not at_rest and not ((key in ("gains.position", "coupling.drag") or of_spring) and side == "lower"):
            yield "warn-bound", f"{key} is on its {side} bound; the bound, not the device, limits the design there"
    band, demand = problem.stability.band, problem.stability.safety_factor
    # only Llewellyn's claim has a band, whose edge does not matter if a claim in hands covers every frequency
    edged = problem.hands_met is None and problem.device.kind.banded
    if edged and demand <= judgement.min_ratio < demand * 1.001:
        for side, edge in (("lower", band.min), ("upper", band.max)):
            if judgement.worst == edge and 0 < edge < problem.nyquist:
                yield (
                    "warn-band-edge",
                    f"the {side} edge of the stability band, {edge / (2 * pi):.4g} Hz, limits the design: "
                    "outside the band a passive hand or environment can make it oscillate",
                )
    servo = problem.device.servo
    if servo is not None and servo.max_acceleration is not None:
        _, acceleration = first_command(problem.device, series_coupling(judgement.coupling))
        if acceleration > servo.max_acceleration:
            units = problem.units
            yield (
                "warn-acceleration",
                f"1 {units.force} from rest commands {acceleration:.3g} {units.acceleration} in its first sample, more "
                f"than device.servo.max_acceleration = {servo.max_acceleration:g}; more coupling.mass commands less",
            )
    if judgement.idle:
        yield (
            "warn-idle",
            f"the design hardly uses its velocity loop: |1 - G_he| is {judgement.transparency.tracking:.3g}, "
            "and 1 means no loop at all; a constraint that can be relaxed, a wider bound or a faster device may help",
        )


def _judged(problem: Problem, judgement: Judgement) -> dict[str, Any]:
    gains, coupling = judgement.gains, judgement.coupling
    display, in_any, outcomes = _display(problem), judgement.in_any_hand, judgement.certificate.outcomes
    any_hand = AnyHandRecord(**_claimed(problem, outcomes[ANY_HAND.id], in_any)) if in_any else None
    also = {
        "hands": _in_hands(problem, judgement),
        "any_hand": any_hand,
        "wall": _wall(problem, judgement),
        "whole_sample": _beside(problem, judgement),
        "least_hand": _least_hand(problem),
    }
    return {
        "gains": gains,
        "coupling": coupling,
        "transparency": TransparencyRecord(**asdict(judgement.transparency), **_apart(problem), **display),
        "certificate": made(CertificateRecord, judgement, claims=claim_records(problem, judgement), **also, **display),
        "inner_loop": made(InnerLoopRecord, judgement) if gains.closed else None,
        "uncertainty": _uncertainty(problem, judgement),
    }


def _apart(problem: Problem) -> dict[str, Any]:
    """Return the record of the weighted terms that the error does not count; empty if it counts them all."""
    return {"apart": list(problem.apart)} if problem.apart else {}


def _display(problem: Problem) -> dict[str, Any]:
    """Return the record of the kind of display; empty for an admittance display."""
    return {"display": problem.device.display} if problem.device.kind is not ADMITTANCE else {}


def _claimed(problem: Problem, outcome: Outcome, at: LeastRatio) -> dict[str, Any]:
    """Return what the records of all claims in hands state."""
    found = {"verdict": outcome.verdict.value, "boxes": outcome.boxes, **_display(problem)}
    return {**found, "min_ratio": at.ratio, "worst_hz": finite_hertz(at.omega)}


def _in_hands(problem: Problem, judgement: Judgement) -> HandsRecord | None:
    """Return the record of the claim in a box of hands; None if the problem does not make this claim."""
    held, hands, worlds = judgement.in_hand, problem.hands, problem.worlds
    if held is None or held.hand is None or problem.hands_met is None:
        return None
    outcomes, also = judgement.certificate.outcomes, dict[str, Any]()
    if worlds is not None:
        low, high = asdict(worlds.low), asdict(worlds.high)
        also["worlds"] = {name: [low[name], high[name]] for name in low}
    device = held.device if held is judgement.binding else problem.device
    law, factor = (judgement.gains, judgement.coupling), problem.stability.safety_factor
    if (
        not (worlds and worlds.nothing)
        and (world := binding_world(device, *law, held.hand, held.omega, factor, worlds)) is not None
    ):
        also["worst_world"] = WorldRecord(mass=world.mass, stiffness=world.stiffness)
    if (walls := judgement.in_walls) is not None and (corner := judgement.corner) is not None:
        claimed = _claimed(problem, outcomes[WALLS.id], walls) | {"worst_hand": walls.hand}
        also["walls"] = WallsRecord(**claimed, corner_hz=hertz(corner))
    outcome = next(outcomes[claim] for claim in IN_HANDS if claim in outcomes)
    return HandsRecord(**_claimed(problem, outcome, held), **_boxes(hands), worst_hand=held.hand, **also)


def _boxes(hands: Hands) -> dict[str, Any]:
    """Return the ends of the ranges of hands, and of the tool that they include."""
    both = {"box": hands} | ({} if hands.tool is None else {"tool": hands.tool})
    return {key: {name: list(ends) for name, ends in box.ranges.items()} for key, box in both.items()}


def _wall(problem: Problem, judgement: Judgement) -> WallRecord | None:
    """Return the record of the coupling as a wall; None if it is none."""
    if (at := judgement.before_wall) is None:
        return None
    outcomes = judgement.certificate.outcomes
    outcome = next(outcomes[claim] for claim in BEFORE_WALL if claim in outcomes)
    also: dict[str, Any] = (_boxes(problem.hands) | {"worst_hand": at.hand}) if at.hand else {}
    loop = judgement.closed_loop
    return WallRecord(
        verdict=outcome.verdict.value,
        min_ratio=at.ratio,
        worst_hz=finite_hertz(at.omega),
        peak_sensitivity=loop and loop.peak,
        peak_sensitivity_hz=loop and hertz(loop.omega),
        phase_margin_deg=loop and degrees(loop.phase),
        boxes=outcome.boxes,
        **also,
    )


def _least_hand(problem: Problem) -> Hand | None:
    """Return what the proof of any passive hand counts on in every hand; None for nothing."""
    least = problem.device.counted_on if problem.passive or problem.any_hand else None
    return None if least is None else Hand(least.mass, least.damping, 0.0)


def _beside(problem: Problem, judgement: Judgement) -> WholeSampleRecord | None:
    """Return the record of the design with a delay of a whole number of samples, if the delay is near such a value."""
    if not (beside := judgement.certificate.beside):
        return None
    verdict, samples = worst_verdict(each.verdict for each in beside), round(delay_in_samples(problem.device))
    delay = float(f"{samples * problem.device.sample_time:.15g}")
    return WholeSampleRecord(verdict=verdict.value, samples=samples, delay=delay)


def claim_records(problem: Problem, judgement: Judgement) -> list[ClaimRecord]:
    """Return the record of each claim."""
    found = []
    for claim, outcome in judgement.certificate.outcomes.items():
        device = None if outcome.device is None else device_record(outcome.device, problem, changed=True)
        also = {"cut": outcome.cut or None, "witness_device": device, "witness_hand": outcome.hand}
        said, witness = CLAIMS[claim].said_of(problem.device.kind, problem.passive_hand), finite_hertz(outcome.witness)
        more: dict[str, Any] = _present(also)
        found.append(ClaimRecord(id=claim, claim=said, verdict=outcome.verdict.value, witness_hz=witness, **more))
    return found


def _uncertainty(problem: Problem, judgement: Judgement) -> UncertaintyRecord | None:
    """Return the box, the errors that show the cost of robustness, and the devices on which the design is worst."""
    posed, design = judgement.posed, (judgement.gains, judgement.coupling)
    box, uncertainty = posed.box, problem.uncertainty
    if box is None or uncertainty is None:
        return None
    worst = max(posed.cases, key=lambda case: transparency_error(case, *design).error)
    return UncertaintyRecord(
        box={key: [box.low.number(key), box.high.number(key)] for key in box.modelled.uncertain},
        **({"unmodelled": [list(point) for point in uncertainty.unmodelled]} if uncertainty.unmodelled else {}),
        objective=uncertainty.objective,
        robust_error=judgement.transparency.error,
        worst_error=transparency_error(worst, *design).error,
        worst_device=device_record(worst.device, problem),
        min_ratio_device=device_record(judgement.tightest, problem),
    )


def optimality_record(problem: Problem, found: Optimality) -> OptimalityRecord:
    """Return the record of the bound on every design."""
    return OptimalityRecord(
        lower_bound=found.bound,
        gap=found.gap,
        verdict="proved" if found.proved else "open",
        boxes=found.boxes,
        error=found.incumbent,
        both_sides=bool(problems_beside(problem)),
    )


def felt_record(device: Device, gains: Gains, coupling: AnyCoupling) -> FeltRecord:
    """Return the mass and damping that the hand feels, the stiffest wall, and the tracking bandwidth."""
    felt = feel(device, gains, coupling)
    numbers = (*felt.mass, *felt.damping, felt.stiffness, felt.tracking_bandwidth)
    return FeltRecord(**dict(zip(FeltRecord.model_fields, numbers, strict=True)))


ACTIVE = 1e-5  # Multiplier above which the record lists a constraint as active
AT_LIMIT = 1.01  # Greatest ratio, over the safety factor, of a claim that limits a design without multipliers
DIGITS = 9  # Number of significant digits of multipliers, of which machines agree


def active(solved: Solved) -> list[ActiveRecord]:
    """Return the active constraints of a design, with kind, frequency and multiplier, the greatest multiplier first."""
    if solved.polished is None:
        return [] if solved.judgement is None else _at_limit(solved.problem, solved.judgement)
    if not solved.polished.solution.converged or solved.judgement is None:
        return []
    at, multipliers = solved.polished.working_set, [float(f"{m:.{DIGITS}g}") for m in _priced(solved.polished)]
    coupled = _coupled(solved.problem)
    # the demand and the place of each constraint, in the order of the NLP
    where: list[tuple[str, ConstraintPoint | None]] = [("Re Z_c >= safety_factor R", place) for place in at.ratio]
    where += [("|S| <= max_sensitivity", place) for place in at.sensitivity]
    where += [("greatest error", place) for place in at.peak]
    where += [("|1 - S| r < 1 of the unmodelled dynamics", place) for place in at.unmodelled]
    for place in at.in_hand:
        in_hand = f"{coupled} in {'any passive' if place.hand is None else 'a'} hand"
        where.append((in_hand if place.wall is None else "walls in a hand", place))
    for place in at.tracked_peaks:
        where += [("|S| <= max_sensitivity", place), ("", None)]
    where += [("greatest error", None)] * solved.polished.structure.mean_errors
    several, found = len(solved.judgement.posed.cases) > 1, list[ActiveRecord]()
    for (demand, where_at), multiplier in zip(where, multipliers, strict=True):
        if demand and multiplier > ACTIVE:
            hz = hertz(where_at.omega / solved.problem.device.sample_time) if where_at else None
            also = {"device": _device(solved.problem, where_at)} if where_at and several else {}
            found.append(ActiveRecord(demand=demand, hz=hz, multiplier=multiplier, **also))
    return sorted(found, key=lambda row: -(row.multiplier or 0.0))


def _coupled(problem: Problem) -> str:
    """Return the formula of the constraint in hands."""
    if problem.rigid:
        return "stable against a wall of safety_factor times the coupling"
    if problem.worlds is not None:
        return "stable with Z_c / safety_factor"
    return f"Re {problem.device.kind.couples} >= safety_factor R"


def _at_limit(problem: Problem, judgement: Judgement) -> list[ActiveRecord]:
    """Return the claims whose least ratio is next to the safety factor, of a design without multipliers."""
    found, limit = list[ActiveRecord](), AT_LIMIT * problem.stability.safety_factor
    for at in judgement.margins:
        on_band = CLAIMS[at.claim].quantity == "ratio"
        own = "Re Z_c >= safety_factor R" if on_band else _coupled(problem)
        where = "" if on_band else f" in {'any passive' if at.hand is None else 'a'} hand"
        demand = "walls in a hand" if at.claim == WALLS.id else own + where
        if at.ratio <= limit and all(each.demand != demand for each in found):
            found.append(ActiveRecord(demand=demand, hz=finite_hertz(at.omega), multiplier=None))
    if any(at_greatest_rest(problem, judgement, key) for key, _ in _touched(problem, judgement)):
        said = RESTS.said_of(problem.device.kind)
        found.append(ActiveRecord(demand=said.rpartition(": ")[2], hz=None, multiplier=None))
    if judgement.gains.closed and AT_LIMIT * judgement.peak_sensitivity >= problem.stability.max_sensitivity:
        hz = hertz(judgement.worst_sensitivity)
        found.append(ActiveRecord(demand="|S| <= max_sensitivity", hz=hz, multiplier=None))
    return found


def _device(problem: Problem, place: ConstraintPoint) -> DeviceRecord:
    """Return the device of a dimensionless point in SI units."""
    impedance, time = problem.transparency.reference_impedance, problem.device.sample_time
    return device_record(place.device.in_units(1 / impedance, 1 / time), problem)


def _priced(polished: Polished) -> Floats:
    """Return the multipliers; for the ratio, the multipliers of 2 Re(D + Z_h) Re Z_c >= factor 2 Re(D + Z_h) R."""
    multipliers, ratio = np.abs(polished.solution.multipliers), polished.working_set.ratio
    operator = ratio[0].device.operator if ratio else None
    if operator is not None and operator.damping > 0:
        device, omega = points_as_one(ratio)
        loop = response(device, design_of(polished.values)[0], omega)
        multipliers[: len(ratio)] *= llewellyn_excess(loop, FLOATS) / modulus_excess(loop, FLOATS)
    return multipliers


def solver_record(solved: Solved) -> dict[str, Any]:
    """Return the record of the optimiser: starts, sizes of the NLP, and iterations; empty without an NLP."""
    if solved.polished is None or solved.scanned is None:
        return {}
    polished = solved.polished
    return {
        "name": "ipopt",
        "converged": polished.solution.converged,
        "starts": len(solved.scanned.starts),
        "optima": solved.optima,
        "variables": polished.structure.variables,
        "constraints": sum(polished.working_set.sizes())
        + 2 * polished.structure.tracked_peaks
        + polished.structure.mean_errors,
        "frequencies": dict(zip(CONSTRAINT_KINDS, polished.working_set.sizes(), strict=True)),
        "rounds": len(polished.rounds),
        "iterations": sum(each.iterations for each in polished.rounds),
    }


def device_record(device: Device, problem: Problem, *, changed: bool = False) -> DeviceRecord:
    """Return mass, damping and delay of a device, and its other parameters for which the problem states an uncertainty;
    if `changed`, also those that differ from the problem's."""
    uncertain = problem.uncertainty.keys if problem.uncertainty is not None else ()
    known, of_problem = numbers_to_state(device), numbers_to_state(problem.device)
    stated = {*uncertain, *(key for key in known if changed and known[key] != of_problem[key])}
    others = {key: number for key, number in known.items() if "." in key and key in stated}
    found: dict[str, Any] = {"parts": others} if others else {}
    if device.unmodelled is not None and device.unmodelled.share > 0:
        share, phase = float(device.unmodelled.share), degrees(device.unmodelled.phase)
        found["unmodelled"] = PerturbationRecord(share=share, phase_deg=phase)
    own = {key: known[key] for key in ("mass", "damping", "delay") if key in known}
    return DeviceRecord(**own, **found)
