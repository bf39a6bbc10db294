"""Prove that some hand, with an environment of the box, has a pole on the unit circle (model/README.md, sections 15
and 18): a refutation that no sample of hands and environments meets."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from math import pi
from typing import NamedTuple

from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.hands import Hand
from vctune.model.numbers.arithmetic import Number
from vctune.model.problem import Demands
from vctune.model.sampled.loop_in_worlds import Disjuncts, real_at_nyquist, sum_of
from vctune.proof.claims.cases import exact_case
from vctune.proof.claims.margins_of_claims import margins_in_worlds
from vctune.proof.enclosures.intervals import ENCLOSURES, between, surely_negative

NARROW, HALVINGS = 1e-10, 10  # relative width of a crossing; halvings of it in which the resistance is seen negative


class Suspect(NamedTuple):
    """A device and a hand of their boxes in which a pole seems to be on the unit circle between two angles."""

    device: Device
    hand: Hand
    angles: tuple[float, float]  # omega T, rad; twice the same if it seems to be there


# A function that says where to look for a failure in hands. Whatever it returns, a verdict is proved
Suspects = Callable[[Design, Demands, Sequence[Device]], Iterable[Suspect]]


def no_suspects(_design: Design, _demands: Demands, _devices: Sequence[Device]) -> Iterable[Suspect]:
    """Return no place to look at."""
    return ()


def sums(found: Disjuncts) -> tuple[Number, Number, Number]:
    """Return the sums of the resistive margin, and of those above and below; one that cannot be positive is -1."""
    above, below = (-1.0 if terms is None else sum_of(terms) for terms in (found.above, found.below))
    return sum_of(found.resistive), above, below


def crossing(design: Design, demands: Demands, suspect: Suspect) -> float | None:
    """Return an angle next to which a pole is proved on the circle; None if it cannot be proved."""
    assert demands.worlds is not None
    there = exact_case(replace(design, device=suspect.device.undisturbed), replace(demands, factor=1.0), suspect.hand)
    low, high = suspect.angles

    def at(first: float, last: float) -> tuple[Number, Number, Number]:
        return sums(margins_in_worlds(there, between(first, last)))

    def is_above(theta: float) -> bool:
        return surely_negative(at(theta, theta)[1])

    def is_below(theta: float) -> bool:
        return surely_negative(at(theta, theta)[2])

    ends = high == pi and real_at_nyquist(design.series, design.device.rule, demands.worlds)
    if ends and surely_negative(sum_of(margins_in_worlds(there, ENCLOSURES.pi).resistive)):
        return pi
    rising = is_above(low) and is_below(high)
    if not rising and not (is_below(low) and is_above(high)):
        return None
    while high - low > NARROW * high:
        middle = 0.5 * (low + high)
        if is_above(middle) and is_below(middle):  # an environment within the box
            low = high = middle
        elif is_above(middle) if rising else is_below(middle):
            low = middle
        elif is_below(middle) if rising else is_above(middle):
            high = middle
        else:
            break
    parts = [(low, high)]
    for _ in range(HALVINGS):
        parts = [part for part in parts if not surely_negative(at(*part)[0])]
        if not parts:
            return 0.5 * (low + high)
        parts = [half for a, b in parts for half in ((a, 0.5 * (a + b)), (0.5 * (a + b), b))]
    return None
