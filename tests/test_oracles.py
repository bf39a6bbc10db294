"""Agreement with python-control (margins) and scikit-rf (Rollett's K)."""

from __future__ import annotations

from dataclasses import replace
from math import degrees, pi

import control
import numpy as np
import pytest
import skrf
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import Case, coupling, exact_sampled_sensitivity, loop, sampled_sensitivity
from test_model import cases

from vctune.analysis.demands import rollett_factor_at, stability_ratio
from vctune.analysis.margins import loop_margins, unstable_poles
from vctune.analysis.sampled_loop import sensitivity
from vctune.bench.evaluator import loop_matrix
from vctune.model.quantities import Coupling, Device, Gains
from vctune.proof.sampled_loop import spectral_radius

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
    found = sensitivity(device, gains, 2 * pi * np.array([1.0, 10.0, 50.0, 100.0, 400.0, 500.0]))
    assert found == pytest.approx(S, rel=5e-9)
    assert 20 * np.log10(loop_margins(device, gains).gain) == pytest.approx(0.98667, abs=1e-5)


@settings(max_examples=100, deadline=None)
@given(cases(), st.floats(1e-4, 1.0))
def test_sampled_sensitivity_against_50_digits(case, place):
    omega = place * pi / case.sample_time
    device, gains = Device(case.mass, case.damping, case.sample_time, case.delay, "zoh"), Gains(case.K_v, case.K_p)
    true = float(exact_sampled_sensitivity(case, omega))
    assert float(sensitivity(device, gains, np.array(omega))) == pytest.approx(true, rel=1e-9)
    m, b, T, delay = case.mass, case.damping, case.sample_time, case.delay
    assert sampled_sensitivity(m, b, T, delay, case.K_v, case.K_p, omega) == pytest.approx(true, rel=1e-8)


@pytest.mark.parametrize("case", LOOPS)
def test_rollett_factor_agrees_with_scikit_rf(case):
    """The two-port of DESIGN 1.2 is an inverse hybrid matrix: [i1; v2] = g [v1; i2]."""
    device, gains = quantities(case)
    virtual = Coupling(30.0, 0.2, 0.01)
    case = Case(**{**case.__dict__, "b_c": 30.0, "m_c": 0.2, "b_0": 0.01})
    omega = np.geomspace(1.0, 0.9 * pi / case.sample_time, 50)
    g = np.empty((omega.size, 2, 2), dtype=complex)
    for k, w in enumerate(omega):
        Z_d, C = loop(case, 1j * w)
        g[k] = [[1 / (Z_d + C), -C / (Z_d + C)], [1.0, coupling(case, 1j * w)]]
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
    poles = np.linalg.eigvals(loop_matrix(device, gains, 1 + (gains.position > 0)))
    assert unstable_poles(device, gains) == np.count_nonzero(np.abs(poles) > 1)
