"""Estimate the devices of an uncertain box on which the ratio Re Z_c / R of a design is least, or |S| greatest.

At a frequency omega the delay d matters only through the phase omega d, which makes a full turn within 2 pi/omega. So
the delays of one turn represent all longer ones.
"""

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

SHARES, DELAY_SHARES, MOST_DEVICES = 5, 13, 325
"""Number of values that are tried for each uncertain number, including its ends; the same for delays and unmodelled
responses; and greatest number of devices. The ratio is smooth in mass and damping. A delay or an unmodelled response
turns a phase once, and 13 values sample every half turn six times. Half as many values may miss a minimum, which the
proof then finds. Twice as many mean four to eight times the devices, whose number is limited: with many uncertain
numbers, three or two values of each are tried."""
MOST = 24
"""Number of minima over frequency that are refined, the lowest ones, all at once on arrays. A long delay makes more
minima, but the higher ones do not bind."""
FIRST_STEP = 0.02, 0.1
"""First steps of the refinement: the relative step in frequency, and the step of a number as a share of its range. They
are about half of the grid's steps. With smaller steps a minimum takes more rounds; larger steps may reach another
minimum."""
STEPS, SHRINK = 40, 0.5
"""Number of rounds of the refinement, and factor by which its steps shrink if no neighbour is lower. In 40 rounds, half
of them for moving, the steps shrink to 1e-10. The ratio is flat at its minimum, so half as many still give it to
1e-6."""
MANY, TOGETHER = 5, 2
"""Greatest number of variables, including the frequency, that may all move in one step. If there are more variables,
the second number limits how many move at once. For nine variables this leaves 162 of 19,682 steps. Moving half and
twice as many at once leads to designs that are as good."""

SWEEPS = 3
"""Number of times that all numbers are moved to their ends for a greater |S|. Once mostly suffices, and the proof finds
any remaining rise. Half and twice as many find the same devices."""


@dataclass(frozen=True, slots=True)
class Worst:
    """A local minimum of the ratio over frequency and a box of devices.

    Attributes
    ----------
    ratio : Re Z_c / R, or Re(D + Z_h)/|D| where that is not positive
    omega : frequency, rad/s
    device : a device that is not a vertex of the box
    """

    ratio: float
    omega: float
    device: Device


Value = Callable[[Floats], Floats]
"""A function of omega and the uncertain numbers, which lie along the first axis."""


def worst_inside(posed: Posed, gains: Gains, coupling: AnyCoupling) -> list[Worst]:
    """Return the local minima of the ratio over frequency and box that are not at a vertex of the box, the lowest
    first.

    Parameters
    ----------
    posed : prepared problem with a box of devices, in any units
    gains, coupling : a design with plain floats in these units

    Returns
    -------
    list of Worst
        Estimates; the list may be empty.
    """
    box, (low, high) = posed.box, posed.span
    assert box is not None

    def value(at: Floats) -> Floats:
        return ratio_or_resistance(_device(box, list(at[1:])), gains, coupling, at[0])

    ends = np.array([[low, high], *([box.low.number(key), box.high.number(key)] for key in box.uncertain)])
    least, at = _refined(value, box, _minima(value, box, demand_grid(box.high, low, high)), ends)
    inside = ((at[1:] > ends[1:, :1]) & (at[1:] < ends[1:, 1:])).any(axis=0)
    found = [Worst(float(least[k]), float(at[0, k]), _device(box, at[1:, k].tolist())) for k in np.flatnonzero(inside)]
    return sorted(found, key=lambda worst: worst.ratio)


def loudest(posed: Posed, gains: Gains, case: Problem, peaks: Minima) -> tuple[Problem, Minima] | None:
    """Move uncertain numbers to the ends at which |S| is greater; return the resulting device and the maxima of its
    |S|.

    The function moves one number after the other until no move helps, since |S| usually rises or falls with each
    number.

    Parameters
    ----------
    posed : prepared problem in any units
    gains : gains with plain floats in these units
    case, peaks : problem of the first device, and the maxima of its |S|

    Returns
    -------
    problem and Minima, or None
        None if the result is the first device, or if the search tries all vertices of the box anyway.
    """
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
    """Return the range of an uncertain number at each frequency; the range of a delay is at most one turn."""
    reach = box.high.number(name) - box.low.number(name)
    return np.minimum(reach, 2 * pi / omega) if name in DELAYS else np.full_like(omega, reach)


def _shares(box: DeviceBox) -> dict[str, int]:
    """Return the number of values to try for each uncertain number."""
    counts = {name: DELAY_SHARES if name in (*DELAYS, DIRECTION) else SHARES for name in box.uncertain}
    for fewer in (3, 2):
        if prod(counts.values()) > MOST_DEVICES:
            counts = {name: count if name == DIRECTION else min(count, fewer) for name, count in counts.items()}
    return counts


def _minima(value: Value, box: DeviceBox, omega: Floats) -> Floats:
    """Return the lowest local minima over frequency of the least ratio on a grid of devices, shape (1 + numbers, n)."""
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
    """Return lower values and their positions, by a search among neighbours at shrinking distances."""
    low, high = ends[:, :1], ends[:, 1:]
    steps = np.array(list(product((-1.0, 0.0, 1.0), repeat=len(at))))
    if len(at) > MANY:
        steps = steps[np.count_nonzero(steps, axis=1) <= TOGETHER]
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
