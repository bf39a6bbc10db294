"""What limits a design: its active constraints and their prices."""

from __future__ import annotations

import numpy as np

from vctune.analysis.demands import response
from vctune.analysis.extrema import Floats
from vctune.design.judging.judge import Judgement
from vctune.design.judging.kicked import ringing_of
from vctune.design.nlp.solution import Polished
from vctune.design.nlp.working_set import ConstraintPoint, points_as_one
from vctune.design.records.claims import DeviceRecord, device_record
from vctune.design.records.warned import at_greatest_rest
from vctune.design.result import Solved
from vctune.design.variables import design_of, touched
from vctune.document.records.part import Nullable, RecordPart
from vctune.model.loop.llewellyn import llewellyn_excess, modulus_excess
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.units import finite_hertz, hertz
from vctune.model.problem import Problem
from vctune.proof.claims.registry import CLAIMS
from vctune.proof.claims.rest import RESTS
from vctune.proof.claims.walls import WALLS

ACTIVE = 1e-5  # Multiplier above which the record lists a constraint as active
NEAR_RATIO = 1.02  # Such a ratio of a damping ratio, of which designs keep a hundredth more
AT_LIMIT = 1.01  # Greatest ratio, over the safety factor, of a claim that limits a design without multipliers
DIGITS = 9  # Number of significant digits of multipliers, of which machines agree


class ActiveRecord(RecordPart):
    """An active constraint of the search."""

    demand: str  # formula of the constraint
    hz: Nullable  # frequency at which it is active; null if it belongs to no frequency
    multiplier: float | None  # relative decrease of the error for a relative weakening of it; null without an optimum
    device: DeviceRecord | None = None  # device on which it is active; null if there is only one device


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
    if any(
        at_greatest_rest(problem, judgement, key) for key, _ in touched(problem, judgement.gains, judgement.coupling)
    ):
        said = RESTS.said_of(problem.device.kind)
        found.append(ActiveRecord(demand=said.rpartition(": ")[2], hz=None, multiplier=None))
    if (ratio := problem.stability.damping_ratio) is not None:
        rings = ringing_of(judgement.posed, judgement.tightest, judgement.gains, judgement.coupling)
        if rings is not None and rings.damping_ratio <= NEAR_RATIO * ratio:
            hz = hertz(rings.frequency)
            found.append(ActiveRecord(demand=f"damping ratio >= {ratio:g}", hz=hz, multiplier=None))
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
