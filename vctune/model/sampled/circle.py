"""Represent a point z = e^(j theta) of the unit circle by quantities of theta/2 that are regular at theta = 0."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from vctune.model.numbers.arithmetic import Arithmetic, Number

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
