"""Estimate on a grid of frequencies where the constraints on cells of gains are hardest to meet."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, replace
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
from vctune.model.problem import Problem
from vctune.model.sampled.hand_loop import offered
from vctune.proof.claims.damping import admissible_damping
from vctune.proof.claims.many_designs import Places
from vctune.proof.claims.margins_of_claims import inwards
from vctune.proof.enclosures.array_intervals import TINY, Flags
from vctune.proof.engine.boxes import Cells, Integers
from vctune.study.estimate_in_worlds import DAMPING, best_damping, need_at, worst_places

POINTS_PER_DECADE = 24
LOOPS_AT_ONCE = 16
"""Number of loops whose arrays, a hundred hands at a hundred angles each, fit into the processor's cache. It only
affects speed."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """What seems to be true of the designs at the centres of n cells.

    Attributes
    ----------
    damping : a b_c with which the centre seems to meet the constraints of all problems; nan if there seems to be none
    places : for each problem, the places where its constraints are hardest to meet
    missed : for each problem, whether the centre misses its constraint in hands with every b_c, shape (n,)
    """

    damping: Floats
    places: list[Places]
    missed: list[Flags]


def estimate(problems: Sequence[Problem], cells: Cells, *, free: bool) -> Estimate:
    """Return where the constraints are hardest to meet at the centres of cells, on a grid of frequencies.

    Parameters
    ----------
    problems : problems, all of whose constraints must be met
    cells : n cells
    free : whether each cell may have its own b_c
    """
    if problems[0].worlds is not None:
        return _estimate_in_worlds(problems, cells, free=free)
    least, most = cells.low[DAMPING].copy(), cells.high[DAMPING].copy()
    meets, places, missed = np.ones(len(cells), bool), [], []
    for problem in problems:
        at = _hardest(problem, cells, free=free)
        least, most, meets = np.maximum(least, at.least), np.minimum(most, at.most), meets & at.meets
        places.append(at.places)
        missed.append(at.least > at.most if free else ~at.meets)
    damping = np.clip(np.sqrt(least) * np.sqrt(most), least, most) if free else cells.low[DAMPING].copy()
    return Estimate(np.where(meets & (least <= most), damping, np.nan), places, missed)


def _estimate_in_worlds(problems: Sequence[Problem], cells: Cells, *, free: bool) -> Estimate:
    """Return `estimate` with a box of environments."""
    damping = _damping_in_worlds(problems, cells) if free else cells.low[DAMPING].copy()
    middle, meets, places, missed = _with_damping(cells.centres(), damping), np.ones(len(cells), bool), [], []
    for problem in problems:
        need, at = worst_places(problem, middle)
        peak, theta_S = _peak_of_sensitivity(problem, Gains(*middle.low[:2, :, None]))
        missed.append(need * problem.stability.safety_factor > 1)
        meets &= ~missed[-1] & (peak <= problem.stability.max_sensitivity)
        places.append(Places(theta_S, in_hands=at[None]))
    return Estimate(np.where(meets, damping, np.nan), places, missed)


def _damping_in_worlds(problems: Sequence[Problem], cells: Cells) -> Floats:
    """Return a b_c that bears every passive environment, which is found at once, or else the best one."""
    damping = estimate([replace(problem, worlds=None) for problem in problems], cells, free=True).damping
    left = np.isnan(damping)
    if left.any():
        damping[left] = best_damping(problems, cells.subset(left))
    return damping


def _with_damping(points: Cells, damping: Floats) -> Cells:
    """Return designs with another b_c."""
    numbers = points.low.copy()
    numbers[DAMPING] = damping
    return Cells(numbers, numbers)


@np.errstate(all="ignore")
def _changes_in_worlds(problems: Sequence[Problem], cells: Cells, axes: tuple[int, int], *, free: bool) -> list[Floats]:
    """Return `changes` with a box of environments, at the places that are worst at the centres."""
    middle = cells.centres()
    if free:
        middle = _with_damping(middle, _damping_in_worlds(problems, cells))
    places, found = [worst_places(problem, middle)[1] for problem in problems], list[Floats]()
    for axis in axes:
        ends = []
        for edge in (cells.low, cells.high):
            numbers = middle.low.copy()
            numbers[axis] = edge[axis]
            ends.append(
                np.max([_missed_at(each, numbers, at) for each, at in zip(problems, places, strict=True)], axis=0)
            )
        found.append(np.nan_to_num(np.abs(ends[1] - ends[0])))
    return found


def _missed_at(problem: Problem, numbers: Floats, places: PlacesInHands) -> Floats:
    """Return the logarithm by which designs miss the hardest constraint, in hands each at its own place."""
    need = need_at(problem, Cells(numbers, numbers), places) * problem.stability.safety_factor
    peak, _ = _peak_of_sensitivity(problem, Gains(*numbers[:2, :, None]))
    return np.maximum(np.log(np.maximum(need, TINY)), np.log(peak / problem.stability.max_sensitivity))


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
    if problems[0].worlds is not None:
        return _changes_in_worlds(problems, cells, axes, free=free)
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
    peak, theta_S = _peak_of_sensitivity(problem, Gains(K_v, K_p))
    meets &= peak <= problem.stability.max_sensitivity
    worst = np.maximum(worst, np.log(peak / problem.stability.max_sensitivity))
    if free:
        between = np.log(np.maximum(least, cells.low[DAMPING]) / np.minimum(most, cells.high[DAMPING]))
        worst = np.maximum(worst, np.where(np.isfinite(between), between, -inf))
    return _Hardest(least, most, meets, Places(theta_S, **found), worst)


def _peak_of_sensitivity(problem: Problem, gains: Gains) -> tuple[Floats, Floats]:
    """Return the greatest |S| of loops with gains of shape (n, 1), and the angles omega T at which it occurs."""
    below = frequency_grid(
        *inwards((slowest_resonance(problem, problem.bounds.velocity.min), problem.nyquist)), POINTS_PER_DECADE
    )
    S = sensitivity_of(problem.device, gains)(below)
    return S.max(axis=1), below[np.argmax(S, axis=1)] * problem.device.sample_time


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
