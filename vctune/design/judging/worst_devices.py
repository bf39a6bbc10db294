"""Estimate the devices of an uncertain box on which the ratio Re Z_c / R of a design is least or |S| is greatest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from math import pi, prod
from typing import Any

import numpy as np

from vctune.analysis.demands import demand_grid, ratio_or_resistance, sensitivity_maxima
from vctune.analysis.extrema import Floats, Minima
from vctune.design.prepared import Posed, with_device
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.parts import DELAYS
from vctune.model.problem import Problem
from vctune.proof.device_box import DIRECTION, MOST_AT_ONCE, DeviceBox
from vctune.running import check_time

# Number of values of each uncertain parameter, including its ends; number of values of a delay or an unmodelled
# response; and greatest number of devices on the grid
VALUES_OF_EACH, VALUES_OF_A_DELAY, MOST_DEVICES = 5, 13, 325
MOST = 24  # Greatest number of minima over frequency that the search refines, beginning with the lowest
# First steps of the refinement: the relative step in frequency, and the step of an uncertain parameter as a share of
# its range
FIRST_STEP = 0.02, 0.1
# Number of rounds of the refinement, and factor by which the steps shrink if no neighbour is lower
STEPS, SHRINK = 40, 0.5
# Up to the first number of variables, including the frequency, all variables may change in one step
MANY, MOVED_AT_ONCE = 5, 2

# Greatest number of passes in which the search moves each uncertain parameter to the end with the greater |S|
SWEEPS = 3


@dataclass(frozen=True, slots=True)
class Worst:
    """A local minimum of the ratio over frequency and a box of devices."""

    ratio: float  # Re Z_c / R, or Re(D + Z_h)/|D| if Re(D + Z_h) is not positive
    omega: float  # frequency, rad/s
    device: Device  # a device that is not a vertex of the box


Value = Callable[[Floats], Floats]  # A function of an array whose first axis has omega and the uncertain parameters


def worst_inside(posed: Posed, gains: Gains, coupling: AnyCoupling) -> list[Worst]:
    """Return the local minima of the ratio over frequency and the box of devices, except those at vertices of the
    box."""
    box, (low, high) = posed.box, posed.span
    assert box is not None

    def value(at: Floats) -> Floats:
        device = _device(box, list(at[1:]))
        return ratio_or_resistance(device, gains, coupling, at[0], alone=posed.problem.alone)

    ends = np.array([[low, high], *([box.low.number(key), box.high.number(key)] for key in box.uncertain)])
    least, at = _refined(value, box, _minima(value, box, demand_grid(box.high, low, high)), ends)
    inside = ((at[1:] > ends[1:, :1]) & (at[1:] < ends[1:, 1:])).any(axis=0)
    found = [Worst(float(least[k]), float(at[0, k]), _device(box, at[1:, k].tolist())) for k in np.flatnonzero(inside)]
    return sorted(found, key=lambda worst: worst.ratio)


def loudest(posed: Posed, gains: Gains, case: Problem, peaks: Minima) -> tuple[Problem, Minima] | None:
    """Move uncertain parameters to the ends of their ranges at which |S| is greater."""
    if posed.box is None or len(posed.box.modelled.uncertain) <= MOST_AT_ONCE:
        return None
    box, best, found = posed.box.modelled, case, peaks
    ends = [(key, end.number(key)) for key in box.uncertain for end in (box.low, box.high)]
    for _ in range(SWEEPS):
        before = best
        for key, value in ends:
            other = with_device(posed.problem, best.device.with_numbers({key: value}))
            there = sensitivity_maxima(other, gains) if best.device.number(key) != value else found
            if there.value[0] < found.value[0]:
                best, found = other, there
        if best is before:
            break
    return None if best is case else (best, found)


def _device(box: DeviceBox, numbers: Sequence[Any]) -> Device:
    return box.device(dict(zip(box.uncertain, numbers, strict=True)))


def _reach(box: DeviceBox, name: str, omega: Floats) -> Floats:
    """Return the width of the range of an uncertain parameter at each frequency. The width for a delay is at most one
    turn of the phase."""
    reach = box.high.number(name) - box.low.number(name)
    return np.minimum(reach, 2 * pi / omega) if name in DELAYS else np.full_like(omega, reach)


def _shares(box: DeviceBox) -> dict[str, int]:
    """Return the number of values to try for each uncertain parameter."""
    counts = {name: VALUES_OF_A_DELAY if name in (*DELAYS, DIRECTION) else VALUES_OF_EACH for name in box.uncertain}
    for fewer in (3, 2):
        if prod(counts.values()) > MOST_DEVICES:
            counts = {name: count if name == DIRECTION else min(count, fewer) for name, count in counts.items()}
    return counts


def _minima(value: Value, box: DeviceBox, omega: Floats) -> Floats:
    """Return the lowest local minima over frequency of the least ratio on a grid of devices."""
    counts = _shares(box)
    axes = [
        np.clip(
            box.low.number(name) + np.linspace(0.0, 1.0, counts[name])[:, None] * _reach(box, name, omega),
            box.low.number(name),
            box.high.number(name),
        )
        for name in box.uncertain
    ]
    grid = np.array([[omega, *point] for point in product(*axes)])
    values = value(np.moveaxis(grid, 1, 0))
    best = values.argmin(axis=0)
    least = np.concatenate(([np.inf], values.min(axis=0), [np.inf]))
    at = np.flatnonzero((least[1:-1] <= least[:-2]) & (least[1:-1] <= least[2:]) & np.isfinite(least[1:-1]))
    at = at[np.argsort(least[1 + at], kind="stable")[:MOST]]
    return grid[best[at], :, at].T


def _refined(value: Value, box: DeviceBox, at: Floats, ends: Floats) -> tuple[Floats, Floats]:
    """Refine minima by a pattern search with shrinking steps; return the values and their positions."""
    low, high = ends[:, :1], ends[:, 1:]
    steps = np.array(list(product((-1.0, 0.0, 1.0), repeat=len(at))))
    if len(at) > MANY:
        steps = steps[np.count_nonzero(steps, axis=1) <= MOVED_AT_ONCE]
    steps = steps.T[:, :, None]
    widths = np.array([FIRST_STEP[0] * at[0], *(FIRST_STEP[1] * _reach(box, name, at[0]) for name in box.uncertain)])
    lowest, rows = value(at), np.arange(at.shape[1])
    for _ in range(STEPS):
        check_time()
        tried = np.clip(at[:, None] + steps * widths[:, None], low[:, None], high[:, None])
        values = value(tried)
        k = values.argmin(axis=0)
        better = values[k, rows] < lowest
        at = np.where(better, tried[:, k, rows], at)
        lowest = np.where(better, values[k, rows], lowest)
        widths = np.where(better, widths, widths * SHRINK)
    return lowest, at
