"""No pole of the frequency model in the closed right half plane (condition 1 of model/README.md, section 4)."""

from __future__ import annotations

from math import pi

from flint import arb

from vctune.model.loop import hold_response, loop_response
from vctune.model.pair import Pair
from vctune.model.quantities import Device, Gains
from vctune.proof.arb_balls import BALLS, device_ball, gains_ball
from vctune.proof.interval import Outcome, Verdict
from vctune.proof.winding import turned_angle


def prove_model_poles(device: Device, gains: Gains) -> Outcome:
    """Prove that the zeros of D, the poles of G_hh, lie in the open left half plane.

    D (times j omega when K_p > 0) is followed from omega = 0, where it is real and positive, to omega_1, beyond which
    |C| < |m omega|/2 because |H| <= 1: from there arg D tends to pi/2 without another turn. With no zero on the axis,
    there is none to its right if and only if the argument has turned by less than a turn there.
    """
    exact, law, integral = device_ball(device), gains_ball(gains), gains.position > 0
    if not gains.closed:
        return Outcome(Verdict.PROVED if device.damping > 0 else Verdict.REFUTED, 1)

    def curve(omega: arb) -> Pair:
        D = loop_response(exact, law, omega, hold_response(exact, omega, BALLS), BALLS).D_scaled
        return Pair(-D.im, D.re) if integral else D

    last = 4 * max(gains.velocity / device.mass, (gains.position / device.mass) ** 0.5)
    outcome, angle = turned_angle(curve, 0.0, last)
    if outcome.verdict is not Verdict.PROVED:
        return outcome
    least = pi / 2 if integral else 0.0
    upright = least - 1e-6 < angle < least + pi + 1e-6
    return outcome if upright else Outcome(Verdict.REFUTED, outcome.boxes)
