"""Estimate the frequencies of a grid at which the constraints on cells of gains are hardest to meet."""

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
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Coupling, Gains, SpringDamper, coupling_impedance
from vctune.model.hand_arrays import PlacesInHands
from vctune.model.loop.llewellyn import required_resistance
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.keys import KEYS
from vctune.model.problem import Problem
from vctune.model.sampled.hand_loop import offered
from vctune.proof.boxes import Cells, Integers
from vctune.proof.claims.cells import Places, admissible_damping
from vctune.proof.claims.margins_of_claims import inwards
from vctune.proof.enclosures.intervals import TINY, Flags

COUPLING_DAMPING = KEYS.index("coupling.damping")
POINTS_PER_DECADE = 24  # Number of frequencies per decade of the grids
# Number of loops whose arrays, with a hundred hands at a hundred angles each, fit into the processor's cache
LOOPS_AT_ONCE = 16


@dataclass(frozen=True, slots=True)
class Estimate:
    """Estimates in double precision for the designs at the centres of n cells."""

    damping: Floats
    places: list[Places]  # for each problem, the places where its constraints are hardest to meet


def estimate(problems: Sequence[Problem], cells: Cells, *, free: bool) -> Estimate:
    """Return where, on a grid of frequencies, the constraints are hardest to meet at the centres of cells, and which
    centres meet them."""
    least, most = cells.low[COUPLING_DAMPING].copy(), cells.high[COUPLING_DAMPING].copy()
    meets, places = np.ones(len(cells), bool), []
    for problem in problems:
        hardest = _hardest_places(problem, cells, free=free)
        least, most, meets = np.maximum(least, hardest.least), np.minimum(most, hardest.most), meets & hardest.meets
        places.append(hardest.places)
    damping = np.clip(np.sqrt(least) * np.sqrt(most), least, most) if free else cells.low[COUPLING_DAMPING].copy()
    return Estimate(np.where(meets & (least <= most), damping, np.nan), places)


@np.errstate(all="ignore")
def changes(problems: Sequence[Problem], cells: Cells, axes: tuple[int, int], *, free: bool) -> list[Floats]:
    """Return the logarithm of the factor by which the hardest constraint changes across each cell along two axes."""
    middle, changes_by_axis = cells.centres(), list[Floats]()
    for axis in axes:
        ends = []
        for edge in (cells.low, cells.high):
            low, high = middle.low.copy(), middle.high.copy()
            low[axis] = high[axis] = edge[axis]
            if free:
                low[COUPLING_DAMPING] = cells.low[COUPLING_DAMPING]
                high[COUPLING_DAMPING] = cells.high[COUPLING_DAMPING]
            edge_cells = Cells(low, high)
            ends.append(
                np.max([_hardest_places(problem, edge_cells, free=free).missed for problem in problems], axis=0)
            )
        changes_by_axis.append(np.nan_to_num(np.abs(ends[1] - ends[0])))
    return changes_by_axis


@dataclass(frozen=True, slots=True)
class _Requirement:
    """The requirement on the coupling at the centres of n cells."""

    omega: Floats  # frequencies of the coupling, rad/s; for an impedance display theta = omega T, rad; shape (places,)
    required: Floats  # the least Re Z_c there, N s/m, or the least Re(1/Z_c)/s^2, m/(N s), with the safety factor
    place: Callable[[Integers], Floats | PlacesInHands]  # function of one index into `omega` for each cell


@dataclass(frozen=True, slots=True)
class _Hardest:
    """The places where the constraints on n cells are hardest to meet."""

    least: Floats  # ends of the interval of b_c that meets the coupling's constraints if b_c is free, N s/m, shape (n,)
    most: Floats
    meets: Flags  # whether the other constraints are met, which include the coupling's if b_c is not free, shape (n,)
    places: Places  # the hardest places
    missed: Floats  # logarithm of the factor by which the centre misses the hardest of all constraints, shape (n,)


def _hardest_places(problem: Problem, cells: Cells, *, free: bool) -> _Hardest:
    """Return the places of one problem where the constraints are hardest to meet at the centres of cells."""
    K_v, K_p, *of_coupling = cells.centres().low[:, :, None]
    coupling = coupling_from(of_coupling)
    least, most = np.zeros(len(cells)), np.full(len(cells), inf)
    meets, places_by_name, worst = np.ones(len(cells), bool), dict[str, Any](), np.full(len(cells), -inf)
    for name, requirement in _requirements(problem, K_v, K_p).items():
        if free and isinstance(coupling, Coupling):
            required = requirement.required - coupling.drag
            low, high = admissible_damping(required, coupling.mass * requirement.omega)
            # three places: where r/omega is greatest, and where the interval of b_c begins highest and ends lowest;
            # no b_c suffices if 2 r > omega m_c (`proof.claims.damping`)
            least, most = np.maximum(least, low.max(axis=1)), np.minimum(most, high.min(axis=1))
            hardness = [required / np.maximum(requirement.omega, TINY), low, -high]
            worst = np.maximum(worst, np.log(np.maximum(2 * hardness[0] / coupling.mass, TINY)).max(axis=1))
        else:
            scarcity = requirement.required / _offered(coupling, problem.device, requirement.omega)
            meets &= scarcity.max(axis=1) <= 1
            hardness = [scarcity]
            worst = np.maximum(worst, np.log(np.maximum(scarcity, TINY)).max(axis=1))
        places_by_name[name] = _stacked([requirement.place(np.argmax(hard, axis=1)) for hard in hardness])
    peak, theta_S = _peak_of_sensitivity(problem, Gains(K_v, K_p))
    meets &= peak <= problem.stability.max_sensitivity
    worst = np.maximum(worst, np.log(peak / problem.stability.max_sensitivity))
    if free:
        gap = np.log(np.maximum(least, cells.low[COUPLING_DAMPING]) / np.minimum(most, cells.high[COUPLING_DAMPING]))
        worst = np.maximum(worst, np.where(np.isfinite(gap), gap, -inf))
    return _Hardest(least, most, meets, Places(theta_S, **places_by_name), worst)


def _peak_of_sensitivity(problem: Problem, gains: Gains) -> tuple[Floats, Floats]:
    """Return the greatest |S| of loops with gains of shape (n, 1), and the angles omega T at which it occurs."""
    below = frequency_grid(
        *inwards((slowest_resonance(problem, problem.bounds.velocity.min), problem.nyquist)), POINTS_PER_DECADE
    )
    S = sensitivity_of(problem.device, gains)(below)
    return S.max(axis=1), below[np.argmax(S, axis=1)] * problem.device.sample_time


def _stacked(places: Sequence[Any]) -> Any:
    """Return several places of each cell as one array, or one set of arrays, of shape (places, n)."""
    if isinstance(places[0], PlacesInHands):
        return places[0].mapped(lambda *arrays: np.stack(arrays), *places[1:])
    return np.stack(places)


def _offered(coupling: AnyCoupling, device: Device, place: Floats) -> Floats:
    """Return the quantity of a coupling that must meet a requirement: Re Z_c, or Re(1/Z_c)/s^2 for an impedance
    display."""
    if isinstance(coupling, SpringDamper):
        return np.asarray(offered(coupling, device, place, FLOATS))
    return np.asarray(coupling_impedance(coupling, place).re)


def _requirements(problem: Problem, K_v: Floats, K_p: Floats) -> dict[str, _Requirement]:
    """Return the requirements that gains of shape (n, 1) impose on the coupling, by the names of `Places`' fields."""
    device, factor, requirements = problem.device, problem.stability.safety_factor, {}
    if problem.passive:
        omega = frequency_grid(*inwards(sampled_span(problem)), POINTS_PER_DECADE)
        loop = response(device, Gains(K_v, K_p), omega)
        # where the resistance is not positive, no coupling suffices
        required = np.where(loop.resistance > 0, factor * required_resistance(loop, FLOATS), inf)
        requirements["omega"] = _Requirement(omega, required, lambda index: omega[index])
    if problem.hands_met is not None:
        requirements["in_hands"] = _requirement_in_hands(
            loops_in_hands(device, problem.hands_met), device, factor, Gains(K_v, K_p)
        )
    if problem.any_hand:
        loops = loops_in_any_hand(device)
        requirements["theta"] = _Requirement(
            loops.theta, factor * loops.required(Gains(K_v, K_p)), lambda index: loops.theta[index]
        )
    return requirements


def _requirement_in_hands(loops: LoopsInHands, device: Device, factor: float, gains: Gains) -> _Requirement:
    """Return the requirement at each angle in the worst hand at that angle, from gains of shape (n, 1)."""
    distinct, position = np.unique(
        np.hstack(astuple(gains)), axis=0, return_inverse=True
    )  # many cells have the same gains
    required, worst = np.empty((2, len(distinct), loops.theta.size))
    for i in range(0, len(distinct), LOOPS_AT_ONCE):
        batch = Gains(*distinct[i : i + LOOPS_AT_ONCE].T[..., None, None])
        R = np.nan_to_num(loops.required(batch), nan=0.0)
        required[i : i + LOOPS_AT_ONCE], worst[i : i + LOOPS_AT_ONCE] = factor * R.max(axis=1), R.argmax(axis=1)
    required, worst = required[position], worst[position]

    def place(index: Integers) -> PlacesInHands:
        hand = worst[np.arange(len(index)), index].astype(np.intp)
        return PlacesInHands(loops.theta[index], loops.hands.mapped(lambda number: number[hand]))

    coupling_axis = loops.theta if device.kind.inverse else np.tan(loops.theta / 2) * (2 / device.sample_time)
    return _Requirement(coupling_axis, required, place)
