"""Compute the device's response at a frequency, which does not depend on the gains (model/README.md, sections 1 and
12)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from vctune.model.device import Device
from vctune.model.loop.filters import (
    FilterResponse,
    drive_response,
    interpolation,
    low_pass,
    sensor_response,
    velocity_estimate,
)
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.pair import Pair
from vctune.model.parts import Servo, Structure


class DriveResponse(NamedTuple):
    """Hold, delay and actuator at a frequency, A H = re - j omega lag. Both parts are even and smooth at omega = 0."""

    re: Number  # Re A H, dimensionless
    lag: Number  # -Im A H / omega, s; for omega -> 0 it tends to T/2 + delay plus the lag of A


@dataclass(frozen=True, slots=True)
class Spring:
    """The handle on its spring: the handle's impedance Z_2 and the spring's admittance y = omega^2 y_c + j omega
    y_k."""

    mass: Number  # mass and damping of the handle including its load, kg and N s/m; damping is None without a load
    damping: Number | None
    y_c: Number  # c/(k^2 + (omega c)^2) and k/(k^2 + (omega c)^2), s m/N and m/N
    y_k: Number
    total: Number  # mass of the device and mass of its handle, both without a load, kg
    own_mass: Number
    bent: Number  # g/omega^2 = mu/(k + j omega c) = bent - j omega bent_lag, which contains no mass, s^2 and s^3
    bent_lag: Number


class DeviceResponse(NamedTuple):
    """The response of a device at a frequency."""

    omega: Number  # frequency, rad/s
    mass: Number  # mass and damping of the motor's part, kg and N s/m
    damping: Number
    drive: DriveResponse  # A H, the response of hold, delay and actuator; for a servo, of the motion to the command
    estimate: FilterResponse | None = None  # F, from the motor's velocity to the firmware's estimate; None for 1
    sensor: FilterResponse | None = None  # F_s, from the hand's force to the sensed force; None for 1
    spring: Spring | None = None  # spring between motor and handle; None for a rigid device
    operator: Number | None = None  # b_h, the damping of the least operator, N s/m; None without an operator
    factor: Pair | None = None  # x = 1 + delta, factor of the mechanism's response; None for 1
    follows: bool = False  # whether the motion follows the command alone, as a servo's does


@dataclass(frozen=True, slots=True)
class Mechanism:
    """The two masses of a structure, and the spring between them."""

    motor: Number  # the two masses, kg
    handle: Number
    damping: Number | None  # damping of the handle, N s/m
    stiffness: Number  # stiffness and damping of the spring, N/m and N s/m
    viscosity: Number


def mechanism(device: Device, structure: Structure, ops: Arithmetic) -> Mechanism:
    """Return the masses and the spring of a structure from its free resonance (model/README.md, section 12)."""
    motor, handle, swing = device.motor_mass, structure.handle_mass, 2 * ops.pi * structure.frequency_hz
    reduced = motor * handle / device.mass
    load = structure.load
    return Mechanism(
        motor=motor,
        handle=handle if load is None else handle + load.mass,
        damping=None if load is None else load.damping,
        stiffness=reduced * (swing * swing),
        viscosity=2 * structure.damping_ratio * reduced * swing,
    )


def hold_response(device: Device, omega: Number, ops: Arithmetic) -> DriveResponse:
    """Evaluate H = hold(j omega) e^{-j omega delay}, including the factor 1/T that paper eq. 9 lacks."""
    half = device.sample_time / 2
    if device.hold == "zoh":
        modulus = ops.sinc(omega * half)
        phase = omega * device.loop_lag
        return DriveResponse(modulus * ops.cos(phase), device.loop_lag * modulus * ops.sinc(phase))
    squared = 1 + (omega * half) * (omega * half)
    if ops.is_zero(device.delay):
        return DriveResponse(1 / squared, half / squared)
    phase = omega * device.delay
    cos, sinc = ops.cos(phase), ops.sinc(phase)
    return DriveResponse(
        (cos - omega * half * ops.sin(phase)) / squared,
        (half * cos + device.delay * sinc) / squared,
    )


def device_response(device: Device, omega: Number, ops: Arithmetic) -> DeviceResponse:
    """Evaluate every part of the loop that does not depend on the gains, at s = j omega."""
    drive = hold_response(device, omega, ops)
    if device.servo is not None:
        return _servo_response(device, device.servo, drive, omega, ops)
    operator = None if device.operator is None else device.operator.damping
    if device.ideal:
        return DeviceResponse(omega, device.mass, device.damping, drive, operator=operator)
    omega2 = omega * omega
    late = drive_response(device, omega, ops)
    if late is not None:
        drive = _behind(drive, late, omega2)
    estimate, mass, spring = None, device.mass, None
    if device.velocity is not None:
        estimate = velocity_estimate(device, omega, ops)
    sensor = sensor_response(device, omega, ops)
    if device.structure is not None:
        parts = mechanism(device, device.structure, ops)
        loss = omega * parts.viscosity
        below = 1 / (parts.stiffness * parts.stiffness + loss * loss)
        rate = 2 * ops.pi * device.structure.frequency_hz
        stiff, lossy = rate * rate, 2 * device.structure.damping_ratio * rate
        flat = 1 / (stiff * stiff + omega2 * (lossy * lossy))
        mass = parts.motor
        spring = Spring(
            parts.handle,
            parts.damping,
            parts.viscosity * below,
            parts.stiffness * below,
            device.mass,
            device.structure.handle_mass,
            stiff * flat,
            lossy * flat,
        )
    factor = None
    if device.unmodelled is not None:
        radius = device.unmodelled.share * ops.interpolated(omega / (2 * ops.pi), device.unmodelled.radii)
        phase = device.unmodelled.phase
        factor = Pair(1 + radius * ops.cos(phase), radius * ops.sin(phase))
    return DeviceResponse(omega, mass, device.damping, drive, estimate, sensor, spring, operator, factor)


def _servo_response(
    device: Device, servo: Servo, drive: DriveResponse, omega: Number, ops: Arithmetic
) -> DeviceResponse:
    """Return the response of a servo: that of its motion to its command (hold, delay, low-pass and interpolation), and
    that of its force sensor."""
    omega2 = omega * omega
    drive = _behind(drive, low_pass(servo.bandwidth(ops), servo.order, omega, ops), omega2)
    if device.interpolates:
        drive = _behind(drive, interpolation(device.sample_time, omega, ops), omega2)
    sensor = sensor_response(device, omega, ops)
    return DeviceResponse(omega, device.mass, device.damping, drive, sensor=sensor, follows=True)


def _behind(drive: DriveResponse, late: FilterResponse, omega2: Number) -> DriveResponse:
    re = drive.re * late.re - omega2 * (drive.lag * late.lag)
    return DriveResponse(re, drive.lag * late.re + drive.re * late.lag)
