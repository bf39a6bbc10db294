"""Estimate in which hands and at which angles a box of environments is hardest to render, for cells of gains."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.analysis.hardest_hands import needs_in_hands
from vctune.analysis.loops_in_hands import SHARES, LoopsInHands, loops_in_hands
from vctune.design.variables import coupling_from
from vctune.model.gains import Gains
from vctune.model.hand_arrays import PlacesInHands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.keys import KEYS
from vctune.model.problem import Problem
from vctune.model.sampled.hand_loop import loop_in_hand
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.proof.engine.boxes import Cells

# Row of b_c among the variables of a design, for each kind of display
COUPLING_DAMPING = KEYS.index("coupling.damping")
# Number of designs whose arrays, with a hundred hands at a hundred angles each, fit into the processor's cache
LOOPS_AT_ONCE = 2
# Number of values of b_c that the estimate tries for each cell
DAMPINGS, FEW_SHARES, FEW_ANGLES = 24, (0.0, 0.1, 1.0), 12


def worst_places(problem: Problem, points: Cells, *, few: bool = False) -> tuple[Floats, PlacesInHands]:
    """For each design, return 1/ratio in the worst hand at the worst angle omega T, and this hand and angle as a
    place."""
    assert problem.hands_met is not None
    loops = loops_in_hands(problem.device, problem.hands_met, *((FEW_SHARES, FEW_ANGLES) if few else (SHARES,)))
    need, worst = np.zeros(len(points)), np.zeros(len(points), np.intp)
    for i in range(0, len(points), LOOPS_AT_ONCE):
        batch = slice(i, i + LOOPS_AT_ONCE)
        needs = _needs(problem, loops, points.low[:, batch])
        worst[batch] = np.argmax(needs, axis=1)
        need[batch] = needs[np.arange(len(needs)), worst[batch]]
    hand, angle = np.divmod(worst, loops.theta.size)
    return need, PlacesInHands(loops.theta[angle], loops.hands.mapped(lambda number: number[hand]))


def _needs(problem: Problem, loops: LoopsInHands, numbers: Floats) -> Floats:
    """Return 1/ratio of designs at all angles in all hands, shape (designs, hands and angles)."""
    gains, coupling = numbers[:2, :, None, None], coupling_from([*numbers[2:, :, None, None]])
    with np.errstate(all="ignore"):
        needs = needs_in_hands(loops.loop, problem.device, Gains(*gains), coupling, loops.theta, problem.worlds_met)
    return np.nan_to_num(needs, nan=0.0, posinf=np.finfo(float).max).reshape(numbers.shape[1], -1)


def need_at(problem: Problem, points: Cells, places: PlacesInHands) -> Floats:
    """Return 1/ratio of each design at its own place, shape (n,)."""
    device, numbers = problem.device, points.low
    loop = loop_in_hand(plant_in_hand(device, places.hands, delays_of(device), FLOATS), places.at, FLOATS)
    coupling = coupling_from([*numbers[2:]])
    with np.errstate(all="ignore"):
        need = needs_in_hands(loop, device, Gains(*numbers[:2]), coupling, places.at, problem.worlds_met)
    return np.nan_to_num(need, nan=0.0, posinf=np.finfo(float).max)


def best_damping(problems: Sequence[Problem], cells: Cells) -> Floats:
    """For each cell, return the damping b_c of the coupling that is best at the cell's centre, N s/m, shape (n,)."""
    dampings = np.geomspace(cells.low[COUPLING_DAMPING], cells.high[COUPLING_DAMPING], DAMPINGS)
    middle, needs = np.tile(cells.centres().low, DAMPINGS), np.zeros(dampings.size)
    middle[COUPLING_DAMPING] = dampings.ravel()
    for problem in problems:
        needs = np.maximum(needs, worst_places(problem, Cells(middle, middle), few=True)[0])
    least = np.argmin(needs.reshape(dampings.shape), axis=0)
    return np.asarray(dampings[least, np.arange(len(cells))])
