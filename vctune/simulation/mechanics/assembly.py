"""Describe a device with its parts, and the hand on it, by linear rates."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from vctune.model.device import Device
from vctune.model.experiment import Operator
from vctune.model.loop.device_response import mechanism
from vctune.model.loop.drive import Rows, drive_rows, drive_states
from vctune.model.loop.filters import plain_low_pass_rates
from vctune.model.numbers.arithmetic import FLOATS, Floats, Number
from vctune.model.parts import ForceSensor, Servo
from vctune.model.sampled.velocity_loop import SNAP, split_delay
from vctune.simulation.mechanics.intended_motion import push_matrix
from vctune.simulation.mechanics.rigid_motion import Transition, exponential_less_one, timing
from vctune.simulation.scene import Scene

# Inputs of the states. "command" is the held command that has arrived (a force, or a servo's velocity), and "friction"
# is the force of the friction. "push" is the force, N, that the hand's spring and damper would exert on a handle at
# rest at 0
GIVEN = ("command", "friction", "push", "push_1", "push_2", "push_3")


@dataclass(frozen=True, slots=True)
class Assembly:
    """Device and hand as d/dt (states, given) = rates @ (states, given), with `given` as in `GIVEN`."""

    states: tuple[str, ...]  # names of the states: position and velocity of the motor first
    rates: Floats  # matrix of the rates over states and given, shape (n, n) for n states and given
    units: Floats
    position: Floats  # rows of the handle's position and velocity, m, m/s
    velocity: Floats
    force: Floats  # row of f_h, the force of the hand on the handle, N
    sensed: Floats  # row of the sensor's force without its delay, N

    @property
    def size(self) -> int:
        """Number of states."""
        return len(self.states)

    def changed(self, time: float) -> Floats:
        """Return e^(rates t) - 1, the change of the states and of the given inputs over a time, s."""
        scaled = self.rates * self.units / self.units[:, None]
        return exponential_less_one(scaled * time) / self.units * self.units[:, None]


@dataclass(frozen=True, slots=True)
class Sensing:
    """The time at which the sensor samples the force that the firmware reads."""

    whole_samples: int  # number of whole samples in the sensor's delay
    instant: float | None  # time after a sample of the firmware at which the sensor samples the force, s


def sensing(scene: Scene) -> Sensing:
    """Return the time at which the sensor samples the force."""
    T, early = scene.device.sample_time, timing(scene).early
    whole, fraction = split_delay(scene.device.sensing.delay, T)
    if fraction == 0:
        return Sensing(whole, None)
    instant = (1 - fraction) * T
    return Sensing(whole, early if abs(instant - early) <= SNAP * T else instant)


def assembly(scene: Scene) -> Assembly | None:
    """Return the moving parts of a scene."""
    device, hand = scene.device, scene.operator
    if device.servo is not None:
        return _servo(device, device.servo, hand)
    structure, sensor, drive = device.structure, device.sensing, drive_states(device)
    if not drive and structure is None and sensor.bandwidth_hz is None and sensing(scene).instant is None:
        return None
    states = ["position", "velocity"]
    states += ["bend", "handle_velocity"] if structure is not None else []
    states += drive
    states += _sensed_states(sensor)
    names = (*states, *GIVEN)
    row_of = dict(zip(names, np.eye(len(names)), strict=True))
    rows: Rows = {name: {} for name in drive}
    motor = _sum(drive_rows(rows, device, FLOATS, plain_low_pass_rates), row_of)
    rates = {
        "position": row_of["velocity"],
        "push": row_of["push_1"],
        "push_1": row_of["push_2"],
        "push_2": row_of["push_3"],
    }
    rates |= {name: _sum(row, row_of) / device.sample_time for name, row in rows.items()}
    bend_frequency = 0.0
    if structure is None:
        position, velocity = row_of["position"], row_of["velocity"]
        driven = motor - device.damping * velocity - row_of["friction"]
        hand_push = row_of["push"] - hand.stiffness * position - hand.damping * velocity
        mass = device.mass + hand.mass
        rates["velocity"] = (driven + hand_push) / mass
        force = device.mass / mass * hand_push - hand.mass / mass * driven
    else:
        masses, velocity = mechanism(device, structure, FLOATS), row_of["handle_velocity"]
        position, mass = row_of["position"] + row_of["bend"], masses.handle + hand.mass
        rates["bend"] = velocity - row_of["velocity"]
        spring = masses.stiffness * row_of["bend"] + masses.viscosity * rates["bend"]
        hand_push = row_of["push"] - hand.stiffness * position - hand.damping * velocity
        rates["velocity"] = (motor + spring - device.damping * row_of["velocity"] - row_of["friction"]) / masses.motor
        rates["handle_velocity"] = (hand_push - spring) / mass
        force = masses.handle / mass * hand_push + hand.mass / mass * spring
        bend_frequency = sqrt(masses.stiffness * (1 / masses.motor + 1 / mass))
    force_unit = device.mass / device.sample_time**2
    units = _units(names, force_unit, force_unit, device.sample_time, bend_frequency)
    return _assembled(tuple(states), row_of, rates, units, (position, velocity, force), sensor)


def _servo(device: Device, servo: Servo, hand: Operator) -> Assembly:
    """Return a servo with the hand's force on it: -(M a + B v + K x) plus the push, where M, B and K are the hand's."""
    velocity = ("velocity", "velocity_rate")[: servo.order]
    states, T = ("position", *velocity, *_sensed_states(device.sensing)), device.sample_time
    names = (*states, *GIVEN)
    row_of = dict(zip(names, np.eye(len(names)), strict=True))
    rates = {
        "position": row_of["velocity"],
        "push": row_of["push_1"],
        "push_1": row_of["push_2"],
        "push_2": row_of["push_3"],
    }
    rates |= _low_pass("velocity", servo.bandwidth_hz, servo.order, row_of["command"], row_of)
    hand_resistance = (
        hand.stiffness * row_of["position"] + hand.damping * row_of["velocity"] + hand.mass * rates["velocity"]
    )
    hand_force = hand.mass / T**2 + hand.damping / T + hand.stiffness
    units = _units(names, hand_force or 1.0, 1 / T, T, 0.0)
    handle_rows = row_of["position"], row_of["velocity"], row_of["push"] - hand_resistance
    return _assembled(states, row_of, rates, units, handle_rows, device.sensing)


def _sum(shares: dict[str, Number], row_of: dict[str, Floats]) -> Floats:
    return np.asarray(sum(share * row_of[name] for name, share in shares.items()))


def _sensed_states(sensor: ForceSensor) -> tuple[str, ...]:
    """Return the states of a force sensor's low-pass."""
    return ("sensed", "sensed_rate")[: sensor.order] if sensor.bandwidth_hz is not None else ()


def _assembled(
    states: tuple[str, ...],
    row_of: dict[str, Floats],
    rates: dict[str, Floats],
    units: Floats,
    handle_rows: tuple[Floats, Floats, Floats],
    sensor: ForceSensor,
) -> Assembly:
    """Return an assembly with its force sensor."""
    position, velocity, force = handle_rows
    if sensor.bandwidth_hz is not None:
        rates = rates | _low_pass("sensed", sensor.bandwidth_hz, sensor.order, force, row_of)
    nothing = np.zeros(len(row_of))
    return Assembly(
        states=states,
        rates=np.array([rates.get(name, nothing) for name in row_of]),
        units=units,
        position=position,
        velocity=velocity,
        force=force,
        sensed=row_of.get("sensed", force),
    )


def _low_pass(
    name: str, bandwidth_hz: float, order: int, source: Floats, row_of: dict[str, Floats]
) -> dict[str, Floats]:
    """Return the rates of the states of a low-pass."""
    corner = float(2 * FLOATS.pi * bandwidth_hz)
    if order == 1:
        return {name: corner * (source - row_of[name])}
    rate = f"{name}_rate"
    return {name: corner * row_of[rate], rate: corner * (source - row_of[name] - sqrt(2) * row_of[rate])}


def _units(names: tuple[str, ...], force: float, command: float, sample_time: float, bend_frequency: float) -> Floats:
    """Return units: T for time, given units for forces and commands, and the size of the oscillation for a bend."""
    units = {"position": 1.0, "command": command, "bend": 1 / (1 + bend_frequency * sample_time)}
    units |= dict.fromkeys(("velocity", "handle_velocity", "velocity_rate"), 1 / sample_time)
    units |= {f"push_{k}": force / sample_time**k for k in (1, 2, 3)}
    return np.array([units.get(name, force) for name in names])


def transition(scene: Scene, moving: Assembly) -> Transition:
    """Return the exact transition of an assembly without friction over one sample."""
    command_timing, reading, n = timing(scene), sensing(scene), moving.size
    command, push = n + GIVEN.index("command"), slice(n + GIVEN.index("push"), None)
    identity, T = np.eye(len(moving.rates)), scene.device.sample_time
    derivatives = push_matrix(scene.operator, T)

    def after(time: float) -> tuple[Floats, Floats]:
        """Return states and given inputs after a time, as a function of their earlier values and of the late
        command."""
        early = identity + moving.changed(min(time, command_timing.early))
        if time <= command_timing.early:
            return early, np.zeros(len(identity))
        late_change = identity + moving.changed(time - command_timing.early)
        arriving = late_change[:, command].copy()
        late_change[:, command] = 0.0  # the early command no longer acts
        return late_change @ early, arriving

    change, late_change = (part[:n] for part in after(T))
    if reading.instant is not None:
        at_reading, late_at_reading = after(reading.instant)
        change, late_change = (
            np.vstack([change, moving.sensed @ at_reading]),
            np.append(late_change, moving.sensed @ late_at_reading),
        )
    state = np.zeros((len(change), len(change)))
    state[:, :n] = change[:, :n]
    return Transition(state, change[:, command], late_change, change[:, push] @ derivatives)


def applied(row: Floats, values: list[Number]) -> Number:
    """Return the product of a row and values. The function skips factors of 0."""
    total: Number = 0.0
    for factor, value in zip(row, values, strict=True):
        if factor != 0:
            total = total + float(factor) * value
    return total
