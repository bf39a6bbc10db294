"""Name the inputs of a scene's step: the intended motion, the sensor's noise, and the move of the hand's grip."""

from __future__ import annotations

from vctune.model.numbers.arithmetic import Floats

# Inputs of a step: x_i [m] and v_i [m/s] at this sample and at the next, the noise of the force sensor [N], and the
# distance [m] by which the hand's grip moves just after the firmware samples the force
INPUT_NAMES = (
    "intended",
    "intended_velocity",
    "next_intended",
    "next_intended_velocity",
    "noise",
    "regrip",
)
# Indices of the inputs
INTENDED, INTENDED_VELOCITY, NEXT_INTENDED, NEXT_INTENDED_VELOCITY, NOISE, REGRIP = range(len(INPUT_NAMES))


def held_at(inputs: Floats, grip: float) -> Floats:
    """Return the inputs of a sample for a hand whose grip is not at 0."""
    shifted = inputs.copy()
    shifted[[INTENDED, NEXT_INTENDED]] += grip
    return shifted
