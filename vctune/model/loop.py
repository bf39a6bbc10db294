"""The velocity loop at a frequency (model/README.md, sections 1 and 2; paper eqs. 7, 9, 10, 11)."""

from __future__ import annotations

from dataclasses import dataclass

from vctune.model.arithmetic import Arithmetic, Number
from vctune.model.pair import Pair
from vctune.model.quantities import Device, Gains


@dataclass(frozen=True, slots=True)
class HoldResponse:
    """Hold and delay at a frequency, H = re - j omega lag; both parts are even and smooth at omega = 0.

    Attributes
    ----------
    re : Re H
    lag : -Im H / omega, s, which tends to T/2 + delay for omega -> 0
    """

    re: Number
    lag: Number


def hold_response(device: Device, omega: Number, ops: Arithmetic) -> HoldResponse:
    """Evaluate H = hold(j omega) e^{-j omega delay} (with the 1/T that paper eq. 9 lacks).

    Parameters
    ----------
    device : only sample_time, delay and hold are used
    omega : rad/s, may be 0; a number or an array of any shape
    ops : arithmetic of omega and of the device's numbers

    Returns
    -------
    HoldResponse
        Both parts of the shape of omega.
    """
    half = device.sample_time / 2
    if device.hold == "zoh":
        modulus = ops.sinc(omega * half)
        phase = omega * device.loop_lag
        return HoldResponse(modulus * ops.cos(phase), device.loop_lag * modulus * ops.sinc(phase))
    squared = 1 + (omega * half) * (omega * half)
    if ops.is_zero(device.delay):
        return HoldResponse(1 / squared, half / squared)
    phase = omega * device.delay
    cos, sinc = ops.cos(phase), ops.sinc(phase)
    return HoldResponse(
        (cos - omega * half * ops.sin(phase)) / squared,
        (half * cos + device.delay * sinc) / squared,
    )


@dataclass(frozen=True, slots=True)
class LoopResponse:
    """C, Z_d and D = Z_d + C, each times a common real scale, with what must not be formed by subtraction.

    With an integrator C grows like 1/omega, so everything carries the scale omega and is then regular down to
    omega = 0; without one the scale is 1.

    Attributes
    ----------
    C_scaled, Z_d_scaled, D_scaled : complex impedances times the scale, N s/m with the scale 1, N/m with omega
    scale2 : the scale squared
    im_C_conj_Zd_scaled : scale * Im(C conj Z_d), which is scale * |D|^2 Im G_he (model/README.md, section 5)
    resistance : Re(D + Z_h) of the device in the hand of its least operator, Re D = |D|^2 Re G_hh without one; not
        scaled, N s/m
    operator_relief : 2 Re Z_h Re C, by which an operator eases the conditions, (N s/m)^2, not scaled; None without one
    """

    C_scaled: Pair
    Z_d_scaled: Pair
    D_scaled: Pair
    scale2: Number
    im_C_conj_Zd_scaled: Number
    resistance: Number
    operator_relief: Number | None


def loop_response(device: Device, gains: Gains, omega: Number, hold: HoldResponse, ops: Arithmetic) -> LoopResponse:
    """Evaluate the velocity loop from its hold.

    Parameters
    ----------
    device : only mass, damping and operator are used
    gains : K_v, K_p; without K_p, for certain, the law has no integrator
    omega : rad/s, > 0, or >= 0 in ball arithmetic
    hold : the hold and delay at omega
    ops : arithmetic of all of these

    Returns
    -------
    LoopResponse
        Its numbers of the shape of omega; those that do not depend on it may be plain.
    """
    mass_reactance = device.mass * omega
    proportional = gains.velocity * hold.re
    if not ops.is_zero(gains.position):
        re_C = proportional - gains.position * hold.lag
        im_C = -(gains.velocity * hold.lag * (omega * omega) + gains.position * hold.re)
        C = Pair(re_C * omega, im_C)
        Z_d = Pair(device.damping * omega, mass_reactance * omega)
        scale2 = omega * omega
    else:
        re_C = proportional
        C = Pair(re_C, -(gains.velocity * hold.lag * omega))
        Z_d = Pair(device.damping, mass_reactance)
        scale2 = 1
    resistance, operator_relief = device.damping + re_C, None
    if device.operator is not None:
        b_h = device.operator.damping
        resistance, operator_relief = resistance + b_h, 2 * b_h * re_C
    return LoopResponse(
        C_scaled=C,
        Z_d_scaled=Z_d,
        D_scaled=Z_d + C,
        scale2=scale2,
        # re_C without the scale, so that this carries the scale once, not twice
        im_C_conj_Zd_scaled=device.damping * C.im - Z_d.im * re_C,
        resistance=resistance,
        operator_relief=operator_relief,
    )


def G_hh_abs2(loop: LoopResponse) -> Number:
    """Return |G_hh|^2 = 1/|D|^2 (paper eq. 10), (m/(N s))^2."""
    return loop.scale2 / loop.D_scaled.abs2()


def tracking_abs2(loop: LoopResponse) -> Number:
    """Return |1 - G_he|^2 = |Z_d/D|^2: by how much the device misses the velocity that it is told.

    See model/README.md, section 2.
    """
    return loop.Z_d_scaled.abs2() / loop.D_scaled.abs2()
