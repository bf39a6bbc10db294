"""Search along the limit of the coupling, before a box of environments or nothing (model/README.md, section 18).

The conditions for one exact environment vanish at every sample of the angle, so that the NLP does not see them. But in
each hand the multiples of the coupling at which a pole lies on the unit circle are known in closed form. Of each shape
of the coupling this search takes the least multiple that is stable, and minimises the error over shapes and gains.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple, dataclass, replace
from functools import partial
from math import exp, inf, log
from typing import NamedTuple

import numpy as np

from vctune.analysis.damped import BoxOnCurve
from vctune.analysis.demands import demand_grid, response, sensitivity_maxima
from vctune.analysis.extrema import Floats
from vctune.analysis.multiples import LoopsInWorlds, angles_of
from vctune.design.prepared import Posed, Prepared
from vctune.design.search.exchange import stable
from vctune.design.search.first_proved import RATIO_RESERVE, RESERVE, Law, LookedAt, Proved, first_proved
from vctune.design.search.scan import scan
from vctune.design.variables import Point, design_of, point, ranges, rounded
from vctune.model.gains import AnyCoupling, Gains, coupling_impedance, series_coupling
from vctune.model.hands import Hand, Hands
from vctune.model.loop.llewellyn import passive_alone
from vctune.model.loop.loop import LoopResponse
from vctune.model.problem import Problem, Range
from vctune.model.worlds import EVERY_WORLD
from vctune.running import check_time

MOST_DEVICES = 16  # of a box, at first
# Of the grid: gains as shares of the greatest K_v, number of corners K_p/K_v, and the shapes: m_c/b_c, or
# m_c/b_0 of a rigid coupling, in sample times, and b_0/b_c
VELOCITIES, CORNERS = (0.99, 0.6, 0.3, 0.1, 0.03, 0.003), 12
CLOSER_CORNERS = (0.5, 0.25)  # that are tried beside the best ones, as shares of the steps between corners
WIDER, WIDEST, CLOSER = 1.5, 24, 6  # steps down to the greatest K_v that is permitted, and halvings of the last step
RIGID, SHAPES, DRAGS = np.geomspace(0.03, 1e5, 13), np.geomspace(0.3, 300, 6), np.geomspace(1e-3, 10, 6)
SOFTER = (0.4, 0.15, 0.06, 0.02, 0.007)  # shares of the greatest stiffness of a hand
STARTS, BEST = 6, 2  # number of starts, and greatest number of those that are proved
NO_BETTER = 0.998  # Estimated error, over that of a proved design, above which the search ends
GAIN_REDUCTIONS = (1.0, 0.9, 0.7, 0.5, 0.3)  # shares of a start's gains that are tried until they are permitted
# Steps of the logarithms, greatest numbers of designs that are compared, and distances at which a search ends: of each
# start, of the best, and of the best with more hands
COARSE, FINE, AGAIN = (0.3, 120, 1e-2), (0.1, 260, 1e-4), (0.01, 60, 1e-4)
GAINS, MASS = 2, 3  # number of gains before the numbers of the coupling in a `Point`, and place of m_c
FAR, HALVINGS = 30.0, 16  # Greatest factor of a coupling that is not free as a whole, and halvings of its logarithm
FEW = 3  # of this many angles one is looked at, to compare starts
TINY = 1e-300
IN_DISC = 1e-3  # First reserve of a servo in a disc, whose proof takes a hundred times as long at less
LIGHTEST = 1e-3  # Least mass of a rigid coupling, over b_0 T; a lighter one is neither felt nor worth a digit
SOFTEST = 1e-3  # Least coupling, over Z_0, if it could be softer: a proof about next to nothing does not end


def follows_limit(problem: Problem) -> bool:
    """Return whether only this search finds a design: with nothing behind, or of a law that the NLP does not state."""
    return has_nothing_behind(problem) or problem.device.rule == "euler"


def has_nothing_behind(problem: Problem) -> bool:
    """Return whether a problem leaves mass and drag alone to choose, with nothing behind them."""
    worlds, bounds = problem.worlds, problem.bounds
    if worlds is None or worlds.walls or worlds.low.damping > 0:
        return False
    return worlds.nothing and bounds.velocity.fixed and bounds.position.fixed and bounds.damping.min == inf


class _Loops(NamedTuple):
    """The loops of the devices with given gains, at which couplings are measured."""

    in_worlds: Sequence[LoopsInWorlds]
    # rad/s and response, for any passive hand with nothing behind the coupling
    on_band: Sequence[tuple[Floats, LoopResponse]]
    damped: Sequence[BoxOnCurve] = ()  # on the curve of a damping ratio that is demanded

    def damped_between(self, coupling: AnyCoupling) -> tuple[float, float]:
        """Return the multiples between which the coupling has the damping ratio; 0 and inf if none is demanded."""
        rooms = [of.room(series_coupling(coupling)) for of in self.damped]
        return max((least for least, _ in rooms), default=0.0), min((most for _, most in rooms), default=inf)

    def ratio(self, coupling: AnyCoupling) -> float:
        """Return the number by which a coupling may be divided before something fails, the damping ratio aside."""
        least = self.least_on_band(coupling)
        return min([1 / least if least > 0 else inf, *(loop.ratio(coupling) for loop in self.in_worlds)])

    def least_stable(self, coupling: AnyCoupling, room: float) -> float:
        """Return the least multiple beyond which nothing fails up to `room` times as much."""
        least = self.in_worlds[0].least_stable(coupling, self.in_worlds[1:], room) if self.in_worlds else 0.0
        return max(least, self.least_on_band(coupling))

    def least_on_band(self, coupling: AnyCoupling) -> float:
        """Return the least multiple that is passive in any passive hand with nothing behind it."""
        least = 0.0
        for omega, loop in self.on_band:
            held, driven = passive_alone(loop, coupling_impedance(series_coupling(coupling), omega))
            least = max(least, float(np.max(np.where(loop.resistance > 0, -driven / held, inf))))
        return least


@dataclass(frozen=True, slots=True)
class _Limit:
    """The designs of a problem whose coupling is at its limit, as far as is seen."""

    posed: Posed
    seen: LookedAt
    coarse: bool = False  # whether few angles are enough

    @property
    def ranges(self) -> tuple[Range, ...]:
        """The ranges of the variables."""
        return ranges(self.posed.problem)

    @property
    def needed(self) -> float:
        """The ratio that a design keeps."""
        return self.posed.problem.stability.safety_factor * (1 + self.seen.reserve)

    @property
    def free(self) -> list[int]:
        """The numbers of the variables that are free and may be positive."""
        return [k for k, bounds in enumerate(self.ranges) if not bounds.fixed and bounds.max > 0]

    def error(self, found: Point | None) -> float:
        """Return the error of a design; inf without one."""
        return inf if found is None else self.posed.error(*design_of(found))

    def permits(self, gains: Gains) -> bool:
        """Return whether gains are within their bounds and their loop is stable and not too loud."""
        if not all(_within(value, bounds) for value, bounds in zip(astuple(gains), self.ranges, strict=False)):
            return False
        problem, cases = self.posed.problem, self.posed.cases[:MOST_DEVICES]
        if not problem.device.kind.own_loop:
            return True
        loudest = problem.stability.max_sensitivity * (1 - RESERVE)
        quiet = (-sensitivity_maxima(case, gains).value[0] <= loudest for case in cases)
        return all(stable(case, gains) for case in cases) and all(quiet)

    def loops(self, gains: Gains) -> _Loops | None:
        """Return the loops with given gains; None if they are not permitted."""
        problem, demands, seen = self.posed.problem, self.posed.demands, self.seen
        if not self.permits(gains):
            return None
        worlds = problem.worlds or EVERY_WORLD
        in_worlds, on_band = list[LoopsInWorlds](), list[tuple[Floats, LoopResponse]]()
        ratio, damped = problem.stability.damping_ratio, list[BoxOnCurve]()
        for device in seen.devices:
            angles = np.union1d(angles_of(device)[:: FEW if self.coarse else 1], seen.angles)
            if demands.hands is not None:
                in_worlds.append(LoopsInWorlds.of(device, gains, seen.hands, worlds, angles))
            if ratio is not None:
                asked = ratio * (1 + RATIO_RESERVE + seen.reserve)
                damped.append(BoxOnCurve.of(device, problem.hands, worlds, asked, angles))
            if demands.alone:
                omega = demand_grid(device, *self.posed.span)
                on_band.append((omega, response(device, gains, omega)))
        return _Loops(in_worlds, on_band, damped)

    def is_light(self, values: Point) -> bool:
        """Return whether the mass of a law without a damper is next to the least that its rule permits: 0, and drag
        times sample_time of Euler's rule."""
        b_c, m_c, b_0 = values[GAINS:]
        device = self.posed.problem.device
        least = b_0 * device.sample_time
        above = m_c - least if device.rule == "euler" else m_c
        return b_c == inf and above < LIGHTEST * least

    def design(self, values: Point, loops: _Loops | None) -> Point | None:
        """Return a design with its free coupling multiplied until it is at the limit; None if the loop or the bounds do
        not permit it."""
        b_c, m_c, b_0 = values[GAINS:]
        free = [k for k in self.free if k >= GAINS]
        if loops is None or (MASS in free and self.is_light(values)):
            return None

        def enough(found: Point) -> float:
            coupling = design_of(found)[1]
            least, most = loops.damped_between(coupling)
            return min(loops.ratio(coupling) / self.needed, 1 / least if least > 0 else inf, most)

        if free and all(k in free or value in (0.0, inf) for k, value in enumerate(values[GAINS:], GAINS)):
            problem = self.posed.problem
            softest = problem.transparency.reference_impedance * SOFTEST
            softest /= max(b_0, min(b_c, m_c / problem.device.sample_time))
            coupling = design_of(values)[1]
            damped, most = loops.damped_between(coupling)
            least = max(loops.least_stable(coupling, self.needed) * self.needed, damped)
            if max(least, softest) > most:
                return None
            found, known = _times(values, free, max(least, softest)), least >= softest
        else:
            found, known = _halved(values, free, enough), False
        raised = tuple(max(value, bounds.min) for value, bounds in zip(found, self.ranges, strict=True))
        if not all(_within(value, bounds) for value, bounds in zip(raised, self.ranges, strict=True)):
            return None
        if self.posed.problem.device.rule == "euler" and self.is_light(raised):
            return None
        if known and raised == found:
            return found
        # at the limit to rounding, unless a bound has moved it
        return raised if enough(raised) >= 1 - (0 if raised != found else 0.1 * self.seen.reserve) else None


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
def best_along_limit(prepared: Prepared) -> Proved | None:
    """Return the best proved design that the search reaches from its starts, or else the last that was tried; None if
    it reaches none."""
    posed = prepared.given
    devices = list(dict.fromkeys(case.device for case in (*posed.cases, *posed.hand_cases)))[:MOST_DEVICES]
    servo = posed.problem.device.servo
    reserve = IN_DISC if servo is not None and servo.radii else RESERVE
    seen = LookedAt(devices, _first_hands(posed.problem.hands), reserve=reserve)
    limit = _Limit(posed, seen, coarse=True)
    fixed, worlds = limit.ranges[0].fixed and limit.ranges[1].fixed, posed.problem.worlds
    unseen = fixed or (worlds is not None and worlds.exact)
    starts = _starts_of_corners(limit) if unseen else _starts_of_scan(limit, prepared)
    best: Proved | None = None
    for _ in range(BEST):
        limit = _Limit(posed, seen, coarse=True)
        reached = [found for start in starts if (found := _least(limit, start, *COARSE)) is not None]
        error, start = min(reached, default=(inf, ()))
        if error == inf or (best is not None and best.certified and error > NO_BETTER * best.judgement.error):
            break
        tried = first_proved(posed, seen, partial(_best_near, posed, start))
        best = best if tried is None else _better(best, tried)
        if tried is None or (tried.certified and error > NO_BETTER * tried.judgement.error):
            break
        seen = replace(tried.seen, reserve=reserve)  # what refuted these designs may be why others seemed worse
    return best


def _first_hands(hands: Hands) -> list[Hand]:
    """Return the corners of a box, its middle, and softer hands of least damping, of which one is often the worst."""
    low, high = hands.low, hands.high
    softer = (Hand(mass, low.damping, share * high.stiffness) for share in SOFTER for mass in (low.mass, high.mass))
    within = (hand for hand in softer if hand.stiffness > low.stiffness)
    return list(dict.fromkeys([*hands.corners, hands.middle, *within]))


def _better(one: Proved | None, other: Proved) -> Proved:
    """Return the certified design of less error, or else the last."""
    if one is None or not one.certified:
        return other
    return min(one, other, key=lambda each: each.judgement.error) if other.certified else one


def _best_near(posed: Posed, start: Point, seen: LookedAt, last: Law | None) -> Law | None:
    """Return the design with the least error near the last one, or at first near a start."""
    near = _least(_Limit(posed, seen), point(*last) if last else start, *(AGAIN if last else FINE))
    return None if near is None else design_of(rounded(posed.problem, near[1]))


@np.errstate(all="ignore")
def least_error(posed: Posed, seen: LookedAt, law: Law) -> float:
    """Return the least error of a design near another one, as far as is seen; inf without one."""
    found = _least(_Limit(posed, seen), point(*law), *AGAIN)
    return inf if found is None else found[0]


def _starts_of_corners(limit: _Limit) -> list[Point]:
    """Return the designs of a grid of gains with the least errors, each of another corner K_p/K_v, or shape.

    A scan sees nothing of one exact environment.
    """
    problem, best = limit.posed.problem, dict[float, tuple[float, Point]]()
    few, limit = limit, replace(limit, coarse=False)

    def compare(kind: float | None, gains: Iterator[Gains]) -> None:
        """Keep the best design of a kind; without a kind that of each shape. Few angles tell what is not better."""
        for law in gains:
            check_time()
            coarse, fine = few.loops(law), None
            for coupling in _shapes(limit) if coarse is not None else ():
                b_c, m_c, b_0 = coupling
                key = float(f"{m_c / max(b_0 if b_c == inf else b_c, TINY):.2g}") if kind is None else kind
                values, known = (*astuple(law), *coupling), best[key][0] if key in best else inf
                if few.error(few.design(values, coarse)) < known:
                    fine = fine or limit.loops(law)
                    design = limit.design(values, fine)
                    if design is not None and limit.error(design) < known:
                        best[key] = limit.error(design), design

    velocity, position = limit.ranges[:GAINS]
    if velocity.fixed and position.fixed:
        compare(None, iter([Gains(velocity.max, position.max)]))
    elif position.fixed:
        compare(0.0, _gains_of_corner(limit, 0.0, VELOCITIES))
    else:
        # with a corner above 1/lag, Re D < 0 at low frequency
        corners = np.geomspace(0.3 * problem.transparency.band.min, 1 / problem.device.loop_lag, CORNERS)
        for corner in [0.0, *map(float, corners)]:
            compare(corner, _gains_of_corner(limit, corner, VELOCITIES))
        for kind in sorted(best, key=lambda kind: best[kind])[:STARTS]:
            for share in CLOSER_CORNERS:
                K_v, K_p = best[kind][1][:GAINS]
                for ratio in (corners[1] / corners[0]) ** np.array([-share, share]):
                    compare(kind, _gains_of_corner(limit, float(K_p / K_v * ratio), VELOCITIES[:1]))
    return [design for _, design in sorted(best.values())[:STARTS]]


def _gains_of_corner(limit: _Limit, corner: float, shares: Sequence[float]) -> Iterator[Gains]:
    """Yield gains with a corner K_p/K_v, K_v as shares of the greatest that is permitted: near it most designs are
    best."""
    velocity, position = limit.ranges[:GAINS]

    def at(K_v: float) -> Gains:
        return Gains(K_v, position.max if position.fixed else max(position.min, K_v * corner))

    if velocity.fixed:
        yield at(velocity.max)
        return
    tried = velocity.max * WIDER ** -np.arange(0.0, WIDEST)
    high = next((float(K_v) for K_v in tried if limit.permits(at(float(K_v)))), velocity.min)
    low, high = high, min(WIDER * high, velocity.max)
    for _ in range(CLOSER):
        middle = (low * high) ** 0.5
        low, high = (middle, high) if limit.permits(at(middle)) else (low, middle)
    yield from (at(max(low * share, velocity.min)) for share in shares)


def _starts_of_scan(limit: _Limit, prepared: Prepared) -> list[Point]:
    """Return the designs with the least errors that have the gains of the scan's starts.

    The scan knows the limits of gains, and little of what a box of environments requires of a coupling: at each of its
    gains the coupling is its own, and that of the best shape.
    """
    found = set[tuple[float, Point]]()
    for start in scan(prepared.scaled).starts:
        check_time()
        K_v, K_p, *own = prepared.units.to_si(point(start.gains, start.coupling))
        shares = ((share, limit.loops(Gains(share * K_v, share * K_p))) for share in GAIN_REDUCTIONS)
        share, loops = next(((share, loops) for share, loops in shares if loops is not None), (0.0, None))
        for shapes in ([tuple(own)], _shapes(limit)) if loops is not None else ():
            designs = (limit.design((share * K_v, share * K_p, *shape), loops) for shape in shapes)
            errors = [(limit.error(design), design) for design in designs if design is not None]
            found |= {min(errors)} if errors else set()
    return [design for _, design in sorted(found)[:STARTS]]


def _shapes(limit: _Limit) -> Iterator[tuple[float, float, float]]:
    """Yield b_c, m_c and b_0 of couplings of any size; what a problem fixes keeps its value."""
    problem = limit.posed.problem
    damping, mass, drag = limit.ranges[GAINS:]
    Z_0, T = problem.transparency.reference_impedance, problem.device.sample_time
    rigid, least = damping.min == inf, float(problem.device.rule == "euler")
    b_c = damping.max if damping.fixed else Z_0
    size = Z_0 if rigid else b_c
    for shape in (RIGID if rigid else SHAPES) if not mass.fixed else (0.0,):
        for share in ((1.0,) if rigid else DRAGS) if not drag.fixed else (0.0,):
            m_c = mass.max if mass.fixed else size * T * (least + shape)
            yield b_c, float(m_c), float(drag.max if drag.fixed else size * share)


def _least(limit: _Limit, start: Point, step: float, most: int, close: float) -> tuple[float, Point] | None:
    """Return the least error, with its design, near a start."""
    from scipy.optimize import minimize

    free = [k for k in limit.free if start[k] > 0]
    scaled = [k for k in free if k >= GAINS]
    shape = [k for k in free if k not in scaled[:1]]  # the first number of the coupling follows from the limit
    given = None if any(k < GAINS for k in shape) else limit.loops(Gains(*start[:GAINS]))

    def at(logs: Floats, *, onto_bounds: bool) -> Point | None:
        values = list(start)
        for k, place in zip(shape, logs, strict=True):
            values[k] = exp(float(place))
            if onto_bounds:
                values[k] = min(max(values[k], limit.ranges[k].min), limit.ranges[k].max)
        return limit.design(tuple(values), given or limit.loops(Gains(*values[:GAINS])))

    def error(logs: Floats, onto_bounds: bool) -> float:
        return limit.error(at(logs, onto_bounds=onto_bounds))

    first = np.array([log(start[k]) for k in shape])
    ways = np.diag([-1.0 if k == 0 else 1.0 for k in shape])  # K_v is next to its limit, so that it becomes less
    for again in (1.0, 0.3) if shape else ():
        simplex = np.vstack([first, *(first + again * step * way for way in ways)])
        options = {"initial_simplex": simplex, "maxfev": most // 2, "xatol": close, "fatol": 1e-7}
        # a simplex that is pressed onto a bound at first has lost a direction
        first = minimize(error, first, (again < 1,), method="Nelder-Mead", options=options).x
    found = at(first, onto_bounds=True)
    return None if found is None else (limit.error(found), found)
