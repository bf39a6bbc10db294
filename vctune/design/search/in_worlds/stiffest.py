"""Find the stiffest coupling of an impedance display with which no environment of a box puts a pole on the unit
circle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from math import exp, inf, log

import numpy as np

from vctune.analysis.demands import sensitivity_maxima
from vctune.analysis.extrema import Floats
from vctune.analysis.in_hands import RatioInHand
from vctune.analysis.in_walls import corner_of
from vctune.analysis.loops_in_hands import angles, loops_in_hands
from vctune.design.prepared import Posed, with_device
from vctune.design.search.in_worlds.force_scale import forbidden_scale
from vctune.design.search.in_worlds.known_places import KnownPlaces, least_scale
from vctune.design.search.shapes import coupling_of, scale_limits, shape_of, time_constants
from vctune.design.search.stabilise import stable
from vctune.design.search.start import Start
from vctune.design.search.working_set import ConstraintPoint
from vctune.design.variables import Coordinate, coordinates
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hand_arrays import stacked
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.problem import Problem
from vctune.model.sampled.hand_loop import loop_in_hand, seen_in_hand
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.model.worlds import WorldsMet
from vctune.running import check_time

ROUNDS = 12  # Greatest number of rounds in which hands join the search
RESERVE = 5e-4  # Least tightening
# Share by which the scale that a hand forbids may exceed the scale of the known hands before the hand joins them
ENOUGH = 2e-5
# Number of angles per decade in each hand, number of angles in a window around the worst of them, and number of times
# that the search narrows the window
PER_DECADE, WINDOW, ZOOMS = 120, 17, 3
# Number of places from which the search for the worst hand starts, both on a grid and among the known hands; and number
# of its steps
SEARCHED, MOVES = 6, 16
AROUND = 41  # Number of angles around a place at which the search evaluates a neighbouring hand
# First step in log(b_c/k_c) and in the coordinate of K_v, first step of later rounds, and last step
FIRST_STEP, NEXT_STEP, LAST_STEP = 0.4, 0.05, 2e-5


@dataclass(slots=True)
class _InHands:
    """A device, the box of its hands, and the hands for which the search computes the coupling."""

    problem: Problem  # problem of the device
    hands: Hands  # the box
    known: list[Hand] = field(default_factory=list)  # hands in which the search evaluates the closed form
    at_walls: KnownPlaces | None = None  # places at which the search evaluates walls; None without walls

    @property
    def device(self) -> Device:
        """The device."""
        return self.problem.device


@dataclass(frozen=True, slots=True)
class _Law:
    """K_v with the time constant b_c/k_c of the coupling, and the corner of the multiplier for walls."""

    gains: Gains
    time_constant: float
    corner: float | None = None


@dataclass(frozen=True, slots=True)
class Stiffest:
    """The stiffest coupling that the search finds, dimensionless."""

    gains: Gains  # the design
    coupling: AnyCoupling
    error: float  # its error
    places: list[ConstraintPoint]  # frequencies and hands at which an environment forbids a stiffer coupling


@np.errstate(all="ignore")
def stiffest(
    posed: Posed, start: Start, incumbent: float, tightening: float, witnesses: Sequence[ConstraintPoint]
) -> Stiffest | None:
    """Return the best coupling near a start; None if no coupling within the bounds has an error below the
    incumbent's."""
    cases = {case.device.modelled: case for case in posed.hand_cases}
    for at in witnesses:
        cases.setdefault(at.device.modelled, with_device(posed.problem, at.device))
    sets = []
    for device, case in cases.items():
        assert case.hands_met is not None
        there = [at for at in witnesses if at.device.modelled == device]
        own = [at.hand for at in there if at.hand is not None]
        at_walls = KnownPlaces(case.device, case.hands_met) if case.worlds is not None and case.worlds.walls else None
        if at_walls is not None and own:
            at_walls.add([RatioInHand(0.0, at.omega, at.hand) for at in there if at.hand is not None])
        sets.append(_InHands(case, case.hands_met, list(dict.fromkeys([*case.hands_met.corners, *own])), at_walls))
    reserve = posed.problem.stability.safety_factor * (1 + max(tightening, RESERVE))
    law = _Law(start.gains, shape_of(start.coupling)[0])
    design: AnyCoupling | None = start.coupling
    for number in range(ROUNDS):
        law = _with_corner(posed, law, design)
        law, error = _least_error(posed, sets, law, reserve, FIRST_STEP if number == 0 else NEXT_STEP)
        if not error < incumbent:
            return None
        joined = _join_linear(sets, law)
        design = _design(posed, sets, law, reserve)
        for one in sets:
            if one.at_walls is not None and design is not None:
                lacking = one.at_walls.lacking(law.gains, design, _met(one.problem, law), (1 - ENOUGH) * reserve)
                if lacking:
                    one.at_walls.add(lacking)
                joined |= bool(lacking)
        if not joined:
            break
    found = _design(posed, sets, law, reserve)
    return None if found is None else Stiffest(law.gains, found, error, _places(sets, law))


def _join_linear(sets: Sequence[_InHands], law: _Law) -> bool:
    """Add the hands that forbid greater scales than the known hands; return whether there are any."""
    known, joined = max(float(_in_each(one, stacked(one.known), law)[0].max()) for one in sets), False
    for one in sets:
        scale, _, hands = _hardest(one, law)
        new = [hand for x, hand in zip(scale, hands, strict=True) if x > (1 + ENOUGH) * known]
        one.known += [hand for hand in new if hand not in one.known]
        joined |= bool(new)
    return joined


def _met(problem: Problem, law: _Law) -> WorldsMet:
    """Return the environments of a problem, with the corner of a law for the multiplier for walls."""
    worlds = problem.worlds
    assert worlds is not None
    return WorldsMet(replace(worlds, corner=law.corner), problem.stability.safety_factor)


def _with_corner(posed: Posed, law: _Law, design: AnyCoupling | None) -> _Law:
    """Return a law with the best corner of the multiplier for walls at a design."""
    worlds = posed.problem.worlds
    if worlds is None or not worlds.walls or design is None:
        return law
    return replace(law, corner=worlds.corner or corner_of(posed.problem, law.gains, design))


def _design(posed: Posed, sets: Sequence[_InHands], law: _Law, reserve: float) -> AnyCoupling | None:
    """Return the stiffest coupling with the time constant of a law, within the bounds; None if there is none."""
    low, high = (float(limit) for limit in scale_limits(posed.problem, np.array(law.time_constant)))
    scale = max(reserve * max(float(_in_each(one, stacked(one.known), law)[0].max()) for one in sets), low)
    if scale > 0 and any(one.at_walls is not None for one in sets):

        def suffices(scale: float) -> bool:
            coupling = coupling_of(posed.problem, scale, law.time_constant, 0.0)
            places = ((one.at_walls, _met(one.problem, law)) for one in sets)
            return all(at is None or at.suffices(law.gains, coupling, met, reserve) for at, met in places)

        scale = least_scale(suffices, scale, high)
    return coupling_of(posed.problem, scale, law.time_constant, 0.0) if 0 < scale <= high else None


def _least_error(posed: Posed, sets: Sequence[_InHands], law: _Law, reserve: float, step: float) -> tuple[_Law, float]:
    """Return the law with the least error near a given law, in the known hands, and this error. The error is inf if no
    law is feasible."""
    own = next((c for c in coordinates(posed.problem, integrator=False) if c.name == "velocity"), None)
    low, high = (log(tau) for tau in _time_constants(posed))
    at = np.array(
        [min(max(log(max(law.time_constant, 1e-300)), low), high), own.to_z(law.gains.velocity) if own else 0]
    )
    bounds = np.array([[low, high], [own.low, own.high] if own else [0.0, 0.0]])

    def error(z: Floats) -> float:
        check_time()
        return _error(posed, sets, _law(z, own, law), reserve)

    best = error(at)
    moves = [np.array(move) for move in product((-1, 0, 1), (-1, 0, 1) if own else (0,)) if any(move)]
    while step > LAST_STEP:
        for move in moves:
            there = np.clip(at + step * move, bounds[:, 0], bounds[:, 1])
            if (there != at).any() and (found := error(there)) < best:
                at, best = there, found
                break
        else:
            step /= 2
    return _law(at, own, law), best


def _time_constants(posed: Posed) -> tuple[float, float]:
    least, most = time_constants(posed.problem, *posed.span)
    return max(least, 1e-12), max(most, 1e-12)


def _law(z: Floats, own: Coordinate | None, law: _Law) -> _Law:
    return _Law(Gains(own.to_x(float(z[1])), 0.0) if own else law.gains, exp(float(z[0])), law.corner)


def _error(posed: Posed, sets: Sequence[_InHands], law: _Law, reserve: float) -> float:
    """Return the error of the stiffest coupling in the known hands; inf if there is none."""
    if law.gains.velocity > 0:
        for one in sets:
            limit = posed.problem.stability.max_sensitivity
            if not stable(one.problem, law.gains) or -sensitivity_maxima(one.problem, law.gains).value[0] > limit:
                return inf
    coupling = _design(posed, sets, law, reserve)
    return inf if coupling is None else posed.error(law.gains, coupling)


def _in_each(one: _InHands, hands: Hand, law: _Law) -> tuple[Floats, Floats]:
    """Return the greatest forbidden scale in each hand, and its angle."""
    theta = angles(one.device, PER_DECADE)[1:]
    return _zoomed(one, hands, np.tile(theta, (hands.mass.size, 1)), law)


def _zoomed(one: _InHands, hands: Hand, theta: Floats, law: _Law) -> tuple[Floats, Floats]:
    """Return the greatest forbidden scale in each of n hands among angles of shape (n, m) and between them."""
    plant = plant_in_hand(one.device, hands.mapped(lambda x: x[:, None]), delays_of(one.device), FLOATS)
    rows, worlds = np.arange(len(theta)), one.problem.worlds
    assert worlds is not None
    best, where = np.zeros(len(theta)), theta[:, 0]
    for _ in range(1 + ZOOMS):
        seen = seen_in_hand(loop_in_hand(plant, theta, FLOATS), law.gains)
        scale = forbidden_scale(worlds, one.device, theta, seen, law.time_constant)
        k = np.argmax(scale, axis=1)
        better = scale[rows, k] > best
        best, where = np.where(better, scale[rows, k], best), np.where(better, theta[rows, k], where)
        first, last = theta[rows, np.maximum(k - 1, 0)], theta[rows, np.minimum(k + 1, theta.shape[1] - 1)]
        theta = first[:, None] + (last - first)[:, None] * np.linspace(0.0, 1.0, WINDOW)
    return best, where


def _hardest(one: _InHands, law: _Law) -> tuple[Floats, Floats, list[Hand]]:
    """Return the hands that forbid the greatest scales, found by a search from each start to better neighbours."""
    hands, theta = _starts(one, law)
    low, width = np.array([(low, high - low) for low, high in one.hands.ranges.values()]).T
    safe = np.where(width > 0, width, 1.0)
    share = np.sqrt((np.array([*hands.numbers.values()]) - low[:, None]) / safe[:, None])
    offsets = np.array(list(product(*((-1, 0, 1) if each > 0 else (0,) for each in width)))).T
    turns, rows = np.linspace(-1.0, 1.0, AROUND), np.arange(theta.size)
    best, step = np.zeros(theta.size), np.full(theta.size, 0.2)
    for _ in range(MOVES):
        check_time()
        near = np.clip(share[:, :, None] + offsets[:, None, :] * step[:, None], 0.0, 1.0)
        tried = Hand(*(low[:, None, None] + width[:, None, None] * near**2).reshape(len(low), -1))
        about = np.minimum(theta[:, None, None] * np.exp(step[:, None, None] * turns), np.pi)
        about = np.broadcast_to(about, (theta.size, offsets.shape[1], AROUND)).reshape(-1, AROUND)
        scale, where = (x.reshape(theta.size, -1) for x in _zoomed(one, tried, about, law))
        k = np.argmax(scale, axis=1)
        better = scale[rows, k] > best
        moved = better & np.any(offsets[:, k] != 0, axis=0)
        best, theta = np.where(better, scale[rows, k], best), np.where(better, where[rows, k], theta)
        share = np.where(better, near[:, rows, k], share)
        step = np.where(moved, step, step / 2)
    numbers = low[:, None] + width[:, None] * share**2
    order = np.argsort(-best)
    return best[order], theta[order], [Hand(*(float(x) for x in numbers[:, k])) for k in order]


def _starts(one: _InHands, law: _Law) -> tuple[Hand, Floats]:
    """Return the worst known hands and the worst hands of a grid, each with its angle."""
    known = stacked(one.known)
    scale, theta = _in_each(one, known, law)
    first = np.argsort(-scale)[:SEARCHED]
    where, worlds = loops_in_hands(one.device, one.hands), one.problem.worlds
    assert worlds is not None
    grid = forbidden_scale(worlds, one.device, where.theta, where.seen(law.gains), law.time_constant)[:, 1:]
    hand = np.argmax(grid, axis=0)
    padded = np.concatenate(([-inf], grid[hand, np.arange(hand.size)], [-inf]))
    peaks = np.flatnonzero((padded[1:-1] >= padded[:-2]) & (padded[1:-1] >= padded[2:]) & (padded[1:-1] > 0))
    peaks = peaks[np.argsort(-padded[1 + peaks], kind="stable")][:SEARCHED]
    numbers = zip(known.numbers.values(), where.hands.numbers.values(), strict=True)
    hands = Hand(*(np.append(own[first], on_grid[hand[peaks]]) for own, on_grid in numbers))
    return hands, np.append(theta[first], where.theta[1 + peaks])


BINDING = 1e-3  # Share below the greatest forbidden scale up to which a place counts as limiting the design


def _places(sets: Sequence[_InHands], law: _Law) -> list[ConstraintPoint]:
    """Return the places that limit a design."""
    found = []
    for one in sets:
        scale, theta = _in_each(one, stacked(one.known), law)
        T = one.device.sample_time
        each = zip(scale, theta, one.known, strict=True)
        found += [(x, ConstraintPoint(float(at / T), one.device, hand)) for x, at, hand in each]
    most = max(x for x, _ in found)
    return [place for x, place in sorted(found, key=lambda pair: -pair[0]) if x >= (1 - BINDING) * most]
