"""What hands ask of the coupling in the sampled loop, bounded over boxes of gains (design/bound/README.md, section 1).

F and P are affine in the gains with constants of the angle and the hand (`vctune.model.hand_loop`), so that both sides
of |F|^2 Re Z_c >= factor (-o/2) are quadratic in them. Any set of places will do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vctune.design.bound.boxes import DesignBoxes
from vctune.design.bound.coefficients import Coefficients, concatenated, mapped, quadratic
from vctune.design.bound.quadratics import GUARD, Quadratic, less, lower, upper
from vctune.model.affine import Affine
from vctune.model.hand_loop import LoopInHand, delays_of, loop_in_hand, plant_in_hand
from vctune.model.pair import EvenOdd, Pair, im_conj_product, re_conj_product
from vctune.model.quantities import Device, Hand
from vctune.proof.array_intervals import Enclosure, Floats, decimal
from vctune.proof.jets import ENCLOSURES


@dataclass(frozen=True, slots=True)
class ConditionsInHands:
    """The demand in hands at some places, those of one device after another.

    Attributes
    ----------
    omega : (2/T) tan(theta/2), rad/s, at which the coupling is met
    lost : |F|^2 R, rounded down
    size, size_low : |F|^2, rounded up and down
    """

    omega: Floats
    lost: Quadratic
    size: Quadratic
    size_low: Quadratic

    def least_required(self, boxes: DesignBoxes) -> Floats:
        """Return a lower bound of R over each box where it is positive, else 0; shape (boxes, places).

        With m the least of lost - r size, R is at least r + m/size for any r, which is the closer the better r is.
        """
        most, least = self.size.greatest(boxes), np.maximum(self.size_low.least(boxes), 0.0)

        def from_guess(r: Floats) -> Floats:
            slack = less(self.lost, r, self.size).least(boxes)
            more = slack / np.where(slack >= 0, most, least)
            return r + more - GUARD * (r + np.abs(more))

        middle = 0.5 * (boxes.low + boxes.high)
        there = DesignBoxes(middle, middle)
        guess = np.fmax(self.lost.least(there) / self.size.greatest(there), 0.0)
        R = np.fmax(np.fmax(from_guess(0.0 * guess), from_guess(guess)), 0.0)
        return np.asarray(np.fmax(from_guess(R), R))


def conditions_in_hands(devices: Sequence[Device], places: Floats) -> ConditionsInHands:
    """Return the demand in hands at some places, on each of several devices.

    Parameters
    ----------
    devices : known exactly
    places : omega [rad/s] in [0, pi/T] and the numbers of a hand, shape (4, places)
    """
    each = [_coefficients(device, places) for device in devices]
    lost, size = concatenated(each)
    omega = [np.tan(_angles(device, places) / 2) * (2 / device.sample_time) for device in devices]
    return ConditionsInHands(np.concatenate(omega), lower(lost), upper(size), lower(size))


def _angles(device: Device, places: Floats) -> Floats:
    return np.minimum(places[0] * device.sample_time, np.pi)


def _coefficients(device: Device, places: Floats) -> tuple[Coefficients, Coefficients]:
    """Return those of -o/2 and |F|^2."""
    hand, theta = Hand(*map(decimal, places[1:])), Enclosure(_angles(device, places))
    plant = plant_in_hand(device.bare.converted(decimal), hand, delays_of(device), ENCLOSURES)
    at, sin = loop_in_hand(plant, theta, ENCLOSURES), ENCLOSURES.sin(theta / 2)
    assert isinstance(at, LoopInHand)

    def parts(number: EvenOdd) -> Pair:
        return Pair(number.even, number.odd)

    def true(number: EvenOdd) -> Pair:
        return Pair(number.even, sin * number.odd)

    F = Affine(parts(at.open), parts(at.velocity), parts(at.position))
    P = Affine(None, parts(at.seen_velocity), parts(at.seen_position))
    lost = mapped(quadratic(im_conj_product, P, F, crossed=True), lambda x: -0.5 * x)
    F = Affine(true(at.open), true(at.velocity), true(at.position))
    return lost, quadratic(re_conj_product, F, F, crossed=True)
