"""Count the unstable poles of the loops by the turns of a curve around 0 (proof/README.md, section 6)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf, pi, sqrt

import numpy as np

from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.hands import HAND
from vctune.model.loop.device_response import mechanism
from vctune.model.numbers.arithmetic import FLOATS, Arithmetic, Number
from vctune.model.numbers.pair import Pair
from vctune.model.numbers.units import KEYS
from vctune.model.problem import Demands
from vctune.proof.box_tests import misses_zero, turned_angles
from vctune.proof.boxes import Boxes, Integers
from vctune.proof.claims.cases import Case, values_of
from vctune.proof.claims.loop_claims import Covered, Held, device_at, held, in_rad_per_s, of_design
from vctune.proof.claims.margins_of_claims import (
    across_position,
    along_drive,
    coupling_curve,
    hand_curve,
    limp_hand_curve,
    limp_hand_real,
    model_curve,
    sampled_curve,
)
from vctune.proof.device_box import DeviceBox
from vctune.proof.enclosures.intervals import ENCLOSURES, Flags, Floats, between, decimal
from vctune.proof.halving import Effort
from vctune.proof.outcome import Outcome, Verdict
from vctune.proof.prover import prove

POLES = Effort(max_halvings=80, max_boxes=40_000)
# Relative allowance for rounding errors, which are about 1e-12, in the frequency that `curve_end` returns and in an
# angle
NEAR = 1e-6
# Greatest difference, rad, between the argument at `curve_end` and its limit, at which the prover accepts the loop as
# stable
ROOM = 2.0


@dataclass(frozen=True, slots=True)
class Turns:
    """How often a curve turns around 0 for every device and design of each of n owners; nan where this is open."""

    number: Floats
    same: Flags  # whether the curve misses 0 throughout, so that the number is the same
    point: Floats  # frequency and rows of a place where this is open, shape (1 + rows, n)
    boxes: Integers


def turns(
    covered: Covered,
    curve: Callable[[Case, Number], Pair],
    over: Callable[[Covered], Boxes],
    turn: float,
    goal: float = 0.0,
    near: Callable[[Case, Number], Number] | None = None,
    limit: Callable[[Case, Number], Number] | None = None,
) -> Turns:
    """Count the turns of a curve at the centre of each owner, and prove that it misses 0 throughout.

    `near` is a margin that is positive only where the curve misses 0, for every K_p; `limit` is the curve's real part,
    which has a formula at frequency 0 where the curve has none.
    """
    n, fixed, effort = covered.owners, covered.fixed, covered.effort(POLES)
    same = Held(np.ones(n, bool), np.full((1 + len(covered.names), n), np.nan), np.zeros(n, np.intp))
    if covered.extended:
        by_near = near and KEYS[1] in covered.names and covered.margin(near)
        test = misses_zero(covered.margin(curve), fixed, by_near or None)
        same = held(covered, effort, [(test, over(covered))])
    at, number = np.flatnonzero(same.proved), np.full(n, np.nan)
    if not len(at):
        return Turns(number, same.proved, same.point, same.boxes)
    points = covered.subset(at).centres()
    there, at_zero = points.margin(curve), limit and points.margin(limit)
    missed, turned = misses_zero(there, fixed, at_zero), turned_angles(there, fixed, at_zero)
    found = prove(missed, over(points), len(at), points.effort(POLES), turned)
    number[at] = np.where(found.proved, np.round((goal - found.total) / turn), np.nan)
    same.boxes[at] += found.boxes
    lost = at[~found.proved]
    same.point[: len(found.open), lost] = found.open[:, ~found.proved]
    return Turns(number, same.proved, same.point, same.boxes)


def model_turns(loop: Covered) -> Turns:
    """Count the poles of the frequency model in the right half plane, for one of the loops."""
    end = _curve_end(loop)
    goal = final_angle(loop.demands.device, integral=loop.integral)
    return turns(loop, model_curve, lambda c: c.over(0.0, end), 2 * pi, goal, along_drive)


def sampled_turns(loop: Covered) -> Turns:
    """Count the poles of the exact sampled loop outside the unit circle, for one of the loops.

    The curve begins at F(1) > 0 and ends on the real axis.
    """
    return turns(loop, sampled_curve, Covered.around_circle, pi, near=lambda *at: across_position(*at)[0])


def final_angle(device: Device, *, integral: bool) -> float:
    """Return the limit of the argument of `model_curve` for omega -> inf if all poles are stable."""
    return pi / 2 * (1 + integral + (2 if device.structure is not None else 0))


def curve_end(device: Device, K_v: float, K_p: float, ops: Arithmetic = FLOATS) -> float:
    """Return a frequency beyond which the argument of `model_curve` stays within `ROOM` of its limit."""
    size = ops.magnitude
    if device.structure is None:
        return 4 * max(size(K_v / device.mass), sqrt(size(K_p / device.mass)))
    parts = mechanism(device, device.structure, ops)
    motor, handle = parts.motor, parts.handle
    held = 0.0 if parts.damping is None else size(parts.damping / handle)
    rates = size(K_v / motor), 4 / 3 * size(parts.viscosity / motor), size(parts.viscosity / handle), held
    squares = size(K_p / motor), 4 / 3 * size(parts.stiffness / motor), size(parts.stiffness / handle)
    return (1 + NEAR) * max(*(8 * rate for rate in rates), *(sqrt(8 * square) for square in squares))


def free_at_rest(demands: Demands, *, integral: bool) -> bool:
    """Return whether nothing but a hand's spring holds the position: without one, a pole of the loop is at z = 1."""
    kind = demands.device.kind
    return kind.own_loop and not demands.rigid and not (kind.senses_force and integral)


def hand_turns(covered: Covered) -> Turns:
    """Count the unstable poles of the loop in the middle hand of the box, or in each owner's own, while the environment
    is at rest."""
    hands = covered.demands.hands
    assert hands is not None
    there = covered  # rows may state a hand for each owner
    if HAND[0] not in covered.names:
        there = replace(covered, fixed={**covered.fixed, **hands.middle.mapped(decimal).by_key})
    if hands.middle.stiffness > 0 or not free_at_rest(covered.demands, integral=covered.integral):
        return turns(there, hand_curve, Covered.around_circle, pi)
    return turns(there, limp_hand_curve, Covered.around_circle, pi, limit=limp_hand_real)


def coupling_turns(covered: Covered) -> Turns:
    """Count the poles of 1/Z_c outside the unit circle, on an impedance display."""
    return turns(covered, coupling_curve, Covered.around_circle, pi)


def _curve_end(loop: Covered) -> float:
    """Return a frequency above which the frequency model's curve cannot turn around 0."""
    if loop.box is None:
        device, ops = loop.demands.device, FLOATS
    else:
        ends = zip(loop.box.uncertain, map(between, loop.low[:, 0], loop.high[:, 0]), strict=True)
        device, ops = loop.box.nominal.converted(decimal).with_numbers(dict(ends)), ENCLOSURES
    if KEYS[0] in loop.names:
        K_v, K_p = (float(row.max(initial=0.0)) for row in loop.high[:2])
    else:
        K_v, K_p = (float(loop.fixed[key].mid) for key in KEYS[:2])
    return (1 + NEAR) * max(curve_end(device, K_v, K_p, ops), NEAR / ops.magnitude(device.sample_time))


def stable_loop(device: Device, gains: Gains, *, model: bool) -> bool | None:
    """Return whether the sampled loop, and with `model` the frequency model, is stable; None if undecided."""
    empty = np.empty((0, 1))
    loop = Covered(Demands(device.modelled, (0.0, inf), 1.0, inf), (), empty, empty, values_of(gains))
    numbers = [sampled_turns(loop).number[0], *([model_turns(loop).number[0]] if model else [])]
    return None if np.isnan(numbers).any() else not any(numbers)


def prove_model_poles(design: Design, demands: Demands, box: DeviceBox | None) -> Outcome:
    """Prove that no pole of the frequency model lies in the closed right half plane, for every device of the box."""
    if not design.gains.closed:
        return Outcome(Verdict.PROVED if design.device.damping > 0 else Verdict.REFUTED, 1)
    return _poles(design, demands, box, model_turns)


def prove_sampled_poles(design: Design, demands: Demands, box: DeviceBox | None) -> Outcome:
    """Prove that the spectral radius of the exact sampled loop is below 1, for every device of the box."""
    return in_rad_per_s(_poles(design, demands, box, sampled_turns), design.device)


def _poles(design: Design, demands: Demands, box: DeviceBox | None, counted: Callable[[Covered], Turns]) -> Outcome:
    boxes, corners = 0, box.modelled.corners() if box is not None else []
    for loop in of_design(design, demands, box).loops():
        found = counted(loop)
        boxes += int(found.boxes[0])
        if found.number[0] == 0:
            continue
        if np.isfinite(found.number[0]):
            return Outcome(Verdict.REFUTED, boxes)
        doubtful = device_at(loop, found.point[:, 0])
        for device in (doubtful, *corners) if not found.same[0] else ():
            one = counted(of_design(replace(design, device=device), demands))
            boxes += int(one.boxes[0])
            if np.isfinite(one.number[0]) and one.number[0] != 0:
                return Outcome(Verdict.REFUTED, boxes, None, device)
        return Outcome(Verdict.UNDECIDED, boxes, float(found.point[0, 0]), doubtful if loop.box is not None else None)
    return Outcome(Verdict.PROVED, boxes)
