"""Compute the constants of the loop at a frequency.

Every response is a quotient of two numbers that are affine in the gains. For a servo, both are constants.

See model/README.md, section 12.
"""

from __future__ import annotations

from dataclasses import dataclass

from vctune.model.gains import Gains
from vctune.model.loop.device_response import DeviceResponse
from vctune.model.numbers.pair import Pair


@dataclass(frozen=True, slots=True)
class Affine:
    """A complex number that is affine in the gains at a frequency: constant + K_v velocity + K_p position.

    Attributes
    ----------
    constant, velocity, position : the three coefficients; None for 0. An impedance has coefficients in N s/m, 1 and s
    """

    constant: Pair | None
    velocity: Pair | None
    position: Pair | None

    def closed(self, gains: Gains) -> Pair:
        """Return the number for given gains."""
        parts = [] if self.constant is None else [self.constant]
        parts += [] if self.velocity is None else [self.velocity.scaled(gains.velocity)]
        parts += [] if self.position is None else [self.position.scaled(gains.position)]
        return sum(parts[1:], start=parts[0]) if parts else Pair(0, 0)

    def driven(self, gains: Gains) -> Pair:
        """Return the gains' part of the number: K_v velocity + K_p position for given gains."""
        return Affine(None, self.velocity, self.position).closed(gains)


@dataclass(frozen=True, slots=True)
class LoopConstants:
    """The constants of the loop at a frequency, without the scale of `LoopResponse`.

    Attributes
    ----------
    controller, C : C_0 and F_s C_0
    D, miss, numerator, motor : D, D - C_0, N and W
    factor : e = 1 + y Z_2, the factor of C_f in D; 1 for a rigid device and for a servo. With both gains 0, the
        velocity per unit of the motor's force is e/D at the motor and 1/D at the handle
    """

    controller: Affine
    C: Affine
    D: Affine
    miss: Affine
    numerator: Affine
    motor: Affine
    factor: Pair


def loop_constants(at: DeviceResponse) -> LoopConstants:
    """Return the constants of a device's loop at omega > 0. The constants do not depend on the gains.

    The function ignores `DeviceResponse.factor`, the perturbation of the mechanism, and the least operator.

    In C_0, the coefficient of K_p is the coefficient of K_v divided by j omega. The coefficients in W and D have the
    same relation if the firmware measures the velocity and does not filter it.
    """
    if at.follows:
        return _following(at)
    omega, spring, sensor = at.omega, at.spring, at.sensor
    drive = Pair(at.drive.re, -(omega * at.drive.lag))
    turned = Pair(-at.drive.lag, -(at.drive.re / omega))
    heard, lost = drive, None
    if at.estimate is not None:
        gone = Pair(omega * omega * at.estimate.loss, omega * at.estimate.lag)  # 1 - F
        lost, heard = drive * gone.scaled(-1), drive * Pair(at.estimate.re, -(omega * at.estimate.lag))
    Z_1 = Pair(at.damping, at.mass * omega)
    told, motor = Affine(None, drive, turned), Affine(Z_1, heard, turned)
    C = told
    if sensor is not None:
        F_s = Pair(sensor.re, -(omega * sensor.lag))
        C = Affine(None, F_s * drive, F_s * turned)
    if spring is None:
        one = Pair(1, 0 * omega)
        return LoopConstants(told, C, motor, Affine(Z_1, lost, None), Affine(one, None, None), motor, one)
    # the masses alone give j omega m (1 - g) of D_0, y Z_1 = -g m/m_2 and y Z_2 = -g m/m_1: terms of D_0 cancel near
    # the resonance, where enclosures must be sharp
    g, m, m_1, m_2 = Pair(spring.bent, spring.bent_im), spring.total, at.mass, spring.own_mass
    y = Pair(-g.im, g.re).scaled(m / (m_1 * m_2) / omega)
    bent, N_0 = g.scaled(-(m / m_1)), (g.scaled(-(m / m_2)) + y.scaled(at.damping)).plus(1)
    D_0 = Pair(g.im, 1 - g.re).scaled(omega * m) + bent.plus(1).scaled(at.damping)
    if spring.damping is not None:
        load = Pair(spring.damping, omega * (spring.mass - spring.own_mass))
        bent, D_0 = bent + y * load, D_0 + load * N_0
    e, swung = bent.plus(1), bent * heard
    return LoopConstants(
        controller=told,
        C=C,
        D=Affine(D_0, e * heard, e * turned),
        miss=Affine(D_0, swung if lost is None else swung + lost, bent * turned),
        numerator=Affine(N_0, y * heard, y * turned),
        motor=motor,
        factor=e,
    )


def _following(at: DeviceResponse) -> LoopConstants:
    """Return the constants of a servo. These constants do not contain the gains."""
    drive = Pair(at.drive.re, -(at.omega * at.drive.lag))
    heard = drive if at.sensor is None else Pair(at.sensor.re, -(at.omega * at.sensor.lag)) * drive
    one, none = Pair(1, 0 * at.omega), Pair(0, 0 * at.omega)

    def constant(number: Pair) -> Affine:
        return Affine(number, None, None)

    miss = Pair(1 - drive.re, -drive.im)
    return LoopConstants(
        controller=constant(drive),
        C=constant(heard),
        D=constant(one),
        miss=constant(miss),
        numerator=constant(none),
        motor=constant(one),
        factor=one,
    )
