"""A device of vctune as the oracles' device and the other way round: numbers only; and what vctune says of a device."""

from __future__ import annotations

from typing import Any

import numpy as np
from device_oracle import LowPass, Real, Velocity
from device_oracle import Structure as Flexible

from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.hands import LeastOperator
from vctune.model.loop.device_response import device_response
from vctune.model.loop.loop import LoopResponse, loop_response
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.parts import Actuator, ForceSensor, Structure, VelocityEstimate


def real_of(device: Device) -> Real:
    """Return a device of vctune as the oracles' one."""
    velocity, actuator, sensor, structure = device.velocity, device.actuator, device.force_sensor, device.structure
    hand = device.operator or LeastOperator(0.0, 0.0)
    return Real(
        mass=device.mass,
        damping=device.damping,
        sample_time=device.sample_time,
        hold=device.hold,
        delay=device.delay,
        velocity=Velocity(velocity.source, velocity.filter_hz, velocity.filter_order) if velocity else Velocity(),
        actuator=LowPass(actuator.bandwidth_hz, actuator.order) if actuator else LowPass(),
        force_sensor=LowPass(sensor.bandwidth_hz, sensor.order, sensor.delay) if sensor else LowPass(),
        structure=Flexible(structure.handle_mass, structure.frequency_hz, structure.damping_ratio)
        if structure
        else None,
        operator_mass=hand.mass,
        operator_damping=hand.damping,
    )


def device_of(real: Real) -> Device:
    """Return an oracles' device as one of vctune."""
    velocity, sensor, structure = real.velocity, real.force_sensor, real.structure
    hand = LeastOperator(real.operator_mass, real.operator_damping)
    return Device(
        real.mass,
        real.damping,
        real.sample_time,
        real.delay,
        real.hold,
        velocity=None
        if velocity == Velocity()
        else VelocityEstimate(velocity.source, velocity.filter_hz, velocity.filter_order),
        actuator=None
        if real.actuator.bandwidth_hz is None
        else Actuator(real.actuator.bandwidth_hz, real.actuator.order),
        force_sensor=None if sensor == LowPass() else ForceSensor(sensor.bandwidth_hz, sensor.order, sensor.delay),
        structure=None
        if structure is None
        else Structure(structure.handle_mass, structure.frequency_hz, structure.damping_ratio),
        operator=None if hand == LeastOperator(0.0, 0.0) else hand,
    )


def loop(device: Device, gains: Gains, omega: Any) -> LoopResponse:
    """Return vctune's velocity loop at frequencies in rad/s, in doubles."""
    return loop_response(device_response(device, np.asarray(omega), FLOATS), gains, FLOATS)
