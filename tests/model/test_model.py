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
