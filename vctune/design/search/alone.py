"""Find the mass and drag that are felt least with nothing behind them, for given gains (model/README.md, section 18).

The loop is Z_c + Z_seen with Z_c = c (1 + tau s). It is stable for a great c, and stays so while c falls until a hand
of the box puts a pole on the unit circle: there, its imaginary part is 0 and its real part not positive. In any passive
hand, c has a least value at each frequency of the band. So each tau has a least c, and the error of c and tau is left
to minimise over tau alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product
from math import exp, inf, log, pi

import numpy as np

from vctune.analysis.demands import demand_grid, response
from vctune.analysis.extrema import Floats
from vctune.design.prepared import Posed
from vctune.design.verdict.judge import PROVING, Judgement, judgement_of
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Coupling, Gains
from vctune.model.hands import Hand, Hands, stacked
from vctune.model.loop.llewellyn import passive_alone
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.pair import Pair
from vctune.model.problem import Problem
from vctune.model.sampled.hand_loop import loop_in_hand, seen_in_hand
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.proof.certificate import Certificate, certify
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.claims.registry import claims_about
from vctune.proof.outcome import Verdict
from vctune.proof.prover import boxes_at_most
from vctune.running import OutOfTimeError, check_time, seconds_left, time_limit

SHARES = (0.0, 0.05, 0.3, 1.0)  # Hands of the box that are looked at first: shares of each range
ANGLES = np.append(np.geomspace(1e-5, 0.5, 400), np.linspace(0.5, pi * (1 - 1e-9), 250)[1:])  # rad
SLOWEST, QUICKEST, TAUS = 1e5, 1e-3, 33  # tau, in sample times, and number of values that are compared first
ENDLESS = 1e12  # tau of a mass without drag, in sample times
HALVINGS = 22  # of the logarithm of c
ROUNDS, TIGHTER = 12, 4e-4  # proofs, and the reserve of the first beyond the estimate; it doubles with each
MOST_BOXES = 20_000  # of a proof: with more reserve it needs few
OF_COUPLING = claims_about("ratio", "in_hand")

LeastScale = Callable[[float, float], float]  # the least c for a tau, if it is above a given one, by an estimate


def has_nothing_behind(problem: Problem) -> bool:
    """Return whether a problem leaves mass and drag alone to choose, with nothing behind them."""
    worlds, servo, bounds = problem.worlds, problem.device.servo, problem.bounds
    if worlds is None or worlds.walls or worlds.low.damping > 0 or (servo is not None and servo.radii):
        return False
    return worlds.nothing and bounds.velocity.fixed and bounds.position.fixed and bounds.damping.min == inf


@np.errstate(all="ignore")
def least_felt(posed: Posed) -> Judgement | None:
    """Return the design with the least error that is proved, or else the last that was tried; None if there is none."""
    bounds, demands = posed.problem.bounds, posed.demands
    gains = Gains(bounds.velocity.min, bounds.position.min)

    def best(devices: Sequence[Device], hands: Sequence[Hand], reserve: float) -> Coupling | None:
        least = [_in_hands(device, gains, hands) for device in devices if demands.hands is not None]
        least += [_on_band(device, gains, posed.span) for device in devices if demands.alone]
        return _best(posed, gains, least, reserve)

    return first_proved(posed, gains, best)


def first_proved(
    posed: Posed,
    gains: Gains,
    best: Callable[[Sequence[Device], Sequence[Hand], float], AnyCoupling | None],
) -> Judgement | None:
    """Return the first of the best couplings that is proved, each estimated with the devices and hands that refuted the
    last and more reserve; or else the last that was tried."""
    hands = _hands_of(posed.problem.hands)
    devices = list(dict.fromkeys(case.device for case in posed.cases))  # others join where they refute
    tried: Certificate | None = None
    reserve = TIGHTER
    for _ in range(ROUNDS):
        try:
            coupling = best(devices, hands, 1 + reserve)
        except OutOfTimeError:
            if tried is None or tried.verdict is Verdict.REFUTED:  # another coupling may be proved
                raise
            break
        if coupling is None:
            break
        with boxes_at_most(MOST_BOXES), time_limit(PROVING * seconds_left()):
            tried = certify(Design(posed.demands.device, gains, coupling), posed.demands, posed.box)
        outcomes = tried.outcomes
        if all(outcomes[claim].verdict is Verdict.PROVED for claim in OF_COUPLING if claim in outcomes):
            break  # certified, or the gains fail
        lost = [each for each in outcomes.values() if each.verdict is Verdict.REFUTED]
        new = [each.hand for each in lost if each.hand is not None and each.hand not in hands]
        others = [each.device for each in lost if each.device is not None and each.device not in devices]
        hands, devices, reserve = hands + new, devices + others, reserve if new or others else 2 * reserve
    return None if tried is None else judgement_of(posed, gains, tried.design.coupling, tried)


def _hands_of(hands: Hands) -> list[Hand]:
    ranges = ([low + share * (high - low) for share in SHARES] for low, high in hands.ranges.values())
    return list(dict.fromkeys(Hand(*numbers) for numbers in product(*ranges)))


def _in_hands(device: Device, gains: Gains, hands: Sequence[Hand]) -> LeastScale:
    """Return the least c in all of some hands."""
    seen = _seen(device, gains, hands)
    return lambda tau, known: _least_scale(1 + 1j * tau * (2 / device.sample_time) * np.tan(ANGLES / 2), seen, known)


def _on_band(device: Device, gains: Gains, span: tuple[float, float]) -> LeastScale:
    """Return the least c in any passive hand on the band."""
    omega = demand_grid(device, *span)
    loop = response(device, gains, omega)

    def least(tau: float, known: float) -> float:
        held, driven = passive_alone(loop, Pair(np.ones_like(omega), tau * omega))
        return float(np.max(np.where(loop.resistance > 0, -driven / held, inf)))

    return least


def _seen(device: Device, gains: Gains, hands: Sequence[Hand]) -> Floats:
    """Return Z_seen in each hand at each angle, shape (hands, angles)."""
    check_time()
    plant = plant_in_hand(device, stacked(hands, (-1, 1)), delays_of(device), FLOATS)
    seen = seen_in_hand(loop_in_hand(plant, ANGLES, FLOATS), gains)
    found = -(seen.lost + 1j * seen.swing / np.sin(ANGLES / 2)) / seen.size
    return np.broadcast_to(found, (len(hands), ANGLES.size))


def _best(posed: Posed, gains: Gains, of_each: Sequence[LeastScale], reserve: float) -> Coupling | None:
    """Return the mass and drag with the least error of those that are stable in all hands, by an estimate."""
    problem, T = posed.problem, posed.problem.device.sample_time
    least, most, massive = log(QUICKEST * T), log(SLOWEST * T), problem.bounds.drag.max == 0

    def coupling(log_tau: float) -> Coupling | None:
        tau, bounds = exp(log_tau), problem.bounds
        c = 0.0
        for each in of_each:
            check_time()
            c = max(c, each(tau, c))
        c *= problem.stability.safety_factor * reserve
        c = max(c, bounds.drag.min, bounds.mass.min / tau)
        mass, drag = float(f"{c * tau:.8g}"), 0.0 if massive else float(f"{c:.8g}")
        return Coupling(inf, mass, drag) if mass <= bounds.mass.max and drag <= bounds.drag.max else None

    def error(log_tau: float) -> float:
        found = coupling(log_tau)
        return inf if found is None else posed.error(gains, found)

    if massive:
        return coupling(log(ENDLESS * T))
    grid = np.linspace(least, most, TAUS)
    values = [error(at) for at in grid]
    k = int(np.argmin(values))
    if values[k] == inf:
        return None
    low, high = float(grid[max(k - 1, 0)]), float(grid[min(k + 1, TAUS - 1)])
    golden = (5**0.5 - 1) / 2
    for _ in range(12):
        inner = high - golden * (high - low), low + golden * (high - low)
        low, high = (low, inner[1]) if error(inner[0]) <= error(inner[1]) else (inner[0], high)
    return coupling(min((float(grid[k]), 0.5 * (low + high)), key=error))


def _least_scale(shape: Floats, seen: Floats, known: float) -> float:
    """Return the least c beyond which no c puts a pole of c shape + seen on the unit circle, in any of the hands.

    If it is below a known c, the function returns some c that is at most the known one."""

    def stable(c: float) -> bool:
        whole = c * shape + seen
        real, imag = whole.real, whole.imag
        share = np.clip(imag[:, :-1] / (imag[:, :-1] - imag[:, 1:]), 0.0, 1.0)
        there = real[:, :-1] + share * (real[:, 1:] - real[:, :-1])
        return not np.any((imag[:, :-1] < 0) != (imag[:, 1:] < 0), where=there <= 0)

    high = float(np.max(np.abs(seen) / np.abs(shape)))
    low = high
    while stable(low) and low > max(1e-12 * high, known):
        low /= 2
    if low == high or stable(low):
        return low
    low, high = log(low), log(2 * low)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if stable(exp(middle)) else (middle, high)
    return exp(high)
