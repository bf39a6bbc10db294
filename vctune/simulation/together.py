"""One sample of many handles at once, in NumPy: the equations of `sample.py`, with a hand for each lane, and a wall if
the lanes have walls of their own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vctune.model.experiment import Friction, MovingHand
from vctune.model.hands import Hand
from vctune.model.numbers.arithmetic import Floats, Number
from vctune.model.numbers.matrices import exponentials
from vctune.simulation.controller import Controller, Operations, State, at_rest, controller_of
from vctune.simulation.friction import dry_force, steps_per_sample
from vctune.simulation.plant import GIVEN, Plant, plant
from vctune.simulation.sample import Parts, begun, sampled, timing
from vctune.simulation.scene import Equilibrium, Scene

ARRAYS = Operations(np.exp, np.expm1, np.abs, np.floor, np.minimum, np.maximum, np.where)
COMMAND, FRICTION = GIVEN.index("command"), GIVEN.index("friction")
STILL = Equilibrium(0.0, 0.0, 0.0, 0.0, 0.0)
# Share of what the whole friction would change in a time, within which a handle that it holds is at rest
AT_REST = 1e-9


def held_by(hand: Hand) -> MovingHand:
    """Return a hand of a box as one that stays at 0."""
    mass, damping, stiffness = map(float, (hand.mass, hand.damping, hand.stiffness))
    return MovingHand(motion="hold", start=0.0, end=0.0, mass=mass, damping=damping, stiffness=stiffness)


@dataclass(frozen=True)
class Together:
    """A scene in several hands, one for each lane. Its friction, if any, is dry."""

    scene: Scene
    moving: Plant  # rows of shape (n, lanes)
    firmware: tuple[Controller, State]  # its wall has shape (lanes,) if the lanes have walls of their own
    wholes: tuple[Floats, ...]  # change in each interval of a sample, shape (n, n, lanes)
    steps: tuple[Floats, ...]  # change in one of the steps of each interval in which friction may stop the motor

    @cached_property
    def start(self) -> Parts:
        """The state of every lane at rest at 0, of arrays of shape (lanes,)."""
        parts = begun(self.scene, self.moving, self.firmware[1], STILL)
        lanes = self.wholes[0].shape[-1]
        return {name: [np.zeros(lanes) for _ in numbers] for name, numbers in parts.items()}

    def of(self, lanes: NDArray[Any]) -> Together:
        """Return some of the lanes."""
        moving = _with_rows(self.moving, lambda name: getattr(self.moving, name)[:, lanes])
        controller, state = self.firmware
        if np.ndim(controller.coupling_stiffness):
            controller = with_walls(
                controller, controller.coupling_stiffness[lanes], controller.coupling_damping[lanes]
            )
        return replace(
            self,
            moving=moving,
            firmware=(controller, state),
            wholes=tuple(change[..., lanes] for change in self.wholes),
            steps=tuple(change[..., lanes] for change in self.steps),
        )

    def advance(self, now: Parts, push: Number) -> tuple[Parts, list[Number]]:
        """Return the states after a sample with a constant push of the hands, N, and the columns of `sampled`."""
        given = [push, 0.0, 0.0, 0.0], 0.0
        return sampled(
            self.scene, self.moving, self.firmware, now, given, lambda velocity, z: z, self._move, ARRAYS
        )  # fmt: skip

    def _move(
        self, values: list[Number], z: Number, held: Sequence[Number]
    ) -> tuple[list[Number], Number, list[Number]]:
        device = self.scene.device
        n = len(self.moving.states)
        late, early = held
        between = list[Number]()
        when = timing(device)
        lanes = self.wholes[0].shape[-1]
        at = np.empty((len(values), lanes))
        for row, value in enumerate(values):
            at[row] = value
        intervals = when.intervals(device.sample_time)
        for (begin, end), whole, step in zip(intervals, self.wholes, self.steps, strict=True):
            at[n + COMMAND] = early if end <= when.early else late
            at[n + FRICTION] = 0.0
            if (friction := self.scene.friction) is None:
                at = at + _times(whole, at)
            else:
                count = _steps_in(self.scene, friction, end - begin)
                at[:n], z = _rubbed(at, n, friction.coulomb, whole, step, count)
            if end == when.instant:
                at[n + FRICTION] = z
                between = [(self.moving.sensed * at).sum(axis=0)]
        return list(at), z, between


def _times(matrices: Floats, vectors: Floats) -> Floats:
    """Return the product of a matrix, shape (n, m, lanes), and a vector, shape (m, lanes), of each lane."""
    return np.asarray(np.einsum("ijl,jl->il", matrices, vectors))


def _rubbed(values: Floats, n: int, coulomb: float, whole: Floats, step: Floats, count: int) -> tuple[Floats, Floats]:
    """Return the n states and the friction of each lane, N, after an interval with dry friction.

    A motor that moves the same way at both ends has met the greatest friction all the time, and one that is held
    throughout does not move: one step is exact. The others are followed in `count` steps, in each of which the friction
    is the force that stops the motor, or the greatest one.

    Parameters
    ----------
    values : Floats
        States and given inputs, shape (n + 6, lanes), with a friction of 0.
    n : int
        Number of states, the first two of which are position and velocity of the motor.
    coulomb : float
        Greatest friction, N.
    whole, step : Floats
        Changes over the interval and over one of the `count` steps, shape (n + 6, n + 6, lanes).
    count : int
        Number of steps.
    """
    body = values[:n]
    free = body + _times(whole[:n], values)
    by_friction = whole[:n, n + FRICTION]
    slid = coulomb * np.sign(body[1])
    holding = dry_force(coulomb, free[1], -by_friction[1], ARRAYS)
    slides = body[1] * (free[1] + by_friction[1] * slid) > 0
    little = AT_REST * coulomb * np.abs(by_friction[:2])
    held = (np.abs(body[1]) <= little[1]) & (np.abs(holding) < coulomb)
    held &= np.abs(free[0] + by_friction[0] * holding - body[0]) <= little[0]
    z = np.where(slides, slid, holding)
    after = free + by_friction * z
    # without the rounding, whose sum over many samples would be a motion
    after[:2] = np.where(held, [body[0], np.zeros_like(z)], after[:2])
    if (turns := np.flatnonzero(~(slides | held))).size:
        after[:, turns], z[turns] = _in_steps(values[:, turns], n, coulomb, step[..., turns], count)
    return after, z


def _in_steps(values: Floats, n: int, coulomb: float, step: Floats, count: int) -> tuple[Floats, Floats]:
    """Return what `_rubbed` does, in steps."""
    body = values[:n]
    given = _times(step[:n, n:], values[n:])
    own = step[:n, :n] + np.eye(n)[..., None]
    by_friction = step[:n, n + FRICTION]
    z = np.zeros(values.shape[1])
    for _ in range(count):
        free = _times(own, body) + given
        z = dry_force(coulomb, free[1], -by_friction[1], ARRAYS)
        body = free + by_friction * z
    return body, z


def with_walls(controller: Controller, stiffness: Floats, damping: Floats) -> Controller:
    """Return a firmware before a rigid world with a wall for each lane, N/m and N s/m, shape (lanes,)."""
    return replace(controller, coupling_stiffness=stiffness, coupling_damping=damping)


def _with_rows(moving: Plant, row: Callable[[str], Floats]) -> Plant:
    """Return a plant with other rows of the handle and the sensor."""
    position, velocity, force, sensed = map(row, ("position", "velocity", "force", "sensed"))
    return replace(moving, position=position, velocity=velocity, force=force, sensed=sensed)


def _steps_in(scene: Scene, friction: Friction, length: float) -> int:
    """Return the number of steps with friction in a part of a sample."""
    share = steps_per_sample(friction, scene.device, scene.operator) * length / scene.device.sample_time
    return max(1, int(np.ceil(share * (1 - 1e-12))))


def together(scene: Scene, hands: Sequence[Hand]) -> Together:
    """Return a scene, whose own hand does not count, in several hands."""
    mass, damping, stiffness = np.array([(hand.mass, hand.damping, hand.stiffness) for hand in hands]).T
    held = replace(held_by(hands[0]), mass=mass, damping=damping, stiffness=stiffness)
    moving, c = plant(scene.device, held), controller_of(scene.law)
    units = moving.units.T
    scaled = np.moveaxis(moving.rates, -1, 0) * units[:, None] / units[:, :, None]

    def change(time: float) -> Floats:
        changes = (exponentials(scaled * time) - np.eye(scaled.shape[-1])) / units[:, None] * units[:, :, None]
        return np.ascontiguousarray(np.moveaxis(changes, 0, -1))

    lengths = [end - begin for begin, end in timing(scene.device).intervals(scene.device.sample_time)]
    wholes = tuple(change(length) for length in lengths)
    steps = wholes
    if (friction := scene.friction) is not None:
        steps = tuple(change(length / _steps_in(scene, friction, length)) for length in lengths)
    return Together(scene, moving, (c, at_rest(c, 0.0, 0.0)), wholes, steps)


def matrices_of(scene: Scene, hands: Sequence[Hand]) -> Floats:
    """Return the matrices of the step of a linear scene from state to state, shape (hands, n, n), from unit states."""
    one, count = together(scene, hands), len(hands)
    size = sum(map(len, one.start.values()))
    lanes, now, k = one.of(np.repeat(np.arange(count), size + 1)), dict[str, list[Number]](), 0
    units = np.hstack([np.zeros((size, 1)), np.eye(size)])  # at rest first: an environment may have its zero elsewhere
    for name, numbers in one.start.items():
        now[name] = list(np.tile(units, (1, count))[k : k + len(numbers)])
        k += len(numbers)
    after, _ = lanes.advance(now, 0.0)
    rows = [np.broadcast_to(number, units.shape[1] * count) for numbers in after.values() for number in numbers]
    ends = np.moveaxis(np.array(rows, float).reshape(size, count, size + 1), 1, 0)
    return ends[..., 1:] - ends[..., :1]
