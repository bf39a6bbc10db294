"""Estimate on a grid of frequencies where the constraints on cells of gains are hardest to meet."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass
from math import inf
from typing import Any

import numpy as np

from vctune.analysis.demands import response, sampled_span, slowest_resonance
from vctune.analysis.extrema import Floats, frequency_grid
from vctune.analysis.loops_in_hands import LoopsInHands, loops_in_any_hand, loops_in_hands
from vctune.analysis.sampled_loop import sensitivity_of
from vctune.design.variables import coupling_from
from vctune.model.coupling import coupling_impedance
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Coupling, Gains, SpringDamper
from vctune.model.hand_arrays import PlacesInHands
from vctune.model.loop.llewellyn import required_resistance
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.keys import KEYS
from vctune.model.problem import Problem
from vctune.model.sampled.hand_loop import offered
from vctune.proof.claims.damping import admissible_damping
from vctune.proof.claims.many_designs import Places
from vctune.proof.claims.margins_of_claims import inwards
from vctune.proof.enclosures.array_intervals import TINY, Flags
from vctune.proof.engine.boxes import Cells, Integers

POINTS_PER_DECADE = 24
LOOPS_AT_ONCE = 16
"""Number of loops whose arrays, a hundred hands at a hundred angles each, fit into the processor's cache. It only
affects speed."""
DAMPING = KEYS.index("coupling.damping")


def estimate(problems: Sequence[Problem], cells: Cells, *, free: bool) -> tuple[Floats, list[Places]]:
    """Evaluate the constraints at the centres of cells on a grid of frequencies.

    Parameters
    ----------
    problems : problems, all of whose constraints must be met
    cells : n cells
    free : whether each cell may have its own b_c

    Returns
    -------
    damping : a b_c with which the centre seems to meet the constraints of all problems; nan if there seems to be none
    places : for each problem, the places where its constraints are hardest to meet
    """
    least, most = cells.low[DAMPING].copy(), cells.high[DAMPING].copy()
    meets, places = np.ones(len(cells), bool), []
    for problem in problems:
        at = _hardest(problem, cells, free=free)
        least, most, meets = np.maximum(least, at.least), np.minimum(most, at.most), meets & at.meets
        places.append(at.places)
    damping = np.clip(np.sqrt(least) * np.sqrt(most), least, most) if free else cells.low[DAMPING].copy()
    return np.where(meets & (least <= most), damping, np.nan), places


@np.errstate(all="ignore")
def changes(problems: Sequence[Problem], cells: Cells, axes: tuple[int, int], *, free: bool) -> list[Floats]:
    """Return the logarithm by which the hardest constraint changes across each cell along two axes.

    Parameters
    ----------
    problems : problems, all of whose constraints must be met
    cells : n cells
    axes : rows of the cells
    free : whether each cell may have its own b_c

    Returns
    -------
    list of array of float
        One array for each axis, shape (n,); 0 where the change is not known.
    """
    middle, found = cells.centres(), list[Floats]()
    for axis in axes:
        ends = []
        for edge in (cells.low, cells.high):
            low, high = middle.low.copy(), middle.high.copy()
            low[axis] = high[axis] = edge[axis]
            if free:
                low[DAMPING], high[DAMPING] = cells.low[DAMPING], cells.high[DAMPING]
            at = Cells(low, high)
            ends.append(np.max([_hardest(problem, at, free=free).missed for problem in problems], axis=0))
        found.append(np.nan_to_num(np.abs(ends[1] - ends[0])))
    return found


@dataclass(frozen=True, slots=True)
class _Asked:
    """The requirement on the coupling at the centres of n cells.

    Attributes
    ----------
    omega : frequencies of the coupling, rad/s; for an impedance display theta, rad; shape (places,)
    needed : the least Re Z_c there, N s/m, or the least Re(1/Z_c)/s^2, shape (n, places)
    place : function that makes the place of each cell for `Places` from an index of `omega` for each
    """

    omega: Floats
    needed: Floats
    place: Callable[[Integers], Floats | PlacesInHands]


@dataclass(frozen=True, slots=True)
class _Hardest:
    """The places where the constraints on n cells are hardest to meet.

    Attributes
    ----------
    least, most : ends of the interval of b_c that meets the coupling's constraints if b_c is free, N s/m, shape (n,)
    meets : whether the other constraints are met, shape (n,)
    places : the hardest places
    missed : logarithm of the greatest violation at these places, over all constraints, shape (n,)
    """

    least: Floats
    most: Floats
    meets: Flags
    places: Places
    missed: Floats


def _hardest(problem: Problem, cells: Cells, *, free: bool) -> _Hardest:
    K_v, K_p, *of_coupling = cells.centres().low[:, :, None]
    coupling = coupling_from(of_coupling)
    least, most = np.zeros(len(cells)), np.full(len(cells), inf)
    meets, found, worst = np.ones(len(cells), bool), dict[str, Any](), np.full(len(cells), -inf)
    for name, asked in _asked(problem, K_v, K_p).items():
        if free and isinstance(coupling, Coupling):
            needed = asked.needed - coupling.drag
            low, high = admissible_damping(needed, coupling.mass * asked.omega)
            least, most = np.maximum(least, low.max(axis=1)), np.minimum(most, high.min(axis=1))
            hardest = [needed / np.maximum(asked.omega, TINY), low, -high]
            worst = np.maximum(worst, np.log(np.maximum(2 * hardest[0] / coupling.mass, TINY)).max(axis=1))
        else:
            scarcity = asked.needed / _offered(coupling, problem.device, asked.omega)
            meets &= scarcity.max(axis=1) <= 1
            hardest = [scarcity]
            worst = np.maximum(worst, np.log(np.maximum(scarcity, TINY)).max(axis=1))
        found[name] = _stacked([asked.place(np.argmax(hard, axis=1)) for hard in hardest])
    below = frequency_grid(
        *inwards((slowest_resonance(problem, problem.bounds.velocity.min), problem.nyquist)), POINTS_PER_DECADE
    )
    S = sensitivity_of(problem.device, Gains(K_v, K_p))(below)
    meets &= S.max(axis=1) <= problem.stability.max_sensitivity
    theta_S = below[np.argmax(S, axis=1)] * problem.device.sample_time
    worst = np.maximum(worst, np.log(S.max(axis=1) / problem.stability.max_sensitivity))
    if free:
        between = np.log(np.maximum(least, cells.low[DAMPING]) / np.minimum(most, cells.high[DAMPING]))
        worst = np.maximum(worst, np.where(np.isfinite(between), between, -inf))
    return _Hardest(least, most, meets, Places(theta_S, **found), worst)


def _stacked(places: Sequence[Any]) -> Any:
    """Return several places of each cell, the hardest first."""
    if isinstance(places[0], PlacesInHands):
        return places[0].mapped(lambda *each: np.stack(each), *places[1:])
    return np.stack(places)


def _offered(coupling: AnyCoupling, device: Device, place: Floats) -> Floats:
    if isinstance(coupling, SpringDamper):
        return np.asarray(offered(coupling, device, place, FLOATS))
    return np.asarray(coupling_impedance(coupling, place).re)


def _asked(problem: Problem, K_v: Floats, K_p: Floats) -> dict[str, _Asked]:
    """Return the requirements at some gains, arrays of shape (n, 1), by the names of `Places`."""
    device, factor, found = problem.device, problem.stability.safety_factor, {}
    if problem.passive:
        omega = frequency_grid(*inwards(sampled_span(problem)), POINTS_PER_DECADE)
        loop = response(device, Gains(K_v, K_p), omega)
        # where the resistance is not positive, no coupling suffices
        needed = np.where(loop.resistance > 0, factor * required_resistance(loop, FLOATS), inf)
        found["omega"] = _Asked(omega, needed, lambda which: omega[which])
    if problem.hands_met is not None:
        found["in_hands"] = _asked_in_hands(loops_in_hands(device, problem.hands_met), device, factor, Gains(K_v, K_p))
    if problem.any_hand:
        at = loops_in_any_hand(device)
        found["theta"] = _Asked(at.theta, factor * at.required(Gains(K_v, K_p)), lambda which: at.theta[which])
    return found


def _asked_in_hands(at: LoopsInHands, device: Device, factor: float, gains: Gains) -> _Asked:
    """Return the requirement at each angle in the worst hand at that angle."""
    few, same = np.unique(np.hstack(astuple(gains)), axis=0, return_inverse=True)  # cells of a plane share gains
    needed, worst = np.empty((2, len(few), at.theta.size))
    for i in range(0, len(few), LOOPS_AT_ONCE):
        some = Gains(*few[i : i + LOOPS_AT_ONCE].T[..., None, None])
        R = np.nan_to_num(at.required(some), nan=0.0)
        needed[i : i + LOOPS_AT_ONCE], worst[i : i + LOOPS_AT_ONCE] = factor * R.max(axis=1), R.argmax(axis=1)
    needed, worst = needed[same], worst[same]

    def place(which: Integers) -> PlacesInHands:
        hand = worst[np.arange(len(which)), which].astype(np.intp)
        return PlacesInHands(at.theta[which], at.hands.mapped(lambda number: number[hand]))

    met = at.theta if device.kind.inverse else np.tan(at.theta / 2) * (2 / device.sample_time)
    return _Asked(met, needed, place)
