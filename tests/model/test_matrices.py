"""Functions of small matrices, against many digits and exact fractions, in every arithmetic."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from agreement import contains
from balls import BALLS
from conftest import mostly_slow
from flint import arb, ctx
from hypothesis import given
from hypothesis import strategies as st
from mpmath.ctx_mp import MPContext

from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.matrices import (
    COTH_WITHIN,
    Matrix,
    applied,
    bernoulli,
    change_of_states,
    exponential_less_one,
    half_coth,
    inverse,
    norm_of,
)
from vctune.proof.enclosures.intervals import ENCLOSURES, Enclosure, matmul
from vctune.proof.enclosures.taylor import variables
from vctune.proof.enclosures.taylor_functions import TAYLOR

NUM = MPContext()
NUM.dps = 140
"""e^A of norm 50 next to e^-A takes 43 digits, a derivative by differences 40."""
NORMS = (0.1, 1.0, 1.99, 2.01, 5.0, 12.0, 27.0, 50.0)
"""On both sides of `COTH_WITHIN`."""


def exact(x: Any) -> Any:
    return NUM.mpf(float(x))


def random_matrix(rng: np.random.Generator, norm: float) -> np.ndarray:
    """Return a matrix of the norm whose eigenvalues are about as far to the left as they oscillate."""
    n = int(rng.integers(2, 9))
    found = rng.normal(size=(n, n))
    found -= np.diag(np.abs(found).sum(axis=1)) * rng.uniform(0.5, 1)
    return found * (norm / np.abs(found).sum(axis=1).max())


def coth_by_exponentials(matrix: Any) -> Any:
    """Return (A/2) (e^A + 1)/(e^A - 1) with many digits."""
    A = NUM.matrix([[NUM.mpf(x) if isinstance(x, float) else x for x in row] for row in matrix])
    power, one = NUM.expm(A), NUM.eye(A.rows)
    return A / 2 * (power + one) * NUM.inverse(power - one)


def rows(matrix: np.ndarray, number: Any) -> Matrix:
    return tuple(tuple(number(x) for x in row) for row in matrix.tolist())


def entries(size: int) -> list[tuple[int, int]]:
    return [(i, j) for i in range(size) for j in range(size)]


def as_ball(x: Any) -> arb:
    """Return a number of many digits as a ball that contains it and little else."""
    with ctx.workprec(400):
        return arb(NUM.nstr(x, 100))


@pytest.mark.parametrize("norm", NORMS)
def test_half_coth_in_every_arithmetic(norm):
    """Doubles are near, balls and enclosures contain; neither is wider than the norm explains."""
    for number in range(8):
        A = random_matrix(np.random.default_rng((51, number)), norm)
        true = coth_by_exponentials(A.tolist())
        size = max(abs(x) for x in true)
        floats = half_coth(rows(A, float), FLOATS)
        boxes = half_coth(rows(A, lambda x: Enclosure(np.array(x))), ENCLOSURES)
        with ctx.workprec(128):
            balls = half_coth(rows(A, arb), BALLS)
        for i, j in entries(len(A)):
            assert abs(exact(floats[i][j]) - true[i, j]) <= 1e-12 * size, number
            assert contains(boxes[i][j], true[i, j]), number
            assert boxes[i][j].rad <= (1e-14 if norm < 3 else 1e-5) * size, number
            assert balls[i][j].contains(as_ball(true[i, j])), number
            assert balls[i][j].rad() <= 1e-28 * float(size), number


@pytest.mark.parametrize("norm", mostly_slow([0.1, 0.99, 1.01, 2.01, 3.99, 4.01, 27.0], [1.01, 4.01]))
def test_the_change_of_states_in_every_arithmetic(norm):
    """(e^A - 1) x: doubles are near, balls and enclosures contain, also if a number of A fills an interval."""
    for number in range(3):
        rng = np.random.default_rng((52, number))
        A = random_matrix(rng, norm)
        x = [float(each) for each in rng.normal(size=len(A) - 1)]
        true = (NUM.expm(NUM.matrix(A.tolist())) - NUM.eye(len(A))) * NUM.matrix([0, *x])
        size = max(abs(each) for each in true)
        floats = change_of_states(rows(A, float), (0, *x), FLOATS)
        points = tuple(Enclosure(np.array(each)) for each in x)
        boxes = change_of_states(rows(A, lambda each: Enclosure(np.array(each))), (0, *points), ENCLOSURES)
        with ctx.workprec(128):
            balls = change_of_states(rows(A, arb), (0, *map(arb, x)), BALLS)
        for i in range(len(A)):
            assert abs(exact(floats[i]) - true[i]) <= 1e-12 * size, number
            assert contains(boxes[i], true[i]) and boxes[i].rad <= (1e-13 if norm < 3 else 1e-5) * size, number
            assert balls[i].contains(as_ball(true[i])) and balls[i].rad() <= 1e-28 * float(size), number
        wide = 10 ** rng.uniform(-8, -1)
        share, *_ = variables([Enclosure(np.array([1.0]), np.array([wide]))], [True])
        spread = tuple(tuple(share * each for each in row) for row in A.tolist())
        found, squared = change_of_states(spread, (0, *x), TAYLOR), exponential_less_one(spread, TAYLOR)
        for near in np.linspace(1 - wide, 1 + wide, 5):
            member = (NUM.expm(NUM.matrix((near * A).tolist())) - NUM.eye(len(A))) * NUM.matrix([0, *x])
            for i in range(len(A)):
                values = found[i].enclosed()
                mid, rad = float(values.mid[0]), float(values.rad[0])
                assert abs(float(member[i]) - mid) <= rad * (1 + 1e-12), (number, wide)
                assert rad <= 1.01 * applied(squared, (0, *x))[i].enclosed().rad[0] + 1e-13, (number, wide)


@pytest.mark.parametrize("size", [1e-3, 1e-12, 1e-30])
@pytest.mark.parametrize("ops", [FLOATS, BALLS], ids=["floats", "balls"])
def test_an_exponential_has_the_powers_that_reach_its_corners(size, ops):
    """A chain of four: the corner of e^A is the product of its links over 3!, however short the series could be."""
    link = arb(size) if ops is BALLS else size
    chain = tuple(tuple(link if column == row + 1 else 0 for column in range(4)) for row in range(4))
    corner = exponential_less_one(chain, ops)[0][3]
    if ops is BALLS:
        assert corner.contains(link * link * link / 6)
    assert float(corner) == pytest.approx(size**3 / 6, rel=1e-12)


def test_numerators_that_are_no_doubles():
    """The series takes some; an enclosure's product with one contains that with the numerator itself."""
    ratio = (COTH_WITHIN / (2 * np.pi)) ** 2
    taken = [k for k in range(1, 40) if 3.7 * ratio**k > 2.0**-62 * ratio]  # as `half_coth` does in doubles
    big = [bernoulli(2 * k).numerator for k in taken if abs(bernoulli(2 * k).numerator) > 2**53]
    assert big, "then nothing need be said of them"
    rng = np.random.default_rng(54)
    for x in rng.uniform(-1, 1, 200):
        for numerator in big:
            found = Enclosure(np.array(x), np.array(0.0)) * float(numerator)
            away = abs(Fraction(float(found.mid)) - Fraction(float(x)) * numerator)
            assert away <= Fraction(float(found.rad)), (x, numerator)


def test_inverse_by_elimination():
    """Next to 1 it is the inverse; balls and enclosures contain it, and a 0 by structure stays."""
    for number in range(20):
        rng = np.random.default_rng((55, number))
        n = int(rng.integers(1, 8))
        A = np.eye(n) + 0.3 * rng.normal(size=(n, n)) / n
        true = NUM.inverse(NUM.matrix(A.tolist()))
        floats = inverse(rows(A, float))
        boxes = inverse(rows(A, lambda x: Enclosure(np.array(x))))
        with ctx.workprec(128):
            balls = inverse(rows(A, arb))
        for i, j in entries(n):
            assert abs(exact(floats[i][j]) - true[i, j]) < 1e-14
            assert contains(boxes[i][j], true[i, j]) and boxes[i][j].rad < 1e-13
            assert balls[i][j].contains(as_ball(true[i, j]))
    assert inverse(((2.0, 0), (1.0, 4.0))) == ((0.5, 0), (-0.125, 0.25))


def test_products_of_matrices_of_enclosures():
    """They contain the exact products, of any members of the factors, of numbers of any size."""
    for number in range(30):
        rng = np.random.default_rng((57, number))
        n, m, k = (int(x) for x in rng.integers(1, 9, 3))

        def factor(*shape: int, rng: np.random.Generator = rng) -> tuple[Enclosure, np.ndarray]:
            mid = rng.normal(size=shape) * 10 ** rng.uniform(-8, 8, shape)
            rad = np.abs(mid) * 10 ** rng.uniform(-17, 0, shape) * rng.integers(0, 2, shape)
            return Enclosure(mid, rad), mid + rad * rng.integers(-1, 2, shape) * 0.999999

        (a, in_a), (b, in_b) = factor(n, m, 3), factor(m, k, 3)
        found = matmul(a, b)
        assert found.mid.shape == (n, k, 3)
        for i, j, at in np.ndindex(n, k, 3):
            true = sum(Fraction(in_a[i, p, at]) * Fraction(in_b[p, j, at]) for p in range(m))
            assert abs(Fraction(found.mid[i, j, at]) - true) <= Fraction(found.rad[i, j, at]), number


def test_the_norm_bounds_every_row():
    assert norm_of(((1.0, -2.0), (0, 2.5)), FLOATS) == 3.0
    assert norm_of(((Enclosure(np.array([1.0, -4.0]), np.array([1.0, 0.5])),),), ENCLOSURES) >= 4.5


@given(st.integers(0, 2**32 - 1), st.floats(-9, 9))
def test_the_exponential_of_floats_is_that_of_scipy(seed, decades):
    matrix = np.random.default_rng(seed).normal(size=(4, 4)) * np.exp(decades / 3)
    found, expected = exponential_less_one(tuple(map(tuple, matrix.tolist())), FLOATS), scipy.linalg.expm(matrix)
    assert np.abs(np.eye(4) + np.array(found) - expected).max() <= 1e-11 * max(1.0, np.abs(expected).max())
