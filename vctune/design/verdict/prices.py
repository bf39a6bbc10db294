"""Compute the prices of a device's parameters: the change of the least error if a parameter improves by 1 %."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from math import exp, isclose

import numpy as np

from vctune.design.nlp.ipopt import lagrangian, numbers_of
from vctune.design.prepared import Prepared, prepare, with_acting_terms
from vctune.design.result import Polished, Price, Solved
from vctune.design.variables import coordinates, design_of
from vctune.design.verdict.judge import Status
from vctune.model.device import Device
from vctune.model.hands import Hand, Hands
from vctune.model.problem import Problem
from vctune.proof.claims.delays import kept_at_whole_sample, sensed_force_jumps
from vctune.running import OutOfTimeError, check_time

PRICES = "the prices of the device's numbers"  # Name of a stage that a time limit may cut short

STEP = 1e-5  # Relative step, up and down, of the difference that approximates a derivative
STEEPEST = 50.0  # Slope d log error/d log parameter above which a change of the error counts as a jump
BETTER = 0.01  # Share by which a parameter improves


@np.errstate(all="ignore")
def with_prices(solved: Solved) -> Solved:
    """Return the result of a problem with the price of each parameter of its device, if its design is a local
    optimum."""
    judgement, polished = solved.judgement, solved.polished
    if judgement is None or judgement.status is not Status.CERTIFIED or polished is None:
        return solved
    if not polished.solution.converged:  # without convergence the multipliers are not derivatives
        return solved
    prepared = prepare(solved.problem)
    prices = []
    try:
        here = _changed(prepared, polished, _OfDevice("sample_time"), 1.0)
        for number in _numbers(solved.problem):
            check_time()
            prices.append(_price(prepared, polished, here, number))
    except OutOfTimeError:
        return replace(solved, cut=(*solved.cut, PRICES))
    return replace(solved, prices=sorted(prices, key=lambda price: price.change))


@dataclass(frozen=True, slots=True)
class _OfDevice:
    """A parameter of the device, identified by its key in its table."""

    name: str

    @property
    def key(self) -> str:
        """The dotted key."""
        return f"device.{self.name}"

    def of(self, problem: Problem) -> float:
        """Return the value of the parameter."""
        return float(problem.device.number(self.name))

    def changed(self, device: Device, factor: float) -> Device:
        """Return a device with the parameter multiplied by `factor`."""
        return device.with_numbers({self.name: factor * device.number(self.name)})

    def held(self, hand: Hand, hands: Hands, factor: float) -> Hand:
        """Return the hand unchanged."""
        return hand


@dataclass(frozen=True, slots=True)
class _OfHands:
    """The least or the greatest mass, damping or stiffness of the hands; both at once if they are equal."""

    name: str  # name of the hand's parameter
    end: str  # "min", "max", or "" for both

    @property
    def key(self) -> str:
        """The dotted key."""
        return f"operator.{self.name}.{self.end}".rstrip(".")

    def of(self, problem: Problem) -> float:
        """Return the value of the parameter."""
        return float(getattr(problem.hands.low if self.end == "min" else problem.hands.high, self.name))

    def changed(self, device: Device, factor: float) -> Device:
        """Return the device unchanged."""
        return device

    def held(self, hand: Hand, hands: Hands, factor: float) -> Hand:
        """Return a hand of a box; if it lies at this end of the range, its parameter is multiplied by `factor`."""
        value = getattr(hand, self.name)
        edge = getattr(hands.low if self.end == "min" else hands.high, self.name)
        return replace(hand, **{self.name: factor * value}) if isclose(value, edge) else hand


def _numbers(problem: Problem) -> list[_OfDevice | _OfHands]:
    """Return the parameters that get a price: parameters of the device and, for a servo, also of the hands."""
    found: list[_OfDevice | _OfHands] = [_OfDevice(name) for name, old in problem.device.numbers().items() if old > 0]
    if problem.device.kind.own_loop:
        return found
    low, high = problem.hands.low, problem.hands.high
    for part in fields(Hand):
        least, most = getattr(low, part.name), getattr(high, part.name)
        ends = [("", most)] if least == most else [("min", least), ("max", most)]
        found += [_OfHands(part.name, end) for end, value in ends if value > 0]
    return found


def _price(prepared: Prepared, polished: Polished, here: _Changed, number: _OfDevice | _OfHands) -> Price:
    """Return the price of a parameter, for an increase or a decrease, whichever lowers the error."""
    old = number.of(prepared.problem)
    less, more = (_changed(prepared, polished, number, factor) for factor in (1 - STEP, 1 + STEP))
    optimised = with_acting_terms(prepared.given).error(*design_of(prepared.units.to_si(polished.values))) ** 2

    def error2(at: _Changed) -> float:
        return optimised * exp(2 * (at.lagrangian - here.lagrangian)) + at.others2

    changes = [(error2(at) / error2(here) - 1, sign) for sign, at in ((-1, less), (1, more))]
    change, sign = min((each for each in changes if abs(each[0]) < 2 * STEP * STEEPEST), default=(0.0, -1))
    return Price(number.key, old, old * (1 + sign * BETTER), round(min(change / 2 * BETTER / STEP, 0.0), 12))


@dataclass(frozen=True, slots=True)
class _Changed:
    """The parts of the squared error after a change of one parameter."""

    lagrangian: float  # Lagrangian of the last NLP, whose objective is the logarithm of the error
    others2: float  # sum of the squared terms of the error that are the same for every design, which the NLP omits


def _changed(prepared: Prepared, polished: Polished, number: _OfDevice | _OfHands, factor: float) -> _Changed:
    """Return the parts of the squared error after a parameter of the devices or hands is multiplied by `factor`."""

    def changed(device: Device) -> Device:
        return number.changed(device, factor)

    def held(hand: Hand) -> Hand:
        return number.held(hand, prepared.scaled.problem.hands, factor)

    def posed_on(device: Device) -> Device:
        if problem.hands_met is None or not sensed_force_jumps(device, problem.hands_met):
            return changed(device)
        return kept_at_whole_sample(changed(device), device)

    problem, structure, design = prepared.problem, polished.structure, prepared.units.to_si(polished.values)
    law = design_of(design)
    other = prepare(replace(problem, device=changed(problem.device)))
    posed, values = other.scaled, other.units.to_dimensionless(design)
    working_set = polished.working_set.on_devices(posed_on, other.units.time / prepared.units.time, held)
    free = coordinates(posed.problem, integrator=structure.integrator)
    box = np.array([each.low for each in free]), np.array([each.high for each in free])
    given = numbers_of(posed, structure, free, values, box, working_set, polished.tightening)
    return _Changed(
        lagrangian(structure, given, polished.solution),
        other.given.error(*law) ** 2 - with_acting_terms(other.given).error(*law) ** 2,
    )
