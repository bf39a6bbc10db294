"""Estimate the frequencies of a grid at which the constraints on cells of gains are hardest to meet."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from math import inf

import numpy as np

from vctune.analysis.before_wall import LoopsBeforeWall
from vctune.analysis.demands import sampled_span, slowest_resonance
from vctune.analysis.extrema import Floats, frequency_grid
from vctune.analysis.in_hands import ratio_before_wall
from vctune.analysis.loops_in_hands import loops_in_any_hand
from vctune.analysis.requirement import requirements
from vctune.analysis.sampled_loop import sensitivity_of
from vctune.analysis.worst_hand import first_hands
from vctune.design.variables import coupling_from
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains, SpringDamper
from vctune.model.hands import Hands, PlacesInHands
from vctune.model.numbers.units import KEYS
from vctune.model.problem import Problem
from vctune.proof.boxes import Cells
from vctune.proof.cells import Places, admissible_damping
from vctune.proof.claims.any_hand import WALL_IN_ANY_HAND
from vctune.proof.claims.band import inwards
from vctune.proof.claims.claim import ClaimId
from vctune.proof.claims.damping import DAMPING
from vctune.proof.claims.sensitivity import SENSITIVITY
from vctune.proof.claims.wall_in_hands import WALL_IN_HANDS
from vctune.proof.claims.worlds import WORLDS
from vctune.proof.enclosures.intervals import TINY, Flags
from vctune.study.region_places import Limits, hard_places, limits_in_worlds, limits_on_curve

COUPLING_DAMPING = KEYS.index("coupling.damping")
LOWEST = 1e-4  # Least angle of the grid for walls, rad
POINTS_PER_DECADE = 24  # Number of frequencies per decade of the grids


@dataclass(frozen=True, slots=True)
class Estimate:
    """Estimates in double precision for the designs at the centres of n cells."""

    damping: Floats  # b_c that meets the constraints; nan if they are not met
    places: list[Places]  # for each problem, the places where its constraints are hardest to meet


def estimate(problems: Sequence[Problem], cells: Cells, *, free: bool) -> Estimate:
    """Return where, on a grid of frequencies, the constraints are hardest to meet at the centres of cells, and which
    centres meet them."""
    each = [_hardest_places(problem, cells, free=free) for problem in problems]
    least = np.maximum.reduce([cells.low[COUPLING_DAMPING], *(hardest.least for hardest in each)])
    most = np.minimum.reduce([cells.high[COUPLING_DAMPING], *(hardest.most for hardest in each)])
    meets = np.logical_and.reduce([least <= most, *(hardest.meets for hardest in each)])
    damping = np.clip(np.sqrt(least) * np.sqrt(most), least, most) if free else cells.low[COUPLING_DAMPING]
    return Estimate(np.where(meets, damping, np.nan), [hardest.places for hardest in each])


@np.errstate(all="ignore")
def changes(problems: Sequence[Problem], cells: Cells, axis: int, *, free: bool) -> Floats:
    """Return the logarithm of the factor by which the hardest constraint changes across each cell along an axis."""
    ends, middle = [], cells.centres()
    for edge in (cells.low, cells.high):
        low, high = middle.low.copy(), middle.high.copy()
        low[axis] = high[axis] = edge[axis]
        if free:
            low[COUPLING_DAMPING], high[COUPLING_DAMPING] = cells.low[COUPLING_DAMPING], cells.high[COUPLING_DAMPING]
        each = [_hardest_places(problem, Cells(low, high), free=free).missed for problem in problems]
        ends.append(np.max(each, axis=0))
    return np.asarray(np.nan_to_num(np.abs(ends[1] - ends[0])))


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
    gains, coupling = Gains(K_v, K_p), coupling_from(of_coupling)
    peak, theta_S = _peak_of_sensitivity(problem, gains)
    places: Places = {SENSITIVITY.id: [theta_S]}
    meets = peak <= problem.stability.max_sensitivity
    scarcities = [peak / problem.stability.max_sensitivity]
    least, most = np.zeros(len(cells)), np.full(len(cells), inf)
    if problem.rigid and problem.hands_met is not None:
        assert isinstance(coupling, SpringDamper)
        limit, in_hands = _limits_before_wall(problem.device, problem.hands_met, coupling)
        scarcities.append(problem.stability.safety_factor / limit)
        meets &= scarcities[-1] <= 1
        ends = ([cells.low[row], cells.high[row]] for row in (2, 3))
        for b_c, k_c in product(*ends):
            corner, _ = _limits_before_wall(problem.device, problem.hands_met, SpringDamper(b_c[:, None], k_c[:, None]))
            meets &= corner >= problem.stability.safety_factor  # else a proof would try in vain
        places[WALL_IN_HANDS.id] = [in_hands]
    if problem.rigid and problem.any_hand:
        assert isinstance(coupling, SpringDamper)
        theta = loops_in_any_hand(problem.device, POINTS_PER_DECADE).theta
        hard = problem.stability.safety_factor / ratio_before_wall(problem.device, coupling, theta)
        scarcities.append(hard.max(axis=1))
        meets &= scarcities[-1] <= 1
        places[WALL_IN_ANY_HAND.id] = [theta[np.argmax(hard, axis=1)]]
    for name, limits, allowed in _limits(problem):
        found = hard_places(limits, cells, allowed)
        scarcities.append(found.multiple / allowed)
        meets &= found.meets  # at every corner, else a proof would try in vain
        places[name] = [found.places]
    grid, apart = frequency_grid(*inwards(sampled_span(problem)), POINTS_PER_DECADE), problem.rigid or problem.worlds
    for claim in () if apart else requirements(problem, gains, grid):
        required = problem.stability.safety_factor * claim.required
        if free and isinstance(coupling, Coupling):
            required = required - coupling.drag
            low, high = admissible_damping(required, coupling.mass * claim.omega)
            # three places: where r/omega is greatest, and where the interval of b_c begins highest and ends lowest;
            # no b_c suffices if 2 r > omega m_c (`proof.claims.damping`)
            least, most = np.maximum(least, low.max(axis=1)), np.minimum(most, high.min(axis=1))
            hardness = [required / np.maximum(claim.omega, TINY), low, -high]
            scarcities.append((2 * hardness[0] / coupling.mass).max(axis=1))
        else:
            hardness = [required / claim.offered(coupling)]
            scarcities.append(hardness[0].max(axis=1))
            meets &= scarcities[-1] <= 1
        places[claim.claim] = [claim.at(np.argmax(hard, axis=1)) for hard in hardness]
    missed = np.log(np.maximum(np.max(scarcities, axis=0), TINY))
    if free:
        gap = np.log(np.maximum(least, cells.low[COUPLING_DAMPING]) / np.minimum(most, cells.high[COUPLING_DAMPING]))
        missed = np.maximum(missed, np.where(np.isfinite(gap), gap, -inf))
    return _Hardest(least, most, meets, places, missed)


def _limits(problem: Problem) -> Iterator[tuple[ClaimId, Limits, float]]:
    """Yield the claims whose hardest places are hands with environments, with the multiples that may fail."""
    if problem.worlds is not None and problem.hands_met is not None:
        yield WORLDS.id, limits_in_worlds(problem), 1 / problem.stability.safety_factor
    if problem.stability.damping_ratio is not None:
        yield DAMPING.id, limits_on_curve(problem), 1.0


def _limits_before_wall(device: Device, hands: Hands, walls: SpringDamper) -> tuple[Floats, PlacesInHands]:
    """Return the least multiples of walls of shape (n, 1) that put a pole on the unit circle in a hand of a box, and
    where, in places of shape (n,)."""
    loops, tried = _loops_before_wall(device, hands), first_hands(hands)
    found = [loops.limits(SpringDamper(b, k)) for b, k in zip(walls.damping[:, 0], walls.stiffness[:, 0], strict=True)]
    worst = [int(np.argmin(limits)) for limits, _ in found]
    places = [(float(angles[at]), tried[at]) for at, (_, angles) in zip(worst, found, strict=True)]
    return np.array([limits[at] for at, (limits, _) in zip(worst, found, strict=True)]), PlacesInHands.of(places)


@lru_cache(maxsize=4)
def _loops_before_wall(device: Device, hands: Hands) -> LoopsBeforeWall:
    """Return the loop of a device in some hands of a box."""
    return LoopsBeforeWall.of(device, first_hands(hands))


def _peak_of_sensitivity(problem: Problem, gains: Gains) -> tuple[Floats, Floats]:
    """Return the greatest |S| of loops with gains of shape (n, 1), and the angles omega T at which it occurs."""
    span = slowest_resonance(problem, problem.bounds.velocity.min), problem.nyquist
    below = frequency_grid(*inwards(span), POINTS_PER_DECADE)
    S = sensitivity_of(problem.device, gains)(below)
    return S.max(axis=1), below[np.argmax(S, axis=1)] * problem.device.sample_time
