"""Compute the device's response at a frequency, which does not depend on the gains (model/README.md, sections 1 and
12).

An ideal device has a mass, a damping, and a hold with its delay. The other parts are optional: actuator, velocity
estimate, force sensor, and a spring between motor and handle. An absent part costs no computation. A servo has only the
response of its motion to the command, and a force sensor.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from vctune.model.device import Device
from vctune.model.loop.drive import drive_response
from vctune.model.loop.filters import (
    FilterResponse,
    interpolation,
    low_pass,
    sensor_response,
    velocity_estimate,
)
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.pair import Pair
from vctune.model.parts import Servo, Structure


class DriveResponse(NamedTuple):
    """Hold, delay and actuator at a frequency, A H = re - j omega lag. Both parts are even and smooth at omega = 0.

    For a servo, A is the servo's low-pass, times the interpolation of a position command.

    Attributes
    ----------
    re : Re A H, dimensionless
    lag : -Im A H / omega, s; for omega -> 0 it tends to T/2 + delay plus the lag of A
    """

    re: Number
    lag: Number


@dataclass(frozen=True, slots=True)
class Spring:
    """The handle on its spring: the handle's impedance Z_2 and the spring's admittance y = omega^2 y_c + j omega y_k.

    Attributes
    ----------
    mass, damping : mass and damping of the handle including its load, kg and N s/m; damping is None without a load
    y_c, y_k : c/(k^2 + (omega c)^2) and k/(k^2 + (omega c)^2), s m/N and m/N
    total, own_mass : mass of the device and mass of its handle, both without a load, kg
    bent, bent_im : real and imaginary part of g = omega^2 mu/(k + j omega c), which contains no mass; y = j g/(omega
        mu)
    """

    mass: Number
    damping: Number | None
    y_c: Number
    y_k: Number
    total: Number
    own_mass: Number
    bent: Number
    bent_im: Number


class DeviceResponse(NamedTuple):
    """The response of a device at a frequency.

    Attributes
    ----------
    omega : frequency, rad/s
    mass, damping : mass and damping of the motor's part, kg and N s/m; a rigid device has no other part; without effect
        for a servo
    drive : A H, the response of hold, delay and actuator; for a servo, of the motion to the command
    estimate : F, from the motor's velocity to the firmware's estimate; None for 1
    sensor : F_s, from the hand's force to the sensed force; None for 1
    spring : spring between motor and handle; None for a rigid device
    operator : b_h, the damping of the least operator, N s/m; None without an operator
    factor : x = 1 + delta, factor of the mechanism's response; None for 1
    follows : whether the motion follows the command alone, as a servo's does
    """

    omega: Number
    mass: Number
    damping: Number
    drive: DriveResponse
    estimate: FilterResponse | None = None
    sensor: FilterResponse | None = None
    spring: Spring | None = None
    operator: Number | None = None
    factor: Pair | None = None
    follows: bool = False


@dataclass(frozen=True, slots=True)
class Mechanism:
    """The two masses of a structure, and the spring between them.

    Attributes
    ----------
    motor, handle : the two masses, kg
    damping : damping of the handle, N s/m; None without damping. The device's damping acts on the motor's part
    stiffness, viscosity : stiffness and damping of the spring, N/m and N s/m
    """

    motor: Number
    handle: Number
    damping: Number | None
    stiffness: Number
    viscosity: Number


def mechanism(device: Device, structure: Structure, ops: Arithmetic) -> Mechanism:
    """Return the masses and the spring of a structure from its free resonance (model/README.md, section 12).

    With the reduced mass mu of motor and handle, k = mu (2 pi f)^2 and c = 2 zeta mu 2 pi f. A load adds its mass to
    the handle's mass and damps the handle. It does not change the spring.

    Parameters
    ----------
    device : device with the total mass m, kg
    structure : handle's mass, kg, free resonance f, Hz, and damping ratio zeta
    ops : arithmetic of the numbers of both

    Returns
    -------
    Mechanism
        It has the shape of the device's parameters.
    """
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
    """Evaluate H = hold(j omega) e^{-j omega delay}, including the factor 1/T that paper eq. 9 lacks.

    Parameters
    ----------
    device : device; the function uses only sample_time, hold and delay, or the delay of the servo
    omega : frequency, rad/s, may be 0; a number or an array of any shape
    ops : arithmetic of omega and of the device's parameters

    Returns
    -------
    DriveResponse
        Both parts have the shape of omega.
    """
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
    """Evaluate every part of the loop that does not depend on the gains, at s = j omega.

    See model/README.md, sections 1 and 12.

    Parameters
    ----------
    device : device in SI units; parts that it lacks are None in the result
    omega : angular frequency, rad/s, may be 0; a number or an array of any shape
    ops : arithmetic of omega and of the device's parameters

    Returns
    -------
    DeviceResponse
        Its numbers have the shape of omega. Numbers that do not depend on omega may be plain.
    """
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
        estimate = velocity_estimate(device.velocity, device.sample_time, omega, ops)
    sensor = sensor_response(device.sensing, omega, ops)
    if device.structure is not None:
        parts = mechanism(device, device.structure, ops)
        loss = omega * parts.viscosity
        below = 1 / (parts.stiffness * parts.stiffness + loss * loss)
        rate = 2 * ops.pi * device.structure.frequency_hz
        stiff, lossy = rate * rate, 2 * device.structure.damping_ratio * rate * omega
        flat = omega2 / (stiff * stiff + lossy * lossy)
        mass = parts.motor
        spring = Spring(
            parts.handle,
            parts.damping,
            parts.viscosity * below,
            parts.stiffness * below,
            device.mass,
            device.structure.handle_mass,
            stiff * flat,
            -lossy * flat,
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
    drive = _behind(drive, low_pass(servo.bandwidth_hz, servo.order, omega, ops), omega2)
    if servo.command == "position":
        drive = _behind(drive, interpolation(device.sample_time, omega, ops), omega2)
    sensor = sensor_response(device.sensing, omega, ops)
    return DeviceResponse(omega, device.mass, device.damping, drive, sensor=sensor, follows=True)


def _behind(drive: DriveResponse, late: FilterResponse, omega2: Number) -> DriveResponse:
    re = drive.re * late.re - omega2 * (drive.lag * late.lag)
    return DriveResponse(re, drive.lag * late.re + drive.re * late.lag)
