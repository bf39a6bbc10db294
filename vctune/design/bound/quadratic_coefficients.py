"""Compute the coefficients of quadratics in the gains from the constants of a loop that is affine in the gains. See
design/bound/README.md, section 1."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from vctune.model.device import Device, stacked
from vctune.model.loop.device_response import device_response
from vctune.model.loop.loop import Affine, LoopConstants, loop_constants
from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.pair import Pair, im_conj_product, re_conj_product
from vctune.model.transparency import Quotient
from vctune.proof.enclosures.intervals import ENCLOSURES, Enclosure, Floats, decimal

# Coefficients of a quadratic: constant, linear, square and cross
Coefficients = tuple[
    Enclosure, tuple[Enclosure, Enclosure] | None, tuple[Enclosure, Enclosure] | None, Enclosure | None
]


class Term(NamedTuple):
    """A term |X|^2/|Y|^2 of the squared error, prepared for the inequality of Cauchy and Schwarz."""

    along: Affine  # X conj X_0, where X_0 is the value of X if both gains are 0
    size: Coefficients  # |X_0|^2 |Y|^2


def quadratic(of: Callable[[Pair, Pair], Number], a: Affine, b: Affine, *, crossed: bool) -> Coefficients:
    """Return the coefficients of a real product of two numbers that are affine in the gains."""

    def product(*pairs: tuple[Pair | None, Pair | None]) -> Number:
        found = [of(x, y) for x, y in pairs if x is not None and y is not None]
        return sum(found[1:], start=found[0]) if found else None

    def both(one: Number, two: Number) -> tuple[Number, Number] | None:
        if one is None and two is None:
            return None
        return 0 * two if one is None else one, 0 * one if two is None else two

    linear = both(
        product((a.constant, b.velocity), (a.velocity, b.constant)),
        product((a.constant, b.position), (a.position, b.constant)),
    )
    square = both(product((a.velocity, b.velocity)), product((a.position, b.position)))
    cross = product((a.velocity, b.position), (a.position, b.velocity)) if crossed else None
    constant = product((a.constant, b.constant))
    if constant is None:
        constant = 0 * (linear or square or (0.0,))[0]
    return constant, linear, square, cross


def error_term(of: Quotient, *, crossed: bool) -> Term:
    """Return a term |X|^2/|Y|^2 of the squared error, prepared for the inequality of Cauchy and Schwarz."""
    X, Y = of.above, of.below
    assert X.constant is not None
    idle, weight = X.constant, X.constant.abs2()

    def along(part: Pair | None) -> Pair | None:
        return None if part is None else Pair(re_conj_product(part, idle), im_conj_product(part, idle))

    Y2 = mapped(quadratic(re_conj_product, Y, Y, crossed=crossed), lambda x: weight * x)
    return Term(Affine(Pair(weight, 0), along(X.velocity), along(X.position)), Y2)


def mapped(coefficients: Coefficients, f: Callable[[Number], Number]) -> Coefficients:
    """Apply a function to each coefficient of a quadratic."""
    constant, linear, square, cross = coefficients
    return (
        f(constant),
        None if linear is None else (f(linear[0]), f(linear[1])),
        None if square is None else (f(square[0]), f(square[1])),
        None if cross is None else f(cross),
    )


def summed(a: Coefficients, b: Coefficients) -> Coefficients:
    """Return the coefficients of the sum of two quadratics at the same places."""

    def both(x: Number, y: Number) -> Number:
        return y if x is None else x if y is None else x + y

    def each(x: tuple[Number, Number] | None, y: tuple[Number, Number] | None) -> tuple[Number, Number] | None:
        return y if x is None else x if y is None else (x[0] + y[0], x[1] + y[1])

    return both(a[0], b[0]), each(a[1], b[1]), each(a[2], b[2]), both(a[3], b[3])


def listed(term: Term) -> list[Number]:
    """Return the coefficients of a term that are not None."""
    found: list[Number] = []
    for part in _pairs(term.along):
        found += [] if part is None else [part.re, part.im]
    mapped(term.size, found.append)
    return found


def replaced(term: Term, numbers: Iterable[Number]) -> Term:
    """Return a term with other coefficients."""
    found = iter(numbers)
    along = (None if part is None else Pair(next(found), next(found)) for part in _pairs(term.along))
    return Term(Affine(*along), mapped(term.size, lambda _: next(found)))


def _pairs(affine: Affine) -> tuple[Pair | None, Pair | None, Pair | None]:
    return affine.constant, affine.velocity, affine.position


def concatenated(parts: Sequence[Sequence[Number]]) -> list[Number]:
    """Concatenate the arrays of several devices, one device after another."""
    return [
        Enclosure(np.concatenate([x.mid for x in row]), np.concatenate([x.rad for x in row]))
        for row in zip(*parts, strict=True)
    ]


def joined(parts: Sequence[Coefficients]) -> Coefficients:
    """Concatenate the coefficients of several devices, one device after another."""
    rows: list[list[Number]] = [[] for _ in parts]
    for row, part in zip(rows, parts, strict=True):
        mapped(part, row.append)
    found = iter(concatenated(rows))
    return mapped(parts[0], lambda _: next(found))


def repeated(devices: Sequence[Device], count: int) -> Device:
    """Return several devices as one device with arrays of parameters, which repeat the parameters of each device."""
    if len(devices) == 1:
        return devices[0]
    return stacked([device for device in devices for _ in range(count)])


def loop_at(device: Device, omega: Floats) -> LoopConstants:
    """Return the constants of a device's loop without a hand, as enclosures (model/README.md, section 2)."""
    return loop_constants(device_response(device.bare.converted(decimal), Enclosure(omega), ENCLOSURES))
