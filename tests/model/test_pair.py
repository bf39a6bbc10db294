"""Pairs of reals calculate as complex numbers do."""

from __future__ import annotations

from math import sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vctune.model.numbers.pair import EvenOdd, Pair, im_conj_product, re_conj_product

REAL = st.floats(-1e3, 1e3)
ANGLE = st.floats(0.0, 3.141592653589793)


def near(value: complex) -> object:
    return pytest.approx(value, rel=1e-12, abs=1e-6)


@given(REAL, REAL, REAL, REAL, REAL)
def test_a_pair_is_a_complex_number(a, b, c, d, real):
    one, other, x, y = Pair(a, b), Pair(c, d), complex(a, b), complex(c, d)
    for pair, value in ((one + other, x + y), (one * other, x * y), (one.scaled(real), x * real)):
        assert complex(pair.re, pair.im) == near(value)
    assert complex(one.plus(real).re, one.plus(real).im) == near(x + real)
    assert one.abs2() == near(abs(x) ** 2)
    assert complex(re_conj_product(one, other), im_conj_product(one, other)) == near(x * y.conjugate())


@given(ANGLE, REAL, REAL, REAL, REAL, REAL)
def test_even_and_odd_parts_are_a_complex_number_of_the_circle(theta, a, b, c, d, real):
    s = sin(theta / 2)
    one, other, x, y = EvenOdd(a, b, s * s), EvenOdd(c, d, s * s), complex(a, s * b), complex(c, s * d)
    results = ((one + other, x + y), (one * other, x * y), (one.scaled(real), x * real), (one.plus(real), x + real))
    for number, value in results:
        assert complex(number.even, s * number.odd) == near(value)
    assert one.abs2() == near(abs(x) ** 2)


def test_the_product_with_a_conjugate_has_the_sign_of_the_angle():
    assert im_conj_product(Pair(0.0, 1.0), Pair(1.0, 0.0)) > 0
