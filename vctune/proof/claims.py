"""What is to be proved of a design, as functions that must be positive; written once for every arithmetic."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nextafter, pi

from vctune.model.arithmetic import Arithmetic, Number
from vctune.model.coupling import coupling_impedance
from vctune.model.llewellyn import llewellyn_demand
from vctune.model.loop import hold_response, loop_response
from vctune.model.pair import re_conj_product
from vctune.model.quantities import Coupling, Device, Gains
from vctune.model.sampled import SampledPlant, difference_slope, return_difference

HALF_TURN = nextafter(pi, inf)
"""theta = omega T at the Nyquist frequency, rounded upwards; the sampled loop's curve is symmetric there."""


@dataclass(frozen=True, slots=True)
class Design:
    """What is judged: a device with its gains and its coupling, in numbers of any arithmetic."""

    device: Device
    gains: Gains
    coupling: Coupling


def conditions_margin(design: Design, omega: Number, factor: Number, ops: Arithmetic) -> Number:
    """Return 2 Re(D + Z_h) (Re Z_c - factor R) at omega > 0, (N s/m)^2 (model/README.md, section 4).

    Where it is positive Re(D + Z_h) > 0 and ratio >= factor: with N = |C||D| - Re(C conj D) >= 0 it is
    2 Re(D + Z_h) Re Z_c + factor (2 b_h Re C - N), which for Re(D + Z_h) <= 0, hence Re C <= 0, is not positive.

    Parameters
    ----------
    design : in numbers of the arithmetic
    omega : rad/s, > 0
    factor : least Re Z_c / R
    ops : arithmetic of all of these
    """
    device = design.device
    loop = loop_response(device, design.gains, omega, hold_response(device, omega, ops), ops)
    return 2 * loop.resistance * coupling_impedance(design.coupling, omega).re - factor * llewellyn_demand(loop, ops)


def low_margin(design: Design, omega: Number, factor: Number, ops: Arithmetic) -> Number:
    """Return a margin that is regular at omega = 0 and, where positive, proves as much as `conditions_margin`.

    Both sides of 2 Re D Re Z_c >= factor N are divided by omega^2 where they vanish together, and Re Z_c >= b_0 is all
    that is used of a coupling with drag, or where an operator eases the demand. Without either R does not vanish if
    K_p > 0 and b > 0: no margin is positive.

    Parameters
    ----------
    design : in numbers of the arithmetic
    omega : rad/s, >= 0
    factor : least Re Z_c / R
    ops : arithmetic of all of these
    """
    device, coupling = design.device, design.coupling
    hold = hold_response(device, omega, ops)
    loop = loop_response(device, design.gains, omega, hold, ops)
    weight = ops.sqrt(loop.C_scaled.abs2() * loop.D_scaled.abs2()) + re_conj_product(loop.C_scaled, loop.D_scaled)
    im = loop.im_C_conj_Zd_scaled
    if device.operator is not None and not ops.is_zero(device.operator.damping):
        eased = 2 * loop.resistance * coupling.drag + factor * loop.operator_relief
        return eased * weight - factor * (im * im)
    if not ops.is_zero(coupling.drag):
        return 2 * loop.resistance * coupling.drag * weight - factor * (
            loop.im_C_conj_Zd_scaled * loop.im_C_conj_Zd_scaled
        )
    b_c, m_c, reactance = coupling.damping, coupling.mass, coupling.mass * omega
    slope = b_c * (m_c * m_c) / (b_c * b_c + reactance * reactance)
    re_C = loop.resistance - device.damping
    im = device.mass * re_C  # Im(C conj Z_d)/omega^2 with an integrator and b = 0, over -omega without one
    integral = not ops.is_zero(design.gains.position)
    if integral and not ops.is_zero(device.damping):
        return -weight
    im = im * omega if integral else im + device.damping * design.gains.velocity * hold.lag
    return 2 * loop.resistance * slope * weight - factor * (im * im)


def high_margin(design: Design, v: Number, factor: Number, ops: Arithmetic) -> Number:
    """Return `conditions_margin` at omega = 1/v for hold "lag" without delay, in terms that are smooth at v = 0.

    Parameters
    ----------
    design : in numbers of the arithmetic
    v : 1/omega, s, >= 0
    factor : least Re Z_c / R
    ops : arithmetic of all of these
    """
    device, gains, coupling = design.device, design.gains, design.coupling
    half = device.sample_time / 2
    decay = 1 / (v * v + half * half)
    re_C_over_v = (gains.velocity - gains.position * half) * decay * v
    omega_im_C = -((gains.velocity * half + gains.position * (v * v)) * decay)
    re_C = re_C_over_v * v
    re_D = device.damping + re_C
    im_D_v, re_D_v = device.mass + omega_im_C * (v * v), re_D * v
    product = (re_C_over_v * re_C_over_v + omega_im_C * omega_im_C) * (re_D_v * re_D_v + im_D_v * im_D_v)
    excess = ops.sqrt(product) - (re_C * re_D + omega_im_C * im_D_v)
    mass2, damping_v = coupling.mass * coupling.mass, coupling.damping * v
    re_Z_c = coupling.drag + coupling.damping * mass2 / (damping_v * damping_v + mass2)
    if device.operator is None:
        return 2 * re_D * re_Z_c - factor * excess
    b_h = device.operator.damping
    return 2 * (re_D + b_h) * re_Z_c + factor * (2 * b_h * re_C - excess)


def sensitivity_margin(plant: SampledPlant, gains: Gains, theta: Number, limit: Number, ops: Arithmetic) -> Number:
    """Return limit^2 |F|^2 - |F_0|^2 of the sampled loop at theta = omega T, positive where |S| = |F_0/F| < limit.

    Parameters
    ----------
    plant, gains : of the sampled loop, in numbers of the arithmetic
    theta : omega T, rad, in [0, pi]
    limit : greatest |S|
    ops : arithmetic of all of these
    """
    parts = return_difference(plant, theta, ops, position=not ops.is_zero(gains.position))
    return limit * limit * parts.closed(gains).abs2() - parts.open.abs2()


def loop_gain_margin(plant: SampledPlant, gains: Gains, theta: Number, limit: Number, ops: Arithmetic) -> Number:
    """Return limit^2 |F_0|^2 - |F - F_0|^2: where positive, |L| < limit and |S| < 1/(1 - limit), whatever the phase.

    Whole samples of delay turn F - F_0 and do not change its size.

    Parameters
    ----------
    plant, gains : of the sampled loop, in numbers of the arithmetic
    theta : omega T, rad, in [0, pi]
    limit : greatest |L|
    ops : arithmetic of all of these
    """
    parts = return_difference(plant, theta, ops, position=not ops.is_zero(gains.position))
    loop = parts.velocity.scaled(gains.velocity) + parts.position.scaled(gains.position)
    return limit * limit * parts.open.abs2() - loop.abs2()


def along_hold(device: Device, gains: Gains, omega: Number, ops: Arithmetic) -> Number:
    """Return Re(D conj H), which does not depend on K_p; regular at omega = 0.

    The integrator's K_p H/(j omega) is at right angles to H. Where Re(D conj H) > 0, D is not 0 for any K_p.

    Parameters
    ----------
    device, gains : in numbers of the arithmetic
    omega : rad/s, >= 0
    ops : arithmetic of all of these
    """
    hold = hold_response(device, omega, ops)
    lagging = omega * hold.lag
    H2 = hold.re * hold.re + lagging * lagging
    return device.damping * hold.re - device.mass * omega * lagging + gains.velocity * H2


def across_position(plant: SampledPlant, gains: Gains, theta: Number, ops: Arithmetic) -> tuple[Number, Number]:
    """Return Im(F conj P)/theta and |F_0|^2 |P|^2/theta^2, P = dF/dK_p, neither of which depends on K_p.

    Both are regular at theta = 0, where F and F_0 are those of the velocity loop alone times 1 - e^{-j theta}.
    Where the former is not 0, F is not 0 for any K_p.

    Parameters
    ----------
    plant, gains : of the sampled loop, in numbers of the arithmetic
    theta : omega T, rad, in [0, pi]
    ops : arithmetic of all of these
    """
    velocity_loop = return_difference(plant, theta, ops, position=False)
    P, slope = return_difference(plant, theta, ops, position=True).position, difference_slope(theta, ops)
    F = velocity_loop.closed(gains) * slope
    return F.im * P.re - F.re * P.im, (velocity_loop.open * slope).abs2() * P.abs2()


def sensitivity_sufficient_margin(
    plant: SampledPlant, gains: Gains, theta: Number, limit: Number, ops: Arithmetic
) -> Number:
    """Return limit Im(F conj P) - |F_0||P|, over theta: positive only where |S| < limit whatever K_p is.

    Parameters
    ----------
    plant, gains : of the sampled loop, in numbers of the arithmetic
    theta : omega T, rad, in [0, pi]
    limit : greatest |S|
    ops : arithmetic of all of these
    """
    across, product2 = across_position(plant, gains, theta, ops)
    return limit * across - ops.sqrt(product2)


def outwards(band: tuple[float, float]) -> tuple[float, float]:
    """Return a band in rad/s widened by the rounding of 2 pi f."""
    low, high = band
    for _ in range(4):
        low, high = nextafter(low, 0.0), nextafter(high, inf)
    return low, high


def inwards(band: tuple[float, float]) -> tuple[float, float]:
    """Return a band in rad/s that lies within the one that was meant, whatever the rounding of 2 pi f."""
    low, high = band
    for _ in range(4):
        low, high = nextafter(low, inf), nextafter(high, 0.0)
    return low, high
