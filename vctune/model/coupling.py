"""Compute the virtual coupling's impedance Z_c = b_0 + b_c m_c s/(b_c + m_c s) (model/README.md, section 3, paper eq.
17)."""

from __future__ import annotations

from vctune.model.gains import Coupling
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.pair import Pair


def coupling_impedance(coupling: Coupling, omega: Number) -> Pair:
    """Return the coupling's impedance Z_c(j omega) (model/README.md, section 3; paper eq. 17)."""
    b_c, m_c = coupling.damping, coupling.mass
    reactance = m_c * omega
    if coupling.rigid:
        return Pair(coupling.drag + 0 * omega, reactance)
    quotient = reactance / (b_c * b_c + reactance * reactance)
    return Pair(coupling.drag + b_c * reactance * quotient, b_c * b_c * quotient)


def sampled_resistance(coupling: Coupling, sample_time: Number, theta: Number, ops: Arithmetic) -> Number:
    """Return Re Z_c of the coupling in the firmware, where s -> (2/T)(z - 1)/(z + 1)."""
    if coupling.rigid:  # the mass of a rigid coupling is a pure reactance
        return coupling.drag + 0 * theta
    b_c, reactance, cos = coupling.damping, coupling.mass * (2 * ops.sin(theta / 2)) / sample_time, ops.cos(theta / 2)
    squared, slack = reactance * reactance, b_c * cos
    return coupling.drag + b_c * (squared / (slack * slack + squared))


def sampled_reactance(coupling: Coupling, sample_time: Number, theta: Number, ops: Arithmetic) -> Number:
    """Return cos(theta/2) Im Z_c of the coupling in the firmware, N s/m. The product is regular at theta = pi."""
    reactance = coupling.mass * (2 * ops.sin(theta / 2)) / sample_time
    if coupling.rigid:
        return reactance
    slack = coupling.damping * ops.cos(theta / 2)
    squared = slack * slack
    return reactance * squared / (squared + reactance * reactance)


def trapezoidal(coupling: Coupling, sample_time: Number) -> tuple[Number, Number]:
    """Return step s and decay p of the series branch, f[k] = p f[k-1] + s (v[k] - v[k-1]), by the trapezoidal rule."""
    if coupling.rigid:
        return 2 * coupling.mass / sample_time, -1
    a = sample_time * coupling.damping / (2 * coupling.mass)
    return coupling.damping / (1 + a), (1 - a) / (1 + a)
