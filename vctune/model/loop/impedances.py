"""Compute the impedances of device and controller in a velocity loop at a frequency (README, section 1)."""

from __future__ import annotations

from typing import NamedTuple

from vctune.model.gains import Gains
from vctune.model.loop.device_response import DeviceResponse
from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.pair import Pair


class LoopResponse(NamedTuple):
    """The loop's impedances times a common real scale, and the numbers for which a subtraction would lose digits.

    With an integrator, C_0 grows like 1/omega for omega -> 0. All impedances are then multiplied by the scale omega,
    which makes them regular at omega = 0. The scale is 1 without an integrator, for a servo, and for a device with a
    `factor`.

    Attributes
    ----------
    C_scaled : F_s C_0 = q D times the scale; N s/m with the scale 1, N/m with the scale omega; for a
        servo D = 1, so C, D and D - C_0 are dimensionless
    D_scaled : D times the scale
    miss_scaled : D - C_0 = (1 - G_he) D times the scale; for an ideal device D - C_0 = Z_d
    numerator : N = G_hh D, dimensionless; None if it is 1; 0 for a servo
    scale2 : the scale squared
    im_C_conj_D_scaled : scale * Im(F_s C_0 conj D), which is scale * |D|^2 Im q (model/README.md, section 5)
    im_slope : `im_C_conj_D_scaled` divided by omega, regular at omega = 0; None if `im_C_conj_D_scaled` does not vanish
        there, for a servo, and for a device with a `factor`
    resistance : Re(N conj D) + b_h |N|^2, not scaled, N s/m. It is |D|^2 Re G_hh without an operator; for a rigid
        device in the hand of its least operator it is Re(D + Z_h); 0 for a servo
    operator_relief : 2 b_h Re(F_s C_0 conj N), the term by which an operator relaxes the conditions, (N s/m)^2, not
        scaled; None without an operator
    """

    C_scaled: Pair
    D_scaled: Pair
    miss_scaled: Pair
    numerator: Pair | None
    scale2: Number
    im_C_conj_D_scaled: Number
    im_slope: Number | None
    resistance: Number
    operator_relief: Number | None


class Impedance(NamedTuple):
    """An impedance: its real part without the scale, and the whole impedance times the scale of `LoopResponse`."""

    re: Number
    scaled: Pair


def controller_impedance(at: DeviceResponse, gains: Gains, re: Number, lag: Number, *, integral: bool) -> Impedance:
    """Return A H (X K_v + K_p/s), the controller's impedance behind a filter X of the velocity (paper eq. 9).

    X is 1 or the velocity estimate F. The caller supplies the product A H X.

    Parameters
    ----------
    at : the device at a frequency; the function uses only omega and A H
    gains : K_v and K_p, N s/m and N/m
    re, lag : the product A H X = re - j omega lag; re is dimensionless, lag in s
    integral : whether the law has its term K_p/s

    Returns
    -------
    Impedance
        The real part, N s/m, is never scaled. The whole impedance is multiplied by omega if the law has the integrator.
    """
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
    """Return |1 - G_he|^2 = |(D - C_0)/D|^2, the squared relative error of the actual against the commanded velocity.

    See model/README.md, section 2.
    """
    return loop.miss_scaled.abs2() / loop.D_scaled.abs2()
