"""Simulate a hand that changes during a run: its damping alternates, or it regrips the handle."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vctune.model.numbers.arithmetic import Floats
from vctune.simulation.mechanics.step_inputs import INTENDED, REGRIP, held_at
from vctune.simulation.scene import Scene

# Function that returns the state after a sample and the sample's record, given its inputs
OneSample = Callable[[Floats], tuple[Floats, Floats]]


@dataclass(frozen=True, slots=True)
class HandChanges:
    """The times at which the hand of a scene changes, and the kinds of change."""

    every: int  # number of samples from one change to the next
    changes_at: tuple[int, ...]  # samples at which the hand changes, in ascending order
    alternates: bool  # whether the hand's damping changes
    regrips: bool  # whether the hand regrips the handle at each change

    def changes_after(self, sample: int) -> bool:
        """Return whether the hand changes just after a sample."""
        return sample > 0 and self._until(sample) > self._until(sample - 1)

    def hands(self, sample: int) -> tuple[int, int]:
        """Return the index of the hand whose force the sensor samples, and the index of the hand after this sample."""
        if not self.alternates:
            return 0, 0
        return self._until(max(sample - 1, 0)) % 2, self._until(sample) % 2

    def _until(self, sample: int) -> int:
        """Return the number of changes up to a sample."""
        return sample // self.every if self.every else bisect_right(self.changes_at, sample)

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """All pairs of hands that `hands` can return."""
        return [(0, 0), (0, 1), (1, 1), (1, 0)] if self.alternates else [(0, 0)]


def hand_changes(scene: Scene) -> HandChanges:
    """Return how the hand of a scene changes."""
    hand = scene.operator
    if not hand.changes:
        return HandChanges(0, (), alternates=False, regrips=False)
    T, alternates = scene.device.sample_time, hand.other_damping is not None
    if hand.dwell is None:
        changes_at = tuple(max(1, round(time / T)) for time in hand.changes_at)
        return HandChanges(0, changes_at, alternates=alternates, regrips=hand.regrip)
    return HandChanges(max(1, round(hand.dwell / T)), (), alternates=alternates, regrips=hand.regrip)


def scenes_of_hands(scene: Scene) -> tuple[Scene, Scene]:
    """Return two scenes: with the hand of the first interval between changes, and with the hand of the second interval.
    They are the same scene if the damping does not change."""
    other = scene.operator.other_damping
    return scene, scene if other is None else replace(scene, operator=replace(scene.operator, damping=other))


def steps_of_hands(scene: Scene, build: Callable[[Scene, Scene], Any]) -> dict[tuple[int, int], Any]:
    """Return the step of each pair of hands, by `HandChanges.pairs`."""
    hands = scenes_of_hands(scene)
    return {(now, then): build(hands[now], hands[then]) for now, then in hand_changes(scene).pairs}


def after_sample(advance: OneSample, inputs: Floats, grip: float, *, regrips: bool) -> tuple[Floats, Floats, float]:
    """Return the state after a sample, the sample's record, and the position at which the hand then holds the
    handle."""
    held_inputs = held_at(inputs, grip)
    state, record = advance(held_inputs)
    if not regrips:
        return state, record, grip
    # regripping relaxes the spring: the new grip plus the intended position is the handle's position (column 0)
    new_grip = float(record[0]) - inputs[INTENDED]
    held_inputs[REGRIP] = new_grip - grip
    return *advance(held_inputs), new_grip


def from_state(step: Any, state: Floats) -> OneSample:
    """Return a compiled step from a state, with arrays instead of CasADi's matrices."""

    def advance(inputs: Floats) -> tuple[Floats, Floats]:
        after, record = step(state, inputs)
        return np.asarray(after).ravel(), np.asarray(record).ravel()

    return advance
