"""Prove that the frequency model has no pole in the closed right half plane (model/README.md, section 4)."""

from __future__ import annotations

from math import pi, sqrt

from flint import arb

from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.loop.device_response import device_response, mechanism
from vctune.model.numbers.arithmetic import FLOATS, Arithmetic
from vctune.model.numbers.pair import Pair
from vctune.proof.claims.margins_of_claims import model_curve
from vctune.proof.enclosures.arb_balls import BALLS, device_ball, gains_ball
from vctune.proof.engine.interval import Outcome, Verdict
from vctune.proof.engine.winding import turned_angle

NEAR = 1e-6
"""Relative allowance for rounding errors, which are about 1e-12, in the frequency that `curve_end` returns and in an
angle. With half or twice this allowance, the count is the same."""
ROOM = 2.0
"""Greatest difference, rad, between the argument at `curve_end` and its limit, at which the prover accepts the loop as
stable. The difference is less than pi/2 + 2/7 if no zero lies in the right half plane, and more than 3 pi/2 - 2/7
otherwise. With half this limit, the prover would reject some stable loops; with twice this limit, it would accept some
unstable ones."""


def prove_model_poles(device: Device, gains: Gains) -> Outcome:
    """Prove that the zeros of D, the poles of G_hh, lie in the open left half plane.

    The proof follows `model_curve` from omega = 0, where it is real and positive, to `curve_end`. Above that frequency
    the argument of the curve stays within half a turn. If no zero lies on the imaginary axis, the argument at
    `curve_end` shows whether zeros lie to the right of the axis: it equals the argument of a curve without such zeros
    if and only if the curve has none.

    Parameters
    ----------
    device : one of `Device.loops`; the proof ignores a disc around its response
    gains : gains; floats of gains and device stand for the decimals that they print as

    Returns
    -------
    Outcome
        If it is undecided, it has a witness, rad/s, where the curve comes too close to 0. If it is refuted, it has no
        witness.
    """
    exact, law = device_ball(device.modelled), gains_ball(gains)
    if not gains.closed:
        return Outcome(Verdict.PROVED if device.damping > 0 else Verdict.REFUTED, 1)

    def curve(omega: arb) -> Pair:
        return model_curve(device_response(exact, omega, BALLS), law, BALLS)

    outcome, angle = turned_angle(curve, 0.0, curve_end(device, gains.velocity, gains.position))
    if outcome.verdict is not Verdict.PROVED:
        return outcome
    goal = final_angle(device, integral=gains.position > 0)
    return outcome if abs(angle - goal) < ROOM else Outcome(Verdict.REFUTED, outcome.boxes)


def final_angle(device: Device, *, integral: bool) -> float:
    """Return the limit of the argument of `model_curve` for omega -> inf if all poles are stable.

    D grows like s, and with an integrator s D grows like s^2. For a handle on a spring, (k + c s) D grows by two more
    powers of s.

    Parameters
    ----------
    device : a rigid device, or one with its handle on a spring
    integral : whether the law has its term K_p/s

    Returns
    -------
    float
        In rad; a multiple of pi/2.
    """
    return pi / 2 * (1 + integral + (2 if device.structure is not None else 0))


def curve_end(device: Device, K_v: float, K_p: float, ops: Arithmetic = FLOATS) -> float:
    """Return a frequency beyond which the argument of `model_curve` stays within `ROOM` of its limit.

    |C_f| <= K_v + K_p/omega, because hold, actuator and velocity estimate never amplify. For a rigid device this bound
    is at most 5/16 of m omega. For a handle on a spring, D = e (C_f + Z_1 + Z_2/e) with |Z_2/e| <= 4/3 (c + k/omega).
    The sum of |Z_2/e| and |C_f| is at most half of m_1 omega, so that the imaginary part of the bracket is positive.
    Moreover, e (k + j omega c) = k - m_2 omega^2 + j omega (c + b_2) lies within 2/7 rad of the negative axis.

    Parameters
    ----------
    device : device in numbers of the arithmetic; enclosures represent all devices of a box
    K_v, K_p : the greatest gains, N s/m and N/m
    ops : arithmetic of the device's parameters

    Returns
    -------
    float
        rad/s; 0 for a rigid device without gains.
    """
    size = ops.magnitude
    if device.structure is None:
        return 4 * max(size(K_v / device.mass), sqrt(size(K_p / device.mass)))
    parts = mechanism(device, device.structure, ops)
    motor, handle = parts.motor, parts.handle
    held = 0.0 if parts.damping is None else size(parts.damping / handle)
    rates = size(K_v / motor), 4 / 3 * size(parts.viscosity / motor), size(parts.viscosity / handle), held
    squares = size(K_p / motor), 4 / 3 * size(parts.stiffness / motor), size(parts.stiffness / handle)
    return (1 + NEAR) * max(*(8 * rate for rate in rates), *(sqrt(8 * square) for square in squares))
