"""The feasible gains as a set: cells proved feasible throughout, proved infeasible throughout, or undecided."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, replace
from enum import IntEnum
from math import inf

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.demands import response, sampled_span, slowest_resonance
from vctune.analysis.extrema import Floats, frequency_grid
from vctune.analysis.in_hands import LoopsInHands, hardest_near, loops_in_any_hand, loops_in_hands
from vctune.analysis.sampled_loop import sensitivity_of
from vctune.design.prepared import of_one_device, pose, problems_beside
from vctune.design.variables import coupling_from
from vctune.model.coupling import coupling_impedance
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Coupling, Gains, SpringDamper
from vctune.model.loop.llewellyn import required_resistance
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.keys import KEYS
from vctune.model.problem import Problem
from vctune.model.sampled.hand_loop import offered
from vctune.proof.claims.damping import admissible_damping, no_damping
from vctune.proof.claims.many_designs import Places, prove, refuted
from vctune.proof.claims.margins_of_claims import inwards
from vctune.proof.enclosures.array_intervals import TINY, Flags
from vctune.proof.engine.boxes import Cells, Integers
from vctune.running import OutOfTimeError, out_of_time
from vctune.study.plane import Plane, Squares, halved

POINTS_PER_DECADE = 24
TOGETHER = 512
"""Cells judged together: what is known of them fits into memory."""
LOOPS_AT_ONCE = 16
"""Loops whose arrays, a hundred hands at a hundred angles each, stay in the processor's cache; of no consequence but
speed."""
DAMPING = KEYS.index("coupling.damping")
EASING = "coupling.mass", "coupling.drag"
"""Variables of which more eases the demands."""

Progress = Callable[[str], None]


class Kind(IntEnum):
    """The verdict on a cell."""

    UNDECIDED = 0
    FEASIBLE = 1
    INFEASIBLE = 2


Kinds = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Region:
    """The cells of a plane, each with its verdict.

    Attributes
    ----------
    plane : the variables and their edges
    squares : the cells, shape (4, n)
    kinds : of each cell, `Kind`
    damping : for each feasible cell a b_c that serves all of it, N s/m, when the problem leaves b_c free; else nan
    interrupted : whether cells were left undecided that had not been looked at, or could have been divided
    """

    plane: Plane
    squares: Squares
    kinds: Kinds
    damping: Floats
    interrupted: bool = False

    def area(self, kind: Kind) -> float:
        """Return the share of the plane that is of this kind."""
        return float(self.plane.areas(self.squares)[self.kinds == kind].sum())


def region(
    problem: Problem,
    plane: Plane,
    squares: Squares,
    progress: Progress = lambda stage: None,
    stopped: Callable[[], bool] = lambda: False,
) -> Region:
    """Divide cells of a plane of gains until each is decided or as small as the plane's edges allow.

    Where b_c, m_c or b_0 are free and not on an axis, feasible means that some values within their bounds will do. The
    demands ease as m_c and b_0 grow, so that their upper bounds decide. Coarse cells come before fine ones, so that a
    search that is stopped has decided most of the plane that it could in its time.

    Parameters
    ----------
    problem : one without `plane_errors` in the plane
    plane : the variables and the edges of the finest cells
    squares : cells to begin with, shape (4, n)
    progress : told what share of the plane is decided
    stopped : whether to give up now; asked before each `TOGETHER` cells. The time limit ends it earlier

    Returns
    -------
    Region
        The cells that those are divided into, in no particular order.
    """
    one = of_one_device(problem)
    assert one is not None
    problems = [one, *problems_beside(one)]
    return divided(plane, squares, lambda some: _judged(problems, plane, some), progress, stopped)


def divided(
    plane: Plane,
    squares: Squares,
    judged: Callable[[Squares], tuple[Kinds, Floats]],
    progress: Progress = lambda stage: None,
    stopped: Callable[[], bool] = lambda: False,
) -> Region:
    """Divide cells of a plane until each is decided or as small as the plane's edges allow.

    Parameters
    ----------
    plane, squares, progress, stopped : as of `region`
    judged : returns what can be proved of some cells, and a b_c of each; nan for none

    Returns
    -------
    Region
        The cells that those are divided into, in no particular order.
    """
    done, decided = list[tuple[Squares, Kinds, Floats]](), 0.0
    while squares.shape[1] and not (stopped() or out_of_time()):
        progress(f"{decided:.1%} of the plane decided, {squares.shape[1]} cells open")
        first, rest = np.split(squares, [TOGETHER], axis=1)
        try:
            kinds, damping = judged(first)
        except OutOfTimeError:
            break
        squares = rest
        size = np.maximum(first[1] - first[0], first[3] - first[2])
        decided += plane.areas(first)[kinds != Kind.UNDECIDED].sum()
        settled = (kinds != Kind.UNDECIDED) | (size == 1)
        done.append((first[:, settled], kinds[settled], damping[settled]))
        squares = np.concatenate((squares, halved(first[:, ~settled])), axis=1)
    left = squares.shape[1]
    done.append((squares, np.full(left, Kind.UNDECIDED, np.intp), np.full(left, np.nan)))
    cells, kinds, damping = (np.concatenate(part, axis=-1) for part in zip(*done, strict=True))
    return Region(plane, cells, kinds, damping, interrupted=left > 0)


def free_damping(plane: Plane) -> bool:
    """Return whether each cell may have a b_c of its own."""
    return plane.at_full_width(KEYS[DAMPING])


def easiest(cells: Cells, plane: Plane) -> Cells:
    """Return the cells with m_c and b_0 at their upper bounds where they are free.

    Parameters
    ----------
    cells : boxes of the variables, SI units, n of them
    plane : says which variables are axes
    """
    low = cells.low.copy()
    for index in (KEYS.index(key) for key in EASING if plane.at_full_width(key)):
        low[index] = cells.high[index]
    return Cells(low, cells.high)


def with_damping(cells: Cells, damping: Floats) -> Cells:
    """Return the cells with b_c fixed where a value is given.

    Parameters
    ----------
    cells : boxes of the variables, n of them
    damping : b_c, N s/m, shape (n,); nan where the cell keeps its range
    """
    low, high = cells.low.copy(), cells.high.copy()
    given = np.isfinite(damping)
    low[DAMPING, given] = high[DAMPING, given] = damping[given]
    return Cells(low, high)


@np.errstate(all="ignore")
def _judged(problems: Sequence[Problem], plane: Plane, squares: Squares) -> tuple[Kinds, Floats]:
    """Return the verdict on each cell, and the b_c of a feasible one if it is free.

    Parameters
    ----------
    problems : all of which a feasible cell meets: those of the stated delay and of others beside it
    plane, squares : the cells

    Returns
    -------
    kinds : of each cell, `Kind`, shape (n,)
    damping : N s/m, shape (n,); nan where the cell is not feasible, or b_c is fixed or an axis
    """
    cells, free = easiest(plane.cells(squares), plane), free_damping(plane)
    damping, places = _estimate(problems, cells, free=free)
    kinds = np.full(len(cells), Kind.UNDECIDED)
    served = with_damping(cells, damping) if free else cells
    hopeful = np.flatnonzero(~np.isnan(damping))
    for problem in problems:
        hopeful = hopeful[prove(pose(problem).demands, served.subset(hopeful)).proved]
    kinds[hopeful] = Kind.FEASIBLE
    for problem, hardest in zip(problems, places, strict=True):
        left = np.flatnonzero(kinds == Kind.UNDECIDED)
        kinds[left[_lost(problem, cells.subset(left), hardest.subset(left), free=free)]] = Kind.INFEASIBLE
    return kinds, np.where((kinds == Kind.FEASIBLE) & free, damping, np.nan)


def _lost(problem: Problem, cells: Cells, places: Places, *, free: bool) -> Flags:
    """Return which cells are proved to hold no design that meets a problem's demands."""
    demands = pose(problem).demands
    lost = refuted(demands, cells, places)
    if free:
        lost |= no_damping(demands, cells, places)
    elif places.in_hands is not None and not lost.all():
        near = np.flatnonzero(~lost)
        some = cells.subset(near)
        lost[near] = refuted(demands, some, _closer(problem, some, places.subset(near)))
    return lost


def _closer(problem: Problem, cells: Cells, places: Places) -> Places:
    """Return the places with the hands and the angles next to those that ask most of the centres."""
    assert problem.hands_met is not None and places.in_hands is not None
    K_v, K_p, *of_coupling = cells.centres().low[:, :, None, None]
    at, *hand = places.in_hands[:, 0]
    coupling = coupling_from(of_coupling)
    _, theta, hands = hardest_near(problem.device, problem.hands_met, Gains(K_v, K_p), coupling, at, np.array(hand))
    return replace(places, in_hands=np.vstack((theta, hands))[:, None])


@dataclass(frozen=True, slots=True)
class _Asked:
    """The requirement on the coupling at the centres of n cells.

    Attributes
    ----------
    omega : rad/s, at which the coupling is met, of an impedance display theta, rad, shape (places,)
    needed : the least Re Z_c there, N s/m, or Re(1/Z_c)/s^2, shape (n, places)
    place : the place of each cell as `Places` has it, from one of these numbers each
    """

    omega: Floats
    needed: Floats
    place: Callable[[Integers], Floats]


def _estimate(problems: Sequence[Problem], cells: Cells, *, free: bool) -> tuple[Floats, list[Places]]:
    """Look at the centres on a grid of frequencies.

    Returns
    -------
    damping : a b_c with which the centre meets the demands of all problems; nan if there seems to be none
    places : of each problem, where they are hardest to meet
    """
    least, most = cells.low[DAMPING].copy(), cells.high[DAMPING].copy()
    meets, places = np.ones(len(cells), bool), []
    for problem in problems:
        at = _hardest(problem, cells, free=free)
        least, most, meets = np.maximum(least, at.least), np.minimum(most, at.most), meets & at.meets
        places.append(at.places)
    damping = np.clip(np.sqrt(least) * np.sqrt(most), least, most) if free else cells.low[DAMPING].copy()
    return np.where(meets & (least <= most), damping, np.nan), places


@dataclass(frozen=True, slots=True)
class _Hardest:
    """Where the demands on n cells are hardest to meet.

    Attributes
    ----------
    least, most : b_c between which the coupling's demands are met where it is free, N s/m, shape (n,)
    meets : whether the others are, shape (n,)
    places : where
    """

    least: Floats
    most: Floats
    meets: Flags
    places: Places


def _hardest(problem: Problem, cells: Cells, *, free: bool) -> _Hardest:
    K_v, K_p, *of_coupling = cells.centres().low[:, :, None]
    coupling = coupling_from(of_coupling)
    least, most = np.zeros(len(cells)), np.full(len(cells), inf)
    meets, found = np.ones(len(cells), bool), dict[str, Floats]()
    for name, asked in _asked(problem, K_v, K_p).items():
        if free and isinstance(coupling, Coupling):
            needed = asked.needed - coupling.drag
            low, high = admissible_damping(needed, coupling.mass * asked.omega)
            least, most = np.maximum(least, low.max(axis=1)), np.minimum(most, high.min(axis=1))
            hardest = [needed / np.maximum(asked.omega, TINY), low, -high]
        else:
            scarcity = asked.needed / _offered(coupling, problem.device, asked.omega)
            meets &= scarcity.max(axis=1) <= 1
            hardest = [scarcity]
        found[name] = np.stack([asked.place(np.argmax(hard, axis=1)) for hard in hardest], axis=-2)
    below = frequency_grid(
        *inwards((slowest_resonance(problem, problem.bounds.velocity.min), problem.nyquist)), POINTS_PER_DECADE
    )
    S = sensitivity_of(problem.device, Gains(K_v, K_p))(below)
    meets &= S.max(axis=1) <= problem.stability.max_sensitivity
    theta_S = below[np.argmax(S, axis=1)] * problem.device.sample_time
    return _Hardest(least, most, meets, Places(theta_S, **found))


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
        # where the resistance is not positive nothing will do
        needed = np.where(loop.resistance > 0, factor * required_resistance(loop, FLOATS), inf)
        found["omega"] = _Asked(omega, needed, lambda which: omega[which])
    if problem.hands_met is not None:
        found["in_hands"] = _asked_in_hands(loops_in_hands(device, problem.hands_met), device, factor, Gains(K_v, K_p))
    if problem.any_hand:
        at = loops_in_any_hand(device)
        found["theta"] = _Asked(at.theta, factor * at.required(Gains(K_v, K_p)), lambda which: at.theta[which])
    return found


def _asked_in_hands(at: LoopsInHands, device: Device, factor: float, gains: Gains) -> _Asked:
    """Return the same at each angle in the worst hand there."""
    few, same = np.unique(np.hstack(astuple(gains)), axis=0, return_inverse=True)  # cells of a plane share some
    needed, worst = np.empty((2, len(few), at.theta.size))
    for i in range(0, len(few), LOOPS_AT_ONCE):
        some = Gains(*few[i : i + LOOPS_AT_ONCE].T[..., None, None])
        R = np.nan_to_num(at.required(some), nan=0.0)
        needed[i : i + LOOPS_AT_ONCE], worst[i : i + LOOPS_AT_ONCE] = factor * R.max(axis=1), R.argmax(axis=1)
    needed, worst = needed[same], worst[same]

    def place(which: Integers) -> Floats:
        hand = worst[np.arange(len(which)), which].astype(np.intp)
        return np.stack((at.theta[which], *(number[hand] for number in astuple(at.hands))))

    met = at.theta if device.kind.inverse else np.tan(at.theta / 2) * (2 / device.sample_time)
    return _Asked(met, needed, place)
