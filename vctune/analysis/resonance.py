"""Add frequencies near the resonance of a handle on a spring, which a grid of constant spacing may miss."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.model.device import Device

# Range around a structure's resonances in which the relative spacing of the grid is half their damping ratio, and the
# finest relative spacing
RESONANCE_REACH, NARROWEST = 1.1, 2e-3
NARROWER = 6.0  # Number of points that a drawn curve has within the width of a resonance


def with_resonance(device: Device, grid: Floats) -> Floats:
    """Return a grid, rad/s, with more frequencies between the resonances of only the handle and of both masses."""
    structure, mass = device.structure, device.mass
    if structure is None:
        return grid
    # if the loop holds the motor still, only the handle resonates: the reduced mass m_1 m_2/m becomes m_2
    resonance = 2 * pi * float(structure.frequency_hz)
    load = structure.load.mass if structure.load is not None else 0.0
    held = resonance * ((mass - structure.handle_mass) / mass) ** 0.5
    held *= (structure.handle_mass / (structure.handle_mass + load)) ** 0.5
    low, high = max(grid[0], held / RESONANCE_REACH), min(grid[-1], resonance * RESONANCE_REACH)
    if low >= high:
        return grid
    # half the damping ratio, a quarter of the relative width 2 zeta of a resonance
    step = min(max(float(structure.damping_ratio) / 2, NARROWEST), 0.02)
    # 1 + int(...) steps, so that no step exceeds `step`, and one more frequency than steps
    return np.union1d(grid, np.geomspace(low, high, 2 + int(np.log(high / low) / step)))


def round_at_resonance(device: Device, hz: Floats) -> Floats:
    """Return frequencies with more of them around a structure's resonance, so that a curve over them looks smooth."""
    if device.structure is None:
        return hz
    narrow = replace(device.structure, damping_ratio=device.structure.damping_ratio / NARROWER)
    return with_resonance(replace(device, structure=narrow), 2 * pi * hz) / (2 * pi)
