"""Name the inputs of a scene's step: the intended motion, the sensor's noise, and the move of the hand's grip."""

from __future__ import annotations

from vctune.model.numbers.arithmetic import Floats

INPUT_NAMES = (
    "intended",
    "intended_velocity",
    "next_intended",
    "next_intended_velocity",
    "noise",
    "regrip",
)
"""Inputs of a step: x_i [m] and v_i [m/s] at this sample and at the next, the noise of the force sensor [N], and the
distance [m] by which the hand's grip moves just after the firmware samples the force."""
INTENDED, INTENDED_VELOCITY, NEXT_INTENDED, NEXT_INTENDED_VELOCITY, NOISE, REGRIP = range(len(INPUT_NAMES))
"""Indices of the inputs."""


def held_at(inputs: Floats, grip: float) -> Floats:
    """Return the inputs of a sample for a hand whose grip is not at 0.

    Parameters
    ----------
    inputs : inputs of the sample for a hand that holds at 0
    grip : position at which the hand holds, m
    """
    shifted = inputs.copy()
    shifted[[INTENDED, NEXT_INTENDED]] += grip
    return shifted
