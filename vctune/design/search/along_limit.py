"""Improve designs along the limit of their coupling, before a box of environments (model/README.md, section 18).

The conditions for one exact environment vanish at every sample of the angle, so that the NLP does not see them. But in
each hand the multiples of the coupling at which a pole lies on the unit circle are known in closed form. Of each shape
of the coupling this search takes the least multiple that is stable, and minimises the error over shapes and gains.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple, dataclass, replace
from math import exp, inf, log, pi

import numpy as np
from scipy.optimize import minimize

from vctune.analysis.demands import sensitivity_maxima
from vctune.analysis.extrema import Floats
from vctune.analysis.multiples import LoopsInWorlds, angles_of
from vctune.design.prepared import Posed
from vctune.design.search.exchange import stable
from vctune.design.variables import Point, design_of, ranges
from vctune.design.verdict.judge import Judgement, Status, judge_posed
from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.hands import Hand
from vctune.model.problem import Range
from vctune.proof.claims.crossing import ANGLES, BESIDE
from vctune.proof.outcome import Verdict
from vctune.proof.prover import boxes_at_most
from vctune.running import check_time

RESERVE, ROUNDS = 1e-4, 8  # of the first proof beyond the safety factor, and number of proofs
MOST_BOXES, MOST_DEVICES = 100_000, 16
# Of the grid: gains as shares of the greatest K_v, number of corners K_p/K_v over the band, and the shapes: m_c/b_c, or
# m_c/b_0 of a rigid coupling, in sample times, and b_0/b_c
VELOCITIES, CORNERS = np.geomspace(1e-3, 0.95, 11), 5
RIGID, SHAPES, DRAGS = np.geomspace(0.03, 1e5, 13), np.geomspace(0.3, 300, 6), np.geomspace(1e-3, 10, 6)
STARTS, BEST = 4, 2  # number of starts of the grid, each with another K_v or shape, and of those that are proved
# Steps of the logarithms, greatest numbers of designs that are compared, and distances at which a search ends: of each
# start, of the best, and of the best with more hands
COARSE, FINE, AGAIN = (0.3, 120, 1e-2), (0.1, 260, 1e-4), (0.01, 60, 1e-4)
GAINS = 2  # number of gains before the numbers of the coupling in a `Point`
FAR, HALVINGS = 30.0, 16  # Greatest factor of a coupling that is not free as a whole, and halvings of its logarithm
DIGITS = 8  # of a design
TINY = 1e-300
SOFTEST = 1e-3  # Least coupling, over Z_0, if it could be softer: a proof about next to nothing does not end


@dataclass(frozen=True, slots=True)
class _Limit:
    """The designs of a problem whose coupling is at its limit, on some devices in some hands."""

    posed: Posed
    devices: Sequence[Device]
    hands: Sequence[Hand]
    reserve: float = RESERVE  # share beyond the safety factor
    angles: Floats | None = None

    @property
    def ranges(self) -> tuple[Range, ...]:
        """The ranges of the variables."""
        return ranges(self.posed.problem)

    @property
    def free(self) -> list[int]:
        """The numbers of the variables that are free and may be positive."""
        return [k for k, bounds in enumerate(self.ranges) if not bounds.fixed and bounds.max > 0]

    def loops(self, gains: Gains) -> list[LoopsInWorlds] | None:
        """Return the loops with given gains; None if they are out of bounds, unstable or too loud."""
        problem = self.posed.problem
        if not all(_within(value, bounds) for value, bounds in zip(astuple(gains), self.ranges, strict=False)):
            return None
        if problem.device.kind.own_loop:
            cases, loudest = self.posed.cases[:MOST_DEVICES], problem.stability.max_sensitivity * (1 - self.reserve)
            if not all(stable(case, gains) for case in cases):
                return None
            if any(-sensitivity_maxima(case, gains).value[0] > loudest for case in cases):
                return None
        assert problem.worlds is not None
        return [LoopsInWorlds.of(each, gains, self.hands, problem.worlds, self.angles) for each in self.devices]

    def reserve_of(self, values: Point, loops: Sequence[LoopsInWorlds]) -> float:
        """Return the share by which the coupling may be divided beyond the safety factor."""
        least = min(loop.ratio(design_of(values)[1]) for loop in loops)
        return least / self.posed.problem.stability.safety_factor - 1

    def design(self, values: Point, loops: Sequence[LoopsInWorlds] | None) -> Point | None:
        """Return a design with its free coupling multiplied until it is at the limit; None if the loop or the bounds do
        not permit it."""
        if loops is None:
            return None
        free = [k for k in self.free if k >= GAINS]

        def ratio(found: Point) -> float:
            return (1 + self.reserve_of(found, loops)) / (1 + self.reserve)

        if free and all(k in free or value in (0.0, inf) for k, value in enumerate(values[GAINS:], GAINS)):
            needed = self.posed.problem.stability.safety_factor * (1 + self.reserve)
            problem, (b_c, m_c, b_0) = self.posed.problem, values[GAINS:]
            least = loops[0].least_stable(design_of(values)[1], loops[1:], needed)
            softest = problem.transparency.reference_impedance * SOFTEST
            softest /= max(b_0, min(b_c, m_c / problem.device.sample_time))
            found = _times(values, free, max(least * needed, softest))
        else:
            found = _halved(values, free, ratio)
        raised = tuple(max(value, bounds.min) for value, bounds in zip(found, self.ranges, strict=True))
        if not all(_within(value, bounds) for value, bounds in zip(raised, self.ranges, strict=True)):
            return None
        # at the limit to rounding, unless a bound has moved it
        return raised if ratio(raised) >= 1 - (0 if raised != found else 0.1 * self.reserve) else None


def _halved(values: Point, free: Sequence[int], ratio: Callable[[Point], float]) -> Point:
    """Return the values with those that are free multiplied by the least factor that suffices, or else the greatest."""
    low, high = -log(FAR), log(FAR)
    for _ in range(HALVINGS if free else 0):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if ratio(_times(values, free, exp(middle))) >= 1 else (middle, high)
    return _times(values, free, exp(high))


def _within(value: float, bounds: Range) -> bool:
    return bounds.min * (1 - 1e-9) <= value <= bounds.max * (1 + 1e-9)


def _times(values: Point, free: Sequence[int], factor: float) -> Point:
    return tuple(value * factor if k in free else value for k, value in enumerate(values))


@np.errstate(all="ignore")
def best_along_limit(posed: Posed) -> Judgement | None:
    """Return the best proved design that the search reaches from a grid, or else the last that was tried; None if it
    reaches none."""
    devices = list(dict.fromkeys(case.device for case in (*posed.cases, *posed.hand_cases)))[:MOST_DEVICES]
    limit = _Limit(posed, devices, [*posed.problem.hands.corners, posed.problem.hands.middle])
    tried: Judgement | None = None
    starts = _starts(replace(limit, angles=ANGLES[::3]))
    reached = [found for start in starts if (found := _least(limit, start, *COARSE)) is not None]
    for _, start in sorted(reached)[:BEST]:
        tried = _proved_near(limit, start) or tried
        if tried is not None and tried.status is Status.CERTIFIED:
            break
    return tried


def _proved_near(limit: _Limit, start: Point) -> Judgement | None:
    """Return the first proved design of those with the least error near a start, each with the hands and devices that
    refuted the last; or else the last that was tried."""
    tried, best = None, start
    for again in range(ROUNDS):
        near = _least(limit, best, *(AGAIN if again else FINE))
        if near is None:
            return tried
        best = near[1]
        law = design_of(tuple(float(f"{value:.{DIGITS}g}") for value in best))
        with boxes_at_most(MOST_BOXES):
            tried = judge_posed(limit.posed, *law)
        lost = [each for each in tried.certificate.outcomes.values() if each.verdict is Verdict.REFUTED]
        if tried.status is Status.CERTIFIED or any(each.witness is None for each in lost):
            return tried  # no coupling helps a loop that is unstable by itself
        hands = [each.hand for each in lost if each.hand is not None and each.hand not in limit.hands]
        others = [each.device for each in lost if each.device is not None and each.device not in limit.devices]
        limit = replace(limit, hands=[*limit.hands, *hands], devices=[*limit.devices, *others])
        T, known = limit.devices[0].sample_time, angles_of(limit.devices[0]) if limit.angles is None else limit.angles
        beside = [np.minimum(each.witness * T * BESIDE, pi) for each in lost if each.witness]
        limit = replace(limit, angles=np.unique(np.concatenate([known, *beside])))
        loops = limit.loops(law[0])
        if loops is not None and limit.reserve_of((*astuple(law[0]), *astuple(law[1])), loops) >= limit.reserve / 2:
            limit = replace(limit, reserve=2 * limit.reserve)  # what was lost is not seen by the estimate
    return tried


def _starts(limit: _Limit) -> list[Point]:
    """Return the designs of a grid with the least errors that are apart from one another."""
    found = list[tuple[float, Point]]()
    for gains in _grid_of_gains(limit):
        check_time()
        if (loops := limit.loops(gains)) is None:
            continue
        for coupling in _shapes(limit):
            design = limit.design((*astuple(gains), *coupling), loops)
            if design is not None:
                found.append((limit.posed.error(*design_of(design)), design))
    best = dict[float, Point]()  # of each K_v, or of each shape without a loop, by the least error
    for _, design in sorted(found):
        b_c, m_c, b_0 = design[GAINS:]
        shape = m_c / b_c if b_c < inf else m_c / max(b_0, TINY)
        best.setdefault(design[0] if limit.posed.problem.device.kind.own_loop else float(f"{shape:.2g}"), design)
    return list(best.values())[:STARTS]


def _grid_of_gains(limit: _Limit) -> Iterator[Gains]:
    velocity, position = limit.ranges[:GAINS]
    band = limit.posed.problem.transparency.band
    corners = np.append(0.0, np.geomspace(0.3 * band.min, band.max, CORNERS))
    speeds = [velocity.max] if velocity.fixed else sorted({max(velocity.min, velocity.max * s) for s in VELOCITIES})
    for K_v in speeds:
        springs = [position.max] if position.fixed else sorted({max(position.min, K_v * corner) for corner in corners})
        yield from (Gains(float(K_v), float(K_p)) for K_p in springs)


def _shapes(limit: _Limit) -> Iterator[tuple[float, float, float]]:
    """Yield b_c, m_c and b_0 of couplings of any size; what a problem fixes keeps its value."""
    problem = limit.posed.problem
    damping, mass, drag = limit.ranges[GAINS:]
    Z_0, T = problem.transparency.reference_impedance, problem.device.sample_time
    rigid = damping.min == inf
    b_c = damping.max if damping.fixed else Z_0
    size = Z_0 if rigid else b_c
    for shape in (RIGID if rigid else SHAPES) if not mass.fixed else (0.0,):
        for share in ((1.0,) if rigid else DRAGS) if not drag.fixed else (0.0,):
            m_c = mass.max if mass.fixed else size * T * shape
            yield b_c, float(m_c), float(drag.max if drag.fixed else size * share)


def _least(limit: _Limit, start: Point, step: float, most: int, close: float) -> tuple[float, Point] | None:
    """Return the least error, with its design, near a start."""
    free = [k for k in limit.free if start[k] > 0]
    scaled = [k for k in free if k >= GAINS]
    shape = [k for k in free if k not in scaled[:1]]  # the first number of the coupling follows from the limit

    def at(logs: Floats) -> Point | None:
        values = list(start)
        for k, place in zip(shape, logs, strict=True):
            values[k] = exp(float(place))
        return limit.design(tuple(values), limit.loops(Gains(*values[:GAINS])))

    def error(logs: Floats) -> float:
        found = at(logs)
        return inf if found is None else limit.posed.error(*design_of(found))

    first = np.array([log(start[k]) for k in shape])
    for again in (1.0, 0.3) if shape else ():
        simplex = np.vstack([first, *(first + again * step * unit for unit in np.eye(len(shape)))])
        options = {"initial_simplex": simplex, "maxfev": most // 2, "xatol": close, "fatol": 1e-7}
        first = minimize(error, first, method="Nelder-Mead", options=options).x
    found = at(first)
    return None if found is None else (limit.posed.error(*design_of(found)), found)
