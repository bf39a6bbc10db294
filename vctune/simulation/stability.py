"""Decide whether a scene's sampled loop, with hand and environment, is stable, from the eigenvalues of its linear
step."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi

import numpy as np

from vctune.interrupt import interrupt_deferred
from vctune.model.numbers.arithmetic import Floats
from vctune.simulation.sample import INPUT_NAMES, build
from vctune.simulation.scene import Scene

# Distance from 1 within which an eigenvalue belongs to a position without a restoring force, not to an oscillation
STANDING = 1e-6


@dataclass(frozen=True, slots=True)
class Mode:
    """The fastest growing, or slowest decaying, mode of a sampled loop: its factor per sample, and its frequency."""

    radius: float
    hz: float


def loop_matrix(scene: Scene) -> Floats:
    """Return the matrix of a linear scene's step from state to state. The function applies the step to unit states."""
    with interrupt_deferred():  # an interrupt must not end the compilation of the step
        step = build(scene)
        size, no_input = len(step.start), np.zeros(len(INPUT_NAMES))
        answers = [np.asarray(step.advance(state, no_input)[0]).ravel() for state in (np.zeros(size), *np.eye(size))]
    return np.array([answer - answers[0] for answer in answers[1:]]).T


def fastest_mode(scene: Scene) -> Mode:
    """Return the mode that decides whether hand, device and environment oscillate together.

    The loop has no friction, quantisation, limit and noise. Before a wall, it is the worse of contact and release."""
    rendered = scene.law.environment
    environments = [replace(rendered, wall=False)]
    if rendered.wall:
        environments.append(replace(rendered, damping=0.0, stiffness=0.0, zero=0.0, wall=False))
    modes = []
    for environment in environments:
        law = replace(scene.law, position_resolution=0.0, limit=None, environment=environment)
        linear = replace(scene, friction=None, force_noise=0.0, law=law)
        values = np.linalg.eigvals(loop_matrix(linear))
        counted = values[np.abs(values - 1) > STANDING]
        dominant = counted[np.argmax(np.abs(counted))]
        modes.append(Mode(float(abs(dominant)), float(abs(np.angle(dominant)) / (2 * pi * scene.device.sample_time))))
    return max(modes, key=lambda mode: mode.radius)
