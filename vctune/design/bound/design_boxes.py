"""Represent boxes of designs, and halve them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vctune.design.search.shapes import SLACK
from vctune.design.variables import coordinates
from vctune.model.problem import Problem
from vctune.proof.enclosures.intervals import Flags, Floats

K_V, K_P, TAU_C, B_0 = range(4)  # Rows of `DesignBoxes`: K_v, K_p, tau_c = m_c/b_c, b_0


@dataclass(frozen=True, slots=True)
class DesignBoxes:
    """Boxes of designs: [low, high] in each of K_v, K_p, tau_c and b_0; arrays of shape (4, n), SI units."""

    low: Floats
    high: Floats

    def __len__(self) -> int:
        return int(self.low.shape[1])

    def subset(self, at: NDArray[np.intp] | Flags) -> DesignBoxes:
        """Return the boxes with the given indices or flags."""
        return DesignBoxes(self.low[:, at], self.high[:, at])


@dataclass(frozen=True, slots=True)
class Axis:
    """A variable, with the coordinate log(scale + x) in which the search halves it."""

    low: float  # range of the variable
    high: float
    scale: float  # 0

    def middle(self, low: Floats, high: Floats) -> Floats:
        """Return the points at which the search halves intervals: their midpoints in the coordinate."""
        if self.scale == 0:
            return np.clip(np.sqrt(low) * np.sqrt(high), low, high)
        z = 0.5 * (np.log1p(low / self.scale) + np.log1p(high / self.scale))
        return np.clip(self.scale * np.expm1(z), low, high)

    def share(self, low: Floats, high: Floats) -> Floats:
        """Return the share of the axis that each interval covers."""
        if self.low == self.high:
            return np.zeros_like(low)
        whole = np.log((self.scale + self.high) / (self.scale + self.low))
        return np.log((self.scale + high) / (self.scale + low)) / whole


def axes_of(problem: Problem) -> tuple[Axis, Axis, Axis, Axis]:
    """Return the axes K_v, K_p, tau_c and b_0 of a problem in SI units."""
    impedance, time = problem.transparency.reference_impedance, problem.device.sample_time
    units = {"velocity": impedance, "position": impedance / time, "drag": impedance}
    scaled = coordinates(problem.in_units(impedance, time), integrator=True)
    scale = {c.name: c.scale * units[c.name] for c in scaled if c.name in units}
    bounds = problem.bounds
    return (
        Axis(bounds.velocity.min, bounds.velocity.max, scale.get("velocity", 0.0)),
        Axis(bounds.position.min, bounds.position.max, scale.get("position", 0.0)),
        _time_constants(problem),
        Axis(bounds.drag.min, bounds.drag.max, scale.get("drag", 0.0)),
    )


def _time_constants(problem: Problem) -> Axis:
    bounds = problem.bounds
    above, below = bounds.mass, bounds.damping
    if problem.device.kind.inverse:
        above, below = bounds.damping, bounds.stiffness
    low, high = above.min / below.max, above.max / below.min
    return Axis(low, high, SLACK * problem.device.sample_time if low == 0 < high else 0.0)


def all_designs(axes: tuple[Axis, ...]) -> DesignBoxes:
    """Return the single box of all designs."""
    return DesignBoxes(np.array([[axis.low] for axis in axes]), np.array([[axis.high] for axis in axes]))


def halves(axis: Axis, row: int, boxes: DesignBoxes) -> tuple[DesignBoxes, DesignBoxes]:
    """Return the lower and the upper halves of boxes along an axis."""
    middle = axis.middle(boxes.low[row], boxes.high[row])
    low, high = boxes.low.copy(), boxes.high.copy()
    low[row] = high[row] = middle
    return DesignBoxes(boxes.low, high), DesignBoxes(low, boxes.high)


def joined(parts: list[DesignBoxes]) -> DesignBoxes:
    """Return several sets of boxes as one set."""
    return DesignBoxes(np.hstack([part.low for part in parts]), np.hstack([part.high for part in parts]))
