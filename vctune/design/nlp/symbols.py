"""The arithmetic of CasADi symbols, and trees of numbers, of which a constraint has one for each of its points."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields, is_dataclass
from math import pi
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from vctune.analysis.extrema import Floats
from vctune.model.numbers.arithmetic import Arithmetic, Number, by_conjugate

Tree = TypeVar("Tree")


class _SymbolArithmetic:
    """Arithmetic of CasADi symbols."""

    pi = pi
    precision = 2.0**-53
    arrays = None

    @staticmethod
    def is_zero(x: Number) -> bool:
        return bool(ca.SX(x).is_zero())

    sqrt = staticmethod(ca.sqrt)
    exp = staticmethod(ca.exp)
    sin = staticmethod(ca.sin)
    cos = staticmethod(ca.cos)
    reciprocal = staticmethod(by_conjugate)

    @staticmethod
    def modulus(re: Number, im: Number) -> Number:
        return ca.sqrt(re * re + im * im)

    @staticmethod
    def sinc(x: Number) -> Number:
        return ca.sin(x) / x

    @staticmethod
    def sinc_curvature(x: Number) -> Number:
        return (1 - ca.sin(x) / x) / (x * x)

    @staticmethod
    def phi_1(x: Number) -> Number:
        return (1 - ca.exp(-x)) / x

    @staticmethod
    def where_positive(x: Number, yes: Callable[[], Number], no: Callable[[], Number]) -> Number:
        return ca.if_else(x > 0, yes(), no())

    @staticmethod
    def interpolated(x: Number, table: tuple[tuple[float, float], ...]) -> Number:
        raise NotImplementedError("a symbol lies between no two points of a table")

    @staticmethod
    def within(radius: Number) -> Number:
        return 0.0

    @staticmethod
    def middle(x: Number) -> Number:
        return x

    @staticmethod
    def magnitude(x: Number) -> float:
        raise NotImplementedError("a symbol has no size")


CASADI: Arithmetic = _SymbolArithmetic()


def leaves(tree: Any) -> list[Any]:
    """Return the numbers of a tree of tuples and dataclasses. None, flags, texts and integers are its form."""
    if tree is None or isinstance(tree, bool | int | str):
        return []
    if is_dataclass(tree):
        return [leaf for each in fields(tree) for leaf in leaves(getattr(tree, each.name))]
    return [leaf for part in tree for leaf in leaves(part)] if isinstance(tree, tuple) else [tree]


def rebuilt(tree: Any, numbers: Iterator[Any]) -> Any:
    """Return a tree of the same form with other numbers."""
    if tree is None or isinstance(tree, bool | int | str):
        return tree
    if is_dataclass(tree) and not isinstance(tree, type):
        return type(tree)(*(rebuilt(getattr(tree, each.name), numbers) for each in fields(tree)))
    if isinstance(tree, tuple):
        parts = [rebuilt(part, numbers) for part in tree]
        return type(tree)(*parts) if hasattr(tree, "_fields") else tuple(parts)
    return next(numbers)


def form_of(tree: Tree) -> Tree:
    """Return the form of a tree, with 0 for each number, which tells trees of other forms apart."""
    numbers: Iterator[Any] = iter([0.0] * len(leaves(tree)))
    form: Tree = rebuilt(tree, numbers)
    return form


def columns_of(trees: Sequence[Any]) -> Floats:
    """Return the numbers of trees of one form, each over some points, as a matrix with a column for each point."""
    each = [np.vstack(np.broadcast_arrays(*map(np.atleast_1d, leaves(tree)))) for tree in trees]
    return np.hstack(each)
