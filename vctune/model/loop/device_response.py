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
from vctune.model.mechanism import Link, chain
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.pair import Pair
from vctune.model.parts import Servo


class DriveResponse(NamedTuple):
    """Hold, delay and actuator at a frequency, A H = re - j omega lag. Both parts are even and smooth at omega = 0."""

    re: Number  # Re A H, dimensionless
    lag: Number  # -Im A H / omega, s; for omega -> 0 it tends to T/2 + delay plus the lag of A


@dataclass(frozen=True, slots=True)
class Spring:
    """A mass on its spring: the impedance Z_2 of the mass and the spring's admittance y = omega^2 y_c + j omega y_k."""

    mass: Number  # mass and damping, with the load of a handle, kg and N s/m; damping is None without a load
    damping: Number | None
    y_c: Number  # c/(k^2 + (omega c)^2) and k/(k^2 + (omega c)^2), s m/N and m/N
    y_k: Number


class DeviceResponse(NamedTuple):
    """The response of a device at a frequency."""

    omega: Number  # frequency, rad/s
    mass: Number  # mass and damping of the motor's part, kg and N s/m
    damping: Number
    drive: DriveResponse  # A H, the response of hold, delay and actuator; for a servo, of the motion to the command
    estimate: FilterResponse | None = None  # F, from the motor's velocity to the firmware's estimate; None for 1
    sensor: FilterResponse | None = None  # F_s, from the hand's force to the sensed force; None for 1
    springs: tuple[Spring, ...] = ()  # springs from the motor to the handle
    operator: Number | None = None  # b_h, the damping of the least operator, N s/m; None without an operator
    factor: Pair | None = None  # x = 1 + delta, factor of the mechanism's response; None for 1
    at_handle: bool = False  # whether the handle is sensed, not the motor
    follows: bool = False  # whether the motion follows the command alone, as a servo's does


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
    estimate = velocity_estimate(device, omega, ops) if device.velocity is not None else None
    sensor = sensor_response(device, omega, ops)
    of = chain(device, ops)
    springs = tuple(_spring(link, of.held if link is of.links[-1] else None, omega) for link in of.links)
    factor = None
    if device.unmodelled is not None:
        radius = device.unmodelled.share * ops.interpolated(omega / (2 * ops.pi), device.unmodelled.radii)
        phase = device.unmodelled.phase
        factor = Pair(1 + radius * ops.cos(phase), radius * ops.sin(phase))
    return DeviceResponse(
        omega, of.motor, device.damping, drive, estimate, sensor, springs, operator, factor, device.at_handle
    )


def _spring(link: Link, held: Number | None, omega: Number) -> Spring:
    loss = omega * link.viscosity
    below = 1 / (link.stiffness * link.stiffness + loss * loss)
    return Spring(link.mass, held, link.viscosity * below, link.stiffness * below)


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
