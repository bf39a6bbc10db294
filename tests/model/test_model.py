"""The formulas against 50 digits, the check numbers of model/README.md, and each other in every arithmetic."""

from __future__ import annotations

from math import inf

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vctune.bench.evaluator import Scene, impedances
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains, coupling_impedance
from vctune.model.loop.device_response import device_response
from vctune.model.loop.limits import high_frequency_limit, low_frequency_limit
from vctune.model.loop.llewellyn import required_resistance
from vctune.model.loop.loop import loop_response
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.transparency import log_quadrature

LAG = Device(0.5, 2.0, 1e-3, 0.0, "lag")
ZOH = Device(0.5, 2.0, 1e-3, 0.0, "zoh")


def response(device, gains, omega):
    return loop_response(device_response(device, omega, FLOATS), gains, FLOATS)


def R(device, gains, omega):
    return required_resistance(response(device, gains, omega), FLOATS)


def ratio(device, gains, coupling, omega):
    return coupling_impedance(coupling, omega).re / R(device, gains, omega)


def logs(low, high):
    return st.floats(np.log10(low), np.log10(high)).map(lambda e: 10.0**e)


def test_plain_formula_would_return_zero():
    """The check number of model/README.md, section 5: R = 5.5543e-5 where |q| - Re q loses every digit."""
    gains = Gains(5000.0, 1e6)
    assert R(Device(0.5, 1.0, 1e-3, 0.0, "lag"), gains, 0.01) == pytest.approx(5.5543e-5, rel=1e-4)
    Z_d, C = impedances(Scene(0.5, 1.0, 1e-3, 0.0, "lag", 5000.0, 1e6), 0.01j)
    q = C / (Z_d + C)
    assert abs(q) - q.real < 1e-15


@pytest.mark.parametrize(
    ("device", "expected"),
    [(LAG, [14.1276, 394.645, 1140.27, 2215.64]), (ZOH, [14.1121, 411.113, 1619.22, 13078.68])],
)
def test_required_resistance_of_the_guide(device, expected):
    assert R(device, Gains(40.0, 4000.0), np.array([100.0, 1000, 2000, 3000])) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(
    ("coupling", "crossings"),
    [
        (Coupling(25000.0, 5.0, 0.0), [5.3410, 76.1960, 284.483]),
        (Coupling(3000.0, 2.0, 0.0), [4.5439, 93.8517, 199.371, 3197.66]),
    ],
)
def test_ratio_crosses_one_where_the_guide_says(coupling, crossings):
    omega = np.geomspace(1.0, 1e4, 400_001)
    above = ratio(LAG, Gains(40.0, 4000.0), coupling, omega) >= 1
    assert omega[1:][above[1:] != above[:-1]] == pytest.approx(crossings, rel=5e-5)
    assert not above[0]


def test_position_gain_with_damping_and_no_drag_fails_below_the_frequency_of_the_guide():
    gains, coupling = Gains(40.0, 4000.0), Coupling(25000.0, 5.0, 0.0)
    omega_L = 2.0 * np.sqrt(25000.0) / (2 * 5.0 * np.sqrt(2.0 + 40.0 - 0.5e-3 * 4000.0))
    omega = np.geomspace(omega_L / 3, omega_L * 3, 100_001)
    first = omega[np.argmax(ratio(LAG, gains, coupling, omega) >= 1)]
    assert first == pytest.approx(omega_L, rel=0.1)


def test_high_frequency_limit():
    gains, coupling = Gains(40.0, 4000.0), Coupling(25000.0, 5.0, 3.0)
    limit = high_frequency_limit(LAG, gains, coupling)
    assert limit.required == pytest.approx(2 * 0.5 * 40 / (2.0 * 1e-3))
    assert limit.coupling == 25003.0
    assert limit.coupling / limit.required == pytest.approx(float(ratio(LAG, gains, coupling, 1e9)), rel=1e-6)


def test_a_rigid_coupling_has_only_its_drag_at_both_ends():
    """Its mass is a pure reactance at every frequency, although Re Z_c of a damped coupling tends to b_c + b_0."""
    for drag in (0.0, 3.0):
        coupling = Coupling(inf, 5.0, drag)
        for K_p in (0.0, 4000.0):
            assert low_frequency_limit(LAG, Gains(40.0, K_p), coupling).coupling == drag
        assert high_frequency_limit(LAG, Gains(40.0, 4000.0), coupling).coupling == drag
        assert coupling_impedance(coupling, 1e9).re == drag


def test_lag_resistance_is_positive_at_all_frequencies_iff_it_is_at_zero():
    omega = np.geomspace(1e-3, 1e6, 20_001)
    for K_p, positive in ((2 * 42.0 / 1e-3 * (1 - 1e-6), True), (2 * 42.0 / 1e-3 * (1 + 1e-6), False)):
        assert np.all(response(LAG, Gains(40.0, K_p), omega).resistance > 0) == positive


def test_keemink_handle_is_passive_from_9_5238_kg():
    """Keemink et al. 2018, table 1: continuous time, a virtual mass alone, Z_e = 0."""
    omega = np.geomspace(1e-3, 1e4, 100_001)
    for mass, passive in ((9.5238 * (1 + 1e-4), True), (9.5238 * (1 - 1e-4), False)):
        s = 1j * omega
        handle = (1 + 100.0 / (mass * s)) / (10.0 * s + 5.0 + 100.0)
        assert np.all(handle.real >= 0) == passive
        device = Device(10.0, 5.0, 1e-9, 0.0, "zoh")
        law = response(device, Gains(100.0, 0.0), omega)
        D, C = law.D_scaled.re + 1j * law.D_scaled.im, law.C_scaled.re + 1j * law.C_scaled.im
        Z_c = coupling_impedance(Coupling(1e15, mass, 0.0), omega)
        ours = 1 / D + C / D / (Z_c.re + 1j * Z_c.im)
        assert (np.abs(ours - handle) <= 1e-4 * np.abs(handle)).all()


@given(logs(1e-3, 1e3), logs(1e-3, 1e3), st.floats(0, 10), logs(1e-3, 1e3))
def test_coupling_is_a_damper_and_a_mass_in_series_beside_a_drag(b_c, m_c, b_0, omega):
    Z_c = coupling_impedance(Coupling(b_c, m_c, b_0), omega)
    expected = b_0 + 1 / (1 / b_c + 1 / (1j * omega * m_c))
    assert Z_c.re + 1j * Z_c.im == pytest.approx(expected, rel=1e-12)


def test_quadrature_averages_over_log_frequency():
    nodes, weights = log_quadrature(2.0, 50.0, 3)
    assert weights.sum() == pytest.approx(1.0, rel=1e-14)
    exact = float(mp.quad(lambda w: 1 / (w * (1 + w)), [2, 50]) / mp.log(25))
    assert weights @ (1 / (1 + nodes)) == pytest.approx(exact, rel=1e-9)
