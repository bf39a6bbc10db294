"""Make the record of a solved problem, in SI units and hertz. See document/README.md, section 3."""

from __future__ import annotations

from dataclasses import asdict, replace
from math import degrees, inf, log10, pi
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vctune.analysis.demands import rollett_factor_at
from vctune.analysis.margins import loop_margins, unstable_poles
from vctune.analysis.sampled_loop import spectral_radius
from vctune.analysis.worlds.binding import binding_world
from vctune.design.result import Solved
from vctune.design.search.rounding import near
from vctune.design.variables import Point, keys_for, point, ranges
from vctune.design.verdict.contact_record import contact_record
from vctune.design.verdict.in_hand_record import in_hand_record
from vctune.design.verdict.judge import Judgement, judge
from vctune.design.verdict.nlp_record import active, device_record, solver_record
from vctune.document.doubts import file_doubts
from vctune.document.reading import ProblemFile
from vctune.document.records.certificate_json import (
    AnyHandRecord,
    CertificateRecord,
    HandsRecord,
    InnerLoopRecord,
    NyquistRecord,
    WallsRecord,
    WholeSampleRecord,
    WithoutOperatorRecord,
    WorldRecord,
)
from vctune.document.records.design_json import (
    BoxRecord,
    DesignRecord,
    GlanceRecord,
    OptimalityRecord,
    PriceRecord,
    RepairRecord,
)
from vctune.document.records.gains_json import (
    ProblemRecord,
    TransparencyRecord,
    stated_units,
)
from vctune.document.records.part import Part
from vctune.document.text.codes import Note
from vctune.model.display import ADMITTANCE
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.numbers.units import finite_hertz, hertz
from vctune.model.problem import Problem
from vctune.proof.claims.delays import delay_in_samples
from vctune.proof.claims.registry import IN_HANDS, claims_about
from vctune.proof.outcome import Verdict, worst_verdict
from vctune.running import out_of_time, unlimited
from vctune.version import versions

if TYPE_CHECKING:
    from vctune.design.bound.search import Optimality
from vctune.analysis.demands import transparency_error
from vctune.analysis.feel import feel
from vctune.design.prepared import pose
from vctune.document.records.certificate_json import ClaimRecord
from vctune.document.records.design_json import UncertaintyRecord
from vctune.document.records.rows_json import FeltRecord
from vctune.model.device import Device
from vctune.proof.claims.registry import CLAIMS, ClaimId
from vctune.proof.outcome import Outcome


def uncertainty_record(problem: Problem, judgement: Judgement) -> UncertaintyRecord:
    """Return the box, the errors that show the cost of robustness, and the devices on which the design is worst."""
    posed, design = pose(problem), (judgement.gains, judgement.coupling)
    box, uncertainty = posed.box, problem.uncertainty
    assert box is not None and uncertainty is not None
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


def claim_records(problem: Problem, judgement: Judgement) -> list[ClaimRecord]:
    """Return the record of each claim."""
    outcomes = judgement.certificate.outcomes
    return [_claim(problem, judgement, claim, outcome) for claim, outcome in outcomes.items()]


def _claim(problem: Problem, judgement: Judgement, claim: ClaimId, outcome: Outcome) -> ClaimRecord:
    also: dict[str, Any] = {"cut": True} if outcome.cut else {}
    if outcome.device is not None:
        also["witness_device"] = device_record(outcome.device, problem)
    if outcome.hand is not None:
        also["witness_hand"] = outcome.hand
    return ClaimRecord(
        id=claim,
        claim=CLAIMS[claim].said_of(problem.device.kind),
        verdict=outcome.verdict.value,
        witness_hz=finite_hertz(outcome.witness),
        **also,
    )


def felt_record(device: Device, gains: Gains, coupling: AnyCoupling) -> FeltRecord:
    """Return the mass and damping that the hand feels, the stiffest wall, and the tracking bandwidth."""
    felt = feel(device, gains, coupling)
    return FeltRecord(
        felt_mass_1hz=felt.mass[0],
        felt_mass_10hz=felt.mass[1],
        felt_damping_1hz=felt.damping[0],
        felt_damping_10hz=felt.damping[1],
        stiffest_wall=None if felt.stiffness == inf else felt.stiffness,
        tracking_bandwidth_hz=felt.tracking_bandwidth,
    )


PROVED_BAND = "the proof of a wider band"  # Name of a stage that a time limit may cut short
SHOWN = 200  # Greatest number of rounds of an exchange, and of states of a search of boxes, that a record keeps


def design_record(file: ProblemFile, solved: Solved, ipopt: str | None = None) -> dict[str, Any]:
    """Return the JSON object of a solved problem. Every number in the object is finite or null.

    Parameters
    ----------
    file : ProblemFile
        The problem and its text.
    solved : Solved
        Its result.
    ipopt : str, optional
        Version of IPOPT if the result needed it (`vctune.design.nlp.ipopt.ipopt_version`).

    Returns
    -------
    dict
        The object of design.json, in SI units and hertz.
    """
    return record_of(file, solved, ipopt).to_json()


def record_of(file: ProblemFile, solved: Solved, ipopt: str | None = None, date: str | None = None) -> DesignRecord:
    """Return the record of a solved problem, from which `design_record` makes the JSON object."""
    judgement, problem = solved.judgement, solved.problem
    proved = _proved(problem, judgement) if judgement is not None else {}
    borne = _borne(problem, judgement) if judgement is not None else {}
    if out_of_time() and proved:
        solved = replace(solved, cut=(*solved.cut, PROVED_BAND))
    with unlimited():
        return _recorded(file, solved, proved, ipopt, date, borne)


def _recorded(
    file: ProblemFile,
    solved: Solved,
    proved: dict[str, Any],
    ipopt: str | None,
    date: str | None,
    borne: dict[str, Part],
) -> DesignRecord:
    judgement, problem = solved.judgement, solved.problem
    parts: dict[str, Any] = dict.fromkeys(("gains", "coupling", "transparency", "certificate", "inner_loop"))
    touched: list[str] = []
    said = [*solved.cut_short, *file_doubts(file, Path(file.source).name)]
    if judgement is not None:
        parts = _judged(problem, judgement, proved)
        touched = at_bound(problem, judgement.gains, judgement.coupling)
        said += warnings(problem, judgement)
        if problem.uncertainty is not None:
            parts["uncertainty"] = uncertainty_record(problem, judgement)
    if date is not None:
        parts["date"] = date
    parts |= borne
    if solved.prices is not None:
        parts["prices"] = [PriceRecord(**asdict(price)) for price in solved.prices]
    return DesignRecord(
        problem=ProblemRecord(name=problem.name, sha256=file.sha256, text=file.text, **stated_units(problem.device)),
        status=solved.status.value,
        reason=solved.reason,
        active=active(solved),
        proved=solved.infeasibility.proved if solved.infeasibility else None,
        idle=judgement is not None and judgement.idle,
        repairs=None if solved.repairs is None else [RepairRecord(**asdict(repair)) for repair in solved.repairs],
        at_bound=touched,
        warnings=[note.line for note in said],
        solver=solver_record(solved),
        optimality=optimality_record(solved.optimality) if solved.optimality else None,
        versions=versions(ipopt),
        **parts,
    )


def at_bound(problem: Problem, gains: Gains, coupling: AnyCoupling) -> list[str]:
    """Return the dotted keys of the free variables that lie on a bound."""
    return [key for key, _ in _touched(problem, point(gains, coupling))]


def _touched(problem: Problem, values: Point) -> list[tuple[str, str]]:
    found = []
    for key, value, bounds in zip(keys_for(problem), values, ranges(problem), strict=True):
        if not bounds.fixed:
            found += [(key, "upper")] if near(value, bounds.max, bounds) else []
            found += [(key, "lower")] if near(value, bounds.min, bounds) else []
    return found


def warnings(problem: Problem, judgement: Judgement) -> list[Note]:
    """Return warnings about a design."""
    found = []
    for key, side in _touched(problem, point(judgement.gains, judgement.coupling)):
        of_spring = key == "coupling.damping" and problem.device.kind.inverse and problem.bounds.damping.min == 0
        if not ((key in ("gains.position", "coupling.drag") or of_spring) and side == "lower"):
            said = f"{key} is on its {side} bound; the bound, not the device, limits the design there"
            found.append(Note("warn-bound", said))
    band, demand = problem.stability.band, problem.stability.safety_factor
    # only Llewellyn's claim has a band, whose edge does not matter if a claim in hands covers every frequency
    edged = problem.hands_met is None and problem.device.kind.banded
    if edged and demand <= judgement.min_ratio < demand * 1.001:
        for side, edge in (("lower", band.min), ("upper", band.max)):
            if judgement.worst == edge and 0 < edge < problem.nyquist:
                said = (
                    f"the {side} edge of the stability band, {edge / (2 * pi):.4g} Hz, limits the design: "
                    "outside the proved band a passive hand or environment can make it oscillate"
                )
                found.append(Note("warn-band-edge", said))
    if judgement.idle:
        said = (
            f"the design hardly uses its velocity loop: |1 - G_he| is {judgement.transparency.tracking:.3g}, "
            "and 1 means no loop at all; a constraint that can be relaxed, a wider bound or a faster device may help"
        )
        found.append(Note("warn-idle", said))
    return found


@np.errstate(all="ignore")
def _proved(problem: Problem, judgement: Judgement) -> dict[str, Any]:
    """Return the records that need additional proofs. The time limit may leave some out."""
    proved = judgement.certificate.proved_band_hz
    return {
        "proved_band_hz": list(proved) if proved else None,
        **_without_operator(problem, judgement.gains, judgement.coupling),
    }


@np.errstate(all="ignore")
def _borne(problem: Problem, judgement: Judgement) -> dict[str, Part]:
    """Return the records of a servo's contacts and of what the hand feels."""
    found = {"contact": contact_record(problem, judgement), "felt": in_hand_record(problem, judgement)}
    return {name: part for name, part in found.items() if part is not None}


@np.errstate(all="ignore")
def _judged(problem: Problem, judgement: Judgement, proved: dict[str, Any]) -> dict[str, Any]:
    gains, coupling, certificate = judgement.gains, judgement.coupling, judgement.certificate
    worst, band = judgement.worst, problem.stability.band
    somewhere = problem.passive and 0 < worst < inf
    also: dict[str, Any] = {**proved, **_in_hands(problem, judgement)}
    also |= _in_any_hand(problem, judgement) | _at_whole_sample(problem, judgement)
    display = _display(problem)
    return {
        "gains": gains,
        "coupling": coupling,
        "transparency": TransparencyRecord(**asdict(judgement.transparency), **display),
        "certificate": CertificateRecord(
            verdict=certificate.verdict.value,
            band_hz=[finite_hertz(band.min), finite_hertz(band.max)] if problem.passive else None,
            proved_ratio=certificate.proved_ratio,
            min_ratio=judgement.min_ratio,
            worst_hz=finite_hertz(worst),
            rollett_k=rollett_factor_at(judgement.tightest, gains, coupling, worst) if somewhere else None,
            boxes=certificate.boxes,
            claims=claim_records(problem, judgement),
            **also,
            **display,
        ),
        "inner_loop": _inner_loop(problem, judgement) if problem.device.kind.own_loop else None,
    }


def _display(problem: Problem) -> dict[str, Any]:
    """Return the record of the kind of display; empty for an admittance display."""
    return {"display": problem.device.display} if problem.device.kind is not ADMITTANCE else {}


def _in_hands(problem: Problem, judgement: Judgement) -> dict[str, HandsRecord]:
    """Return the record of the claim in a box of hands; empty if the problem does not make this claim."""
    held, hands = judgement.in_hand, problem.hands
    if held is None or problem.hands_met is None:
        return {}
    outcomes = judgement.certificate.outcomes
    outcome = next(outcomes[claim] for claim in IN_HANDS if claim in outcomes)
    low, high, also = asdict(hands.low), asdict(hands.high), dict[str, Any]()
    if problem.worlds is not None:
        ends = asdict(problem.worlds.low), asdict(problem.worlds.high)
        also["worlds"] = {name: [ends[0][name], ends[1][name]] for name in ends[0]}
    device = judgement.tightest if held.ratio == judgement.min_ratio else problem.device
    law, factor = (judgement.gains, judgement.coupling), problem.stability.safety_factor
    world = binding_world(device, *law, held.hand, held.omega, factor, problem.worlds)
    if world is not None:
        also["worst_world"] = WorldRecord(mass=world.mass, stiffness=world.stiffness)
    if (walls := judgement.in_walls) is not None and (corner := judgement.corner) is not None:
        proved = outcomes["walls"]
        also["walls"] = WallsRecord(
            verdict=proved.verdict.value,
            corner_hz=hertz(corner),
            min_ratio=walls.ratio,
            worst_hz=finite_hertz(walls.omega),
            worst_hand=walls.hand,
            boxes=proved.boxes,
            **_display(problem),
        )
    return {
        "hands": HandsRecord(
            verdict=outcome.verdict.value,
            box={name: [low[name], high[name]] for name in low},
            min_ratio=held.ratio,
            worst_hz=finite_hertz(held.omega),
            worst_hand=held.hand,
            boxes=outcome.boxes,
            **also,
            **_display(problem),
        )
    }


def _in_any_hand(problem: Problem, judgement: Judgement) -> dict[str, AnyHandRecord]:
    """Return the record of the claim in any passive hand on an impedance display; empty without this claim."""
    held = judgement.in_any_hand
    if held is None:
        return {}
    outcome = judgement.certificate.outcomes["any_hand"]
    return {
        "any_hand": AnyHandRecord(
            verdict=outcome.verdict.value,
            min_ratio=held.ratio,
            worst_hz=finite_hertz(held.omega),
            boxes=outcome.boxes,
            **_display(problem),
        )
    }


def _at_whole_sample(problem: Problem, judgement: Judgement) -> dict[str, WholeSampleRecord]:
    """Return the record of the design with a delay of a whole number of samples; empty if the delay is not near such a
    value."""
    beside = judgement.certificate.beside
    if not beside:
        return {}
    verdict = worst_verdict(each.verdict for each in beside)
    samples = round(delay_in_samples(problem.device))
    delay = samples * problem.device.sample_time
    return {"whole_sample": WholeSampleRecord(verdict=verdict.value, samples=samples, delay=float(f"{delay:.15g}"))}


def _without_operator(problem: Problem, gains: Gains, coupling: AnyCoupling) -> dict[str, WithoutOperatorRecord]:
    """Return the record of the design without the least operator; empty without an operator."""
    if problem.device.operator is None:
        return {}
    bare = judge(replace(problem, device=problem.device.bare), gains, coupling)
    verdict, worst = bare.certificate.verdict, finite_hertz(bare.worst)
    return {"without_operator": WithoutOperatorRecord(verdict=verdict.value, min_ratio=bare.min_ratio, worst_hz=worst)}


def _inner_loop(problem: Problem, judgement: Judgement) -> InnerLoopRecord:
    device, gains, outcomes = problem.device, judgement.gains, judgement.certificate.outcomes
    poles = [outcomes[claim].verdict for claim in claims_about("poles") if claim in outcomes]
    margins = loop_margins(device, gains)
    return InnerLoopRecord(
        stable=False if Verdict.REFUTED in poles else None if Verdict.UNDECIDED in poles else True,
        spectral_radius=spectral_radius(device, gains),
        peak_sensitivity=judgement.peak_sensitivity,
        peak_sensitivity_hz=finite_hertz(judgement.worst_sensitivity),
        gain_margin_db=20 * log10(margins.gain),
        phase_margin_deg=degrees(margins.phase),
        delay_margin_s=margins.delay,
        nyquist=NyquistRecord(
            N=unstable_poles(device, gains), P=0, Z=0 if outcomes["stable"].verdict is Verdict.PROVED else None
        ),
    )


def optimality_record(found: Optimality) -> OptimalityRecord:
    """Return the record of the bound on every design: bound, gap, history, and open boxes."""
    nodes = found.open
    lowest = np.argsort(nodes.bound, kind="stable")[:SHOWN]
    every = max(1, len(found.history) // SHOWN)
    return OptimalityRecord(
        lower_bound=found.bound,
        gap=found.gap,
        verdict="proved" if found.proved else "open",
        boxes=found.boxes,
        terms=list(found.terms) or None,
        history=[
            GlanceRecord(boxes=at.boxes, lower_bound=at.bound, error=at.incumbent, open=at.open)
            for at in [*found.history[:-1:every], found.history[-1]]
        ],
        open=[BoxRecord(low=nodes.boxes.low[:, i].tolist(), high=nodes.boxes.high[:, i].tolist()) for i in lowest],
    )
