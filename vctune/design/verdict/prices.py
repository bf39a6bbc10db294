"""What a better device would be worth: how much the least error changes with each of its numbers.

By the envelope theorem that is the derivative of the Lagrangian at the optimum. See design/README.md, section 11.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp

import numpy as np

from vctune.design.nlp.ipopt import lagrangian, numbers_of
from vctune.design.prepared import Prepared, compared, prepare
from vctune.design.result import Polished, Price, Solved
from vctune.design.variables import coordinates, design_of
from vctune.design.verdict.judge import Status
from vctune.model.device import Device
from vctune.proof.claims.whole_samples import kept_at_whole_sample, sensed_force_jumps
from vctune.running import OutOfTimeError, check_time

PRICES = "the prices of the device's numbers"
"""What a time limit may cut short."""

STEP = 1e-5
"""Relative change of a number over which the derivative is taken, each way: its error is about as great, and rounding
is far below. Half and twice give the same four digits."""
BETTER = 0.01
"""By what share a better number is better: to so much the least error is linear, but for a bend at the optimum."""


@np.errstate(all="ignore")
def with_prices(solved: Solved) -> Solved:
    """Return what came of a problem with what each better number of its device is worth, if its design is optimal.

    Parameters
    ----------
    solved : what came of a problem
    """
    judgement, polished = solved.judgement, solved.polished
    if judgement is None or judgement.status is not Status.CERTIFIED or polished is None:
        return solved
    prepared = prepare(solved.problem)
    numbers = {key: old for key, old in solved.problem.device.numbers().items() if old > 0}
    prices = []
    try:
        here = _changed(prepared, polished, "mass", 1.0)
        for key in numbers:
            check_time()
            prices.append(_price(prepared, polished, here, key))
    except OutOfTimeError:
        return replace(solved, cut=(*solved.cut, PRICES))
    return replace(solved, prices=sorted(prices, key=lambda price: price.change))


def _price(prepared: Prepared, polished: Polished, here: _Changed, key: str) -> Price:
    """Return the price of a number: of more or less of it, whichever lowers the error."""
    old = prepared.problem.device.number(key)
    less, more = (_changed(prepared, polished, key, factor) for factor in (1 - STEP, 1 + STEP))
    optimised = compared(prepared.given).error(*design_of(prepared.units.to_si(polished.values))) ** 2

    def error2(at: _Changed) -> float:
        return optimised * exp(2 * (at.lagrangian - here.lagrangian)) + at.others2

    change, sign = min((error2(at) / error2(here) - 1, sign) for sign, at in ((-1, less), (1, more)))
    return Price(f"device.{key}", old, old * (1 + sign * BETTER), min(change / 2 * BETTER / STEP, 0.0))


@dataclass(frozen=True, slots=True)
class _Changed:
    """What a number of the device changes.

    Attributes
    ----------
    lagrangian : of the last NLP, whose objective is the logarithm of the error
    others2 : sum of the squares of the terms of the error that are the same for every design, and not in the NLP
    """

    lagrangian: float
    others2: float


def _changed(prepared: Prepared, polished: Polished, key: str, factor: float) -> _Changed:
    """Return what there is on devices one of whose numbers is changed, all else the same in SI units."""

    def changed(device: Device) -> Device:
        return device.with_numbers({key: factor * device.number(key)})

    def posed_on(device: Device) -> Device:
        if problem.hands_met is None or not sensed_force_jumps(device, problem.hands_met):
            return changed(device)
        return kept_at_whole_sample(changed(device), device)

    problem, structure, design = prepared.problem, polished.structure, prepared.units.to_si(polished.values)
    law = design_of(design)
    other = prepare(replace(problem, device=changed(problem.device)))
    posed, values = other.scaled, other.units.to_dimensionless(design)
    working_set = polished.working_set.on_devices(posed_on, other.units.time / prepared.units.time)
    free = coordinates(posed.problem, integrator=structure.integrator)
    box = np.array([each.low for each in free]), np.array([each.high for each in free])
    given = numbers_of(posed, structure, free, values, box, working_set, polished.tightening)
    return _Changed(
        lagrangian(structure, given, polished.solution),
        other.given.error(*law) ** 2 - compared(other.given).error(*law) ** 2,
    )
