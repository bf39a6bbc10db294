"""Compute what any passive hand requires of an impedance display in the sampled loop (model/README.md, section 15)."""

from __future__ import annotations

from typing import NamedTuple

from vctune.model.device import Device
from vctune.model.gains import Gains, SpringDamper
from vctune.model.loop.filters import drive_response, drive_states
from vctune.model.mechanism import chain
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.pair import Pair
from vctune.model.sampled.impedance_display import Required, firmware_filter, offered_by_spring

ALIASES = 24  # Number of pairs of aliases that the code sums one by one if the device has an actuator or a spring


class InAnyHand(NamedTuple):
    """R/s^2, m/(N s), in any passive hand, as (lost + K_v lost_slope)/(1 + K_v size_slope + K_v^2 size_square)."""

    lost: Number
    lost_slope: Number
    size_slope: Number
    size_square: Number


class AnyHand(NamedTuple):
    """The response of y to a force, in any passive hand: at each frequency a disc with centre c and radius r."""

    short: Number  # (r - Re c)/s^2
    beyond: Number  # (|c|^2 - r^2)/s^2
    centre: Pair  # c
    turn: Number  # Im c/s, regular at theta = 0
    low_pass: Pair | None  # F at theta; None for 1
    sine2: Number  # s^2

    @property
    def of_velocity(self) -> InAnyHand:
        """Numerator and denominator of R/s^2 as polynomials in K_v."""
        low_pass, inside = self.low_pass, self.beyond * self.sine2
        if low_pass is None:
            return InAnyHand(self.short, -self.beyond, 2 * self.centre.re, inside)
        along = low_pass.re * self.centre.re - low_pass.im * self.centre.im
        return InAnyHand(self.short, -(self.beyond * low_pass.re), 2 * along, low_pass.abs2() * inside)

    def required(self, gains: Gains) -> Required:
        """Return R/s^2 as a quotient. R depends on K_v alone."""
        K_v, of = gains.velocity, self.of_velocity
        return Required(of.lost + K_v * of.lost_slope, 1 + K_v * of.size_slope + K_v * K_v * of.size_square)

    def before_wall(
        self, wall: SpringDamper, sample_time: Number, theta: Number, ops: Arithmetic
    ) -> tuple[Number, Number]:
        """Return 2 Re(Z_c c) and |Z_c|^2 (|c|^2 - r^2): 1, w times the first and w^2 times the second add up to
        |1 + w Z_c c|^2 - |w Z_c r|^2, and where that is positive no passive hand has a pole with a share w of Z_c."""
        passed, spring = self.low_pass or Pair(1, 0), wall.stiffness * sample_time / 2
        along = wall.damping * (passed.re * self.centre.re - passed.im * self.centre.im)
        along = along + spring * (self.centre.re + ops.cos(theta / 2) * self.turn)
        return 2 * along, offered_by_spring(wall, sample_time, self.low_pass, theta, ops).below * self.beyond


def any_hand(device: Device, whole: Number, theta: Number, ops: Arithmetic, *, fractional: bool) -> AnyHand:
    """Return the disc of an impedance display's responses G_y in every passive hand (model/README.md, section 15)."""
    disc, sine = _disc(device, whole, theta, ops, fractional=fractional), ops.sin(theta / 2)
    return AnyHand(*disc, firmware_filter(device, theta, ops), sine * sine)


class _Disc(NamedTuple):
    """The first four fields of `AnyHand`, with the same meaning."""

    short: Number
    beyond: Number
    centre: Pair
    turn: Number


def _disc(device: Device, whole: Number, theta: Number, ops: Arithmetic, *, fractional: bool) -> _Disc:
    if drive_states(device) or device.structure is not None:
        return _sum_of_aliases(device, theta, ops)
    b, steps, half = device.least_damping, whole + 1, ops.sinc(theta / 2)

    def turned(n: Number) -> tuple[Number, Pair, Number]:
        """Return (1 - cos n theta)/(2 s^2), e^{-j n theta}, and its imaginary part over 2 s."""
        chord = n * (ops.sinc(theta * (n * 0.5)) / half)
        return chord * chord, Pair(ops.cos(theta * n), -ops.sin(theta * n)), -n * (ops.sinc(theta * n) / half)

    short, centre, turn = turned(steps)
    if not fractional:
        return _Disc(short / b, 0, centre.scaled(1 / (2 * b)), turn / b)
    part = device.delay / device.sample_time - whole
    later = turned(steps + 1)
    short, turn = ((1 - part) * now + part * then for now, then in ((short, later[0]), (turn, later[2])))
    centre = centre.scaled(1 - part) + later[1].scaled(part)
    return _Disc(short / b, -(part * (1 - part)) / (b * b), centre.scaled(1 / (2 * b)), turn / b)


class _Alias(NamedTuple):
    """The disc of the motor's responses to a force at one frequency, including the delays."""

    centre: Pair
    radius: Number  # |A| rho, with the radius rho of the disc of the motor's admittance


def _sum_of_aliases(device: Device, theta: Number, ops: Arithmetic) -> _Disc:
    """Return the disc of a device with an actuator or a structure."""
    near, short = _first_alias(device, theta, ops)
    others, radius = Pair(0 * theta, 0 * theta), 0 * theta
    for n in (sign * k for k in range(1, ALIASES + 1) for sign in (-1, 1)):
        at = theta + 2 * ops.pi * n
        alias, inverse = _alias(device, theta, at, ops), 2 / at
        weight = inverse * inverse
        others, radius = others + alias.centre.scaled(weight), radius + alias.radius * weight
    reach, rest = _beyond_the_last(device, ops)
    off, rest = ops.within(ops.magnitude(reach)), ops.magnitude(rest) / 2
    others, radius = Pair(others.re + off, others.im + off), radius + (rest + ops.within(rest))
    sine, half = ops.sin(theta / 2), ops.sinc(theta / 2)
    square, h = sine * sine, half * half
    beyond = h * h * near.beyond + 2 * h * (near.centre.re * others.re + near.centre.im * others.im)
    beyond = beyond - 2 * h * near.radius * radius + square * (others.abs2() - radius * radius)
    centre, turn = near.centre.scaled(h) + others.scaled(square), 2 * half * near.turn + sine * others.im
    return _Disc(short + (radius - others.re), beyond, centre, turn)


def _alias(device: Device, theta: Number, at: Number, ops: Arithmetic) -> _Alias:
    """Return the disc of the motor's responses at omega = at/T."""
    drive = drive_at(device, theta, at, ops)
    size = ops.sqrt(drive.abs2()) if drive_states(device) else 1
    rho, reactance, g = motor_disc(device, at / device.sample_time, ops)
    if g is None:
        return _Alias(drive.scaled(rho), size * rho)
    centre = drive * Pair(1 + 2 * g * device.damping, -(2 * g * reactance))
    return _Alias(centre.scaled(rho), size * rho)


def drive_at(device: Device, theta: Number, at: Number, ops: Arithmetic) -> Pair:
    """Return A e^{-j (theta + omega_n delay)}, the motor's force per held force at the alias omega_n."""
    turn = theta + at * (device.delay / device.sample_time)
    delayed = Pair(ops.cos(turn), -ops.sin(turn))
    omega = at / device.sample_time
    A = drive_response(device, omega, ops)
    return delayed if A is None else delayed * Pair(A.re, -(omega * A.lag))


def motor_disc(device: Device, omega: Number, ops: Arithmetic) -> tuple[Number, Number, Number | None]:
    """Return the disc with radius rho and centre C that contains the motor's admittance in every passive hand."""
    b, reactance = device.damping, omega * device.motor_mass
    if device.structure is None:
        return 1 / (2 * device.least_damping), reactance, None
    loss = _loss(device, omega, ops)
    g = omega * omega * loss
    return 1 / (2 * b + 2 * g * (b * b + reactance * reactance)), reactance, g


def _loss(device: Device, omega: Number, ops: Arithmetic) -> Number:
    """Return g/omega^2 = c/(k^2 + (omega c)^2) of the spring."""
    (link,) = chain(device, ops).links
    return link.viscosity / (link.stiffness * link.stiffness + (omega * link.viscosity) * (omega * link.viscosity))


class _First(NamedTuple):
    """The disc of the first alias, (|centre|^2 - radius^2)/s^2, and Im centre/theta."""

    centre: Pair
    radius: Number
    beyond: Number
    turn: Number


def _first_alias(device: Device, theta: Number, ops: Arithmetic) -> tuple[_First, Number]:
    """Return the first alias, and h (radius - Re centre)/s^2 = (2/theta)^2 (radius - Re centre), regular at 0."""
    T, b = device.sample_time, device.damping
    omega, d = theta / T, device.delay / T
    alias, (rho, reactance, g) = _alias(device, theta, theta, ops), motor_disc(device, omega, ops)
    turn, A = theta * (1 + d), drive_response(device, omega, ops)
    if A is None:
        passed, chord = Pair(ops.cos(turn), -ops.sin(turn)), (1 + d) * ops.sinc(turn / 2)
        short, size2, slope = 2 * (chord * chord), 1, (1 + d) * ops.sinc(turn)
    else:
        passed = Pair(ops.cos(turn), -ops.sin(turn)) * Pair(A.re, -(omega * A.lag))
        size2 = passed.abs2()
        size = ops.sqrt(size2)
        slope = A.re * ((1 + d) * ops.sinc(turn)) + A.lag / T * ops.cos(turn)  # -Im/theta
        short = 4 * ops.where_positive(
            passed.re,
            lambda: slope * slope / (size + passed.re),
            lambda: (size - passed.re) / (theta * theta),
        )
    if g is None:
        return _First(alias.centre, alias.radius, 0, -(rho * slope)), rho * short
    loss, half, across = _loss(device, omega, ops) / (T * T), ops.sinc(theta / 2), b * b + reactance * reactance
    short = rho * (short - 8 * loss * (passed.re * b + passed.im * reactance))
    beyond = 16 * loss * size2 * (rho * rho) * (b + g * across) / (half * half)
    turned = rho * (slope * (1 + 2 * g * b) + 2 * passed.re * (theta * loss * reactance))
    return _First(alias.centre, alias.radius, beyond, -turned), short


def _beyond_the_last(device: Device, ops: Arithmetic) -> tuple[Number, Number]:
    """Return bounds of the weighted sums of |centre| and radius over all aliases after the last summed one, divided by
    s^2."""
    omega = (2 * ALIASES + 1) * ops.pi / device.sample_time
    weight = 2 / (ops.pi * ops.pi * ALIASES)
    A = drive_response(device, omega, ops)
    if A is not None:
        weight = weight * ops.sqrt(A.re * A.re + (omega * A.lag) * (omega * A.lag))
    rho, reactance, g = motor_disc(device, omega, ops)
    if g is None:
        return weight * rho, weight * rho
    b = device.damping
    along = ops.where_positive(reactance - b, lambda: (1 + 2 * g * b) * rho, lambda: 2 / (b + reactance))
    return weight * (along + 1 / reactance), weight * rho
