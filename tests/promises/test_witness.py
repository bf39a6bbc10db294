"""What absolute stability means, tried on random passive operators and environments (paper section 4.1)."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

from vctune.bench.evaluator import case_of, coupling_impedance, impedances
from vctune.design.solve import solve
from vctune.document.reading import parse_problem
from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.proof.certificate import certify
from vctune.proof.outcome import Verdict

PAIRS = 1000


def passive(rng, scale, corner):
    """A random passive impedance as numerator and denominator polynomials in s, highest power first."""
    size = scale * 10.0 ** rng.uniform(-2, 3, size=3)
    place = corner * 10.0 ** rng.uniform(-2, 2)
    kind = rng.integers(5)
    mass, damper, spring = size[0] / place, size[1], size[2] * place
    if kind == 0:
        return np.array([mass, damper * (rng.random() < 0.5)]), np.array([1.0])
    if kind == 1:
        return np.array([damper * (rng.random() < 0.5), spring]), np.array([1.0, 0.0])
    if kind == 2:
        return np.array([mass, damper * rng.choice([0, 1e-3, 1]), spring]), np.array([1.0, 0.0])
    if kind == 3:
        return np.array([mass * spring, 0.0]), np.array([mass, damper * rng.choice([0, 1e-3]), spring])
    return np.array([damper]), np.array([1.0])


def closed_loop_poles(case, operator, environment):
    """Zeros of D (Z_c + Z_e) + Z_h (Z_c + Z_e + C), hold "lag", no delay; time in samples to balance the numbers."""
    (nh, dh), (ne, de) = operator, environment
    p = np.polymul
    integrator = case.K_p > 0
    C = np.array([case.K_v, case.K_p]) if integrator else np.array([case.K_v])
    C_den = p([case.sample_time / 2, 1.0], [1.0, 0.0] if integrator else [1.0])
    D = np.polyadd(p([case.mass, case.damping], C_den), C)
    Z_c = np.polyadd(case.b_0 * np.array([case.m_c, case.b_c]), [case.b_c * case.m_c, 0.0])
    Z_c_den = np.array([case.m_c, case.b_c])
    series = np.polyadd(p(Z_c, de), p(ne, Z_c_den))
    series_den = p(Z_c_den, de)
    first = p(p(D, series), dh)
    second = p(nh, np.polyadd(p(series, C_den), p(C, series_den)))
    polynomial = np.polyadd(first, second)
    powers = np.arange(polynomial.size)[::-1]
    roots = np.roots(np.trim_zeros(polynomial / case.sample_time**powers / np.abs(polynomial).max(), "f"))
    return roots / case.sample_time


WHOLE_AXIS = """
device = {{ mass = {mass}, damping = {damping}, sample_time = 1e-3, hold = "lag" }}
gains = {{ velocity = {velocity}, position = {position} }}
coupling = {{ drag = {drag} }}
stability = {{ criterion = "passive", band_hz = [0.0, inf], max_sensitivity = 3.0 }}
"""


@pytest.mark.parametrize(
    ("mass", "damping", "velocity", "position", "drag"),
    [(0.5, 2.0, 40.0, 0.0, 0.0), (0.5, 2.0, 40.0, 2000.0, 0.03), (0.05, 5.0, 60.0, 0.0, 0.0)],
)
def test_certified_on_the_whole_axis_means_stable_with_every_passive_pair(mass, damping, velocity, position, drag):
    problem = parse_problem(WHOLE_AXIS.format(**locals()), "whole-axis", "whole-axis")
    solved = solve(problem)
    assert solved.status == "certified"
    judgement = solved.judgement
    case = case_of(problem.device, judgement.gains, judgement.coupling)
    rng = np.random.default_rng(7)
    scale, corner = case.K_v, case.K_v / case.mass
    for _ in range(PAIRS):
        poles = closed_loop_poles(case, passive(rng, scale, corner), passive(rng, scale, corner))
        moving = poles[np.abs(poles) > 1e-9 * np.abs(poles).max()]
        assert np.all(moving.real <= 1e-9 * np.abs(moving))


def value(polynomials, s):
    return np.polyval(polynomials[0], s) / np.polyval(polynomials[1], s)


def handle_admittance(case, Z_e, s):
    """Y = G_hh + G_he/(Z_c + Z_e), from the two-port of model/README.md, section 2, with f_e = Z_e v_e."""
    Z_d, C = impedances(case, s)
    return 1 / (Z_d + C) + C / (Z_d + C) / (coupling_impedance(case, s) + Z_e)


def reactance(X, omega):
    """A mass or a spring with reactance X at omega."""
    return (np.array([X / omega, 0.0]), np.array([1.0])) if X >= 0 else (np.array([-X * omega]), np.array([1.0, 0.0]))


@pytest.mark.parametrize("hold", ["lag", "zoh"])
def test_refuted_means_a_passive_pair_that_puts_a_pole_at_the_witness(hold):
    """The worst lossless environment turns Re Y negative; the operator -1/Y is passive and closes the loop there."""
    device, gains, virtual = Device(0.5, 2.0, 1e-3, 0.0, hold), Gains(40.0, 4000.0), Coupling(25000.0, 5.0, 0.0)
    certificate = certify(Design(device, gains, virtual), Demands(device, (60.0, 1000.0), 1.0, 2.0))
    outcome = certificate.outcomes["passive"]
    assert outcome.verdict is Verdict.REFUTED
    case, omega = case_of(device, gains, virtual), outcome.witness
    s = 1j * omega
    Z_d, C = impedances(case, s)
    q, Z_c = C / (Z_d + C), coupling_impedance(case, s)
    environment = reactance(-Z_c.real * np.tan((pi - np.angle(q)) / 2) - Z_c.imag, omega)
    handle = handle_admittance(case, value(environment, s), s)
    assert handle.real < 0
    Z_h = -1 / handle
    assert Z_h.real > 0
    mass_or_spring = reactance(Z_h.imag, omega)
    operator = (np.polyadd(mass_or_spring[0], Z_h.real * mass_or_spring[1]), mass_or_spring[1])
    closed = 1 + value(operator, s) * handle_admittance(case, value(environment, s), s)
    assert abs(closed) < 1e-9
    if hold == "lag":
        poles = closed_loop_poles(case, operator, environment)
        assert np.min(np.abs(poles - s)) < 1e-6 * omega
