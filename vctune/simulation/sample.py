"""Compile one sample of a scene into a function: measure, control, and move until the next sample. This module imports
casadi."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from math import ceil
from typing import Any

import casadi as ca
import numpy as np

from vctune.model.device import Device
from vctune.model.experiment import Friction
from vctune.model.loop.drive import drive_at_rest
from vctune.model.numbers.arithmetic import Floats, Number
from vctune.model.sampled.delays import SNAP, split_delay
from vctune.simulation.controller import Measurement, State, at_rest, control, controller_of, encoded
from vctune.simulation.friction import Sliding, friction_force, friction_step, slide
from vctune.simulation.motion import push_matrix
from vctune.simulation.operations import FLOATS, Operations
from vctune.simulation.plant import GIVEN, Plant, applied, plant
from vctune.simulation.scene import Equilibrium, Scene, equilibrium

SYMBOLS = Operations(ca.exp, ca.expm1, ca.fabs, ca.floor, ca.fmin, ca.fmax, ca.if_else)
SAMPLES_PER_CALL = 1024  # Number of samples per call of the compiled function, and between two checks for divergence
STEPS_PER_RADIAN = 64  # Number of fixed steps per radian of the bristles' oscillation with the moving mass
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
    device, c, when = scene.device, controller_of(scene.law), timing(scene.device)
    moving, begin = plant(device, scene.operator), equilibrium(scene)
    rest = at_rest(c, encoded(c, begin.position, FLOATS), begin.reference)
    start = _start(scene, moving, rest, begin)
    now = {name: [ca.SX.sym(f"{name}_{k}") for k in range(len(numbers))] for name, numbers in start.items()}
    inputs = ca.SX.sym("inputs", len(INPUT_NAMES))
    push = ca.vertsplit(ca.mtimes(ca.DM(push_matrix(scene.operator, device.sample_time)), inputs[:NOISE]))
    # the oldest command acts just before the sample, when the new command does not exist yet
    body, held = now["body"], _acting(scene, now["commands"])[-1]
    z: Any = now["bristles"][0] if now["bristles"] else 0.0
    values = [*body, held, _rubbing(scene, body[1], z), *push]
    sensed = now["between"][0] if now["between"] else applied(moving.sensed, values)
    read = (now["unread"] or [sensed])[-1] + (inputs[NOISE] if scene.force_noise > 0 else 0.0)
    after = {"filtered": [], "unread": [sensed, *now["unread"]][: when.unread]}
    if (share := device.sensing.filter_coefficient) is not None:
        read = now["filtered"][0] + float(share) * (read - now["filtered"][0])
        after["filtered"] = [read]
    if device.servo is not None and device.servo.stiffness is not None:
        read = read - float(device.servo.stiffness) * (body[0] - begin.position)
    memory, command = control(c, _like(rest, now["memory"]), Measurement(body[0], body[1], read), SYMBOLS)
    after["memory"], commands = _listed(memory), [command.given, *now["commands"]]
    after["commands"] = commands[:-1]
    record = [applied(row, values) for row in (moving.position, moving.velocity, moving.force)]
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
        "filtered": [] if device.sensing.filter_coefficient is None else [begin.hand],
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
    return 0.0 if scene.friction is None else friction_force(scene.friction, velocity, z, SYMBOLS)[0]


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
            values = [value + applied(row, values) for value, row in zip(values, change, strict=True)]
        else:
            values, z = _slid(scene, scene.friction, moving, values, z, end - begin)
        if end == when.instant:
            felt = [*values]
            felt[rubbing] = _rubbing(scene, values[1], z)
            after["between"] = [applied(moving.sensed, felt)]
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
    end = friction_step(change, length / count, friction, Sliding(at, deflection, foreseen), SYMBOLS)
    compiled = ca.Function("slid", [symbols], [ca.vertcat(*end.values, end.z, end.foreseen)])

    def step(before: Sliding) -> Sliding:
        *after, z, foreseen = ca.vertsplit(compiled(ca.vertcat(*before.values, before.z, before.foreseen)))
        return Sliding(after, z, foreseen)

    last = slide(step, Sliding(values, z, values[1]), count)
    return list(last.values), last.z


def steps_per_sample(scene: Scene, friction: Friction) -> int:
    """Return the number of fixed steps per sample, from the bristles' oscillation with the moving mass."""
    device = scene.device
    mass = device.mass + scene.operator.mass if device.structure is None else device.motor_mass
    frequency = (friction.stiffness / mass) ** 0.5  # rad/s
    return ceil(min(max(frequency * device.sample_time * STEPS_PER_RADIAN, LEAST_STEPS), MOST_STEPS))
