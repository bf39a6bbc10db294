"""Estimate the tracking term of many loops at once."""

from __future__ import annotations

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.model.gains import Gains
from vctune.model.loop.device_response import device_response
from vctune.model.loop.loop import loop_response
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.problem import Problem
from vctune.model.transparency import log_quadrature, loop_terms

NODES = 64  # Number of frequencies that `tracking_terms` evaluates


def tracking_terms(problem: Problem, gains: Gains) -> Floats:
    """Return the tracking term of many loops, an estimate on a grid of frequencies."""
    band, device = problem.transparency.band, problem.device
    omega, weights = log_quadrature(band.min, band.max, NODES)
    at, every = device_response(device, omega, FLOATS), Gains(gains.velocity[..., None], gains.position[..., None])
    squares = loop_terms(loop_response(at, every, FLOATS), at, device.kind).tracking
    return np.asarray(np.sqrt(squares @ weights if problem.transparency.norm == "rms" else squares.max(axis=-1)))
