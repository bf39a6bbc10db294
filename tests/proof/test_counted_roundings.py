"""Constants that cover roundings: these, in exact arithmetic, are as many as the comments count, and covered."""

from __future__ import annotations

from fractions import Fraction
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from mpmath import mp, mpf

from vctune.design.bound import quadratics
from vctune.design.bound.quadratics import K_P, K_V, less, quadratic
from vctune.proof import cells as damping
from vctune.proof.enclosures.intervals import Enclosure
from vctune.proof.enclosures.taylor import HIGHER_ERROR, Taylor
from vctune.proof.enclosures.taylor_functions import TAYLOR

U = 2.0**-53
ROWS = 14


def phi_1(x):
    return (1 - mp.exp(-x)) / x if x else mpf(1)


def curvature(x):
    return (1 - mp.sinc(x)) / x**2 if x else mpf(1) / 6


COUNTED = {"reciprocal": (3, 5), "sqrt": (2, 3), "exp": (0, 0), "sin": (0, 0), "cos": (0, 0), "sinc": (0, 0)}
COUNTED |= dict.fromkeys(("phi_1", "sinc_curvature"), (0, 0))
"""Roundings of f' and of f''/2, as `HIGHER_ERROR` counts them; 0 where `error` has them."""
SERIES = {
    "reciprocal": (lambda x: 1 / x, lambda m: (-1 / m**2, 1 / m**3)),
    "sqrt": (TAYLOR.sqrt, lambda m: (1 / (2 * mp.sqrt(m)), -1 / (8 * mp.sqrt(m) ** 3))),
    "exp": (TAYLOR.exp, lambda m: (mp.exp(m), mp.exp(m) / 2)),
    "sin": (TAYLOR.sin, lambda m: (mp.cos(m), -mp.sin(m) / 2)),
    "cos": (TAYLOR.cos, lambda m: (-mp.sin(m), -mp.cos(m) / 2)),
    "sinc": (TAYLOR.sinc, lambda m: (mp.diff(mp.sinc, m), mp.diff(mp.sinc, m, 2) / 2)),
    "phi_1": (TAYLOR.phi_1, lambda m: (mp.diff(phi_1, m), mp.diff(phi_1, m, 2) / 2)),
    "sinc_curvature": (TAYLOR.sinc_curvature, lambda m: (mp.diff(curvature, m), mp.diff(curvature, m, 2) / 2)),
}


def awkward(rng, shape):
    """Return positive numbers whose last bits are lost wherever they can be: just above powers of two, or anything."""
    above = 2.0 ** rng.integers(-2, 3, shape) * (1 + 2 * U * rng.integers(1, 4, shape))
    return np.where(rng.uniform(size=shape) < 0.5, above, rng.uniform(0.3, 3.0, shape))


@pytest.mark.parametrize("name", SERIES)
def test_slopes_of_a_function_are_off_by_what_is_counted_and_covered_over_many_rows(name, monkeypatch):
    """Each row adds its reach, in exact arithmetic; what the slopes are off by, times that, is within the radius."""
    given, count = [], 100
    inner = Taylor.mapped
    monkeypatch.setattr(Taylor, "mapped", lambda x, *how: given.append(how) or inner(x, *how))
    rng = np.random.default_rng(8)
    poly = np.zeros((1 + ROWS + ROWS * (ROWS + 1) // 2, count))
    poly[0], poly[1 : 1 + ROWS] = awkward(rng, count), 1e-3 * awkward(rng, (ROWS, count))
    f, slopes = SERIES[name]
    f(Taylor(ROWS, poly, np.zeros((ROWS + 1, count))))
    ((_, *found), _, _, *error) = given[0]
    error = error[0] if error else 0.0
    most = [0.0, 0.0]
    with mp.workdps(60):
        for box in range(count):
            reach = mpf(0) + sum(mpf(float(row)) for row in poly[1 : 1 + ROWS, box])
            off, covered = mpf(0), mpf(0)
            for order, (slope, true) in enumerate(zip(found, slopes(mpf(float(poly[0, box]))), strict=True)):
                apart = abs(mpf(float(slope[box])) - true)
                most[order] = max(most[order], float(apart / abs(true) / U))
                off += apart * reach ** (order + 1)
                covered += reach ** (order + 1) * (
                    mpf(float(np.broadcast_to(error, count)[box])) + mpf(HIGHER_ERROR) * abs(mpf(float(slope[box])))
                )
            assert off <= covered
    for seen, counted in zip(most, COUNTED[name], strict=True):
        assert not counted or 0.5 < seen <= counted


def exact_terms(coefficients, K_v, K_p):
    """Return the terms of a quadratic whose coefficients are fractions."""
    factors = 1, K_v, K_p, K_v**2, K_p**2, K_v * K_p
    return [factor * each for factor, each in zip(factors, coefficients, strict=True)]


def enclosed(rng, points, signs):
    sizes = [awkward(rng, points) * rng.choice(signs, points) for _ in range(6)]
    return [Enclosure(size, np.abs(size) * rng.choice([0.0, U, 2.0**-30], points)) for size in sizes]


@pytest.mark.parametrize("guard", [quadratics.GUARD, 0.0])
def test_a_quadratic_is_off_by_nine_roundings_of_its_terms_and_its_bounds_hold_the_exact_ones(monkeypatch, guard):
    """Without the guard the bounds fail; with it they hold what every gain of the box gives, to the last bit."""
    monkeypatch.setattr(quadratics, "GUARD", guard)
    rng, points, failed, most = np.random.default_rng(9), 60, 0, 0.0
    for signs in ([1.0], [-1.0, 1.0]):
        a, b = enclosed(rng, points, signs), enclosed(rng, points, signs)
        low, high = np.zeros((5, 1)), np.zeros((5, 1))
        low[[K_V, K_P], 0] = awkward(rng, 2)
        high[[K_V, K_P], 0] = low[[K_V, K_P], 0] * (1 + 2 * U)
        boxes, factor = SimpleNamespace(low=low, high=high), awkward(rng, (1, points))
        with np.errstate(all="ignore"):  # as where these are used
            greatest, least = quadratic(a).greatest(boxes)[0], quadratic(a).least(boxes)[0]
            taken = quadratics.least(less(quadratic(a), factor, quadratic(b)), boxes)[0]
        for at, ends in product(range(points), product(*((low[k, 0], high[k, 0]) for k in (K_V, K_P)))):
            gains = [Fraction(float(end)) for end in ends]
            sums = {}
            for name, of in (("a", a), ("b", b)):
                for side in (-1, 1):
                    said = [Fraction(x.mid[at]) + side * Fraction(x.rad[at]) for x in of]
                    sums[name, side] = exact_terms(said, *gains)
            r = Fraction(float(factor[0, at]))
            high_b, low_a, high_a = sums["b", 1], sums["a", -1], sums["a", 1]
            outside = [
                sum(high_a) - Fraction(float(greatest[at])),
                Fraction(float(least[at])) - sum(low_a),
                Fraction(float(taken[at])) - (sum(low_a) - r * sum(high_b)),
            ]
            moduli = [sum(map(abs, high_a)), sum(map(abs, low_a)), sum(map(abs, low_a)) + r * sum(map(abs, high_b))]
            failed += any(gap > 0 for gap in outside)
            most = max(most, *(float(gap / size / Fraction(U)) for gap, size in zip(outside, moduli, strict=True)))
    assert (failed == 0) == (guard > 0)
    assert guard > 0 or 0.5 < most <= 9


@pytest.mark.parametrize("guard", [damping.GUARD, 0.0])
def test_what_is_asked_of_b_c_is_never_more_than_in_exact_arithmetic(guard):
    """factor R - b_0 where it cancels by up to all its digits, as `no_damping` forms it."""
    rng = np.random.default_rng(10)
    factor, bound = awkward(rng, 2000), awkward(rng, 2000)
    drag = factor * bound * (1 - rng.choice([0.0, 2 * U, 1e-12, 1e-3, 0.5], 2000))
    needed = (factor * bound - drag * (1 + guard)) * (1 - guard)
    too_much = [
        Fraction(float(n)) - (Fraction(float(f)) * Fraction(float(R)) - Fraction(float(b)))
        for n, f, R, b in zip(needed, factor, bound, drag, strict=True)
    ]
    positive = [gap for gap, n in zip(too_much, needed, strict=True) if n > 0]
    assert any(gap > 0 for gap in positive) == (guard == 0)
    share = max(
        float(gap / Fraction(float(f * R)) / Fraction(U)) for gap, f, R in zip(too_much, factor, bound, strict=True)
    )
    assert guard > 0 or 0.5 < share <= 4
