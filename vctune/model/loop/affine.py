"""Compute the constants of the loop at a frequency. See model/README.md, section 12."""

from __future__ import annotations

from dataclasses import dataclass

from vctune.model.gains import Gains
from vctune.model.loop.device_response import DeviceResponse
from vctune.model.numbers.pair import Pair


@dataclass(frozen=True, slots=True)
class Affine:
    """A complex number that is affine in the gains at a frequency: constant + K_v velocity + K_p position."""

    constant: Pair | None  # the three coefficients; None for 0. An impedance has coefficients in N s/m, 1 and s
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
    """The constants of the loop at a frequency, without the scale omega of `LoopResponse`."""

    controller: Affine  # C_0 and F_s C_0
    C: Affine
    D: Affine  # D, D - C_0, N and W
    miss: Affine
    numerator: Affine
    motor: Affine
    factor: Pair  # e = 1 + y Z_2, the factor of C_f in D


def loop_constants(at: DeviceResponse) -> LoopConstants:
    """Return the constants of a device's loop at omega > 0. The constants do not depend on the gains."""
    if at.follows:
        return _following(at)
    omega, spring, sensor = at.omega, at.spring, at.sensor
    drive = Pair(at.drive.re, -(omega * at.drive.lag))  # A H
    integrated = Pair(-at.drive.lag, -(at.drive.re / omega))  # A H/(j omega)
    estimated, minus_lost = drive, None  # A H F, and -A H (1 - F)
    if at.estimate is not None:
        one_less_F = Pair(omega * omega * at.estimate.loss, omega * at.estimate.lag)
        minus_lost, estimated = drive * one_less_F.scaled(-1), drive * Pair(at.estimate.re, -(omega * at.estimate.lag))
    Z_1 = Pair(at.damping, at.mass * omega)
    C_0, motor = Affine(None, drive, integrated), Affine(Z_1, estimated, integrated)
    C = C_0
    if sensor is not None:
        F_s = Pair(sensor.re, -(omega * sensor.lag))
        C = Affine(None, F_s * drive, F_s * integrated)
    if spring is None:
        one = Pair(1, 0 * omega)
        return LoopConstants(C_0, C, motor, Affine(Z_1, minus_lost, None), Affine(one, None, None), motor, one)
    # g = -j omega y m_1 m_2/m. The masses alone give j omega m (1 - g) of D_0, y Z_1 = -g m/m_2 and y Z_2 = -g m/m_1:
    # terms of D_0 cancel near the resonance, where enclosures must be sharp
    g, m, m_1, m_2 = Pair(spring.bent, spring.bent_im), spring.total, at.mass, spring.own_mass
    y = Pair(-g.im, g.re).scaled(m / (m_1 * m_2) / omega)
    y_Z_2, N_0 = g.scaled(-(m / m_1)), (g.scaled(-(m / m_2)) + y.scaled(at.damping)).plus(1)
    D_0 = Pair(g.im, 1 - g.re).scaled(omega * m) + y_Z_2.plus(1).scaled(at.damping)
    if spring.damping is not None:  # the load of the handle adds its mass and damping to Z_2
        load = Pair(spring.damping, omega * (spring.mass - spring.own_mass))
        y_Z_2, D_0 = y_Z_2 + y * load, D_0 + load * N_0
    e, driven_miss = y_Z_2.plus(1), y_Z_2 * estimated
    return LoopConstants(
        controller=C_0,
        C=C,
        D=Affine(D_0, e * estimated, e * integrated),
        miss=Affine(D_0, driven_miss if minus_lost is None else driven_miss + minus_lost, y_Z_2 * integrated),
        numerator=Affine(N_0, y * estimated, y * integrated),
        motor=motor,
        factor=e,
    )


def _following(at: DeviceResponse) -> LoopConstants:
    """Return the constants of a servo. These constants do not contain the gains."""
    drive = Pair(at.drive.re, -(at.omega * at.drive.lag))
    sensed = drive if at.sensor is None else Pair(at.sensor.re, -(at.omega * at.sensor.lag)) * drive
    one, zero = Pair(1, 0 * at.omega), Pair(0, 0 * at.omega)

    def constant(number: Pair) -> Affine:
        return Affine(number, None, None)

    miss = Pair(1 - drive.re, -drive.im)
    return LoopConstants(
        controller=constant(drive),
        C=constant(sensed),
        D=constant(one),
        miss=constant(miss),
        numerator=constant(zero),
        motor=constant(one),
        factor=one,
    )
