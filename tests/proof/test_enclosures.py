"""Ball arithmetic on arrays: every result encloses the true value, and agrees with Arb about every design."""

from __future__ import annotations

import operator
from fractions import Fraction
from math import inf, pi

import numpy as np
import pytest
from agreement import contains
from conftest import ROOT, mostly_slow
from hypothesis import given
from hypothesis import strategies as st
from mpmath import mp, mpf

from vctune.document.reading import read_gains, read_problem
from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.numbers.arithmetic import CURVATURE_BELOW
from vctune.model.numbers.units import KEYS
from vctune.proof.box_tests import positive
from vctune.proof.boxes import Cells, band_of, over_cells
from vctune.proof.cells import proved_cells as prove
from vctune.proof.certificate import certify
from vctune.proof.enclosures import elementary
from vctune.proof.enclosures.elementary import EXP_ERROR, GREATEST, LOG_ERROR, PHI_BELOW, PHI_ERROR, SINE_ERROR
from vctune.proof.enclosures.intervals import (
    ENCLOSURES,
    SWELL,
    Enclosure,
    between,
    decimal,
    raised,
)
from vctune.proof.halving import Effort
from vctune.proof.outcome import Verdict
from vctune.proof.prover import prove as prove_boxes

ordinary = st.floats(-1e6, 1e6, allow_subnormal=False)
numbers = ordinary | st.floats(allow_nan=False, allow_infinity=False)
radii = st.floats(0, 10, allow_subnormal=False)
places = st.floats(-1, 1)
BINARY = [operator.add, operator.sub, operator.mul, operator.truediv]


def inside(mid, rad, place):
    return mpf(mid) + mpf(rad) * mpf(place)


@pytest.mark.parametrize("operation", BINARY)
@np.errstate(all="ignore")
@given(numbers, radii, places, numbers, radii, places)
def test_arithmetic_encloses(operation, a, ra, pa, b, rb, pb):
    with mp.workdps(60):
        x, y = inside(a, ra, pa), inside(b, rb, pb)
        if operation is operator.truediv and 0 in (x, y, b):
            return
        left, right = Enclosure(np.array(a), np.array(ra)), Enclosure(np.array(b), np.array(rb))
        assert contains(operation(left, right), operation(x, y))
        assert contains(operation(left, b), operation(x, mpf(b)))
        assert contains(operation(b, left), operation(mpf(b), x))


@given(ordinary, radii, places)
def test_square_encloses_and_is_nowhere_negative(a, rad, place):
    x = Enclosure(np.array(a), np.array(rad))
    with mp.workdps(60):
        assert contains(x * x, inside(a, rad, place) ** 2)
    assert not (x * x).negative()
    assert (x * x).mid >= (x * x).rad * (1 - 1e-12) - 1e-290


FUNCTIONS = {
    "sqrt": (mp.sqrt, 0.0),
    "exp": (mp.exp, -700.0),
    "sin": (mp.sin, -1e6),
    "cos": (mp.cos, -1e6),
    "sinc": (mp.sinc, 0.0),
    "phi_1": (lambda x: -mp.expm1(-x) / x if x else mpf(1), 0.0),
    "sinc_curvature": (lambda x: (1 - mp.sinc(x)) / x**2 if x else mpf(1) / 6, 0.0),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_enclose(name):
    exact, least = FUNCTIONS[name]
    rng = np.random.default_rng(1)
    mid = np.concatenate([10.0 ** rng.uniform(-12, 2.5, 300), [0.0]]) * (rng.choice([-1, 1], 301) if least < 0 else 1)
    rad = np.minimum(10.0 ** rng.uniform(-18, 0, mid.size) * np.abs(mid), np.where(least < 0, np.inf, mid))
    image = getattr(ENCLOSURES, name)(Enclosure(mid, rad))
    with mp.workdps(60):
        for place in (-1.0, -0.3, 0.0, 0.7, 1.0):
            for i in range(mid.size):
                x = inside(mid[i], rad[i], place)
                assert contains(image.subset(i), exact(x)), (mid[i], rad[i])


def neighbours(x):
    return np.concatenate([np.nextafter(x, -np.inf), x, np.nextafter(x, np.inf)])


TINY_NUMBERS = np.array([0.0, 5e-324, 1e-310, 2.3e-308, 1e-200, 1e-17, 1e-16, 3e-9])
LARGE_ANGLES = np.concatenate(
    [np.random.default_rng(3).integers(1, int(GREATEST / 2), 200) * (pi / 2), 2.0 ** np.arange(10, 20)]
)
"""Where the reduction of the argument is hardest: next to multiples of pi/2, and far away."""


def test_elementary_functions_are_as_accurate_as_their_roundings_tell():
    """sin and cos relative to 1, sin also to itself where sinc divides by its argument; exp to itself; log to 1 and to
    itself."""
    multiples = np.arange(1, 40) * (pi / 2)
    angles = np.concatenate([TINY_NUMBERS, neighbours(multiples), neighbours(multiples / 2), neighbours(LARGE_ANGLES)])
    between = np.log(2) * np.arange(1, 40) / 2
    exponents = np.concatenate([TINY_NUMBERS, neighbours(np.geomspace(1e-8, 700, 60)), between])
    normal = np.concatenate([neighbours(2.0 ** np.arange(-1000, 1000, 90.5)), neighbours(np.ones(1)), [0.7, 0.8, 1.3]])

    def error(function, exact, x):
        values = function(x)
        return np.array([float(mpf(float(v)) - exact(mpf(float(t)))) for t, v in zip(x, values, strict=True)]), values

    with mp.workprec(1300):
        for sign in (-1, 1):
            for function, exact in ((elementary.sine, mp.sin), (elementary.cosine, mp.cos)):
                away, values = error(function, exact, sign * angles)
                assert (np.abs(away) <= SINE_ERROR).all()
                if function is elementary.sine:
                    small = np.abs(angles) < pi / 4
                    assert (np.abs(away[small]) <= SINE_ERROR * np.abs(values[small])).all()
            away, values = error(elementary.exponential, mp.exp, sign * exponents)
            assert (np.abs(away) <= EXP_ERROR * np.abs(values)).all()
        away, values = error(elementary.logarithm, mp.log, normal)
        assert (np.abs(away) <= LOG_ERROR * (1 + np.abs(values))).all()
    assert np.isnan(elementary.sine_and_cosine(np.array([1.01 * GREATEST, np.inf, np.nan]))).all()
    assert np.isnan(elementary.exponential(np.nan)) and elementary.exponential(-1e9) <= 1e-300


@pytest.mark.parametrize(
    ("name", "below", "most"), [("phi_1", PHI_BELOW, 1e101), ("sinc_curvature", CURVATURE_BELOW, 300)]
)
def test_series_are_as_accurate_as_the_proof_takes_them_for(name, below, most):
    x = np.concatenate([TINY_NUMBERS, neighbours(np.array([below])), 10.0 ** np.arange(-300, 101, 10.0)])
    x = np.concatenate([x, np.geomspace(1e-3, 50, 300), np.linspace(0.9, 1.1, 50) * below])
    x = x[x < most]
    with mp.workdps(700):
        exact = FUNCTIONS[name][0]
        for at, value in zip(x.tolist(), getattr(elementary, name)(x).tolist(), strict=True):
            assert abs(mpf(value) / exact(mpf(at)) - 1) <= PHI_ERROR, at


@np.errstate(over="ignore")
def test_reciprocals_and_exponentials_beyond_the_range_of_their_squares():
    mid = 10.0 ** np.array([-300.0, -200.0, -160.0, 160.0, 200.0, 300.0])
    for share in (0.0, 1e-9, 0.5):
        inverse = Enclosure(mid, share * mid).reciprocal()
        exponential = ENCLOSURES.exp(Enclosure(np.array([-750.0, -1e4]), share * np.array([750.0, 1e4])))
        with mp.workdps(60):
            for i, place in [(i, place) for i in range(mid.size) for place in (-1.0, 0.0, 1.0)]:
                assert contains(inverse.subset(i), 1 / inside(mid[i], share * mid[i], place))
            for i, x in enumerate((-750.0, -1e4)):
                assert contains(exponential.subset(i), mp.exp(mpf(x) * (1 - mpf(share))))
        assert np.isfinite(inverse.rad).all() and np.isfinite(exponential.rad[0])


@np.errstate(all="ignore")
def test_what_is_not_a_number_proves_nothing():
    unknown = 1 / Enclosure(np.array([0.5, -1.0]), np.array([1.0, 1.0]))
    beyond = Enclosure(np.array([1e300])) * Enclosure(np.array([1e300]))
    for x in (unknown, unknown * unknown, unknown + 1.0, beyond, beyond - beyond):
        assert not x.positive().any() and not x.negative().any()


@pytest.mark.parametrize(
    "name", mostly_slow(["friction-wheel", "cobot-wrist", "desktop", "fixed-gains"], ["cobot-wrist"])
)
@pytest.mark.parametrize("spread", mostly_slow([0.01, 0.3, 2.0], [0.3]))
def test_arrays_prove_what_arb_proves(name, spread):
    """Random designs around a good one: never proved against Arb, and nothing of a usual kind left open."""
    problem = read_problem(ROOT / f"problems/{name}.toml").problem
    file = read_gains(ROOT / f"tests/gains/{name}.toml")
    best = [file.gains.velocity, file.gains.position, file.coupling.damping, file.coupling.mass, file.coupling.drag]
    values = np.array(best)[:, None] * np.exp(np.random.default_rng(2).normal(0, spread, (5, 60)))
    values[1, ::5] = 0.0
    band, limit = (problem.stability.band.min, problem.stability.band.max), problem.stability.max_sensitivity
    demands = Demands(problem.device, band, 1.0, limit)
    proved = prove(demands, Cells(values, values))
    for found, v in zip(proved, values.T.tolist(), strict=True):
        verdict = certify(Design(problem.device, Gains(*v[:2]), Coupling(*v[2:])), demands).verdict
        assert found == (verdict is Verdict.PROVED)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hold", "delay", "band", "damping", "drag"),
    [
        ("lag", 0.0, (0.0, inf), 2.0, 0.05),
        ("lag", 0.0, (0.0, inf), 2.0, 0.0),
        ("lag", 0.0, (3.0, inf), 2.0, 0.0),
        ("zoh", 0.0, (0.0, 600.0), 2.0, 0.01),
        ("zoh", 0.0, (0.0, 600.0), 2.0, 1e-9),
        ("zoh", 3e-4, (0.0, 300.0), 0.0, 0.0),
    ],
)
def test_arrays_prove_what_arb_proves_at_the_ends_of_the_axis(hold, delay, band, damping, drag):
    device, rng = Device(0.5, damping, 1e-3, delay, hold), np.random.default_rng(5)
    values = np.array([[40.0], [4000.0], [25000.0], [6.0], [drag]]) * np.exp(rng.normal(0, 1, (5, 60)))
    values[1, ::2] = 0.0
    demands = Demands(device, band, 1.0, 2.0)
    proved = prove(demands, Cells(values, values))
    assert 0 < proved.sum() < 60
    for found, v in zip(proved, values.T.tolist(), strict=True):
        verdict = certify(Design(device, Gains(*v[:2]), Coupling(*v[2:])), demands).verdict
        assert found == (verdict is Verdict.PROVED)


def test_a_claim_over_a_cell_holds_at_each_of_its_points():
    """(x - K_v)^2 + 0.01 > K_p on a band: proved where K_p < 0.01 throughout, not where a corner fails."""
    low, high = np.zeros((5, 4)), np.ones((5, 4))
    low[0], high[0] = 2.0, 2.0 + np.array([0.5, 0.5, 1e-3, 1e-3])
    low[1], high[1] = 0.001, np.array([0.009, 0.011, 0.0099, 0.0101])
    low[2:] = high[2:] = 1.0
    cells = Cells(low, high)

    def margin(x, v):
        away = x - v[KEYS[0]]
        return away * away + 0.01 - v[KEYS[1]]

    boxes, only_frequency = over_cells(cells, band_of(1.0, 4.0, 1.2)), [True, *[False] * 5]
    found = prove_boxes(positive(margin, {}), boxes, 4, Effort(20, 4000), halved=only_frequency)
    assert found.proved.tolist() == [True, False, True, False]
    assert np.isnan(found.failing[:, [0, 2]]).all() and np.isnan(found.open[:, [0, 2]]).all()
    for failing in found.failing[:, np.isfinite(found.failing[0])].T:
        assert float(margin(failing[0], dict(zip(KEYS, failing[1:], strict=True)))) < 0


def test_one_of_two_cases_is_taken_where_it_surely_is_the_one():
    x = between(np.array([0.1, -0.1, -2.0]), np.array([2.0, 2.0, -0.1]))
    found = ENCLOSURES.where_positive(x, lambda: Enclosure(np.ones(3)), lambda: Enclosure(np.zeros(3)))
    assert found.mid.tolist() == [1.0, 0.0, 0.0]


def test_enclosed_decimals():
    with mp.workdps(30):
        for text in ("0.4", "1e-20", "6.02e19", "0.1"):
            assert contains(decimal(float(text)), mpf(text))
            assert contains(between(0.0, float(text)), mpf(text))
    assert ENCLOSURES.is_zero(decimal(0.0)) and not ENCLOSURES.is_zero(decimal(pi))


ROUNDING = 2.0**-53
LOST = ROUNDING * (1 - 2.0**-20)
"""Added to 1 it is rounded away."""


@pytest.mark.parametrize("rows", [14, 60])
def test_a_sum_over_rows_is_raised_by_all_that_rounding_took_from_it(rows):
    # the first term, (1 + 2u + u) (1 - u), is rounded down twice, each of the others away
    sizes, reaches = np.full(rows, LOST), np.ones(rows)
    sizes[0], reaches[0] = (1 + 2 * ROUNDING) + LOST, 1 - ROUNDING
    exact = (Fraction(1 + 2 * ROUNDING) + Fraction(LOST)) * Fraction(1 - ROUNDING) + (rows - 1) * Fraction(LOST)
    total = np.tile((sizes * reaches)[:, None], 2).sum(axis=0)  # one after the other, as rows of many boxes are
    assert total[0] == 1.0
    assert Fraction(float(raised(total, rows)[0])) >= exact
    assert Fraction(float((total * (1 + rows * ROUNDING))[0])) < exact, "as many roundings as terms are too few"
    assert rows < 16 or Fraction(float((total * SWELL)[0])) < exact, "and so are those of an operation"
