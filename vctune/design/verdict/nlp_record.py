"""Record the NLP of a solved problem: its content, the parts that it omits, and the active constraints."""

from __future__ import annotations

from math import degrees
from typing import Any

import numpy as np

from vctune.analysis.demands import response
from vctune.analysis.extrema import Floats
from vctune.design.prepared import pose
from vctune.design.result import Polished, Solved
from vctune.design.search.working_set import DEMANDS, ConstraintPoint, stacked
from vctune.design.variables import design_of
from vctune.document.records.certificate_json import DeviceRecord, PerturbationRecord
from vctune.document.records.design_json import ActiveRecord
from vctune.model.device import Device
from vctune.model.loop.llewellyn import llewellyn_demand, modulus_excess
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.units import hertz
from vctune.model.problem import Problem

ACTIVE = 1e-5  # Multiplier above which the record lists a constraint as active
DIGITS = 9  # Number of significant digits of multipliers, of which machines agree


def active(solved: Solved) -> list[ActiveRecord]:
    """Return the active constraints of a design, with kind, frequency and multiplier, the greatest multiplier first."""
    if solved.polished is None or not solved.polished.solution.converged:
        return []
    at, multipliers = solved.polished.working_set, [float(f"{m:.{DIGITS}g}") for m in _priced(solved.polished)]
    coupled = f"Re {solved.problem.device.kind.couples} >= safety_factor R in"
    # the demand and the place of each constraint, in the order of the NLP
    where: list[tuple[str, ConstraintPoint | None]] = [("Re Z_c >= safety_factor R", place) for place in at.ratio]
    where += [("|S| <= max_sensitivity", place) for place in at.sensitivity]
    where += [("stability of the sampled loop", None)] * len(at.stability)
    where += [("greatest error", place) for place in at.peak]
    where += [("|1 - S| r < 1 of the unmodelled dynamics", place) for place in at.unmodelled]
    for place in at.in_hand:
        in_hand = f"{coupled} {'any passive' if place.hand is None else 'a'} hand"
        where.append((in_hand if place.wall is None else "walls in a hand", place))
    for place in at.tracked_peaks:
        where += [("|S| <= max_sensitivity", place), ("", None)]
    where += [("greatest error", None)] * solved.polished.structure.mean_errors
    several, found = len(pose(solved.problem).cases) > 1, list[ActiveRecord]()
    for (demand, where_at), multiplier in zip(where, multipliers, strict=True):
        if demand and multiplier > ACTIVE:
            hz = hertz(where_at.omega / solved.problem.device.sample_time) if where_at else None
            also = {"device": _device(solved.problem, where_at)} if where_at and several else {}
            found.append(ActiveRecord(demand=demand, hz=hz, multiplier=multiplier, **also))
    return sorted(found, key=lambda row: -row.multiplier)


def _device(problem: Problem, place: ConstraintPoint) -> DeviceRecord:
    """Return the device of a dimensionless point in SI units."""
    impedance, time = problem.transparency.reference_impedance, problem.device.sample_time
    return device_record(place.device.in_units(1 / impedance, 1 / time), problem)


def _priced(polished: Polished) -> Floats:
    """Return the multipliers; for the ratio, the multipliers of 2 Re(D + Z_h) Re Z_c >= factor 2 Re(D + Z_h) R."""
    multipliers, ratio = np.abs(polished.solution.multipliers), polished.working_set.ratio
    operator = ratio[0].device.operator if ratio else None
    if operator is not None and operator.damping > 0:
        device, omega = stacked(ratio)
        loop = response(device, design_of(polished.values)[0], omega)
        multipliers[: len(ratio)] *= llewellyn_demand(loop, FLOATS) / modulus_excess(loop, FLOATS)
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
        "frequencies": dict(zip(DEMANDS, polished.working_set.sizes(), strict=True)),
        "rounds": len(polished.rounds),
        "iterations": sum(each.iterations for each in polished.rounds),
    }


def device_record(device: Device, problem: Problem) -> DeviceRecord:
    """Return mass, damping and delay of a device, and its other parameters for which the problem states an
    uncertainty."""
    widths = dict(problem.uncertainty.half_widths) if problem.uncertainty is not None else {}
    known = device.numbers()
    others = {key: number for key, number in known.items() if "." in key and key in widths}
    found: dict[str, Any] = {"parts": others} if others else {}
    if device.unmodelled is not None and device.unmodelled.share > 0:
        share, phase = float(device.unmodelled.share), degrees(device.unmodelled.phase)
        found["unmodelled"] = PerturbationRecord(share=share, phase_deg=phase)
    own = {key: known[key] for key in ("mass", "damping", "delay") if key in known}
    return DeviceRecord(**own, **found)
