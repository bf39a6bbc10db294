"""The prover against the check numbers of model/README.md and 50 digits, and at the limit of what can be told apart."""

from __future__ import annotations

from dataclasses import astuple, replace
from math import inf, pi

import numpy as np
import pytest
from arithmetic import Digits
from balls import BALLS, PRECISION, ball
from conftest import mostly_slow
from flint import arb, ctx
from frequency import demanded, offered
from hypothesis import given
from hypothesis import strategies as st
from loop import Loop, sensitivity

from vctune.analysis.demands import stability_ratio
from vctune.analysis.extrema import frequency_grid, local_minima
from vctune.api.checking import check
from vctune.bench import evaluator
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import LeastOperator
from vctune.model.numbers.pair import Pair
from vctune.model.problem import Demands
from vctune.proof.box_tests import turned_angles
from vctune.proof.boxes import over_band
from vctune.proof.certificate import certify
from vctune.proof.claims.cases import case_at
from vctune.proof.claims.loop_claims import Covered, of_design, prove_conditions, prove_sensitivity
from vctune.proof.claims.margins_of_claims import conditions_margin
from vctune.proof.claims.poles import turns
from vctune.proof.enclosures.intervals import ENCLOSURES, Enclosure
from vctune.proof.enclosures.taylor_functions import TAYLOR
from vctune.proof.outcome import Verdict

EXACT = Digits(120)
LAG = Device(0.5, 2.0, 1e-3, 0.0, "lag")
INTEGRAL = Gains(40.0, 4000.0)
VELOCITY = Gains(40.0, 0.0)


def tables(device):
    return {"device": {name: getattr(device, name) for name in ("mass", "damping", "sample_time", "delay", "hold")}}


def ratio(design, omega):
    """Return Re Z_c/R by the definitions, with 120 digits; inf where R is not positive."""
    s, coupling = EXACT.i * EXACT.number(omega), design.coupling
    R = demanded(tables(design.device), astuple(design.gains), s, EXACT).required
    return offered(astuple(coupling), s, EXACT).real / R if R > 0 else inf


def conditions(design, low, high, factor=1.0):
    return prove_conditions(design, Demands(design.device, (low, high), factor, inf), None)


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
    design = Design(LAG, INTEGRAL, Coupling(25000.0 * scale, 5.0 * scale, 0.0))
    assert float(ratio(design, omega)) == pytest.approx(1 + offset, abs=1e-8)
    outcome = conditions(design, 20.0, 1000.0)
    assert outcome.verdict is verdict
    assert outcome.boxes < 2000
    if verdict is Verdict.REFUTED:
        assert ratio(design, outcome.witness) < 1


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


@pytest.mark.parametrize("seed", mostly_slow(range(60), range(12)))
def test_the_whole_axis_is_decided_as_50_digits_say(seed):
    """Next to 0 and infinity the margins have forms of their own."""
    rng = np.random.default_rng(seed)
    design = lag_design(rng)
    design = replace(design, device=replace(design.device, operator=None))
    outcome = conditions(design, 0.0, inf)
    if outcome.verdict is Verdict.REFUTED:
        assert ratio(design, outcome.witness) < 1
    elif outcome.verdict is Verdict.PROVED:
        for omega in 10 ** rng.uniform(-8, 8, 30) / design.device.sample_time:
            assert ratio(design, float(omega)) > 1 - 1e-12


def test_sensitivity_is_decided_close_to_its_peak():
    design = Design(
        Device(0.8, 1.5, 1e-3, 1e-3, "zoh"), Gains(278.65418437695695, 46985.153617955424), Coupling(1.0, 1.0, 0.0)
    )
    device, gains = design.device, design.gains
    case = evaluator.case_of(device, gains, design.coupling)
    omega = np.linspace(400, 700, 300_001)
    highest = omega[np.argmax(evaluator.sensitivity(case, omega))]
    exact = Loop(tables(device)["device"], astuple(gains), num=EXACT)

    def sensed(omega):
        return abs(sensitivity(exact, EXACT.exp(EXACT.i * EXACT.number(omega) * exact.T)))

    peak = float(sensed(highest))
    proved, refuted = (
        prove_sensitivity(design, Demands(device, (0.0, 1.0), 1.0, peak * (1 + side)), None) for side in (1e-6, -1e-6)
    )
    assert proved.verdict is Verdict.PROVED and refuted.verdict is Verdict.REFUTED
    assert sensed(refuted.witness) > peak * (1 - 1e-6)


@given(st.integers(-3, 3), st.floats(0.1, 0.9))
def test_turns_are_counted(number, radius):
    def curve(case, t):
        once, also = TAYLOR.cos(t * (2 * number)), TAYLOR.sin(t * (2 * number))
        return Pair(once + TAYLOR.cos(t * 5) * (radius / 10), also + TAYLOR.sin(t * 5) * (radius / 10))

    covered = of_design(Design(LAG, VELOCITY, Coupling(1.0, 1.0, 0.0)), Demands(LAG, (0.0, 1.0), 1.0, 2.0))
    found = turns(covered, curve, Covered.around_circle, 2 * pi)
    assert found.number[0] == -number


@pytest.mark.parametrize(("blur", "known"), [(0.04, True), (0.06, False)])
def test_an_angle_is_known_only_where_its_curve_surely_passes_on_one_side(blur, known):
    empty, half = np.empty((0, 1)), (np.zeros(1), np.full(1, pi))
    curve = turned_angles(lambda t, _: Pair(ENCLOSURES.cos(t), Enclosure(np.full(1, 0.05), blur)), {})
    assert np.isfinite(curve(over_band((), empty, empty, half)))[0] == known


def test_an_unstable_loop_is_refuted_although_its_sensitivity_is_small():
    """The paper leaves stable poles out: far beyond the stability limit |S| is small all over the band."""
    design = Design(Device(0.4, 2.0, 1e-3, 0.0, "zoh"), Gains(3e4, 0.0), Coupling(1e5, 1.0, 0.0))
    certificate = certify(design, Demands(design.device, (pi, 60 * pi), 1.0, 2.0))
    assert certificate.outcomes["stable"].verdict is Verdict.REFUTED
    assert certificate.outcomes["stable_model"].verdict is Verdict.REFUTED
    assert certificate.verdict is Verdict.REFUTED


@pytest.mark.parametrize(
    ("damping", "verdict"), [(0.0, "refuted"), (5.0, "proved"), ({"min": 0.0, "max": 5.0}, "refuted")]
)
def test_the_hand_with_the_least_damping_decides_of_a_servo(damping, verdict):
    servo = {"delay": 0.004, "bandwidth_hz": 15.0, "order": 2, "command": "velocity"}
    stated = {"device": {"sample_time": 0.002, "servo": servo}, "stability": {"safety_factor": 1.0}}
    stated |= {"operator": {"mass": 0.1, "damping": damping, "stiffness": 400.0}}
    found = check(stated | {"coupling": {"mass": 6.0, "drag": 6.0, "damping": inf}})
    assert found.finding.judgement.certificate.verdict.value == verdict


def test_proof_is_about_the_decimals():
    """0.1 + 0.2 as written is not 0.3: a margin of exactly 0 is not proved, one of 1e-20 is."""
    with ctx.workprec(PRECISION):
        assert not ball(0.1) + ball(0.2) - ball(0.3) > 0
        assert ball(0.1) + ball(0.2) + arb("1e-20") - ball(0.3) > 0
        assert ball(0.1).overlaps(arb(1) / 10) and not ball(0.1).contains(arb(0.1))


def test_margin_without_a_loop_is_the_device_and_the_coupling_alone():
    design = Design(LAG, Gains(0.0, 0.0), Coupling(3.0, 1.0, 0.5))
    with ctx.workprec(PRECISION):
        case = case_at(design, Demands(LAG, (0.0, inf), 1.0, inf), number=ball, ops=BALLS)
        margin = conditions_margin(case, arb(2))
        assert float(margin) == pytest.approx(2 * 2.0 * (0.5 + 3 * 4 / (9 + 4)))
