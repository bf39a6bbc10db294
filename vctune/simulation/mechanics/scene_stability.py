"""Decide whether a scene's sampled loop, with hand and environment, is stable, from the eigenvalues of its linear
step."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi

import numpy as np

from vctune.interrupt import interrupt_deferred
from vctune.model.device import Device
from vctune.model.experiment import Baseline, Experiment
from vctune.model.numbers.arithmetic import Floats
from vctune.simulation.mechanics.hand_changes import (
    HandChanges,
    after_sample,
    from_state,
    hand_changes,
    scenes_of_hands,
    steps_of_hands,
)
from vctune.simulation.mechanics.step import build
from vctune.simulation.mechanics.step_inputs import INPUT_NAMES
from vctune.simulation.scene import Scene, baseline_scene

# Distance from 1 within which an eigenvalue belongs to a position without a restoring force, not to an oscillation
STANDING = 1e-6
# Number of decades, up and down from the file's virtual mass and damping, in which the code searches for a stable
# factor
DECADES = 4
BISECTIONS = 30  # Number of bisections of half a decade, down to 1e-9


@dataclass(frozen=True, slots=True)
class Mode:
    """The fastest growing, or slowest decaying, mode of a sampled loop: its factor per sample, and its frequency in
    Hz."""

    radius: float
    hz: float


def linear_scenes(scene: Scene) -> list[Scene]:
    """Return a scene without friction, quantisation, limit and noise. If the environment is a wall, return two scenes:
    in contact with the wall, and away from it."""
    law = replace(scene.law, position_resolution=0.0, limit=None)
    rendered = law.environment
    environments = [replace(rendered, wall=False)]
    if rendered.wall:
        environments.append(replace(rendered, damping=0.0, stiffness=0.0, zero=0.0, wall=False))
    return [
        replace(scene, friction=None, force_noise=0.0, law=replace(law, environment=environment))
        for environment in environments
    ]


def loop_matrix(scene: Scene) -> Floats:
    """Return the matrix of a linear scene's step from state to state. The function applies the step to unit states."""
    with interrupt_deferred():  # an interrupt must not end the compilation of the step
        step = build(scene)
        size, no_input = len(step.start), np.zeros(len(INPUT_NAMES))
        answers = [np.asarray(step.advance(state, no_input)[0]).ravel() for state in (np.zeros(size), *np.eye(size))]
    return np.array([answer - answers[0] for answer in answers[1:]]).T


def fastest_mode(scene: Scene) -> Mode:
    """Return the mode that decides whether hand, device and environment oscillate together."""
    T, changes = scene.device.sample_time, hand_changes(scene)
    if changes.every == 0:
        scenes = scenes_of_hands(scene) if changes.alternates else (scene,)
        modes = [_fastest(loop_matrix(linear), T) for of_hand in scenes for linear in linear_scenes(of_hand)]
    else:
        period = changes.every * (2 if changes.alternates else 1)
        modes = [_fastest(_period_matrix(linear, changes), T, period) for linear in linear_scenes(scene)]
    return max(modes, key=lambda mode: mode.radius)


def _period_matrix(scene: Scene, changes: HandChanges) -> Floats:
    """Return the matrix over one period of the changes: up to the next change, or the one after that if the damping
    alternates."""
    with interrupt_deferred():
        steps = steps_of_hands(scene, lambda now, then: build(now, then=then))

    def matrix(before_and_after: tuple[int, int], *, regrips: bool) -> Floats:
        """Return the matrix of a sample, given the numbers of the hands before and after the sensor's sample."""
        size = len(steps[before_and_after].start)

        def after(state_and_grip: Floats) -> Floats:
            advance = from_state(steps[before_and_after].advance, state_and_grip[:-1])
            state, _, grip = after_sample(advance, np.zeros(len(INPUT_NAMES)), state_and_grip[-1], regrips=regrips)
            return np.append(state, grip)

        at_zero = after(np.zeros(size + 1))
        return np.array([after(unit) - at_zero for unit in np.eye(size + 1)]).T

    product = np.eye(len(steps[0, 0].start) + 1)
    with interrupt_deferred():
        for now, then in [(0, 1), (1, 0)] if changes.alternates else [(0, 0)]:
            unchanged, changed = matrix((now, now), regrips=False), matrix((now, then), regrips=changes.regrips)
            product = changed @ np.linalg.matrix_power(unchanged, changes.every - 1) @ product
    return product if changes.regrips else product[:-1, :-1]


def _fastest(matrix: Floats, sample_time: float, samples: int = 1) -> Mode:
    """Return the fastest growing mode of a matrix that covers some samples. Eigenvalues near 1 do not count
    (`STANDING`)."""
    values = np.linalg.eigvals(matrix)
    counted = values[np.abs(values - 1) > STANDING]
    dominant = counted[np.argmax(np.abs(counted))]
    return Mode(
        float(abs(dominant)) ** (1 / samples), float(abs(np.angle(dominant)) / (2 * pi * sample_time * samples))
    )


def least_virtual(device: Device, experiment: Experiment, pid: Baseline) -> float | None:
    """Return the lower end of the uppermost range of factors with which a regular PID's loop is stable."""

    def stable(factor: float) -> bool:
        scaled = replace(pid, mass=factor * pid.mass, damping=factor * pid.damping)
        return fastest_mode(baseline_scene(device, experiment, scaled)).radius < 1

    factors = np.geomspace(10.0**DECADES, 10.0**-DECADES, 4 * DECADES + 1)
    is_stable = [stable(factor) for factor in factors]
    if True not in is_stable:
        return None
    greatest_stable = is_stable.index(True)
    if False not in is_stable[greatest_stable:]:
        return 0.0
    next_unstable = greatest_stable + is_stable[greatest_stable:].index(False)
    good, bad = float(factors[next_unstable - 1]), float(factors[next_unstable])
    for _ in range(BISECTIONS):
        middle = (good * bad) ** 0.5
        good, bad = (middle, bad) if stable(middle) else (good, middle)
    return good
