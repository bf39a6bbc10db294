"""Compile one sample of a scene into a function: measure, control, and move until the next sample. This module imports
casadi."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from math import ceil
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from vctune.model.device import Device
from vctune.model.experiment import Friction
from vctune.model.loop.filters import drive_at_rest
from vctune.model.numbers.arithmetic import Floats, Number
from vctune.model.sampled.circle import SNAP, split_delay
from vctune.simulation.controller import (
    FLOATS,
    Measurement,
    Operations,
    State,
    at_rest,
    control,
    controller_of,
    encoded,
)
from vctune.simulation.plant import GIVEN, Plant, plant, row_times
from vctune.simulation.scene import Equilibrium, Scene, equilibrium, initial_velocity, push_matrix

SERIES_BELOW = 0.01  # Argument y at which the code changes from the series of phi_2 to its formula


def friction_force(friction: Friction, velocity: Number, deflection: Number, ops: Operations) -> tuple[Number, Number]:
    """Return F [N] and dz/dt [m/s]."""
    rate, damping = _relaxation(friction, velocity, ops)
    creep = velocity - rate * deflection
    return friction.stiffness * deflection + damping * creep, creep


def _relaxation(friction: Friction, velocity: Number, ops: Operations) -> tuple[Number, Number]:
    """Return a(v) [1/s] and damping(v) [N s/m]."""
    speed, g = ops.absolute(velocity), friction.coulomb
    if friction.stiction > friction.coulomb:
        ratio = velocity / friction.stribeck_velocity
        g = g + (friction.stiction - friction.coulomb) * ops.exp(-ratio * ratio)
    return friction.stiffness * speed / g, friction.damping / (1 + friction.damping * speed / (4 * friction.coulomb))


class Sliding(NamedTuple):
    """Where a step begins or ends."""

    values: Sequence[Number]  # states and given inputs of the plant
    z: Number  # deflection of the bristles, m; the last force of a dry friction, N
    foreseen: Number  # predicted velocity of the motor in the middle of the next step, m/s


def dry_step(change: Floats, coulomb: float, at: Sliding, ops: Operations) -> Sliding:
    """Advance by a step in which the plant changes by `change`. The friction is the force that stops the motor, or the
    greatest one against the motion; `at.z` of the result is this force, N."""
    rubbing = len(change) - len(GIVEN) + GIVEN.index("friction")
    held = [*at.values]
    held[rubbing] = 0.0
    stopping = (at.values[1] + row_times(change[1], held)) / -float(change[1, rubbing])
    held[rubbing] = ops.maximum(-coulomb, ops.minimum(coulomb, stopping))
    values = [value + row_times(row, held) for value, row in zip(at.values, change, strict=True)]
    return Sliding(values, held[rubbing], values[1])


def friction_step(change: Floats, h: float, friction: Friction, at: Sliding, ops: Operations) -> Sliding:
    """Advance by a step h, s, in which command and friction are held and the plant changes by `change`."""
    rate, damping = _relaxation(friction, at.foreseen, ops)
    phi_1, phi_2 = _phi_1_and_2(rate * h, ops)
    # the bristles' mean force over a step at the velocity w is stiffness z + slope w
    stiffness = (friction.stiffness - damping * rate) * phi_1
    slope = friction.stiffness * h * phi_2 + damping * phi_1
    rubbing = len(change) - len(GIVEN) + GIVEN.index("friction")
    compliance = -float(change[0, rubbing])  # reduction of the motor's travel per newton, m/N
    w = (row_times(change[0], at.values) - compliance * (stiffness * at.z)) / (h + compliance * slope)
    held = [*at.values]
    held[rubbing] = stiffness * at.z + slope * w
    values = [value + row_times(row, held) for value, row in zip(at.values, change, strict=True)]
    # v + (v - w), where w is about the velocity at the middle of the step
    return Sliding(values, at.z + h * phi_1 * (w - rate * at.z), 2 * values[1] - w)


def slide(step: Callable[[Sliding], Sliding], at: Sliding, count: int) -> Sliding:
    """Advance by several steps. A first try foresees the velocity of the first step."""
    tried = step(at)
    at = at._replace(foreseen=2 * tried.values[1] - tried.foreseen)
    for _ in range(count):
        at = step(at)
    return at


def _phi_1_and_2(y: Number, ops: Operations) -> tuple[Number, Number]:
    """Return phi_1 = (1 - e^-y)/y and phi_2 = (y - 1 + e^-y)/y^2 for y >= 0."""
    safe = ops.maximum(y, SERIES_BELOW)
    phi_1, small = -ops.expm1(-safe) / safe, y < SERIES_BELOW
    series = 0.5 - y * (1 / 6 - y * (1 / 24 - y * (1 / 120 - y / 720)))
    return ops.where(small, 1 - y * series, phi_1), ops.where(small, series, (1 - phi_1) / safe)


CASADI_OPERATIONS = Operations(ca.exp, ca.expm1, ca.fabs, ca.floor, ca.fmin, ca.fmax, ca.if_else)
SAMPLES_PER_CALL = 1024  # Number of samples per call of the compiled function, and between two checks for divergence
STEPS_PER_RADIAN = 64  # Number of fixed steps per radian of the bristles' oscillation with the moving mass
DRY_STEPS = 32  # Number of fixed steps per sample with dry friction, which stops the handle at the end of one
LEAST_STEPS, MOST_STEPS = 4, 256  # Least and greatest number of steps in a sample
# Inputs of a step: x_i [m] and v_i [m/s] at this sample and at the next, and the noise of the force sensor [N]
INPUT_NAMES = ("intended", "intended_velocity", "next_intended", "next_intended_velocity", "noise")
INTENDED, INTENDED_VELOCITY, NEXT_INTENDED, NEXT_INTENDED_VELOCITY, NOISE = range(len(INPUT_NAMES))
# Columns that a simulation records at each sample: x, v, f_h, x_e, v_e, f_e, u, f_s
COLUMNS = ("position", "velocity", "force", "reference", "desired", "environment_force", "motor", "sensed")
MOTOR_COLUMNS = ("motor_position", "motor_velocity")  # Additional recorded columns if motor and handle move differently


@dataclass(frozen=True, slots=True)
class Step:
    """A compiled step, advance(state, inputs) -> (state, record), and its state at the start of the motion."""

    advance: Any
    start: Floats

    def chunk(self) -> Any:
        """Return the function for `SAMPLES_PER_CALL` samples, with one column for each sample."""
        return self.advance.mapaccum(SAMPLES_PER_CALL)


@dataclass(frozen=True, slots=True)
class Timing:
    """The events of a sample. After sample k, up to the next, u[k-N-1] acts for `early` seconds, then u[k-N].

    The hold is the real zero-order hold, whatever the device's `hold`."""

    whole: int  # N, the number of whole samples in the delay
    early: float  # s; 0 if the delay is a whole number of samples
    unread: int  # number of whole samples in the force sensor's delay
    instant: float | None  # time after a sample at which the sensor samples the force, s; None for at the sample


def timing(device: Device) -> Timing:
    """Return the events of a sample. An event of the sensor that all but meets a command's arrival meets it."""
    T = device.sample_time
    whole, fraction = split_delay(device.latency, T)
    unread, sensed = split_delay(device.sensing.delay, T)
    early, instant = fraction * T, None if sensed == 0 else (1 - sensed) * T
    if instant is not None and abs(instant - early) <= SNAP * T:
        instant = early
    return Timing(whole, early, unread, instant)


def columns(scene: Scene) -> tuple[str, ...]:
    """Return the recorded columns of a scene's step."""
    return COLUMNS if scene.device.structure is None else COLUMNS + MOTOR_COLUMNS


def build(scene: Scene) -> Step:
    """Assemble and compile the step of a scene."""
    device, when, begin = scene.device, timing(scene.device), equilibrium(scene)
    moving, c = plant(device, scene.operator), controller_of(replace(scene.law, own_zero=begin.position))
    rest = at_rest(c, encoded(c, begin.position, FLOATS), begin.reference, begin.hand)
    start = _start(scene, moving, rest, begin)
    now = {name: [ca.SX.sym(f"{name}_{k}") for k in range(len(numbers))] for name, numbers in start.items()}
    inputs = ca.SX.sym("inputs", len(INPUT_NAMES))
    push = ca.vertsplit(ca.mtimes(ca.DM(push_matrix(scene.operator, device.sample_time)), inputs[:NOISE]))
    # the oldest command acts just before the sample, when the new command does not exist yet
    body, held = now["body"], _acting(scene, now["commands"])[-1]
    z: Any = now["bristles"][0] if now["bristles"] else 0.0
    values = [*body, held, _rubbing(scene, body[1], z), *push]
    sensed = now["between"][0] if now["between"] else row_times(moving.sensed, values)
    read = (now["unread"] or [sensed])[-1] + (inputs[NOISE] if scene.force_noise > 0 else 0.0)
    after = {"unread": [sensed, *now["unread"]][: when.unread]}
    memory, command = control(c, _like(rest, now["memory"]), Measurement(body[0], body[1], read), CASADI_OPERATIONS)
    after["memory"], commands = _listed(memory), [command.given, *now["commands"]]
    after["commands"] = commands[:-1]
    record = [row_times(row, values) for row in (moving.position, moving.velocity, moving.force)]
    record += [memory.reference, memory.desired, command.environment, command.given, read, *body[:2]]
    after |= _moved(scene, moving, when, [*body, held, 0.0, *push], z, _acting(scene, commands)[-2:])
    names = ca.vertcat(*(symbol for symbols in now.values() for symbol in symbols))
    ends = ca.vertcat(*(number for name in start for number in after[name]))
    advance = ca.Function("one", [names, inputs], [ends, ca.vertcat(*record[: len(columns(scene))])])
    return Step(advance, np.array([number for numbers in start.values() for number in numbers], float))


def _start(scene: Scene, moving: Plant, rest: State, begin: Equilibrium) -> dict[str, list[Number]]:
    """Return the state of a step at rest, part by part."""
    device, when = scene.device, timing(scene.device)
    not_zero = {"position": begin.position, "bend": begin.bend, "sensed": begin.hand}
    not_zero |= dict.fromkeys(("velocity", "handle_velocity"), initial_velocity(scene.operator))
    not_zero |= {name: share * begin.motor for name, share in drive_at_rest(device).items()}
    # past commands that still act: one for each whole sample of delay, and one that ends within a sample; a servo that
    # interpolates between positions also needs the position before these
    count = when.whole + (2 if scene.law.command == "position" else 1)
    return {
        "body": [not_zero.get(name, 0.0) for name in moving.states],
        "bristles": [] if scene.friction is None else [0.0],
        "between": [] if when.instant is None else [begin.hand],
        "memory": _listed(rest),
        "commands": [begin.motor] * count,  # the newest first
        "unread": [begin.hand] * when.unread,  # forces that were sampled and not read, the newest first
    }


def _listed(state: State) -> list[Number]:
    """Return the numbers of a firmware's state."""
    parts = [getattr(state, field.name) for field in fields(State)]
    return [number for part in parts for number in (part if isinstance(part, tuple) else [part])]


def _like(state: State, numbers: Sequence[Number]) -> State:
    """Return the state of a firmware with other numbers."""
    given: Iterator[Number] = iter(numbers)
    parts = [getattr(state, field.name) for field in fields(State)]
    return State(*(tuple(next(given) for _ in part) if isinstance(part, tuple) else next(given) for part in parts))


def _acting(scene: Scene, commands: list[Any]) -> list[Any]:
    """Return the held values of commands, the newest first: of positions the velocity from one to the next."""
    if scene.law.command != "position":
        return commands
    return [(newer - older) / scene.device.sample_time for newer, older in pairwise(commands)]


def _rubbing(scene: Scene, velocity: Any, z: Any) -> Any:
    if scene.friction is None or scene.friction.dry:
        return z
    return friction_force(scene.friction, velocity, z, CASADI_OPERATIONS)[0]


def _moved(
    scene: Scene, moving: Plant, when: Timing, values: list[Any], z: Any, held: list[Any]
) -> dict[str, list[Any]]:
    """Return body, bristles and a force that is sensed on the way, after a sample in which two commands act."""
    T, n, (late, early) = scene.device.sample_time, len(moving.states), held
    command, rubbing = (n + GIVEN.index(name) for name in ("command", "friction"))
    instants = {0.0, when.early, T} | ({when.instant} if when.instant is not None else set())
    after: dict[str, list[Any]] = {"between": []}
    for begin, end in pairwise(sorted(instants)):
        values[command] = early if end <= when.early else late
        if scene.friction is None:
            change = moving.change(end - begin)
            values = [value + row_times(row, values) for value, row in zip(values, change, strict=True)]
        else:
            values, z = _slid(scene, scene.friction, moving, values, z, end - begin)
        if end == when.instant:
            felt = [*values]
            felt[rubbing] = _rubbing(scene, values[1], z)
            after["between"] = [row_times(moving.sensed, felt)]
    return after | {"body": values[:n], "bristles": [] if scene.friction is None else [z]}


def _slid(
    scene: Scene, friction: Friction, moving: Plant, values: list[Any], z: Any, length: float
) -> tuple[list[Any], Any]:
    """Return values and bristles after a part of a sample with friction."""
    # a rounding above a whole number must not add a step
    count = max(1, ceil(steps_per_sample(scene, friction) * length / scene.device.sample_time * (1 - 1e-12)))
    symbols = ca.SX.sym("values", len(values) + 2)
    change = moving.change(length / count)
    *at, deflection, foreseen = ca.vertsplit(symbols)
    begin = Sliding(at, deflection, foreseen)
    if friction.dry:
        end = dry_step(change, friction.coulomb, begin, CASADI_OPERATIONS)
    else:
        end = friction_step(change, length / count, friction, begin, CASADI_OPERATIONS)
    compiled = ca.Function("slid", [symbols], [ca.vertcat(*end.values, end.z, end.foreseen)])

    def step(before: Sliding) -> Sliding:
        *after, z, foreseen = ca.vertsplit(compiled(ca.vertcat(*before.values, before.z, before.foreseen)))
        return Sliding(after, z, foreseen)

    last = Sliding(values, z, values[1])
    if not friction.dry:
        last = slide(step, last, count)
    else:
        for _ in range(count):
            last = step(last)
    return list(last.values), last.z


def steps_per_sample(scene: Scene, friction: Friction) -> int:
    """Return the number of fixed steps per sample: of bristles, from their oscillation with the moving mass."""
    if friction.dry:
        return DRY_STEPS
    device = scene.device
    mass = device.mass + scene.operator.mass if device.structure is None else device.motor_mass
    frequency = (friction.stiffness / mass) ** 0.5  # rad/s
    return ceil(min(max(frequency * device.sample_time * STEPS_PER_RADIAN, LEAST_STEPS), MOST_STEPS))
