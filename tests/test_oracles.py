"""Agreement with python-control (margins) and scikit-rf (Rollett's K)."""

from __future__ import annotations

from math import degrees, pi

import control
import numpy as np
import pytest
import skrf
from oracles import Case, coupling, loop

from vctune.analysis.demands import rollett_factor_at, stability_ratio
from vctune.analysis.margins import encirclements, loop_margins
from vctune.model.quantities import Coupling, Device, Gains
from vctune.proof.interval import Verdict
from vctune.proof.poles import prove_model_poles

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


@pytest.mark.parametrize("case", LOOPS[:3])
def test_margins_agree_with_python_control_on_a_rational_loop(case):
    s = control.tf("s")
    L = (case.K_v + case.K_p / s) * 2 / (2 + s * case.sample_time) / (case.mass * s + case.damping)
    gain, phase, _, _, crossing, _ = control.stability_margins(L)
    ours = loop_margins(*quantities(case))
    assert ours.gain == pytest.approx(gain, rel=1e-6)
    assert degrees(ours.phase) == pytest.approx(phase, rel=1e-6)
    assert ours.delay == pytest.approx(np.radians(phase % 360) / crossing, rel=1e-6)


@pytest.mark.parametrize("case", LOOPS[3:])
def test_margins_agree_with_python_control_on_frequency_data(case):
    ours = loop_margins(*quantities(case))
    omega = np.geomspace(1e-2, 1.9 * pi / case.sample_time, 400_001)
    Z_d, C = np.array([loop(case, 1j * w) for w in omega[::40]]).T
    gain, phase, _, _, crossing, _ = control.stability_margins(control.FRD(C / Z_d, omega[::40], smooth=True))
    assert ours.gain == pytest.approx(gain, rel=1e-5)
    assert degrees(ours.phase) == pytest.approx(phase, abs=1e-3)
    assert ours.delay == pytest.approx(np.radians(phase % 360) / crossing, rel=1e-4)


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
    """Z = N + P with P = 0: N = 0 exactly where no pole of the frequency model lies to the right."""
    device, gains = quantities(case)
    stable = prove_model_poles(device, gains).verdict is Verdict.PROVED
    assert (encirclements(device, gains) == 0) == stable
    assert encirclements(device, gains) >= 0
