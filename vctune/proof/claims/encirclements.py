"""Count how often the curves of the loop go around 0, for many cells of designs at once. 0 means no unstable pole. See
proof/README.md, section 8."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi

import numpy as np

from vctune.model.device import Device
from vctune.model.numbers.arithmetic import FLOATS, Arithmetic
from vctune.model.problem import Demands
from vctune.proof.boxes import Cells, Integers, Values
from vctune.proof.claims.array_claims import Claims, claims_of
from vctune.proof.claims.margins_of_claims import HALF_TURN
from vctune.proof.claims.model_poles import NEAR, curve_end, final_angle
from vctune.proof.enclosures.intervals import Flags, Floats, decimal
from vctune.proof.engine.bands import cells_over_band
from vctune.proof.prover import Curve, Margin, misses_zero, turned_angles


def by_integrator(cells: Cells) -> list[Integers]:
    """Return the indices of the cells with K_p > 0, and of the cells with K_p = 0, where the law has no integrator."""
    # row 1 is K_p in `KEYS` and in `SPRING_KEYS`
    parts = np.flatnonzero(cells.high[1] > 0), np.flatnonzero(cells.high[1] == 0)
    return [at for at in parts if len(at)]


@dataclass(frozen=True, slots=True)
class Encirclements:
    """How often the curves of every design of a cell go around 0."""

    number: Floats  # number of turns, shape (rows, n)
    boxes: Integers  # number of boxes at the cells' centres for the model and for the sampled loop, shape (2, n)
    throughout: Integers  # number of boxes of the proof that no pole crosses the boundary within a cell, shape (n,)


def encirclements(demands: Demands, cells: Cells) -> Encirclements:
    """Return how often the loop's curves go around 0 for each cell (proof/README.md, section 8)."""
    parts = [_encirclements(replace(demands, device=loop), cells) for loop in demands.device.loops]
    if not parts:
        n = len(cells)
        return Encirclements(np.zeros((0, n)), np.zeros((2, n), np.intp), np.zeros(n, np.intp))
    number, boxes, throughout = (np.stack([getattr(part, name) for part in parts]) for name in Encirclements.__slots__)
    return Encirclements(np.concatenate(number), boxes.sum(axis=0), throughout.sum(axis=0))


def _encirclements(demands: Demands, cells: Cells) -> Encirclements:
    """Return the numbers of turns for one loop. If no pole crosses the boundary within a cell, the cell has the numbers
    of its centre."""
    claims, device = claims_of(demands), demands.device
    same, throughout = np.ones((2, len(cells)), bool), np.zeros(len(cells), np.intp)
    if cells.extended:
        same, throughout = _no_pole_crosses(demands, claims, cells)
    number, boxes = np.full((2, len(cells)), np.nan), np.zeros((2, len(cells)), np.intp)
    calm = np.flatnonzero(same.any(axis=0))
    points = cells.subset(calm).centres()
    # `vctune.proof.claims.model_poles` gives the reasons: the model's curve ends within a third of a turn of its limit;
    # the sampled loop's curve begins at F(1) > 0 and ends on the real axis
    if demands.passive:
        goal, end = final_angle(device, integral=bool(points.high[1].any())), model_curve_end(device, points)
        number[0, calm], boxes[0, calm] = _turns_at(claims.model_poles, points, end, 2 * pi, goal)
    number[1, calm], boxes[1, calm] = _turns_at(claims.sampled_poles, points, HALF_TURN, pi)
    number = np.where(same, number, np.nan)
    return Encirclements(number if demands.passive else number[1:], boxes, throughout)


def _turns_at(
    curve: Curve, points: Cells, end: float, turn: float, goal: float = 0.0, fixed: Values | None = None
) -> tuple[Floats, Integers]:
    """Return how often a curve goes around 0 at each point (nan if undecided), and the number of evaluated boxes."""
    test, angles = misses_zero(curve, fixed or {}), turned_angles(curve, fixed or {})
    found = cells_over_band(test, points, 0.0, end, angles)
    return np.where(found.proved, np.round((goal - found.total) / turn), np.nan), found.boxes


def _no_pole_crosses(demands: Demands, claims: Claims, cells: Cells) -> tuple[Flags, Integers]:
    """Return the cells within which no pole crosses the boundary, in the sampled loop and, if required, in the
    model."""
    boxes = np.zeros(len(cells), np.intp)

    def uncrossed(curve: Curve, sufficient: Margin, high: float) -> Flags:
        nonlocal boxes
        found = cells_over_band(misses_zero(curve, {}, sufficient), cells, 0.0, high)
        boxes = boxes + found.boxes
        return found.proved

    model = np.ones(len(cells), bool)
    if demands.passive:
        end = model_curve_end(demands.device, cells)
        model = uncrossed(claims.model_poles, claims.model_any_position, end)
    sampled = uncrossed(claims.sampled_poles, claims.sampled_any_position, HALF_TURN)
    return np.stack((model, sampled)), boxes


def encirclements_in_hand(demands: Demands, cells: Cells) -> tuple[Floats, Integers]:
    """Return how often the loop's curve in the middle hand of the box goes around 0, for each cell."""
    assert demands.hands is not None
    claims, number = claims_of(demands), np.full(len(cells), np.nan)
    same = cells_over_band(misses_zero(claims.poles_in_hand, _middle(demands)), cells, 0.0, HALF_TURN)
    calm = np.flatnonzero(same.proved)
    if len(calm):
        number[calm] = turns_in_hand(demands, cells.subset(calm).centres())
    return number, same.boxes


def turns_in_hand(demands: Demands, points: Cells) -> Floats:
    """Return how often the loop's curve in the middle hand of the box goes around 0, for single designs."""
    claims = claims_of(demands)
    turns, _ = _turns_at(claims.poles_in_hand, points, HALF_TURN, pi, fixed=_middle(demands))
    return turns


def _middle(demands: Demands) -> Values:
    """Return the parameters of the hand at the centre of the box, by name."""
    assert demands.hands is not None
    return demands.hands.middle.mapped(decimal).by_key


def model_curve_end(device: Device, cells: Cells, ops: Arithmetic = FLOATS) -> float:
    """Return a frequency above which the frequency model's curve cannot turn around 0 in any cell."""
    K_v, K_p = (float(row.max(initial=0.0)) for row in cells.high[:2])
    return (1 + NEAR) * max(curve_end(device, K_v, K_p, ops), NEAR / ops.magnitude(device.sample_time))
