"""Exact limits of R and Re Z_c at the ends of the frequency axis (model/README.md, section 6)."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from vctune.model.arithmetic import Number
from vctune.model.quantities import Coupling, Device, Gains


@dataclass(frozen=True, slots=True)
class EndLimit:
    """Re Z_c and R at an end, both divided by the same positive power of omega where both vanish.

    Attributes
    ----------
    coupling : the limit of Re Z_c
    required : the limit of R; inf where no coupling will do
    """

    coupling: Number
    required: Number


def low_frequency_limit(device: Device, gains: Gains, coupling: Coupling) -> EndLimit:
    """Return the limits for omega -> 0 (any hold).

    With K_p > 0, R -> b^2/(4 (b + K_v - tau K_p)) while Re Z_c -> b_0. With K_p = 0, R vanishes like omega^2, and so
    does Re Z_c when there is no drag: the ratio then tends to (m_c^2/b_c) 4 (b + K_v)^2/(K_v (m + b tau)^2). With
    K_p > 0 and b = 0, R vanishes like omega^4. In the hand of an operator of damping b_h

        R -> (b^2 - 4 b_h k)/(4 (b + b_h + k)) with k = K_v - tau K_p,   -b_h K_v/(b + b_h + K_v) with K_p = 0.

    Where Re(D + Z_h) is not positive R is given as inf.

    Parameters
    ----------
    device, gains, coupling : in numbers of any arithmetic that can compare with 0
    """
    m, b, tau = device.mass, device.damping, device.loop_lag
    K_v, K_p, b_0 = gains.velocity, gains.position, coupling.drag
    integral = not _is_zero(K_p)
    stiffness = K_v - tau * K_p if integral else K_v
    b_h = device.operator.damping if device.operator is not None else 0
    loop = b + b_h + stiffness
    series = coupling.mass * coupling.mass / coupling.damping if _is_zero(b_0) else b_0
    if loop < 0 or _is_zero(loop):
        return EndLimit(series, inf)
    if not _is_zero(b_h):
        return EndLimit(b_0, ((b * b if integral else 0) - 4 * b_h * stiffness) / (4 * loop))
    if integral:
        return EndLimit(series, 0) if _is_zero(b) else EndLimit(b_0, b * b / (4 * loop))
    inertia = m + b * tau
    return EndLimit(series, K_v * inertia * inertia / (4 * loop * loop) if _is_zero(b_0) else 0)


def high_frequency_limit(device: Device, gains: Gains, coupling: Coupling) -> EndLimit:
    """Return the limits for omega -> inf, hold "lag" without delay: R -> 2 m K_v/((b + b_h) T), Re Z_c -> b_c + b_0.

    Parameters
    ----------
    device, gains, coupling : in numbers of any arithmetic that can compare with 0
    """
    needed = 2 * device.mass * gains.velocity / device.sample_time
    damping = device.damping if device.operator is None else device.damping + device.operator.damping
    required = needed / damping if not _is_zero(damping) else inf
    series = 0 if _is_zero(coupling.mass) else coupling.damping
    return EndLimit(series + coupling.drag, required)


def _is_zero(x: Number) -> bool:
    return bool(x == 0)
