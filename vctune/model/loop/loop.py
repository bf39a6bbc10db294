"""Evaluate the velocity loop at a frequency (model/README.md, sections 1, 2 and 12; paper eqs. 7, 9, 10, 11)."""

from __future__ import annotations

from vctune.model.gains import Gains
from vctune.model.loop.device_response import DeviceResponse
from vctune.model.loop.impedances import LoopResponse, controller_impedance
from vctune.model.loop.loop_parts import loop_with_parts, perturbed_loop
from vctune.model.numbers.arithmetic import Arithmetic
from vctune.model.numbers.pair import Pair


def loop_response(at: DeviceResponse, gains: Gains, ops: Arithmetic) -> LoopResponse:
    """Evaluate the velocity loop of a device at a frequency (model/README.md, sections 1, 2 and 12)."""
    if at.follows:
        return _following(at)
    if at.factor is not None:
        return perturbed_loop(at, at.factor, gains)
    if not (at.estimate is None and at.sensor is None and at.spring is None):
        return loop_with_parts(at, gains, ops)
    omega, b, integral = at.omega, at.damping, not ops.is_zero(gains.position)
    loop, reactance = controller_impedance(at, gains, *at.drive, integral=integral), at.mass * omega
    re_C, C, scale2, im_slope = loop.re, loop.scaled, 1, None
    if integral:
        Z_d, scale2 = Pair(b * omega, reactance * omega), omega * omega
        # re_C is not scaled, so this product contains the scale once, not twice
        im = b * C.im - Z_d.im * re_C
        if ops.is_zero(b):
            im_slope = -(reactance * re_C)
    else:
        Z_d = Pair(b, reactance)
        im_slope = -(at.mass * re_C + b * (gains.velocity * at.drive.lag))
        im = omega * im_slope
    resistance, operator_relief = b + re_C, None
    if at.operator is not None:
        resistance, operator_relief = resistance + at.operator, 2 * at.operator * re_C
    return LoopResponse(
        C_scaled=C,
        D_scaled=Z_d + C,
        miss_scaled=Z_d,
        numerator=None,
        scale2=scale2,
        im_C_conj_D_scaled=im,
        im_slope=im_slope,
        resistance=resistance,
        operator_relief=operator_relief,
    )


def _following(at: DeviceResponse) -> LoopResponse:
    """Return the response of a servo: G_hh = 0, because the hand cannot push it, and G_he = A H for all gains."""
    drive = Pair(at.drive.re, -(at.omega * at.drive.lag))
    C = drive if at.sensor is None else Pair(at.sensor.re, -(at.omega * at.sensor.lag)) * drive
    return LoopResponse(
        C_scaled=C,
        D_scaled=Pair(1 + 0 * at.omega, 0 * at.omega),
        miss_scaled=Pair(1 - at.drive.re, at.omega * at.drive.lag),
        numerator=Pair(0 * at.omega, 0 * at.omega),
        scale2=1,
        im_C_conj_D_scaled=C.im,
        im_slope=None,
        resistance=0 * at.omega,
        operator_relief=None,
    )
