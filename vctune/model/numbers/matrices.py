"""Compute with small matrices in any arithmetic, including the matrix functions that a sampled system needs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import count
from math import ceil, comb, exp, factorial, frexp, inf, log2, pi
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from vctune.model.numbers.arithmetic import Arithmetic, ArrayArithmetic, Floats, Number

Matrix = tuple[tuple[Number, ...], ...]
Vector = tuple[Number, ...]


@dataclass(frozen=True, slots=True)
class Block:
    """A matrix as one array with two leading axes, so that one array operation acts on all its entries."""

    entries: Number  # array of shape (n, m, ...)
    nonzero: NDArray[np.bool_]  # the entries that are not 0 by structure
    ops: ArrayArithmetic  # arithmetic of the entries

    def mapped(self, entries: Number, other: Block) -> Block:
        """Return a block with other entries."""
        return Block(entries, self.nonzero | other.nonzero, self.ops)

    def times(self, other: Block) -> Block:
        """Return the matrix product with another block."""
        return Block(self.ops.matmul(self.entries, other.entries), self.nonzero @ other.nonzero, self.ops)


AnyMatrix = TypeVar("AnyMatrix", Matrix, Block)


def blocked(matrix: Matrix, ops: Arithmetic) -> Any:
    """Return a matrix in the form that its arithmetic multiplies fastest."""
    arrays = ops.arrays
    if arrays is None:
        return matrix
    nonzero = np.array([[not nothing(entry) for entry in row] for row in matrix])
    flat = arrays.stacked([entry for row in matrix for entry in row])
    return Block(flat[np.arange(len(matrix) * len(matrix[0])).reshape(len(matrix), -1)], nonzero, arrays)


def rows_of(matrix: Matrix | Block) -> Matrix:
    """Return a matrix as rows. The integer 0 stands for an entry that is 0 by structure."""
    if not isinstance(matrix, Block):
        return matrix
    return tuple(
        tuple(matrix.entries[i, j] if entry else 0 for j, entry in enumerate(row))
        for i, row in enumerate(matrix.nonzero.tolist())
    )


# Permitted remainder of the Taylor polynomial of e^A, relative to the rounding error, for a norm of A of at most 1/2
LEFT_OUT = 2.0**-10


def exponential_less_one(matrix: Matrix, ops: Arithmetic) -> Matrix:
    """Return e^A - 1 by scaling, Taylor's polynomial and squaring."""
    norm = norm_of(matrix, ops)
    halvings = max(0, ceil(log2(norm)) + 1) if 0 < norm < inf else 0
    small = blocked(scaled(matrix, 2.0**-halvings), ops)
    x = norm / 2.0**halvings
    # an entry that is 0 in A may become nonzero in any power of A up to its number of rows
    last = next(n for n in count(len(matrix)) if not x ** (n + 1) / factorial(n + 1) > LEFT_OUT * ops.precision * x)
    total = term = small
    for order in range(2, last + 1):
        term = divided(product(term, small), order)
        total = added(total, term)
    # for x <= 1/2 all further terms add up to less than 1.1 times the first of them
    rest = ops.within(1.1 * x ** (last + 1) / factorial(last + 1))
    found = _each(total, rest)
    for _ in range(halvings):
        found = added(scaled(found, 2), product(found, found))
    return rows_of(found)


STEPS = 4  # Number of steps up to which it is faster to follow the states than to square e^A


def change_of_states(matrix: Matrix, states: Vector, ops: Arithmetic) -> Vector:
    """Return (e^A - 1) x by Taylor's polynomial, in steps whose exponent has a norm of at most 1."""
    norm = norm_of(matrix, ops)
    steps = 2 ** max(0, ceil(log2(norm))) if 0 < norm < inf else 1
    if steps > STEPS:
        return applied(exponential_less_one(matrix, ops), states)
    n, x, size = len(matrix), norm / steps, max(ops.magnitude(state) for state in states)
    both = blocked(tuple((*row, state) for row, state in zip(scaled(matrix, 1 / steps), states, strict=True)), ops)
    small, first = columns_of(both, 0, n), columns_of(both, n, n + 1)
    last = next(n for n in count(n) if not x ** (n + 1) / factorial(n + 1) > LEFT_OUT * ops.precision * x)
    # for x <= 1 all further terms add up to less than 1.4 times the first of them
    rest = 1.4 * x ** (last + 1) / factorial(last + 1) * size
    total = now = first
    for step in range(steps):
        change = term = product(small, now)
        for order in range(2, last + 1):
            term = divided(product(small, term), order)
            change = added(change, term)
        change = _each(change, ops.within(rest * exp(x * step)))
        total = added(total, change) if step else change
        now = added(first, total)
    return column(rows_of(total), 0)


COTH_WITHIN = 2.0  # Norm of A up to which the series computes (A/2) coth(A/2); its radius of convergence is 2 pi


def half_coth(matrix: Matrix, ops: Arithmetic) -> Matrix:
    """Return f(A) = (A/2) coth(A/2) = 1 + A^2/12 - A^4/720 + ..., using f(2A) = f(A) + (A/2)^2/f(A) for large A."""
    norm = norm_of(matrix, ops)
    halvings = max(0, ceil(log2(norm / COTH_WITHIN))) if 0 < norm < inf else 0
    half = blocked(scaled(matrix, 2.0**-halvings) if halvings else matrix, ops)
    square = product(half, half)
    ratio = (norm / 2.0**halvings / (2 * pi)) ** 2  # |B_2k|/(2k)! = 2 zeta(2k)/(2 pi)^2k
    last = next(n for n in count(len(matrix)) if not 3.7 * ratio ** (n + 1) > LEFT_OUT * ops.precision * ratio)
    term = divided(square, 2)
    found = divided(term, 6)
    for k in range(2, last + 1):
        term = divided(product(term, square), (2 * k - 1) * (2 * k))
        number = bernoulli(2 * k)
        # from B_36 on, a double cannot hold the numerator; the unit that enclosures add for one rounding also covers
        # this rounding
        numerator = number.numerator if ops.arrays is None else float(number.numerator)
        found = added(found, divided(scaled(term, numerator), number.denominator))
    # all further terms add up to less than 2 zeta(2)/(1 - ratio) < 3.7 times a power of ratio <= 1/pi^2
    one, quarter = identity(len(matrix)), rows_of(scaled(square, 0.25))
    total = added(one, rows_of(_each(found, ops.within(3.7 * ratio ** (last + 1)))))
    for _ in range(halvings):
        total = added(total, product(quarter, inverse(total)))
        quarter = scaled(quarter, 4)
    return total


@cache
def bernoulli(n: int) -> Fraction:
    """Return the Bernoulli number B_n."""
    if n == 0:
        return Fraction(1)
    return -sum((comb(n + 1, k) * bernoulli(k) for k in range(n)), Fraction(0)) / (n + 1)


def identity(n: int) -> Matrix:
    """Return the identity matrix."""
    return tuple(tuple(1 if i == j else 0 for j in range(n)) for i in range(n))


def inverse(matrix: Matrix) -> Matrix:
    """Return 1/A by elimination in the order of the rows, without pivoting. A must be close to a triangular matrix, or
    close to the identity. No pivot may be 0."""
    n = len(matrix)
    rows = [[*row, *one] for row, one in zip(matrix, identity(n), strict=True)]
    for i in range(n):
        pivot = rows[i][i]
        rows[i] = [entry if nothing(entry) else 1 if j == i else entry / pivot for j, entry in enumerate(rows[i])]
        for k in range(n):
            factor = rows[k][i]
            if k != i and not nothing(factor):
                rows[k] = [
                    0 if j == i else add(a, times(-factor, b))
                    for j, (a, b) in enumerate(zip(rows[k], rows[i], strict=True))
                ]
    return tuple(tuple(row[n:]) for row in rows)


def _each(matrix: AnyMatrix, rest: Number) -> AnyMatrix:
    """Return A after adding a number to each entry that is not 0 by structure."""
    if isinstance(matrix, Block):
        return matrix.mapped(matrix.entries + rest, matrix)
    return tuple(tuple(entry if nothing(entry) else entry + rest for entry in row) for row in matrix)


def norm_of(matrix: Matrix, ops: Arithmetic) -> float:
    """Return an upper bound of the greatest row sum of |a_ij|, which is a norm of A."""
    return max(sum(ops.magnitude(entry) for entry in row if not nothing(entry)) for row in matrix)


def nothing(x: Number) -> bool:
    """Return whether a number is the integer 0, which stands for an entry that is 0 by structure."""
    return type(x) is int and x == 0


def add(a: Number, b: Number) -> Number:
    """Return a + b. The function skips the integer 0, so that it adds no rounding error."""
    return b if nothing(a) else a if nothing(b) else a + b


def times(a: Number, b: Number) -> Number:
    """Return a b. The product is the integer 0 if either factor is."""
    return 0 if nothing(a) or nothing(b) else a * b


def dot(a: Iterable[Number], b: Iterable[Number]) -> Number:
    """Return the sum of the products a_k b_k."""
    total: Number = 0
    for x, y in zip(a, b, strict=True):
        total = add(total, times(x, y))
    return total


def applied(matrix: Matrix, vector: Vector) -> Vector:
    """Return the vector A x."""
    return tuple(dot(row, vector) for row in matrix)


def product(a: AnyMatrix, b: AnyMatrix) -> AnyMatrix:
    """Return the matrix product A B."""
    if isinstance(a, Block):
        return a.times(b)
    columns = tuple(zip(*b, strict=True))
    return tuple(tuple(dot(row, column) for column in columns) for row in a)


def added(a: AnyMatrix, b: AnyMatrix) -> AnyMatrix:
    """Return A + B."""
    if isinstance(a, Block):
        return a.mapped(a.entries + b.entries, b)
    return tuple(tuple(add(x, y) for x, y in zip(one, two, strict=True)) for one, two in zip(a, b, strict=True))


def scaled(matrix: AnyMatrix, factor: Number) -> AnyMatrix:
    """Return A times a number."""
    if isinstance(matrix, Block):
        return matrix.mapped(matrix.entries * factor, matrix)
    return tuple(tuple(times(entry, factor) for entry in row) for row in matrix)


def divided(matrix: AnyMatrix, count: Number) -> AnyMatrix:
    """Return A divided by a number."""
    if isinstance(matrix, Block):
        return matrix.mapped(matrix.entries / count, matrix)
    return tuple(tuple(entry if nothing(entry) else entry / count for entry in row) for row in matrix)


def columns_of(matrix: AnyMatrix, first: int, end: int) -> AnyMatrix:
    """Return some columns of a matrix."""
    if isinstance(matrix, Block):
        return Block(matrix.entries[:, first:end], matrix.nonzero[:, first:end], matrix.ops)
    return tuple(row[first:end] for row in matrix)


def column(matrix: Matrix, index: int) -> Vector:
    """Return one column of a matrix."""
    return tuple(row[index] for row in matrix)


TAYLOR = 14  # Terms of the series of e^A of doubles: 1e-16 for a norm of 1/2


def exponentials(matrices: Floats) -> Floats:
    """Return e^A of each matrix, by Taylor's series of A / 2^k and k squarings, all matrices at once."""
    norm = float(np.abs(matrices).sum(axis=-1).max(initial=0.0))
    halvings = max(0, frexp(norm)[1] + 1)
    small, term = matrices / 2.0**halvings, np.broadcast_to(np.eye(matrices.shape[-1]), matrices.shape)
    total = term.copy()
    for order in range(1, TAYLOR):
        term = term @ small / order
        total += term
    for _ in range(halvings):
        total = total @ total
    return total
