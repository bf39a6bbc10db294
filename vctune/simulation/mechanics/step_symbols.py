"""Name the symbols of one sample of a scene around its firmware, and the values that the firmware reads. This module
imports casadi."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import casadi as ca

from vctune.model.loop.drive import drive_at_rest
from vctune.simulation.firmware.controller import Measurement
from vctune.simulation.mechanics.assembly import Assembly, applied, assembly, sensing
from vctune.simulation.mechanics.friction import Slide, friction_force
from vctune.simulation.mechanics.rigid_motion import timing
from vctune.simulation.mechanics.step_inputs import INPUT_NAMES, INTENDED, INTENDED_VELOCITY, NOISE
from vctune.simulation.mechanics.stretches import SYMBOLS
from vctune.simulation.scene import Equilibrium, Scene, equilibrium


@dataclass(frozen=True, slots=True)
class SampleValues:
    """The values just before a sample: motion of motor and handle, f_h, and the newest force of the sensor, N."""

    motor: Slide
    handle: Slide
    force: Any
    sensed: Any


@dataclass(frozen=True, slots=True)
class SampleSymbols:
    """The symbols of a scene around its firmware."""

    begin: Equilibrium  # state of the scene at rest
    mechanism: Assembly | None  # moving parts; None for a single mass
    body: Any
    inputs: Any  # inputs of the step
    commands: list[Any]  # past commands that act up to this sample or later, the newest first
    unread: list[Any]  # past forces that the sensor has sampled and the firmware has not read, the newest first
    filtered: list[Any]  # force after the filter of the sensed samples, before and after this sample
    filtered_after: list[Any]
    motion: SampleValues  # values at the sample
    measurement: Measurement  # values that the firmware reads


def sample_symbols(scene: Scene) -> SampleSymbols:
    """Return the symbols of a scene, and the firmware's input: motion of the motor, and the delayed, noisy force."""
    sensor, mechanism, begin = sensing(scene), assembly(scene), equilibrium(scene)
    body, inputs = ca.SX.sym("body", len(at_rest(scene, mechanism, begin))), ca.SX.sym("inputs", len(INPUT_NAMES))
    # past commands that still act: one for each whole sample of delay, and one that ends within a sample; a servo that
    # interpolates between positions also needs the position before these
    count = timing(scene).whole_samples + (2 if _interpolates(scene) else 1)
    commands = [ca.SX.sym(f"u{age}") for age in range(count)]
    unread = [ca.SX.sym(f"f{age}") for age in range(sensor.whole_samples)]
    # the oldest command acts just before the sample, when the new command does not exist yet
    motion = _motion_at_sample(scene, mechanism, body, inputs, acting(scene, commands)[-1])
    delayed = unread[-1] if unread else motion.sensed
    force = delayed + inputs[NOISE] if scene.force_noise > 0 else delayed
    filtered, filtered_after = [], []
    if (share := scene.device.sensing.filter_coefficient) is not None:
        filtered = [ca.SX.sym("filtered")]
        force = filtered[0] + float(share) * (force - filtered[0])
        filtered_after = [force]
    if (servo := scene.device.servo) is not None and servo.stiffness is not None:
        force = force - float(servo.stiffness) * (motion.motor.x - begin.position)
    return SampleSymbols(
        begin=begin,
        mechanism=mechanism,
        body=body,
        inputs=inputs,
        commands=commands,
        unread=unread,
        filtered=filtered,
        filtered_after=filtered_after,
        motion=motion,
        measurement=Measurement(motion.motor.x, motion.motor.v, force),
    )


def _interpolates(scene: Scene) -> bool:
    """Return whether the device moves linearly from one command to the next."""
    return scene.law.command == "position"


def acting(scene: Scene, commands: list[Any]) -> list[Any]:
    """Return the held values of commands, one for each sample, the newest first, like the commands."""
    if not _interpolates(scene):
        return commands
    return [(newer - older) / scene.device.sample_time for newer, older in pairwise(commands)]


def at_rest(scene: Scene, mechanism: Assembly | None, begin: Equilibrium) -> list[float]:
    """Return the body's part of the state at the start of the motion."""
    not_zero = {"position": begin.position, "bend": begin.bend, "sensed": begin.hand}
    not_zero |= {name: share * begin.motor for name, share in drive_at_rest(scene.device).items()}
    states = mechanism.states if mechanism is not None else ("position", "velocity")
    body = [not_zero.get(name, 0.0) for name in states]
    body += [0.0] if scene.friction is not None else []
    return body if sensing(scene).instant is None else [*body, begin.hand]


def _motion_at_sample(scene: Scene, mechanism: Assembly | None, body: Any, inputs: Any, command: Any) -> SampleValues:
    """Return the values just before a sample, while a held command acts. Without an `Assembly`, the handle is the
    motor."""
    size = 2 if mechanism is None else mechanism.size
    motor = Slide(body[0], body[1], body[size] if scene.friction is not None else 0.0)
    if mechanism is None:
        force = _hand_force(scene, motor, inputs, command)
        return SampleValues(motor, motor, force, force)
    values = values_at(
        scene, ca.vertsplit(body[: size + (scene.friction is not None)]), size, command, _push(scene, inputs)
    )
    handle = Slide(applied(mechanism.position, values), applied(mechanism.velocity, values), 0.0)
    force = applied(mechanism.force, values)
    sensed = force if mechanism.sensed is mechanism.force else applied(mechanism.sensed, values)
    # if the sensor samples the force between the firmware's samples, this force is the body's last state
    return SampleValues(motor, handle, force, sensed if sensing(scene).instant is None else body[-1])


def _push(scene: Scene, inputs: Any) -> Any:
    """Return the force of the hand's spring and damper on a handle at rest at 0, N."""
    return scene.operator.stiffness * inputs[INTENDED] + scene.operator.damping * inputs[INTENDED_VELOCITY]


def values_at(scene: Scene, body: list[Any], size: int, motor: Any, push: Any) -> list[Any]:
    """Return states and inputs at a moment, as in `assembly.GIVEN`, with 0 for the derivatives of the push."""
    friction = 0.0 if scene.friction is None else friction_force(scene.friction, body[1], body[size], SYMBOLS)[0]
    return [*body[:size], motor, friction, push, 0.0, 0.0, 0.0]


def _hand_force(scene: Scene, at: Slide, inputs: Any, motor: Any) -> Any:
    """Return f_h just before the sample, N: spring, damper, and the hand's mass with the acceleration at that
    moment."""
    hand, carriage, push = scene.operator, scene.carriage, _push(scene, inputs)
    pull = hand.stiffness * at.x + hand.damping * at.v
    if hand.mass == 0:
        return push - pull
    resisting = scene.device.damping * at.v
    if scene.friction is not None:
        resisting = resisting + friction_force(scene.friction, at.v, at.z, SYMBOLS)[0]
    share = hand.mass / carriage.mass
    return (1 - share) * (push - pull) - share * (motor - resisting)
