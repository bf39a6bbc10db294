"""Compute the prices of a device's parameters: the change of the least error if a parameter improves by 1 %."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from math import expm1, hypot, isclose, log

import numpy as np

from vctune.analysis.demands import transparency_error
from vctune.analysis.in_hands import least_ratios_near
from vctune.design.judging.judge import Judgement, Status
from vctune.design.nlp.nlp import lagrangian, stated
from vctune.design.nlp.solution import Polished
from vctune.design.prepared import Prepared, pose, prepare
from vctune.design.result import Price, Solved
from vctune.design.search.along_limit import least_error
from vctune.design.search.first_proved import Law, LookedAt
from vctune.design.variables import coordinates, design_of
from vctune.model.device import Device
from vctune.model.hands import Hand
from vctune.model.parts import LATENCY, PART_NUMBERS
from vctune.model.problem import Problem
from vctune.proof.claims.delays import kept_at_whole_sample, sensed_force_jumps
from vctune.running import OutOfTimeError, check_time

PRICES = "the prices of the device's numbers"  # Name of a stage that a time limit may cut short

DIFFERENCE_STEP = 1e-5  # Relative step, up and down, of the difference that approximates a derivative
STEEPEST = 50.0  # Slope d log error/d log parameter above which a change of the error counts as a jump
_BETTER = {"time": -1, "rate": 1}  # Direction in which a parameter of a quantity is that of a better device
BETTER = 0.01  # Share by which a parameter improves

_LogError = Callable[[Callable[[Device], Device], Callable[[Hand], Hand]], float]
"""The logarithm of the least error after a change of all devices and hands."""


@np.errstate(all="ignore")
def with_prices(solved: Solved) -> Solved:
    """Return the result of a problem with the price of each parameter of its device, if its design is a local
    optimum."""
    judgement, prices = solved.judgement, list[Price]()
    if judgement is None or judgement.status is not Status.CERTIFIED:
        return solved
    try:
        known = _log_error(solved, judgement)
        if known is None:
            return solved
        log_error, step = known
        here = log_error(lambda device: device, lambda hand: hand)
        for number in _numbers(solved.problem):
            check_time()
            change, sign = _change(log_error, step, here, number)
            better = _BETTER.get(number.quantity, sign)
            if sign != better and change < 0:
                continue  # a later or slower device is no better one, whatever it does to the error
            sign = better
            price = Price(key=number.key, old=number.old, new=number.old * (1 + sign * BETTER), change=change)
            free = _of_free_feel(solved.problem, judgement, number, sign) if solved.problem.apart else None
            prices.append(price if free is None else price.model_copy(update={"free": free}))
    except OutOfTimeError:
        return replace(solved, cut=(*solved.cut, PRICES))
    return replace(solved, prices=sorted(prices, key=lambda price: price.change))


def _log_error(solved: Solved, judgement: Judgement) -> tuple[_LogError, float] | None:
    """Return the error as a function, and the step of the parameters with which it is differentiated."""
    if solved.polished is not None and solved.polished.solution.converged:  # else the multipliers are no derivatives
        prepared = prepare(solved.problem)
        return partial(_lagrangian, prepared, _at_minima(prepared.scaled.problem, solved.polished)), DIFFERENCE_STEP
    if solved.seen is not None:
        return partial(_along_limit, solved.problem, solved.seen, (judgement.gains, judgement.coupling)), BETTER
    return None


def _at_minima(problem: Problem, polished: Polished) -> Polished:
    """Return an optimum with its places in hands moved to the minima beside them: next to a sharp resonance the
    constraint depends strongly on the place, and its multiplier is a derivative only at the minimum."""
    working_set, law, met = polished.working_set.copy(), design_of(polished.values), problem.worlds_met
    for k, place in enumerate(working_set.in_hand):
        if problem.hands_met is None or place.hand is None or place.wall is not None:
            continue
        at = least_ratios_near([place.device], problem.hands_met, *law, place.omega, place.hand, met)[0]
        working_set.in_hand[k] = replace(place, omega=at.omega, hand=at.hand)
    return replace(polished, working_set=working_set)


@dataclass(frozen=True, slots=True)
class _Number:
    """A parameter with a price, and how it changes devices and hands by a factor."""

    key: str
    old: float
    quantity: str = ""  # of a parameter of the device
    device: Callable[[float, Device], Device] = lambda factor, device: device
    hand: Callable[[float, Hand], Hand] = lambda factor, hand: hand


def _numbers(problem: Problem) -> list[_Number]:
    """Return the parameters that get a price: parameters of the device and, for a servo, also of the hands."""
    known = problem.device.numbers()
    known |= {problem.device.delay_key: problem.device.stated_delay}
    if problem.device.digital:
        del known["sample_time"]  # at another rate the same coefficients are another filter
    found = [
        _Number(f"device.{name}", old, PART_NUMBERS[name].quantity, partial(_of_device, name))
        for name, old in known.items()
        if old > 0
    ]
    if problem.device.kind.own_loop:
        return found
    hands = problem.hands
    for table, box in (("operator", hands.held), *([("tool", hands.tool)] if hands.tool else [])):
        for name, (least, most) in box.ranges.items():
            low, high = hands.ranges[name]
            ends = {"": (most, high)} if least == most else {".min": (least, low), ".max": (most, high)}
            found += [
                _Number(f"{table}.{name}{end}", old, hand=partial(_of_hand, name, edge, old))
                for end, (old, edge) in ends.items()
                if old > 0
            ]
    return found


def _of_device(name: str, factor: float, device: Device) -> Device:
    names = (name, LATENCY) if name == "servo.delay" else (name,)  # a latency keeps the shares of delay and lag
    return device.with_numbers({key: factor * number for key in names if (number := device.number(key)) is not None})


def _of_hand(name: str, edge: float, share: float, factor: float, hand: Hand) -> Hand:
    """Return a hand of the box; if it lies at this edge of the box, this share of its parameter, that of the hand
    itself or that of its tool, is multiplied by `factor`."""
    value = getattr(hand, name)
    return replace(hand, **{name: value + (factor - 1) * share}) if isclose(value, edge) else hand


def _change(log_error: _LogError, step: float, here: float, number: _Number) -> tuple[float, int]:
    """Return the change of the error for a parameter that is better by 1 %, and 1 if greater is better or -1."""
    changes = [(0.0, -1)]
    for sign in (-1, 1):
        factor = 1 + sign * step
        there = log_error(partial(number.device, factor), partial(number.hand, factor))
        change = expm1(there - here)
        changes += [(change, sign)] if abs(change) < step * STEEPEST else []
    change, sign = min(changes)
    return round(change * BETTER / step, 12), sign


def _of_free_feel(problem: Problem, judgement: Judgement, number: _Number, sign: int) -> float:
    """Return the relative change of what is felt of the device itself when free, which no design changes."""

    def felt(problem: Problem) -> float:
        found = transparency_error(problem, judgement.gains, judgement.coupling)
        weights = problem.transparency.weights
        return hypot(*(getattr(weights, term) * getattr(found, term) for term in problem.apart))

    changed = replace(problem, device=number.device(1 + sign * BETTER, problem.device))
    return round(felt(changed) / felt(problem) - 1, 12)


def _lagrangian(
    prepared: Prepared, polished: Polished, of_device: Callable[[Device], Device], of_hand: Callable[[Hand], Hand]
) -> float:
    """Return the Lagrangian of the last NLP, whose objective is the logarithm of the error, after a change of all
    devices and hands."""

    def held(hand: Hand) -> Hand:
        return of_hand(hand.in_units(1 / impedance, 1 / time)).in_units(impedance, time)

    problem, units, design = prepared.problem, prepared.units, prepared.units.to_si(polished.values)
    impedance, time = units.impedance, units.time
    other = prepare(replace(problem, device=of_device(problem.device)))
    values = other.units.to_dimensionless(design)
    integrator = polished.structure.integrator
    free = coordinates(other.scaled.problem, integrator=integrator)
    box = np.array([each.low for each in free]), np.array([each.high for each in free])
    working_set = polished.working_set.on_devices(_kept(problem, of_device), other.units.time / time, held)
    given = stated(
        other.scaled, free, values, box, working_set, polished.panels, polished.tightening, integrator=integrator
    )
    return lagrangian(given, polished.solution)


def _along_limit(
    problem: Problem, seen: LookedAt, law: Law, of_device: Callable[[Device], Device], of_hand: Callable[[Hand], Hand]
) -> float:
    """Return the logarithm of the least error next to a design along the limit of its coupling, after a change of all
    devices and hands. Several angles limit a design there, so that its other numbers are searched again."""
    changed = pose(replace(problem, device=of_device(problem.device)))
    # next to whole samples other devices join
    devices = [*map(_kept(problem, of_device), seen.devices), *(case.device for case in changed.hand_cases)]
    hands = [of_hand(hand) for hand in seen.hands]
    return log(least_error(changed, replace(seen, devices=list(dict.fromkeys(devices)), hands=hands), law))


def _kept(problem: Problem, of_device: Callable[[Device], Device]) -> Callable[[Device], Device]:
    """Return a change of devices that keeps a sum of delays at the whole sample where the sensed force jumps."""

    def on(device: Device) -> Device:
        changed = of_device(device)
        jumps = problem.hands_met is not None and sensed_force_jumps(device, problem.hands_met)
        return kept_at_whole_sample(changed, device) if jumps else changed

    return on
