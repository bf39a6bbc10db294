"""The prover against the check numbers of model/README.md and 50 digits, and at the limit of what can be told apart."""

from __future__ import annotations

from dataclasses import astuple, replace
from math import inf, pi

import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from vctune.analysis.demands import stability_ratio
from vctune.analysis.extrema import frequency_grid, local_minima
from vctune.bench import digits, evaluator
from vctune.bench.evaluator import Case
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import LeastOperator
from vctune.model.numbers.pair import Pair
from vctune.model.problem import Demands
from vctune.proof.boxes import Cells
from vctune.proof.certificate import certify
from vctune.proof.claims.llewellyn import polynomials
from vctune.proof.claims.llewellyn.conditions import low_end_verdict, prove_conditions, prove_low_end, widest_band
from vctune.proof.claims.many_designs import prove
from vctune.proof.claims.margins_of_claims import Design, conditions_margin
from vctune.proof.claims.sampled_poles import prove_sensitivity
from vctune.proof.enclosures.arb_balls import BALLS, PRECISION, design_ball
from vctune.proof.engine.interval import Verdict, prove_boxes, prove_positive
from vctune.proof.engine.winding import turned_angle

LAG = Device(0.5, 2.0, 1e-3, 0.0, "lag")
INTEGRAL = Gains(40.0, 4000.0)
VELOCITY = Gains(40.0, 0.0)


def conditions(design, low, high, factor=1.0):
    with ctx.workprec(PRECISION):
        return prove_conditions(design, low, high, factor)


@pytest.mark.parametrize(
    ("gains", "b_c", "m_c", "band", "verdict"),
    [
        (VELOCITY, 21000.0, 8.0, (0.0, inf), Verdict.PROVED),
        (VELOCITY, 21000.0, 5.5, (0.0, inf), Verdict.PROVED),
        (VELOCITY, 21000.0, 5.4, (0.0, inf), Verdict.REFUTED),
        (VELOCITY, 19000.0, 8.0, (0.0, inf), Verdict.REFUTED),
        (INTEGRAL, 25000.0, 5.0, (0.0, inf), Verdict.REFUTED),
        (INTEGRAL, 25000.0, 5.0, (5.3411, 76.195), Verdict.PROVED),
        (INTEGRAL, 25000.0, 5.0, (284.484, inf), Verdict.PROVED),
        (INTEGRAL, 25000.0, 5.0, (5.3409, 76.195), Verdict.REFUTED),
        (INTEGRAL, 25000.0, 5.0, (5.3411, 76.197), Verdict.REFUTED),
        (INTEGRAL, 3000.0, 2.0, (4.5440, 93.851), Verdict.PROVED),
        (INTEGRAL, 3000.0, 2.0, (199.372, 3197.6), Verdict.PROVED),
        (INTEGRAL, 3000.0, 2.0, (199.370, 3197.6), Verdict.REFUTED),
        (INTEGRAL, 3000.0, 2.0, (199.372, 3197.7), Verdict.REFUTED),
    ],
)
def test_fixtures_of_the_guide(gains, b_c, m_c, band, verdict):
    assert conditions(Design(LAG, gains, Coupling(b_c, m_c, 0.0)), *band).verdict is verdict


def test_a_tiny_drag_repairs_the_low_end():
    """R -> b^2/(4 (b + K_v - tau K_p)) = 0.025 for omega -> 0 (model/README.md, section 6)."""
    for drag, verdict in ((0.0251, Verdict.PROVED), (0.0249, Verdict.REFUTED)):
        assert conditions(Design(LAG, INTEGRAL, Coupling(25000.0, 5.0, drag)), 0.0, 50.0).verdict is verdict


@pytest.mark.parametrize(("drag", "verdict"), [(1.01, Verdict.PROVED), (0.99, Verdict.REFUTED)])
def test_a_rigid_coupling_has_its_drag_on_the_whole_axis(drag, verdict):
    """R -> 2 m K_v/(b T) = 5000 for omega -> inf (section 6), above R everywhere else, and Re Z_c is the drag."""
    design = Design(LAG, Gains(10.0, 0.0), Coupling(inf, 5.0, 5000.0 * drag))
    assert conditions(design, 0.0, inf).verdict is verdict


def interior_minimum(b_c, m_c):
    """The least ratio between the two outer crossings of the fixture, inside the band."""
    device, coupling = LAG, Coupling(b_c, m_c, 0.0)
    found = local_minima(lambda w: stability_ratio(device, INTEGRAL, coupling, w), frequency_grid(10.0, 1000.0))
    return float(found.value[0]), float(found.omega[0])


@pytest.mark.parametrize(("offset", "verdict"), [(1e-6, Verdict.PROVED), (-1e-6, Verdict.REFUTED)])
def test_tells_one_plus_from_one_minus_a_millionth(offset, verdict):
    """A coupling whose interior minimum is 1 + offset: scale b_c and m_c together, which scales Re Z_c."""
    least, omega = interior_minimum(25000.0, 5.0)
    assert 76 < omega < 285
    scale = (1 + offset) / least
    b_c, m_c = 25000.0 * scale, 5.0 * scale
    case = Case(0.5, 2.0, 1e-3, 0.0, "lag", 40.0, 4000.0, b_c, m_c)
    assert float(digits.exact(case, omega).ratio) == pytest.approx(1 + offset, abs=1e-8)
    outcome = conditions(Design(LAG, INTEGRAL, Coupling(b_c, m_c, 0.0)), 20.0, 1000.0)
    assert outcome.verdict is verdict
    assert outcome.boxes < 2000
    if verdict is Verdict.REFUTED:
        assert digits.exact(case, outcome.witness).ratio < 1


@st.composite
def designs(draw):
    T = 10.0 ** draw(st.floats(-5, -1.3))
    m, hold = 10.0 ** draw(st.floats(-4, 4)), draw(st.sampled_from(["zoh", "lag"]))
    K_v = m / T * 10.0 ** draw(st.floats(-2, 0.0))
    case = Case(
        m,
        draw(st.sampled_from([0.0, 1e-3, 0.03])) * m / T,
        T,
        T * draw(st.sampled_from([0.0, 0.4, 2.0])),
        hold,
        K_v,
        draw(st.sampled_from([0.0, 0.01, 0.1])) * K_v / T,
        1.0,
        1.0,
    )
    band = (10.0 ** draw(st.floats(-4, -1.5)) / T, 10.0 ** draw(st.floats(-1, 0.3)) / T)
    return case, band, draw(st.sampled_from([0.5, 0.999, 1.001, 1.05, 3.0]))


def assert_as_50_digits_say(drawn, seed):
    case, band, level = drawn
    device, gains = Device(case.mass, case.damping, case.sample_time, case.delay, case.hold), Gains(case.K_v, case.K_p)
    grid = frequency_grid(*band)
    ratio = stability_ratio(device, gains, Coupling(1.0, 1e-2 / band[0], 0.0), grid)
    assume(np.all(ratio > 0))
    b_c = float(level / ratio.min())
    assume(1e-25 < b_c < 1e25)
    case = replace(case, b_c=b_c, m_c=1e-2 / band[0] * b_c)
    outcome = conditions(Design(device, gains, Coupling(case.b_c, case.m_c, 0.0)), *band)
    assert outcome.verdict is not Verdict.UNDECIDED
    if outcome.verdict is Verdict.REFUTED:
        assert digits.exact(case, outcome.witness).ratio < 1
    else:
        rng = np.random.default_rng(seed)
        for omega in band[0] * (band[1] / band[0]) ** np.append(rng.uniform(size=30), [0.0, 1.0]):
            assert digits.exact(case, float(omega)).ratio > 1 - 1e-12


@settings(max_examples=40)
@given(designs(), st.integers(0, 2**32 - 1))
def test_never_proves_what_50_digits_refute_nor_refutes_without_a_witness(drawn, seed):
    assert_as_50_digits_say(drawn, seed)


@pytest.mark.slow
@settings(max_examples=150)
@given(designs(), st.integers(0, 2**32 - 1))
def test_never_proves_what_50_digits_refute_nor_refutes_without_a_witness_for_many(drawn, seed):
    assert_as_50_digits_say(drawn, seed)


@pytest.mark.parametrize("hold", ["lag", "zoh"])
@pytest.mark.parametrize("gains", [VELOCITY, INTEGRAL])
def test_the_low_end_chart_agrees_with_the_formulas_of_the_middle(gains, hold):
    """The edge found from 0 is proved good, and 50 digits agree next to it."""
    coupling, device = Coupling(25000.0, 8.0, 0.1), Device(0.5, 2.0, 1e-3, 0.0, hold)
    case = Case(0.5, 2.0, 1e-3, 0.0, hold, gains.velocity, gains.position, 25000.0, 8.0, 0.1)
    with ctx.workprec(PRECISION):
        low = prove_low_end(Design(device, gains, coupling), 1.0, 1e3)
    assert low is not None
    for omega in (low, low / 10, low / 1e4):
        assert digits.exact(case, omega).ratio > 1


def test_polynomial_roots_are_the_crossings_of_the_guide():
    for coupling, crossings in (
        (Coupling(25000.0, 5.0, 0.0), [5.3410, 76.1960, 284.483]),
        (Coupling(3000.0, 2.0, 0.0), [4.5439, 93.8517, 199.371, 3197.67]),
    ):
        roots = polynomials.conditions(Design(LAG, INTEGRAL, coupling), 1.0).roots
        assert [float(root.mid()) for root in roots] == pytest.approx(crossings, rel=1e-5)
        case = Case(0.5, 2.0, 1e-3, 0.0, "lag", 40.0, 4000.0, coupling.damping, coupling.mass)
        for root in roots:
            assert abs(digits.exact(case, float(root.mid())).ratio - 1) < 1e-12


def lag_design(rng):
    """A random design, with or without an operator, whose conditions are polynomials."""

    def decimal(low, high):
        return float(f"{10 ** rng.uniform(low, high):.6g}")

    mass, T = decimal(-3, 2), decimal(-5, -1)
    Z = mass / T
    operator = LeastOperator(mass * decimal(-2, 1), Z * decimal(-6, 0)) if rng.random() < 0.5 else None
    K_v = Z * decimal(-3, 0)
    gains = Gains(K_v, 0.0 if rng.random() < 0.3 else K_v / T * decimal(-5, -0.1))
    drag = 0.0 if rng.random() < 0.5 else K_v * decimal(-4, 0)
    damping = 0.0 if rng.random() < 0.1 else Z * decimal(-6, 0)
    return Design(
        Device(mass, damping, T, 0.0, "lag", operator),
        gains,
        Coupling(K_v * decimal(-1, 4), mass * decimal(-1, 4), drag),
    )


@pytest.mark.parametrize("seed", range(150))
def test_polynomials_decide_as_balls_do(seed):
    rng = np.random.default_rng(seed)
    design = lag_design(rng)
    band = np.sort(10 ** rng.uniform(-4, 0, 2) / design.device.sample_time)
    found = polynomials.conditions(design, 1.0)
    outcome = polynomials.prove(found, *band)
    with ctx.workprec(PRECISION):
        numbers = design_ball(design)
        balls = prove_positive(lambda omega: conditions_margin(numbers, omega, arb(1), BALLS), *band)
    assert outcome.verdict is balls.verdict is not Verdict.UNDECIDED
    if outcome.verdict is Verdict.REFUTED:
        assert band[0] < outcome.witness < band[1]


@pytest.mark.parametrize("seed", range(60))
def test_polynomials_prove_the_whole_axis_whenever_arrays_do(seed):
    """The arrays reach 0 and infinity by charts of their own."""
    design = lag_design(np.random.default_rng(seed))
    values = np.array([astuple(design.gains) + astuple(design.coupling)]).T
    demands = Demands(design.device, (0.0, inf), 1.0, 1e6)
    outcome = polynomials.prove(polynomials.conditions(design, 1.0), 0.0, inf)
    if prove(demands, Cells(values, values)).proved[0]:
        assert outcome.verdict is Verdict.PROVED
    if outcome.verdict is Verdict.PROVED:
        assert low_end_verdict(design) is not Verdict.REFUTED


def test_widest_band_ends_at_the_crossings():
    with ctx.workprec(PRECISION):
        low, high = widest_band(Design(LAG, INTEGRAL, Coupling(25000.0, 5.0, 0.0)), 10.0, 50.0)
    case = Case(0.5, 2.0, 1e-3, 0.0, "lag", 40.0, 4000.0, 25000.0, 5.0)
    for edge, outwards in ((low, 1 - 1e-6), (high, 1 + 1e-6)):
        assert digits.exact(case, edge).ratio >= 1
        assert digits.exact(case, edge * outwards).ratio < 1


def test_sensitivity_is_decided_close_to_its_peak():
    design = Design(
        Device(0.8, 1.5, 1e-3, 1e-3, "zoh"), Gains(278.65418437695695, 46985.153617955424), Coupling(1.0, 1.0, 0.0)
    )
    device, gains = design.device, design.gains
    case = evaluator.case_of(device, gains, design.coupling)
    omega = np.linspace(400, 700, 300_001)
    highest = omega[np.argmax(evaluator.sensitivity(case, omega))]
    peak = float(digits.sensitivity(case, highest))
    with ctx.workprec(PRECISION):
        assert prove_sensitivity(design, peak * (1 + 1e-6)).verdict is Verdict.PROVED
        refuted = prove_sensitivity(design, peak * (1 - 1e-6))
    assert refuted.verdict is Verdict.REFUTED
    assert digits.sensitivity(case, refuted.witness) > peak * (1 - 1e-6)


def test_an_unstable_loop_is_refuted_although_its_sensitivity_is_small():
    """The paper leaves stable poles out: far beyond the stability limit |S| is small all over the band."""
    design = Design(Device(0.4, 2.0, 1e-3, 0.0, "zoh"), Gains(3e4, 0.0), Coupling(1e5, 1.0, 0.0))
    certificate = certify(design, Demands(design.device, (pi, 60 * pi), 1.0, 2.0))
    assert certificate.outcomes["stable"].verdict is Verdict.REFUTED
    assert certificate.outcomes["stable_model"].verdict is Verdict.REFUTED
    assert certificate.verdict is Verdict.REFUTED


def test_proof_is_about_the_decimals():
    """0.1 + 0.2 as written is not 0.3: a margin of exactly 0 is not proved, one of 1e-20 is."""
    from vctune.proof.enclosures.arb_balls import ball

    with ctx.workprec(PRECISION):
        assert not ball(0.1) + ball(0.2) - ball(0.3) > 0
        assert ball(0.1) + ball(0.2) + arb("1e-20") - ball(0.3) > 0
        assert ball(0.1).overlaps(arb(1) / 10) and not ball(0.1).contains(arb(0.1))


@given(st.floats(-0.99, 0.99), st.integers(2, 9))
def test_prove_positive_on_a_cosine(offset, periods):
    assume(abs(offset) > 1e-9)
    with ctx.workprec(PRECISION):
        outcome = prove_positive(lambda x: x.cos() + (1 + offset), 0.1, 2 * pi * periods)
    assert outcome.verdict is (Verdict.PROVED if offset > 0 else Verdict.REFUTED)


@given(st.integers(-3, 3), st.floats(0.1, 0.9))
def test_turned_angle_counts_turns(turns, radius):
    def curve(t):
        return Pair((t * turns).cos() + radius * (t * 5).cos() / 10, (t * turns).sin() + radius * (t * 5).sin() / 10)

    assume(turns != 0)
    with ctx.workprec(PRECISION):
        outcome, angle = turned_angle(curve, 0.0, 2 * pi)
    assert outcome.verdict is Verdict.PROVED
    assert angle == pytest.approx(2 * pi * turns, abs=1e-9)


def test_margin_without_a_loop_is_the_device_and_the_coupling_alone():
    design = Design(LAG, Gains(0.0, 0.0), Coupling(3.0, 1.0, 0.5))
    with ctx.workprec(PRECISION):
        margin = conditions_margin(design_ball(design), arb(2), arb(1), BALLS)
        assert float(margin) == pytest.approx(2 * 2.0 * (0.5 + 3 * 4 / (9 + 4)))


@pytest.mark.parametrize("low", [0.0, 1e-3])
def test_proved_boxes_cover_the_interval(low):
    """Boxes wider than the curve allows are not proved; those that are leave no gap, and too few of them no proof."""
    proved = []

    def decide(left, right):
        if right - left > 0.02 + 0.1 * abs(right - 2):
            return Verdict.UNDECIDED
        proved.append((left, right))
        return Verdict.PROVED

    enough = prove_boxes(decide, low, 5.0)
    assert enough.verdict is Verdict.PROVED
    assert [left for left, _ in proved] == [low, *(right for _, right in proved[:-1])]
    assert proved[-1][1] == 5.0
    for effort in range(1, enough.boxes):
        assert prove_boxes(decide, low, 5.0, effort).verdict is Verdict.UNDECIDED
    assert prove_boxes(lambda left, right: Verdict.REFUTED if left > 1 else decide(left, right), low, 5.0).witness > 1
