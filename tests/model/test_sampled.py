"""The sampled loop against a state-space model, and its stability proof against eigenvalues."""

from __future__ import annotations

import pytest
from dense import spectral_radius as radius_of
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from vctune.analysis.sampled_loop import spectral_radius
from vctune.analysis.stability import clearly_stable
from vctune.bench.evaluator import Scene
from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.sampled.circle import split_delay
from vctune.proof.claims.covered import of_design
from vctune.proof.claims.poles import model_turns, stable_loop


@st.composite
def loops(draw):
    T = 10.0 ** draw(st.floats(-5, -1))
    m = 10.0 ** draw(st.floats(-4, 4))
    K_v = m / T * 10.0 ** draw(st.floats(-2, 0.6))
    return Scene(
        mass=m,
        damping=draw(st.sampled_from([0.0, 1e-6, 1e-2, 1.0])) * m / T,
        sample_time=T,
        delay=T * draw(st.sampled_from([0.0, 0.25, 1.0, 1.7, 5.0])),
        hold="zoh",
        K_v=K_v,
        K_p=draw(st.sampled_from([0.0, 1e-3, 0.05, 0.3])) * K_v / T,
    )


@settings(max_examples=40, deadline=None)
@given(loops())
def test_spectral_radius_and_its_proof_agree_with_matrix_exponentials(case):
    device, gains = Device(case.mass, case.damping, case.sample_time, case.delay, "zoh"), Gains(case.K_v, case.K_p)
    radius = radius_of(case)
    assert spectral_radius(device, gains) == pytest.approx(radius, rel=1e-6)
    assume(abs(radius - 1) > 1e-6)
    assert stable_loop(device, gains, model=False) is (radius < 1)


@settings(max_examples=40, deadline=None)
@given(loops(), st.sampled_from(["zoh", "lag"]))
def test_what_is_clearly_stable_is_proved_so_and_what_clearly_is_not_is_not(case, hold):
    device, gains = Device(case.mass, case.damping, case.sample_time, case.delay, hold), Gains(case.K_v, case.K_p)
    estimate = clearly_stable(device, gains)
    assume(estimate is not None)
    assert estimate == stable_loop(device, gains, model=True)


def test_too_much_integral_action_is_not_taken_for_stable_without_damping():
    """With tau K_p > K_v the argument of F starts beyond -pi, which looks like just below pi."""
    device, gains = Device(280.0, 0.0, 1.0, 5.0, "zoh"), Gains(32.0, 9.7)
    assert stable_loop(device, gains, model=False) is False
    assert clearly_stable(device, gains) is False


def test_no_position_in_the_loop_without_position_gain():
    """With K_p = 0 the free integrator from velocity to position does not count (model/README.md, section 7)."""
    device = Device(0.4, 0.0, 1e-3, 0.0, "zoh")
    assert spectral_radius(device, Gains(100.0, 0.0)) == pytest.approx(1 - 100.0 * 1e-3 / 0.4)


def test_whole_samples_snaps_rounding_noise():
    assert split_delay(3e-4, 1e-4) == (3, 0.0)
    whole, fraction = split_delay(2.5e-4, 1e-4)
    assert (whole, fraction) == (2, pytest.approx(0.5))


@settings(max_examples=80, deadline=None)
@given(loops(), st.sampled_from(["lag", "zoh"]))
def test_poles_of_the_frequency_model(case, hold):
    """Routh-Hurwitz for "lag" without delay; for the rest: stable well below the phase limit, unstable well above."""
    m, b, T = case.mass, case.damping, case.sample_time
    device, gains = Device(m, b, T, case.delay, hold), Gains(case.K_v, case.K_p)
    stable = (
        model_turns(
            of_design(Design(device, gains, Coupling(1.0, 1.0, 0.0)), Demands(device, (0.0, 1.0), 1.0, 2.0))
        ).number[0]
        == 0
    )
    if hold == "lag" and case.delay == 0:
        excess = (m + b * T / 2) * (b + case.K_v) - case.K_p * m * T / 2
        assume(abs(excess) > 1e-9 * m * case.K_v)
        assert stable == (excess > 0)
    elif case.K_p == 0 and b == 0:
        phase = case.K_v / m * device.loop_lag
        assume(hold == "zoh" or case.delay > 0)
        if phase < 0.5:
            assert stable
        if phase > 4:
            assert not stable
