"""Polynomials over boxes hold every true value, their remainder is of third order, and their least value is bounded."""

from __future__ import annotations

import operator

import numpy as np
import pytest
import scipy.optimize
from hypothesis import given
from hypothesis import strategies as st
from mpmath import mp, mpf
from test_counted_roundings import curvature, phi_1

from vctune.proof.enclosures.intervals import Enclosure
from vctune.proof.enclosures.taylor import Taylor, least_over_boxes, variables
from vctune.proof.enclosures.taylor_functions import TAYLOR

ROWS = 3
middles = st.tuples(*[st.floats(-3, 3, allow_subnormal=False)] * ROWS)
widths = st.tuples(*[st.floats(0, 0.4, allow_subnormal=False)] * ROWS)
places = st.tuples(*[st.floats(-1, 1, allow_subnormal=False)] * ROWS)
FUNCTIONS = {
    "reciprocal": (lambda x: 1 / x, lambda x: 1 / x),
    "sqrt": (TAYLOR.sqrt, mp.sqrt),
    "exp": (TAYLOR.exp, mp.exp),
    "sin": (TAYLOR.sin, mp.sin),
    "cos": (TAYLOR.cos, mp.cos),
    "sinc": (TAYLOR.sinc, mp.sinc),
    "phi_1": (lambda x: TAYLOR.phi_1(x * x), lambda x: phi_1(x * x)),
    "sinc_curvature": (TAYLOR.sinc_curvature, curvature),
}


def rows_of(middle, width):
    return variables(
        [Enclosure(np.array([m]), np.array([w])) for m, w in zip(middle, width, strict=True)], [True] * len(middle)
    )


def left_out(number, place, exact):
    """Return how far a value is from the polynomial, and the radius that this must be within."""
    i, j = np.triu_indices(number.row_count)
    at = [mpf(1), *map(mpf, place), *(mpf(place[a]) * mpf(place[b]) for a, b in zip(i, j, strict=True))]
    value = sum(mpf(float(c)) * x for c, x in zip(number.coefficients[:, 0], at, strict=True))
    return abs(exact - value), sum(mpf(float(r)) for r in number.radii[:, 0])


def holds(number, place, exact):
    off, radius = left_out(number, place, exact)
    return not mp.isfinite(radius) or off <= radius


@st.composite
def expressions(draw, depth=4):
    """Return a function of an arithmetic's numbers, made at random."""
    kind = draw(st.integers(0, 5 if depth else 1))
    if kind == 0:
        row = draw(st.integers(0, ROWS - 1))
        return lambda xs, exact: xs[row]
    if kind == 1:
        c = draw(st.floats(-2, 2, allow_subnormal=False))
        return lambda xs, exact: mpf(c) if exact else Enclosure(c)
    left, right = draw(expressions(depth=depth - 1)), draw(expressions(depth=depth - 1))
    if kind == 5:
        return lambda xs, exact: (mp.sin if exact else TAYLOR.sin)(left(xs, exact) * right(xs, exact))
    both = [operator.add, operator.sub, operator.mul][kind - 2]
    return lambda xs, exact: both(left(xs, exact), right(xs, exact))


@given(expressions(), middles, widths, places)
def test_expressions_hold_every_value(expression, middle, width, place):
    number = expression(rows_of(middle, width), False)
    with mp.workdps(60):
        exact = expression([mpf(m) + mpf(w) * mpf(p) for m, w, p in zip(middle, width, place, strict=True)], True)
        if isinstance(number, Taylor):
            assert holds(number, place, exact)
            assert abs(exact - mpf(float(number.enclosed().mid[0]))) <= mpf(float(number.enclosed().rad[0]))


@pytest.mark.parametrize("name", FUNCTIONS)
@np.errstate(all="ignore")
@given(middles, widths, places)
def test_functions_hold_every_value(name, middle, width, place):
    ours, theirs = FUNCTIONS[name]
    x, y, z = rows_of(middle, width)
    number = ours(x + 0.5 * y * z + 1)
    with mp.workdps(60):
        x, y, z = (mpf(m) + mpf(w) * mpf(p) for m, w, p in zip(middle, width, place, strict=True))
        argument = x + y * z / 2 + 1
        if name == "sqrt" and argument < 0:  # the root of a number that is not negative, as its enclosure may be
            return
        if name == "reciprocal" and argument == 0:
            assert not np.isfinite(number.radii).all()
            return
        assert holds(number, place, theirs(argument))


@given(middles, widths, places)
def test_products_of_matrices_are_those_of_their_entries(middle, width, place):
    x, y, z = rows_of(middle, width)
    entries = [x, y, Enclosure(0.5, 0.01), z * x, y + z, x * 3]
    wide, tall = (TAYLOR.stacked(entries)[np.arange(6).reshape(shape)] for shape in ((2, 3), (3, 2)))
    found = TAYLOR.matmul(wide, tall)
    for i in range(2):
        for j in range(2):
            one, total = found[i, j], wide[i, 0] * tall[0, j] + wide[i, 1] * tall[1, j] + wide[i, 2] * tall[2, j]
            assert one.coefficients == pytest.approx(total.coefficients, rel=1e-12, abs=1e-12)
            assert one.radii.sum() == pytest.approx(total.radii.sum(), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_what_is_left_out_is_of_third_order(name):
    def radius(width):
        x, y, z = rows_of((0.7, 1.1, -0.4), (width, 2 * width, width))
        return FUNCTIONS[name][0](x * y + 0.3 * z * z + 1).radii.sum()

    assert radius(0.02) / radius(0.01) == pytest.approx(8, rel=0.15)


def numbers_of(constant, slopes, curved):
    """Return polynomials c + g.e + e'H e without a remainder."""
    k = len(slopes)
    i, j = np.triu_indices(k)
    pairs = np.where((i == j)[:, None], curved[i, j], 2 * curved[i, j])
    return Taylor(k, np.concatenate((constant[None], slopes, pairs)), np.zeros((k + 1, constant.size)))


@pytest.mark.parametrize("convex", [True, False])
def test_the_least_value_is_bounded(convex):
    """The convex ones are squares of two numbers, as |F|^2 is."""
    rng, n, k = np.random.default_rng(1), 100, 4
    shape = rng.normal(size=(k, 2 if convex else k, n))
    curved = np.einsum("ijn,ljn->iln", shape, shape) if convex else shape + shape.transpose(1, 0, 2)
    constant, slopes = rng.normal(size=n), 2 * rng.normal(size=(k, n))
    least = least_over_boxes(numbers_of(constant, slopes, curved))
    short = 0
    for box in range(n):

        def value(e, box=box):
            return constant[box] + slopes[:, box] @ e + e @ curved[..., box] @ e

        assert value(least.at[:, box]) == pytest.approx(least.estimate[box], rel=1e-9, abs=1e-9)
        tried = rng.uniform(-1, 1, (200, k)) * rng.choice([1.0, 3.0], (200, 1))
        assert least.bound[box] <= min(map(value, np.clip(tried, -1, 1)))
        if convex:
            found = scipy.optimize.minimize(value, np.zeros(k), bounds=[(-1, 1)] * k, method="L-BFGS-B").fun
            scale = np.abs(curved[..., box]).sum()
            assert least.bound[box] <= found + 1e-9 * scale
            short += least.bound[box] < found - 0.02 * scale
    assert short < 0.15 * n


def test_a_valley_across_the_rows_costs_nothing():
    """(x - y)^2 + 1e-6 is positive, however wide the box is."""
    x, y, _ = rows_of((5.0, 5.0, 0.0), (3.0, 3.0, 1.0))
    assert least_over_boxes((x - y) * (x - y) + 1e-6).bound[0] > 0
    assert least_over_boxes((x - y) * (x - y) - 1e-6).estimate[0] < 0


def test_nothing_is_known_where_a_number_is_not_finite():
    x, _, _ = rows_of((0.1, 0.0, 0.0), (0.2, 0.0, 0.0))
    assert least_over_boxes(1 / x + 1e9).bound[0] == -np.inf
