"""Represent a point z = e^(j theta) of the unit circle by quantities of theta/2 that are regular at theta = 0, and
split delays into samples."""

from __future__ import annotations

from collections.abc import Callable
from math import floor
from typing import Any, NamedTuple

import numpy as np

from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import Matrix, Vector, add, change_of_states, scaled

# Type of a function that returns the complex number even + j s odd for given even and odd
OfParts = Callable[[Number, Number], Any]


class Circle(NamedTuple):
    """The point z = e^{j theta}, stored as s = sin(theta/2), c = cos(theta/2) and s^2."""

    theta: Number
    sin: Number
    cos: Number
    square: Number
    ops: Arithmetic

    def late(self, whole: Number, number: OfParts) -> Any:
        """Return e^{-j (N + 1/2) theta}, the delay of N + 1/2 samples."""
        if isinstance(whole, int) and whole == 0:
            return number(self.cos, -1)
        even, odd = self.turned(whole + 0.5)
        return number(even, -odd)

    def turned(self, steps: Number) -> tuple[Number, Number]:
        """Return cos(steps theta) and sin(steps theta)/s."""
        ops = self.ops
        sine = 2 * steps * (ops.sinc(self.theta * steps) / ops.sinc(self.theta / 2))
        return ops.cos(self.theta * steps), sine


def circle(theta: Number, ops: Arithmetic) -> Circle:
    """Return the point z = e^{j theta} of the unit circle."""
    sin, cos = ops.sin(theta / 2), ops.cos(theta / 2)
    return Circle(theta, sin, cos, sin * sin, ops)


# Difference from a whole number of samples, as a share of a sample, that the code treats as a rounding error
SNAP = 1e-12


def split_delay(delay: Number, sample_time: Number) -> tuple[Number, Number]:
    """Split a delay into whole samples and the remaining fraction of a sample."""
    if np.ndim(delay) > 0:
        split = [split_delay(float(one), sample_time) for one in delay]
        return np.array([whole for whole, _ in split]), np.array([fraction for _, fraction in split])
    samples = delay / sample_time
    nearest = round(samples)
    if abs(samples - nearest) <= SNAP * max(1.0, samples):
        return nearest, 0.0
    return floor(samples), samples - floor(samples)


def left_by_older(rates: Matrix, older: Number, ops: Arithmetic) -> Vector:
    """Return the change of the states over one sample per unit of a force that acts in its first part `older`."""
    force = (*(0,) * (len(rates) - 1), 1)
    left = change_of_states(scaled(rates, older), force, ops)
    later = change_of_states(scaled(rates, 1 - older), left, ops)
    return tuple(add(a, b) for a, b in zip(left, later, strict=True))
