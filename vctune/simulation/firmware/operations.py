"""Define the operations of controller and friction on plain floats."""

from __future__ import annotations

import math
from typing import Protocol

from vctune.model.numbers.arithmetic import Number


class Arithmetic(Protocol):
    """Elementary functions of one kind of number."""

    def exp(self, x: Number) -> Number: ...
    def expm1(self, x: Number) -> Number: ...
    def absolute(self, x: Number) -> Number: ...
    def floor(self, x: Number) -> Number: ...
    def minimum(self, a: Number, b: Number) -> Number:
        """Return the lesser of two numbers."""

    def maximum(self, a: Number, b: Number) -> Number:
        """Return the greater of two numbers."""

    def where(self, condition: Number, yes: Number, no: Number) -> Number:
        """Return `yes` if a condition is true, and `no` otherwise. The caller evaluates both numbers."""


class _FloatArithmetic:
    exp = staticmethod(math.exp)
    expm1 = staticmethod(math.expm1)
    absolute = staticmethod(abs)
    floor = staticmethod(math.floor)
    minimum = staticmethod(min)
    maximum = staticmethod(max)

    @staticmethod
    def where(condition: Number, yes: Number, no: Number) -> Number:
        return yes if condition else no


FLOATS: Arithmetic = _FloatArithmetic()
