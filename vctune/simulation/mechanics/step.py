"""Compile one sample of a scene into a function, assembled from the parts of the scene. This module imports casadi.

In a sample, the firmware reads the sensors and runs, and the device moves for a sample time under the forces that have
arrived. Friction, quantisation, saturation, filters, the coupling and a device's parts add operations to the function
only if the scene has them.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from vctune.model.experiment import Friction
from vctune.model.loop.drive import drive_at_rest
from vctune.simulation.firmware.controller import Measurement, State, control, encoded, remembered_by
from vctune.simulation.firmware.operations import FLOATS
from vctune.simulation.mechanics import rigid_motion
from vctune.simulation.mechanics.assembly import Assembly, applied, assembly, sensing
from vctune.simulation.mechanics.assembly import transition as assembled_transition
from vctune.simulation.mechanics.friction import Slide, friction_force
from vctune.simulation.mechanics.intended_motion import Floats, hand_force_derivatives
from vctune.simulation.mechanics.rigid_motion import timing
from vctune.simulation.mechanics.stretches import SYMBOLS, Stretch, fixed_steps, push_at
from vctune.simulation.scene import Equilibrium, Scene, equilibrium

CHUNK = 1024
"""Number of samples per call of the compiled function. Progress and Ctrl-C wait for the end of a call. Half or twice as
many samples take the same time."""
COLUMNS = ("position", "velocity", "force", "reference", "desired", "environment_force", "motor", "sensed")
"""Recorded columns of each sample: x, v, f_h, x_e, v_e, f_e, u, f_s. In a record, x and v belong to the handle, and f_s
is the sensed f_h."""
MOTOR_COLUMNS = ("motor_position", "motor_velocity")
"""Additional recorded columns if motor and handle move differently."""
ANSWER = ("reference", "desired", "environment_force", "motor")
"""Columns that a firmware outputs. An open step takes them as inputs after `INPUTS`."""
INPUTS = 6
"""Number of inputs of a step: x_i and v_i at this sample and at the next, the noise of the force sensor, and the
distance by which the hand's grip moves just after the firmware samples the force."""


@dataclass(frozen=True, slots=True)
class Step:
    """A compiled step, one(state, inputs) -> (state, record), and its state at rest at the start of the motion.

    The state contains x, v and the other moving parts, z if there is friction, and the force sensed within the last
    sample if there is one. The state also contains the firmware's state, and the commands and sensed forces that are
    still delayed.
    """

    one: Any
    start: Floats

    def chunk(self) -> Any:
        """Return the function for `CHUNK` samples, samples(state, inputs) -> (states, records), with a column for each
        sample."""
        return self.one.mapaccum(CHUNK)


@dataclass(frozen=True, slots=True)
class OpenStep:
    """A compiled step without its firmware.

    The function sense(state, inputs) -> (position, velocity, force) returns the firmware's input. The function
    one(state, inputs) -> (state, record) takes the firmware's output, `ANSWER`, after its other inputs.
    """

    sense: Any
    one: Any
    start: Floats


def build(scene: Scene, stretch: Stretch = fixed_steps, then: Scene | None = None) -> Step:
    """Assemble and compile the step of a scene; `stretch` integrates the friction.

    Parameters
    ----------
    scene : the scene of the run
    stretch : function that integrates the friction; not used without friction
    then : the scene with the hand from this sample on; the next sample is the first to sense its force. None if the
        hand does not change

    Returns
    -------
    Step
        In SI units. Its inputs are `INPUTS`, its record has the columns of `columns`.
    """
    wired = _wire(scene, INPUTS)
    memory = {field.name: ca.SX.sym(field.name) for field in fields(State)}
    remembered, command = control(scene.law, State(**memory), wired.measurement, SYMBOLS)
    changed = remembered_by(scene.law)
    known = {"reference": wired.begin.reference, "measured": encoded(scene.law, wired.begin.position, FLOATS)}
    firmware = _Firmware(
        memory=[memory[name] for name in changed],
        kept=[getattr(remembered, name) for name in changed],
        start=[known.get(name, 0.0) for name in changed],
        answer=[remembered.reference, remembered.desired, command.environment, command.given],
    )
    return _compiled(scene, stretch, wired, firmware, then)


def build_open(scene: Scene, stretch: Stretch = fixed_steps, then: Scene | None = None) -> OpenStep:
    """Assemble and compile the step of a scene without its firmware.

    Parameters
    ----------
    scene : the scene of the run; the function uses only the encoder of its law
    stretch : function that integrates the friction; not used without friction
    then : as in `build`

    Returns
    -------
    OpenStep
        Two compiled functions: the firmware's measurement, and a sample with the firmware's output.
    """
    wired = _wire(scene, INPUTS + len(ANSWER))
    given = [wired.inputs[INPUTS + k] for k in range(len(ANSWER))]
    step = _compiled(scene, stretch, wired, _Firmware([], [], [], given), then)
    read = wired.measurement
    position = encoded(scene.law, read.position, SYMBOLS)
    states = ca.vertcat(wired.body, *wired.queue, *wired.late)
    sense = ca.Function("sense", [states, wired.inputs[:INPUTS]], [ca.vertcat(position, read.velocity, read.force)])
    return OpenStep(sense, step.one, step.start)


@dataclass(frozen=True, slots=True)
class _Wired:
    """The symbols of a scene around its firmware: body, delayed commands and forces, and inputs."""

    begin: Equilibrium
    mechanism: Assembly | None
    body: Any
    inputs: Any
    queue: list[Any]
    late: list[Any]
    motion: _Seen
    measurement: Measurement


@dataclass(frozen=True, slots=True)
class _Firmware:
    """The state of a firmware before and after a sample and at the start, and its outputs, as in `ANSWER`."""

    memory: list[Any]
    kept: list[Any]
    start: list[float]
    answer: list[Any]


def _wire(scene: Scene, inputs: int) -> _Wired:
    when, sensed, moving, begin = timing(scene), sensing(scene), assembly(scene), equilibrium(scene)
    body, given = ca.SX.sym("body", len(_at_rest(scene, moving, begin))), ca.SX.sym("inputs", inputs)
    # commands that have not acted completely, the newest first; a servo moves from one position to the next
    queue = [ca.SX.sym(f"u{age}") for age in range(when.whole_samples + (2 if _interpolates(scene) else 1))]
    late = [ca.SX.sym(f"f{age}") for age in range(sensed.whole_samples)]  # forces that are sensed but not yet read
    seen = _seen(scene, moving, body, given, _acting(scene, queue)[-1])
    oldest = [seen.sensed, *late][-1]
    felt = oldest + given[4] if scene.force_noise > 0 else oldest
    return _Wired(begin, moving, body, given, queue, late, seen, Measurement(seen.motor.x, seen.motor.v, felt))


def _compiled(scene: Scene, stretch: Stretch, wired: _Wired, firmware: _Firmware, then: Scene | None) -> Step:
    moved = scene if then is None else then
    mechanism = wired.mechanism if then is None else assembly(then)
    seen, inputs, body, begin = wired.motion, wired.inputs, wired.body, wired.begin
    commanded = [firmware.answer[-1], *wired.queue]
    record = [seen.handle.x, seen.handle.v, seen.force, *firmware.answer, wired.measurement.force]
    record += [seen.motor.x, seen.motor.v] if scene.device.structure is not None else []
    arriving = [seen.sensed, *wired.late]
    state = ca.vertcat(body, *firmware.memory, *wired.queue, *wired.late)
    kept, acting = ca.vertcat(*firmware.kept, *commanded[:-1], *arriving[:-1]), _acting(scene, commanded)
    start = [
        *_at_rest(scene, wired.mechanism, begin),
        *firmware.start,
        *(begin.motor for _ in wired.queue),
        *(begin.hand for _ in wired.late),
    ]
    if scene.friction is None:
        exact = _moved_exactly(moved, mechanism, body, inputs, acting)
        one = ca.Function("one", [state, inputs], [ca.vertcat(exact, kept), ca.vertcat(*record)])
    else:
        given = ca.Function("firmware", [state, inputs], [kept, ca.vertcat(*record), acting[-1], acting[-2]])
        one = _with_friction(moved, mechanism, scene.friction, stretch, given)
    return Step(one, np.array(start))


def _interpolates(scene: Scene) -> bool:
    """Return whether the device moves linearly from one command to the next."""
    return scene.law.command == "position"


def _acting(scene: Scene, commanded: list[Any]) -> list[Any]:
    """Return the held values of commands, one for each sample.

    A position command becomes the velocity from the previous position.
    """
    if not _interpolates(scene):
        return commanded
    return [(newer - older) / scene.device.sample_time for newer, older in pairwise(commanded)]


def columns(scene: Scene) -> tuple[str, ...]:
    """Return the recorded columns of a scene's step."""
    return COLUMNS if scene.device.structure is None else COLUMNS + MOTOR_COLUMNS


def _at_rest(scene: Scene, moving: Assembly | None, begin: Equilibrium) -> list[float]:
    """Return the body's part of the state at the start of the motion."""
    known = {"position": begin.position, "bend": begin.bend, "sensed": begin.hand}
    known |= {name: share * begin.motor for name, share in drive_at_rest(scene.device).items()}
    body = [known.get(name, 0.0) for name in (moving.states if moving is not None else ("position", "velocity"))]
    body += [0.0] if scene.friction is not None else []
    return body if sensing(scene).instant is None else [*body, begin.hand]


@dataclass(frozen=True, slots=True)
class _Seen:
    """The values at a sample: motor and handle, f_h, and the newest force of the sensor, N."""

    motor: Slide
    handle: Slide
    force: Any
    sensed: Any


def _seen(scene: Scene, moving: Assembly | None, body: Any, inputs: Any, motor: Any) -> _Seen:
    n = 2 if moving is None else moving.size
    at = Slide(body[0], body[1], body[n] if scene.friction is not None else 0.0)
    if moving is None:
        hand = _hand_force(scene, at, inputs, motor)
        return _Seen(at, at, hand, hand)
    push = scene.operator.stiffness * inputs[0] + scene.operator.damping * inputs[1]
    values = _values(scene, ca.vertsplit(body[: n + (scene.friction is not None)]), n, motor, push)
    handle = Slide(applied(moving.position, values), applied(moving.velocity, values), 0.0)
    force = applied(moving.force, values)
    now = force if moving.sensed is moving.force else applied(moving.sensed, values)
    return _Seen(at, handle, force, now if sensing(scene).instant is None else body[-1])


def _values(scene: Scene, body: list[Any], size: int, motor: Any, push: Any) -> list[Any]:
    """Return states and inputs at a moment, as in `assembly.GIVEN`; the derivatives of the push are not used."""
    rubbed = 0.0 if scene.friction is None else friction_force(scene.friction, body[1], body[size], SYMBOLS)[0]
    return [*body[:size], motor, rubbed, push, 0.0, 0.0, 0.0]


def _felt(scene: Scene, moving: Assembly, time: float) -> Any:
    """Return the function (body, motor, push) -> sensed force, at a given time after the sample."""
    body, motor, push = ca.SX.sym("body", moving.size + 1), ca.SX.sym("motor"), ca.SX.sym("push", 4)
    values = _values(scene, ca.vertsplit(body), moving.size, motor, push_at(push, time))
    return ca.Function("felt", [body, motor, push], [applied(moving.sensed, values)])


def _hand_force(scene: Scene, at: Slide, inputs: Any, motor: Any) -> Any:
    """Return f_h just before the sample: spring, damper, and the hand's mass with the acceleration at that moment."""
    hand, carriage = scene.operator, scene.carriage
    push = hand.stiffness * inputs[0] + hand.damping * inputs[1]
    pull = hand.stiffness * at.x + hand.damping * at.v
    if hand.mass == 0:
        return push - pull
    resisting = scene.device.damping * at.v
    if scene.friction is not None:
        resisting = resisting + friction_force(scene.friction, at.v, at.z, SYMBOLS)[0]
    share = hand.mass / carriage.mass
    return (1 - share) * (push - pull) - share * (motor - resisting)


def _moved_exactly(scene: Scene, moving: Assembly | None, body: Any, inputs: Any, acting: list[Any]) -> Any:
    exact = rigid_motion.transition(scene) if moving is None else assembled_transition(scene, moving)
    moved = ca.mtimes(ca.DM(exact.state), body) + ca.mtimes(ca.DM(exact.motion), _motion(scene, inputs))
    moved = moved + ca.DM(exact.late) * acting[-2]
    return moved + ca.DM(exact.early) * acting[-1] if exact.early.any() else moved


def _motion(scene: Scene, inputs: Any) -> Any:
    """Return x_i and v_i at this sample and at the next, for the grip from this sample on."""
    if not scene.operator.regrip:
        return inputs[:4]
    return ca.vertcat(inputs[0] + inputs[5], inputs[1], inputs[2] + inputs[5], inputs[3])


def _with_friction(scene: Scene, moving: Assembly | None, friction: Friction, stretch: Stretch, firmware: Any) -> Any:
    """Return the step of a device with friction.

    A step computes the firmware, and then the motion over stretches of time with constant motor force. There are one or
    two stretches, and one more if the firmware senses the force within a stretch.
    """
    when, push = timing(scene), ca.DM(hand_force_derivatives(scene.operator, scene.device.sample_time))
    state, inputs = ca.MX.sym("state", firmware.size_in(0)), ca.MX.sym("inputs", firmware.size_in(1))
    kept, record, early, late = firmware(state, inputs)
    motion = _motion(scene, inputs)
    body, felt = state[: 3 if moving is None else moving.size + 1], []
    instant, T = sensing(scene).instant, scene.device.sample_time
    for begin, end in pairwise(sorted({0.0, when.early, T} | ({instant} if instant is not None else set()))):
        motor = early if end <= when.early else late
        body = stretch(scene, friction, begin, end - begin)(body, motor, ca.mtimes(push, motion))
        if end == instant and moving is not None:
            felt = [_felt(scene, moving, end)(body, motor, ca.mtimes(push, motion))]
    return ca.Function("one", [state, inputs], [ca.vertcat(body, *felt, kept), record])
