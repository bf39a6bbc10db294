"""Compute the impedances of device and controller in a velocity loop at a frequency (README, section 1)."""

from __future__ import annotations

from typing import NamedTuple

from vctune.model.gains import Gains
from vctune.model.loop.device_response import DeviceResponse
from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.pair import Pair


class LoopResponse(NamedTuple):
    """The loop's impedances times a common real scale, and the numbers for which a subtraction would lose digits."""

    C_scaled: Pair  # F_s C_0 = q D times the scale
    D_scaled: Pair  # D times the scale
    miss_scaled: Pair  # D - C_0 = (1 - G_he) D times the scale; for an ideal device D - C_0 = Z_d
    numerator: Pair | None  # N = G_hh D, dimensionless; None if it is 1; 0 for a servo
    scale2: Number  # the scale squared
    im_C_conj_D_scaled: Number  # scale * Im(F_s C_0 conj D), which is scale * |D|^2 Im q (model/README.md, section 5)
    im_slope: Number | None  # `im_C_conj_D_scaled` divided by omega, regular at omega = 0
    resistance: Number  # Re(N conj D) + b_h |N|^2, not scaled, N s/m
    operator_relief: Number | None


class Impedance(NamedTuple):
    """An impedance: its real part without the scale, and the whole impedance times the scale of `LoopResponse`."""

    re: Number
    scaled: Pair


def controller_impedance(at: DeviceResponse, gains: Gains, re: Number, lag: Number, *, integral: bool) -> Impedance:
    """Return A H (X K_v + K_p/s), the controller's impedance behind a filter X of the velocity (paper eq. 9)."""
    proportional = gains.velocity * re
    if not integral:
        return Impedance(proportional, Pair(proportional, -(gains.velocity * lag * at.omega)))
    re_C = proportional - gains.position * at.drive.lag
    im = -(gains.velocity * lag * (at.omega * at.omega) + gains.position * at.drive.re)
    return Impedance(re_C, Pair(re_C * at.omega, im))


def G_hh_abs2(loop: LoopResponse) -> Number:
    """Return |G_hh|^2 = |N|^2/|D|^2 (paper eq. 10), (m/(N s))^2; 0 for a servo."""
    above = loop.scale2 if loop.numerator is None else loop.scale2 * loop.numerator.abs2()
    return above / loop.D_scaled.abs2()


def tracking_abs2(loop: LoopResponse) -> Number:
    """Return |1 - G_he|^2 = |(D - C_0)/D|^2, the squared relative error of the actual against the commanded
    velocity."""
    return loop.miss_scaled.abs2() / loop.D_scaled.abs2()
