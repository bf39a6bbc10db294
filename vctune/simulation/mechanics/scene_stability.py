"""Decide whether a scene's sampled loop, with hand and environment, is stable, from the eigenvalues of its linear
step."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi

import numpy as np

from vctune.interrupt import interrupt_deferred
from vctune.model.numbers.arithmetic import Floats
from vctune.simulation.mechanics.step import build
from vctune.simulation.mechanics.step_inputs import INPUT_NAMES
from vctune.simulation.scene import Scene

# Distance from 1 within which an eigenvalue belongs to a position without a restoring force, not to an oscillation
STANDING = 1e-6


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
    T = scene.device.sample_time
    modes = [_fastest(loop_matrix(linear), T) for linear in linear_scenes(scene)]
    return max(modes, key=lambda mode: mode.radius)


def _fastest(matrix: Floats, sample_time: float) -> Mode:
    """Return the fastest growing mode of a matrix. Eigenvalues near 1 do not count (`STANDING`)."""
    values = np.linalg.eigvals(matrix)
    counted = values[np.abs(values - 1) > STANDING]
    dominant = counted[np.argmax(np.abs(counted))]
    return Mode(float(abs(dominant)), float(abs(np.angle(dominant)) / (2 * pi * sample_time)))
