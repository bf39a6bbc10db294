"""Boxes of designs for branch and bound: the variables, how they are halved, and which loops in them are unstable."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.design.prepared import Posed
from vctune.design.variables import coordinates
from vctune.model.problem import Problem
from vctune.proof.boxes import Cells
from vctune.proof.enclosures import Flags
from vctune.proof.least import without_integrator
from vctune.proof.many_designs import by_law, encirclements
from vctune.proof.quadratics import Boxes


@dataclass(frozen=True, slots=True)
class Axis:
    """A variable in the coordinate in which it is halved, log(scale + x).

    Attributes
    ----------
    low, high : its range
    scale : 0, or the size below which it hardly matters when it may be 0
    """

    low: float
    high: float
    scale: float

    def middle(self, low: Floats, high: Floats) -> Floats:
        """Return where intervals are halved."""
        if self.scale == 0:
            return np.clip(np.sqrt(low) * np.sqrt(high), low, high)
        z = 0.5 * (np.log1p(low / self.scale) + np.log1p(high / self.scale))
        return np.clip(self.scale * np.expm1(z), low, high)

    def share(self, low: Floats, high: Floats) -> Floats:
        """Return which share of the axis intervals take."""
        if self.low == self.high:
            return np.zeros_like(low)
        whole = np.log((self.scale + self.high) / (self.scale + self.low))
        return np.log((self.scale + high) / (self.scale + low)) / whole


def axes_of(problem: Problem) -> tuple[Axis, Axis, Axis, Axis]:
    """Return the axes K_v, K_p, tau_c and b_0 of a problem, SI units."""
    impedance, time = problem.transparency.reference_impedance, problem.device.sample_time
    units = {0: impedance, 1: impedance / time, 4: impedance}
    scaled = coordinates(problem.in_units(impedance, time), integrator=True)
    scale = {c.index: c.scale * units[c.index] for c in scaled if c.index in units}
    bounds = problem.bounds
    return (
        Axis(bounds.velocity.min, bounds.velocity.max, scale.get(0, 0.0)),
        Axis(bounds.position.min, bounds.position.max, scale.get(1, 0.0)),
        Axis(bounds.mass.min / bounds.damping.max, bounds.mass.max / bounds.damping.min, 0.0),
        Axis(bounds.drag.min, bounds.drag.max, scale.get(4, 0.0)),
    )


def halved(axis: Axis, index: int, boxes: Boxes) -> tuple[Boxes, Boxes]:
    """Return both halves of boxes along an axis of this number."""
    middle = axis.middle(boxes.low[index], boxes.high[index])
    low, high = boxes.low.copy(), boxes.high.copy()
    low[index] = high[index] = middle
    return Boxes(boxes.low, high), Boxes(low, boxes.high)


def flattened(problem: Problem, boxes: Boxes) -> Boxes:
    """Return the boxes without the K_p > 0 that no admissible design in them has, if they contain K_p = 0."""
    high = boxes.high.copy()
    high[1, (boxes.low[1] == 0) & without_integrator(problem, boxes)] = 0.0
    return Boxes(boxes.low, high)


def settled(posed: Posed, boxes: Boxes) -> tuple[Flags, Flags]:
    """Return the boxes all of whose loops are proved stable, and those none of whose loops is.

    A box whose K_p starts at 0 contains K_p = 0, which takes the position out of the loop, and is looked at twice.
    """
    corners = np.concatenate((boxes.low[:2], boxes.high[:2]))
    rectangles, place = np.unique(corners, axis=1, return_inverse=True)
    low, high = rectangles[:2], rectangles[2:]
    stable, unstable = _settled(posed, low, high)
    face = (low[1] == 0) & (high[1] > 0)
    if face.any():
        flat = high[:, face] * np.array([[1.0], [0.0]])
        as_well = _settled(posed, low[:, face], flat)
        stable[face] &= as_well[0]
        unstable[face] &= as_well[1]
    place = place.ravel()
    return stable[place], unstable[place]


def _settled(posed: Posed, low: Floats, high: Floats) -> tuple[Flags, Flags]:
    count = low.shape[1]
    cells = Cells(*(np.concatenate((edge, np.ones((3, count)))) for edge in (low, high)))
    stable, unstable = np.zeros(count, bool), np.zeros(count, bool)
    for at in by_law(cells):
        part = cells.taken(at)
        demands = [replace(posed.demands, device=case.device) for case in posed.cases]
        number = np.concatenate([encirclements(each, part).number for each in demands])
        stable[at] = (number == 0).all(axis=0)
        unstable[at] = (np.isfinite(number) & (number != 0)).any(axis=0)
    return stable, unstable
