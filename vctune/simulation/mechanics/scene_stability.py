"""Decide whether a scene's sampled loop, with hand and environment, is stable, from the eigenvalues of its linear
step."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi

import numpy as np

from vctune.interrupt import interrupt_deferred
from vctune.model.device import Device
from vctune.model.experiment import Baseline, Experiment
from vctune.simulation.mechanics.intended_motion import Floats
from vctune.simulation.mechanics.step import INPUTS, build
from vctune.simulation.scene import Scene, baseline_scene

STANDING = 1e-6
"""Distance from 1 within which an eigenvalue is a position without a restoring force, not an oscillation. A double
eigenvalue is computed to the square root of rounding, 1e-8. Half and twice this distance only matter for a mode of a
million samples."""
DECADES = 4
"""Number of decades, up and down from the file's virtual mass and damping, in which a stable share is sought. Half and
twice as many change no result within them."""
BISECTIONS = 30
"""Number of bisections of half a decade, down to 1e-9. Half as many leave 4e-5, which sometimes shows in the fourth
digit; twice as many reach rounding errors."""


@dataclass(frozen=True, slots=True)
class Mode:
    """The mode of a sampled loop that grows the fastest: factor per sample, and frequency in Hz."""

    radius: float
    hz: float


def linear_scenes(scene: Scene) -> list[Scene]:
    """Return a scene without friction, quantisation, limit and noise; with a wall, one scene in contact and one
    away."""
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
    """Return the matrix of a linear scene's step, from state to state, by the step's results for unit states."""
    with interrupt_deferred():
        step = build(scene)
        size, no_input = len(step.start), np.zeros(INPUTS)
        answers = [np.asarray(step.one(state, no_input)[0]).ravel() for state in (np.zeros(size), *np.eye(size))]
    return np.array([answer - answers[0] for answer in answers[1:]]).T


def fastest_mode(scene: Scene) -> Mode:
    """Return the mode that decides whether hand, device and environment oscillate together."""
    modes = [_fastest(loop_matrix(linear), scene.device.sample_time) for linear in linear_scenes(scene)]
    return max(modes, key=lambda mode: mode.radius)


def _fastest(matrix: Floats, sample_time: float) -> Mode:
    values = np.linalg.eigvals(matrix)
    oscillating = values[np.abs(values - 1) > STANDING]
    dominant = oscillating[np.argmax(np.abs(oscillating))]
    return Mode(float(abs(dominant)), float(abs(np.angle(dominant)) / (2 * pi * sample_time)))


def least_virtual(device: Device, experiment: Experiment, pid: Baseline) -> float | None:
    """Return the smallest factor on the virtual mass and damping of a regular PID above which its loop is stable.

    The search covers 10^-`DECADES` to 10^`DECADES` times the values of the file.

    Parameters
    ----------
    device : device with plain numbers, SI units
    experiment : the experiment of the run
    pid : the regular PID, with the mass and the damping that the search varies

    Returns
    -------
    float or None
        The factor; 0 if the loop is stable with almost nothing, None if no tried factor is stable.
    """

    def stable(share: float) -> bool:
        lighter = replace(pid, mass=share * pid.mass, damping=share * pid.damping)
        return fastest_mode(baseline_scene(device, experiment, lighter)).radius < 1

    shares = np.geomspace(10.0**DECADES, 10.0**-DECADES, 4 * DECADES + 1)
    found = [stable(share) for share in shares]
    if True not in found:
        return None
    begin = found.index(True)
    if False not in found[begin:]:
        return 0.0
    first = begin + found[begin:].index(False)
    good, bad = float(shares[first - 1]), float(shares[first])
    for _ in range(BISECTIONS):
        middle = (good * bad) ** 0.5
        good, bad = (middle, bad) if stable(middle) else (good, middle)
    return good
