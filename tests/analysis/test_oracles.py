"""The two oracles against each other, python-control (margins) and scikit-rf (Rollett's K)."""

from __future__ import annotations

from dataclasses import replace
from math import degrees, pi

import control
import numpy as np
import pytest
import skrf
from dense import unstable_model_poles
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from test_model import cases

from vctune.analysis.demands import rollett_factor_at, stability_ratio
from vctune.analysis.margins import loop_margins, unstable_poles
from vctune.analysis.sampled_loop import sensitivity_of
from vctune.bench import digits, evaluator
from vctune.bench.evaluator import Case, coupling_impedance, impedances
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.proof.claims.sampled_poles import spectral_radius

LOOPS = [
    Case(0.4, 2.0, 1e-3, 0.0, "lag", 150.0, 6000.0),
    Case(0.4, 2.0, 1e-3, 0.0, "lag", 150.0, 1e6),
    Case(10.0, 0.0, 2e-3, 0.0, "lag", 900.0, 2e4),
    Case(0.4, 2.0, 1e-3, 0.0, "zoh", 700.0, 2e4),
    Case(10.0, 20.0, 2e-3, 4e-3, "zoh", 1400.0, 0.0),
    Case(0.05, 0.2, 2.5e-4, 6e-4, "lag", 60.0, 9000.0),
]


def quantities(case):
    return Device(case.mass, case.damping, case.sample_time, case.delay, case.hold), Gains(case.K_v, case.K_p)


def pulse_transfer(case):
    """L of the sampled loop by python-control: a plant held over whole samples, the delay as powers of z."""
    plant = control.ss([[-case.damping / case.mass, 0], [1, 0]], [[1 / case.mass], [0]], [[case.K_v, case.K_p]], 0)
    whole = round(case.delay / case.sample_time)
    held = control.sample_system(plant, case.sample_time, "zoh")
    return held * control.tf([1.0], [1.0, *[0.0] * whole], case.sample_time) if whole else held


@pytest.mark.parametrize("case", [case for case in LOOPS if case.delay % case.sample_time == 0 and case.K_p < 1e5])
def test_margins_agree_with_python_control(case):
    L, ours = pulse_transfer(case), loop_margins(*quantities(case))
    _, phase, *_ = control.stability_margins(L)  # its gain margin leaves z = -1 out
    assert degrees(ours.phase) == pytest.approx(phase, rel=1e-5)


@pytest.mark.parametrize("case", [case for case in LOOPS if case.K_p < 1e5])
def test_at_its_margins_the_sampled_loop_is_on_the_verge_of_instability(case):
    device, gains = quantities(case)
    margins = loop_margins(device, gains)
    louder = Gains(gains.velocity * margins.gain, gains.position * margins.gain)
    assert spectral_radius(device, louder) == pytest.approx(1.0, abs=1e-9)
    for share in (0.999, 1.0, 1.001):
        radius = spectral_radius(replace(device, delay=device.delay + share * margins.delay), gains)
        assert radius == pytest.approx(1.0, abs=1e-9) if share == 1 else (radius < 1) == (share < 1)


def test_the_loop_that_runs_rings_where_the_frequency_model_does_not():
    """A velocity loop near its limit: |S| of the sampled loop at 1 to 500 Hz, and 1 dB of gain margin."""
    device, gains = Device(0.4, 2.0, 1e-3, 0.0, "zoh"), Gains(714.08906, 19575.807)
    S = [0.00100550271, 0.032717941, 0.179000391, 0.368029577, 3.2695241, 9.31269179]
    found = sensitivity_of(device, gains)(2 * pi * np.array([1.0, 10.0, 50.0, 100.0, 400.0, 500.0]))
    assert found == pytest.approx(S, rel=5e-9)
    assert 20 * np.log10(loop_margins(device, gains).gain) == pytest.approx(0.98667, abs=1e-5)


@settings(max_examples=100, deadline=None)
@given(cases(), st.floats(1e-4, 1.0))
def test_sampled_sensitivity_against_50_digits(case, place):
    omega = place * pi / case.sample_time
    device, gains = quantities(case)
    true = float(digits.sensitivity(case, omega))
    assert float(sensitivity_of(device, gains)(np.array(omega))) == pytest.approx(true, rel=1e-9)
    assert evaluator.sensitivity(case, omega) == pytest.approx(true, rel=1e-8)


@settings(max_examples=50, deadline=None)
@given(cases())
def test_the_poles_of_both_oracles(case):
    """Eigenvalues of matrix exponentials are roots of the polynomial; a double one is known to half the digits only."""
    polynomial = np.array([float(c) for c in digits.characteristic(case, (case.K_v, case.K_p))])
    radius, roots = evaluator.spectral_radius(case), np.roots(polynomial)
    apart = np.abs(roots[:, None] - roots)[~np.eye(roots.size, dtype=bool)]
    assume(apart.min(initial=1.0) > 1e-3)
    assert np.abs(roots).max() == pytest.approx(radius, rel=1e-4)
    assert digits.stable(case) == (radius < 1) or abs(radius - 1) < 1e-6


@settings(max_examples=100, deadline=None)
@given(cases(), st.floats(1e-3, 1e3), st.floats(1e-3, 1e3), st.floats(0, 1))
def test_required_resistance_of_both_oracles_in_a_hand(case, heavier, stiffer, place):
    """With the hand's mass in the two-port and without: any reactance may be there anyway."""
    case = replace(case, m_h=case.mass * heavier, b_h=(case.damping + case.K_v) * stiffer)
    omega = 1e-3 * (3e3) ** place / case.sample_time
    true, (Z_d, C) = digits.exact(case, omega), impedances(case, 1j * omega)
    assume(abs((Z_d + case.b_h + C).real) > 1e-6 * abs(Z_d + case.b_h + C))
    R = float(evaluator.required(case, omega))
    if true.resistance > 0:
        assert pytest.approx(float(true.required), abs=1e-8 * (abs(R) + case.b_h * abs(C / (Z_d + case.b_h + C)))) == R
    else:
        assert np.inf == R


def test_many_cases_are_judged_as_one_by_one():
    rng, n = np.random.default_rng(4), 30
    whole = Case(
        10 ** rng.uniform(-1, 1, n), 10 ** rng.uniform(-1, 1, n), 1e-3, 1e-3 * rng.choice([0, 0.4, 1, 2.5], n), "zoh",
        10 ** rng.uniform(1, 3, n), 10 ** rng.uniform(3, 5, n) * (rng.random(n) < 0.7), 30.0, 0.2, 0.01, 0.1, 0.5,
    )  # fmt: skip
    omega = np.geomspace(1.0, 3000.0, 20)
    for f in (evaluator.required, evaluator.sensitivity, evaluator.stability_ratio):
        assert f(whole, omega) == pytest.approx(np.array([f(whole.at(i), omega) for i in range(n)]), rel=1e-12)
    for f in (evaluator.spectral_radius, unstable_model_poles):
        assert f(whole) == pytest.approx([f(whole.at(i)) for i in range(n)], rel=1e-9)


@pytest.mark.parametrize(("K_p", "poles"), [(0.9, 0), (1.1, 2)])
def test_unstable_poles_of_the_model_in_closed_form(K_p, poles):
    """m s^2 + K_v s + K_p with a lag tau: m tau s^3 + m s^2 + K_v s + K_p is stable for tau K_p < K_v."""
    case = Case(0.5, 0.0, 1e-3, 0.0, "lag", 20.0, K_p * 20.0 / 0.5e-3)
    assert unstable_model_poles(case) == poles


@pytest.mark.parametrize("case", LOOPS)
def test_rollett_factor_agrees_with_scikit_rf(case):
    """The two-port of model/README.md, section 2, is an inverse hybrid matrix: [i1; v2] = g [v1; i2]."""
    device, gains = quantities(case)
    virtual = Coupling(30.0, 0.2, 0.01)
    case = replace(case, b_c=30.0, m_c=0.2, b_0=0.01)
    omega = np.geomspace(1.0, 0.9 * pi / case.sample_time, 50)
    (Z_d, C), Z_c = impedances(case, 1j * omega), coupling_impedance(case, 1j * omega)
    g = np.array([[1 / (Z_d + C), -C / (Z_d + C)], [np.ones(omega.size), Z_c]]).transpose(2, 0, 1)
    S = skrf.network.g2s(g, z0=20.0)
    K = skrf.Network(f=omega, f_unit="Hz", s=S, z0=20.0).stability
    ours = [rollett_factor_at(device, gains, virtual, w) for w in omega]
    assert ours == pytest.approx(K, rel=1e-8)
    assert np.array_equal(np.array(ours) >= 1, stability_ratio(device, gains, virtual, omega) >= 1) or case.K_p > 1e5


@pytest.mark.parametrize(
    "case", [*LOOPS, Case(0.4, 2.0, 1e-3, 0.0, "lag", 10.0, 5e4), Case(0.4, 0.0, 1e-3, 5e-3, "zoh", 300.0, 0.0)]
)
def test_encirclements_are_the_unstable_poles(case):
    """Z = N + P with P = 0: as many as the eigenvalues outside the unit circle."""
    device, gains = quantities(case)
    polynomial = [float(c) for c in digits.characteristic(case, (case.K_v, case.K_p))]
    assert unstable_poles(device, gains) == np.count_nonzero(np.abs(np.roots(polynomial)) > 1)
