"""Represent the right-hand sides of the firmware's equations as data."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from vctune.model.numbers.arithmetic import Number
from vctune.simulation.firmware.operations import Arithmetic

Operator = Literal["+", "-", "*", "/", "negative", "minimum", "maximum", "floor", "choice"]  # Operators


class Expression:
    """The base class of symbols and operations, which are the operands of an operation."""

    __slots__ = ()

    def __add__(self, other: Term) -> Operation:
        return Operation("+", (self, other))

    def __radd__(self, other: Term) -> Operation:
        return Operation("+", (other, self))

    def __sub__(self, other: Term) -> Operation:
        return Operation("-", (self, other))

    def __mul__(self, other: Term) -> Operation:
        return Operation("*", (self, other))

    def __rmul__(self, other: Term) -> Operation:
        return Operation("*", (other, self))

    def __rtruediv__(self, other: Term) -> Operation:
        return Operation("/", (other, self))

    def __truediv__(self, other: Term) -> Operation:
        return Operation("/", (self, other))

    def __rsub__(self, other: Term) -> Operation:
        return Operation("-", (other, self))

    def __neg__(self) -> Operation:
        return Operation("negative", (self,))


Term = Expression | float  # An operand: an expression or a number


@dataclass(frozen=True, slots=True)
class Symbol(Expression):
    """The value of a quantity at this sample, or after the previous sample if `before` is true."""

    name: str
    before: bool = False


@dataclass(frozen=True, slots=True)
class Operation(Expression):
    """An operator and its operands."""

    operator: Operator
    operands: tuple[Term, ...]


def minimum(a: Term, b: Term) -> Operation:
    """Return the lesser of two terms."""
    return Operation("minimum", (a, b))


def maximum(a: Term, b: Term) -> Operation:
    """Return the greater of two terms."""
    return Operation("maximum", (a, b))


def floor(a: Term) -> Operation:
    """Return the greatest integer that does not exceed a term."""
    return Operation("floor", (a,))


def choice(above: Term, limit: Term, yes: Term, no: Term) -> Operation:
    """Return the term `yes` if `above` exceeds `limit`, and the term `no` otherwise."""
    return Operation("choice", (above, limit, yes, no))


def value(term: Term, values: Mapping[Symbol, Number], ops: Arithmetic) -> Number:
    """Return the value of a term."""
    if isinstance(term, Symbol):
        return values[term]
    if isinstance(term, Operation):
        return _operate(term.operator, [value(operand, values, ops) for operand in term.operands], ops)
    return term


def _operate(operator: Operator, on: list[Number], ops: Arithmetic) -> Number:
    """Return the value of an operator. The function evaluates only the selected operation."""
    evaluated: dict[Operator, Callable[[], Number]] = {
        "+": lambda: on[0] + on[1],
        "-": lambda: on[0] - on[1],
        "*": lambda: on[0] * on[1],
        "/": lambda: on[0] / on[1],
        "negative": lambda: -on[0],
        "minimum": lambda: ops.minimum(on[0], on[1]),
        "maximum": lambda: ops.maximum(on[0], on[1]),
        "floor": lambda: ops.floor(on[0]),
        "choice": lambda: ops.where(on[0] > on[1], on[2], on[3]),
    }
    return evaluated[operator]()
