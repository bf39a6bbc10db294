"""Count the unstable poles of the loops by the turns of a curve around 0 (proof/README.md, section 6)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from math import inf, pi, sqrt

import numpy as np

from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import Gains, SpringDamper
from vctune.model.hands import HAND
from vctune.model.loop.device_response import device_response
from vctune.model.loop.loop import loop_response, masses_behind
from vctune.model.mechanism import chain
from vctune.model.numbers.arithmetic import FLOATS, Arithmetic, Number
from vctune.model.numbers.pair import Pair, re_conj_product
from vctune.model.numbers.units import KEYS
from vctune.model.sampled.hand_loop import loop_in_hand
from vctune.model.sampled.impedance_display import ForceInHand, firmware_filter
from vctune.model.sampled.velocity_loop import return_difference, unturned
from vctune.model.sections import greatest_gain
from vctune.proof.box_tests import misses_zero, turned_angles
from vctune.proof.boxes import Boxes, Integers
from vctune.proof.claims.cases import Case, values_of
from vctune.proof.claims.claim import Claim, Outcomes, Question
from vctune.proof.claims.covered import Covered, Held, Place, device_at, held, in_rad_per_s, of_design
from vctune.proof.claims.sensitivity import across_position, difference
from vctune.proof.device_box import DeviceBox
from vctune.proof.enclosures.intervals import ENCLOSURES, Flags, Floats, between, decimal
from vctune.proof.halving import Effort
from vctune.proof.outcome import Outcome, Verdict
from vctune.proof.prover import prove

POLES = Effort(max_halvings=80, max_boxes=40_000)
# Relative allowance for rounding errors, which are about 1e-12, in the frequency that `curve_end` returns and in an
# angle
NEAR = 1e-6


def sampled_curve(case: Case, theta: Number) -> Pair:
    """Return F of the sampled loop, rotated to be real at both ends."""
    return unturned(case.let_go(), difference(case, theta).closed(case.design.gains), theta, case.ops)


def model_curve(case: Case, omega: Number) -> Pair:
    """Return a curve that has the zeros of D and no pole to the right of the imaginary axis."""
    at, gains = device_response(case.design.device, omega, case.ops), case.design.gains
    D = loop_response(at, gains, case.ops).D_scaled
    if not case.ops.is_zero(gains.position):
        D = Pair(-D.im, D.re)
    for spring in at.springs:
        D = D * Pair(spring.y_k, at.omega * spring.y_c)
    return D


def along_drive(case: Case, omega: Number) -> Number:
    """Return Re(D conj(e A H)), where D = e W + Z. It does not depend on K_p and is regular at omega = 0."""
    at, gains = device_response(case.design.device, omega, case.ops), case.design.gains
    drive, lagging = at.drive, omega * at.drive.lag
    H2 = drive.re * drive.re + lagging * lagging
    kept = H2 if at.estimate is None else H2 * at.estimate.re
    along = at.damping * drive.re - at.mass * omega * lagging + gains.velocity * kept
    if not at.springs:
        return along
    handle = masses_behind(at)[-1]
    e, Z = (Pair(each.even, omega * each.odd) for each in (handle.kept.plus(1), handle.held))
    return e.abs2() * along + re_conj_product(Z, e * Pair(drive.re, -lagging))


def hand_curve(case: Case, theta: Number) -> Pair:
    """Return F of the loop in a hand, before a rigid wall with a share of factor times the coupling as that wall.

    It is rotated to be real at both ends. The curve of a stable loop makes no turn around 0.
    """
    plant, wall = case.held(), case.design.coupling
    loop = loop_in_hand(plant, theta, case.ops)
    if case.demands.rigid:
        assert isinstance(loop, ForceInHand) and isinstance(wall, SpringDamper)
        F = loop.before_wall(wall, case.factor * case.share)
    else:
        F = loop.closed(case.design.gains)
    return Pair(F.even, case.ops.sin(theta / 2) * F.odd) * turned_back(plant.poles, theta, case.ops)


def limp_hand_curve(case: Case, theta: Number) -> Pair:
    """Return `hand_curve` without the pole at z = 1 of a free position."""
    plant, ops = case.held(), case.ops
    F = loop_in_hand(plant, theta, ops).closed(case.design.gains)
    return Pair(F.odd, -F.even / ops.sin(theta / 2)) * turned_back(plant.poles - 1, theta, ops)


def limp_hand_real(case: Case, theta: Number) -> Number:
    """Return the real part of `limp_hand_curve`, also at theta = 0."""
    plant, ops = case.held(), case.ops
    F, others = loop_in_hand(plant, theta, ops).closed(case.design.gains), plant.poles - 1
    ratio = others * ops.sinc(theta * (others / 2)) / ops.sinc(theta / 2)  # of the sines of others theta/2 and theta/2
    return F.odd * ops.cos(theta * (others / 2)) - F.even * ratio


def coupling_curve(case: Case, theta: Number) -> Pair:
    """Return (1 - 1/z) Z_c T of an impedance display, whose zeros outside the unit circle are poles of 1/Z_c."""
    coupling, device, ops = case.design.coupling, case.design.device, case.ops
    assert isinstance(coupling, SpringDamper)
    passed, half = firmware_filter(device, theta, ops) or Pair(1, 0), ops.sin(theta / 2)
    difference = Pair(2 * half * half, 2 * half * ops.cos(theta / 2))
    return (passed * difference).scaled(coupling.damping).plus(coupling.stiffness * device.sample_time)


def turned_back(poles: int, theta: Number, ops: Arithmetic) -> Pair:
    """Return z^(-n/2) of n poles."""
    return Pair(ops.cos(theta * (poles / 2)), -ops.sin(theta * (poles / 2)))


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
    return pi / 2 * (1 + integral + 2 * len(device.modes))


def curve_end(device: Device, K_v: float, K_p: float, ops: Arithmetic = FLOATS) -> float:
    """Return a frequency beyond which the argument of `model_curve` stays within 2 rad of its limit.

    There no spring pulls a mass at its ends with more than a share of its inertia, and all shares together are small.
    """
    size, of = ops.magnitude, chain(device, ops)
    if device.velocity is not None and device.velocity.sections is not None:  # which alone may amplify the estimate
        K_v = K_v * greatest_gain(device.velocity.sections)
    if not of.links:
        return 4 * max(size(K_v / device.mass), sqrt(size(K_p / device.mass)))
    rates, squares, ahead = [size(K_v / of.motor)], [size(K_p / of.motor)], of.motor
    rates += [] if of.held is None else [size(of.held / of.links[-1].mass)]
    for link in of.links:
        rates += [4 / 3 * size(link.viscosity / ahead), size(link.viscosity / link.mass)]
        squares += [4 / 3 * size(link.stiffness / ahead), size(link.stiffness / link.mass)]
        ahead = link.mass
    share = 8 * len(of.links)
    return (1 + NEAR) * max(*(share * rate for rate in rates), *(sqrt(share * square) for square in squares))


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


def _prove_model(question: Question, _known: Outcomes) -> Outcome:
    """Prove that no pole of the frequency model lies in the closed right half plane, for every device of the box."""
    design = question.design
    if not design.gains.closed:
        return Outcome(Verdict.PROVED if design.device.damping > 0 else Verdict.REFUTED, 1)
    return _poles(*question.modelled, model_turns)


def _prove_sampled(question: Question, _known: Outcomes) -> Outcome:
    """Prove that the spectral radius of the exact sampled loop is below 1, for every device of the box."""
    return in_rad_per_s(_poles(*question.modelled, sampled_turns), question.design.device)


def pole_turns(cells: Covered) -> list[Turns]:
    """Count the unstable poles of each loop and model that must be stable, with those in the middle hand of a box."""
    counted = (model_turns, sampled_turns) if cells.demands.passive else (sampled_turns,)
    found = [count(loop) for loop in cells.loops() for count in counted]
    return [*found, hand_turns(cells)] if cells.demands.hands is not None else found


def unstable(turns: Turns) -> Flags:
    """Return the owners of which every loop has an unstable pole."""
    return np.asarray(np.isfinite(turns.number) & (turns.number != 0))


def _all_stable(counted: Callable[[Covered], Turns], cells: Covered) -> Flags:
    return np.all([counted(loop).number == 0 for loop in cells.loops()], axis=0)


def _unstable(counted: Callable[[Covered], Turns], cells: Covered, _places: Place) -> Flags:
    return np.any([unstable(counted(loop)) for loop in cells.loops()], axis=0)


STABLE_MODEL = Claim(
    id="stable_model",
    sentence="no pole of the frequency model in the closed right half plane",
    quantity="poles",
    margin=model_curve,
    witness="if undecided, a frequency where the curve comes close to 0; the proof only counts poles",
    label="poles of the frequency model",
    explain=(
        "The frequency model itself is stable, both without a hand and in the hand of `[operator]`. Without "
        "this claim, `passive` would not imply stability."
    ),
    when='for an admittance display with the criterion "passive" or "both"',
    asked=lambda demands, _: demands.passive,
    prove=_prove_model,
    cells=partial(_all_stable, model_turns),
    lost=partial(_unstable, model_turns),
)


STABLE = Claim(
    id="stable",
    sentence="spectral radius of the sampled loop below 1",
    quantity="poles",
    margin=return_difference,
    witness="if undecided, a frequency where the curve comes close to 0; the proof only counts poles",
    label="poles of the sampled loop",
    explain=(
        "The exactly sampled velocity loop is stable, both when nobody holds the device and in the hand of "
        "`[operator]`."
    ),
    when="for every device but a servo, whose coupling is not a wall",
    asked=lambda demands, _: demands.device.kind.own_loop and not demands.rigid,
    prove=_prove_sampled,
    cells=partial(_all_stable, sampled_turns),
    lost=partial(_unstable, sampled_turns),
)
