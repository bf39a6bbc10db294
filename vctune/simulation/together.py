"""One sample of many handles at once, in NumPy: the equations of `sample.py`, with a hand for each lane."""

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


def held_by(hand: Hand) -> MovingHand:
    """Return a hand of a box as one that stays at 0."""
    mass, damping, stiffness = map(float, (hand.mass, hand.damping, hand.stiffness))
    return MovingHand(motion="hold", start=0.0, end=0.0, mass=mass, damping=damping, stiffness=stiffness)


@dataclass(frozen=True)
class Together:
    """A scene in several hands, one for each lane. Its friction, if any, is dry."""

    scene: Scene
    moving: Plant  # rows of shape (n, lanes)
    firmware: tuple[Controller, State]
    changes: tuple[Floats, ...]  # of a step in each interval of a sample, shape (n, n, lanes)

    @cached_property
    def start(self) -> Parts:
        """The state of every lane at rest at 0, of arrays of shape (lanes,)."""
        parts = begun(self.scene, self.moving, self.firmware[1], STILL)
        lanes = self.changes[0].shape[-1]
        return {name: [np.zeros(lanes) for _ in numbers] for name, numbers in parts.items()}

    def of(self, lanes: NDArray[Any]) -> Together:
        """Return some of the lanes."""
        moving = _with_rows(self.moving, lambda name: getattr(self.moving, name)[:, lanes])
        return replace(self, moving=moving, changes=tuple(c[..., lanes] for c in self.changes))

    def advance(self, now: Parts, push: Number) -> tuple[Parts, list[Number]]:
        """Return the states after a sample with a constant push of the hands, N, and the columns of `sampled`."""
        given = [push, 0.0, 0.0, 0.0], 0.0
        return sampled(
            self.scene, self.moving, self.firmware, now, given, lambda velocity, z: z, self._move, ARRAYS
        )  # fmt: skip

    def _move(
        self, values: list[Number], z: Number, held: Sequence[Number]
    ) -> tuple[list[Number], Number, list[Number]]:
        device, n, (late, early), between = self.scene.device, len(self.moving.states), held, list[Number]()
        when, lanes = timing(device), self.changes[0].shape[-1]
        at = np.array([np.broadcast_to(value, (lanes,)) for value in values])
        for (begin, end), change in zip(when.intervals(device.sample_time), self.changes, strict=True):
            at[n + COMMAND] = early if end <= when.early else late
            at[n + FRICTION] = 0.0
            if (friction := self.scene.friction) is None:
                at = at + np.einsum("ijl,jl->il", change, at)
            else:
                steps = _steps_in(self.scene, friction, end - begin)
                given = np.einsum("ijl,jl->il", change[:n, n:], at[n:])
                own, by_friction, body = change[:n, :n], change[:n, n + FRICTION], at[:n]
                for _ in range(steps):
                    free = body + np.einsum("ijl,jl->il", own, body) + given
                    z = dry_force(friction.coulomb, free[1], -by_friction[1], ARRAYS)
                    body = free + by_friction * z
                at[:n] = body
            if end == when.instant:
                at[n + FRICTION] = z
                between = [(self.moving.sensed * at).sum(axis=0)]
        return list(at), z, between


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
    changes = list[Floats]()
    for begin, end in timing(scene.device).intervals(scene.device.sample_time):
        step = end - begin if scene.friction is None else (end - begin) / _steps_in(scene, scene.friction, end - begin)
        change = (exponentials(scaled * step) - np.eye(scaled.shape[-1])) / units[:, None] * units[:, :, None]
        changes.append(np.moveaxis(change, 0, -1))
    return Together(scene, moving, (c, at_rest(c, 0.0, 0.0)), tuple(changes))


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
