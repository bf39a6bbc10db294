"""Name the inputs of a scene's step: the intended motion, and the sensor's noise."""

from __future__ import annotations

# Inputs of a step: x_i [m] and v_i [m/s] at this sample and at the next, and the noise of the force
# sensor [N]
INPUT_NAMES = (
    "intended",
    "intended_velocity",
    "next_intended",
    "next_intended_velocity",
    "noise",
)
# Indices of the inputs
INTENDED, INTENDED_VELOCITY, NEXT_INTENDED, NEXT_INTENDED_VELOCITY, NOISE = range(len(INPUT_NAMES))
