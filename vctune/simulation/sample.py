"""One sample of a scene in any arithmetic: measure, control, and move until the next sample."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any

from vctune.model.device import Device
from vctune.model.loop.filters import drive_at_rest
from vctune.model.mechanism import chain
from vctune.model.numbers.arithmetic import FLOATS, Number
from vctune.model.sampled.circle import SNAP, split_delay
from vctune.simulation.controller import (
    Controller,
    Measurement,
    Operations,
    State,
    control,
    in_steps,
)
from vctune.simulation.plant import Plant, row_times
from vctune.simulation.scene import Equilibrium, Scene, initial_velocity

# Columns that a simulation records at each sample: x, v, f_h, x_e, v_e, f_e, u, f_s
COLUMNS = ("position", "velocity", "force", "reference", "desired", "environment_force", "motor", "sensed")
MOTOR_COLUMNS = ("motor_position", "motor_velocity")  # Additional recorded columns if motor and handle move differently
Parts = dict[str, list[Number]]  # the numbers of each part of the state of a scene


@dataclass(frozen=True, slots=True)
class Timing:
    """The events of a sample. After sample k, up to the next, u[k-N-1] acts for `early` seconds, then u[k-N].

    The hold is the real zero-order hold, whatever the device's `hold`."""

    whole: int  # N, the number of whole samples in the delay
    early: float  # s; 0 if the delay is a whole number of samples
    unread: int  # number of whole samples in the force sensor's delay
    instant: float | None  # time after a sample at which the sensor samples the force, s; None for at the sample

    def intervals(self, sample_time: float) -> list[tuple[float, float]]:
        """Return the times between two events, s."""
        instants = {0.0, self.early, sample_time} | ({self.instant} if self.instant is not None else set())
        return list(pairwise(sorted(instants)))


def timing(device: Device) -> Timing:
    """Return the events of a sample. An event of the sensor that all but meets a command's arrival meets it."""
    T = device.sample_time
    whole, fraction = split_delay(device.latency, T)
    unread, sensed = split_delay(device.sensing.delay, T)
    early, instant = fraction * T, None if sensed == 0 else (1 - sensed) * T
    if instant is not None and abs(instant - early) <= SNAP * T:
        instant = early
    return Timing(whole, early, unread, instant)


def columns(device: Device) -> tuple[str, ...]:
    """Return the recorded columns of a device's step."""
    return COLUMNS if device.structure is None else COLUMNS + MOTOR_COLUMNS


def begun(scene: Scene, moving: Plant, rest: State, begin: Equilibrium) -> Parts:
    """Return the state of a scene at rest, part by part."""
    device, when = scene.device, timing(scene.device)
    of = chain(device, FLOATS)
    not_zero = {"position": begin.position, "sensed": begin.hand}
    not_zero |= {bend: begin.bend / (link.stiffness * of.give) for bend, link in zip(of.bends, of.links, strict=True)}
    not_zero |= dict.fromkeys(of.velocities, initial_velocity(scene.operator))
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


# Move values (states and given inputs of the plant) and bristles over a sample while a late and an early command act.
# Return both, and what the sensor has on the way
Move = Callable[[list[Number], Number, Sequence[Number]], tuple[list[Number], Number, list[Number]]]


def sampled(
    scene: Scene,
    moving: Plant,
    firmware: tuple[Controller, State],
    now: Parts,
    given: tuple[Sequence[Number], Number],
    rubbing: Callable[[Number, Number], Number],
    move: Move,
    ops: Operations,
) -> tuple[Parts, list[Number]]:
    """Return the state after a sample, and the recorded columns at its start.

    Parameters
    ----------
    scene, moving : Scene and Plant
        What is simulated, and its plant.
    firmware : tuple[Controller, State]
        The firmware, and a state whose form it has.
    now : Parts
        The state at the sample.
    given : tuple[Sequence[Number], Number]
        The hand's push and its derivatives, and the noise of the sensed force, N.
    rubbing : Callable
        The friction, N, of a velocity and of bristles.
    move : Move
        Moves the plant over a sample.
    ops : Operations
        Elementary functions of the arithmetic.
    """
    when, (c, form), (push, noise) = timing(scene.device), firmware, given
    # the oldest command acts just before the sample, when the new command does not exist yet
    body, held = now["body"], _acting(scene, now["commands"])[-1]
    z: Number = now["bristles"][0] if now["bristles"] else 0.0
    values = [*body, held, rubbing(body[1], z), *push]
    sensed = now["between"][0] if now["between"] else row_times(moving.sensed, values)
    # rows of the handle; the first two states are of the motor
    place = row_times(moving.position, values), row_times(moving.velocity, values)
    seen = place if scene.device.at_handle else (body[0], body[1])
    read = in_steps(scene.force_resolution, (now["unread"] or [sensed])[-1] + noise, ops)
    after = {"unread": [sensed, *now["unread"]][: when.unread]}
    memory, command = control(c, _like(form, now["memory"]), Measurement(*seen, read), ops)
    after["memory"], commands = _listed(memory), [command.given, *now["commands"]]
    after["commands"] = commands[:-1]
    record = [*place, row_times(moving.force, values)]
    record += [memory.reference, memory.desired, command.environment, command.given, read, *body[:2]]
    moved, z, between = move([*body, held, 0.0, *push], z, _acting(scene, commands)[-2:])
    after |= {"body": moved[: len(moving.states)], "bristles": [z] * len(now["bristles"]), "between": between}
    return {name: after[name] for name in now}, record[: len(columns(scene.device))]


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
