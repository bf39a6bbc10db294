"""Define the plane of two design variables in which a region lies, and divide it into cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats
from vctune.design.prepared import Units, of_one_device
from vctune.design.variables import coordinates, keys_for, ranges
from vctune.document.text.errors import Mistake
from vctune.model.numbers.units import KEYS, keys_of
from vctune.model.problem import Problem, Range
from vctune.proof.boxes import Cells
from vctune.proof.enclosures.intervals import Flags

# Cells given by the indices of their edges, x_low, x_high, y_low, y_high, as an array of shape (4, number of cells)
Squares = NDArray[np.intp]

COARSEST = 8  # Number of cells along each axis with which a search begins
DIGITS = 12  # Number of significant digits of the edges between cells


@dataclass(frozen=True, slots=True)
class Plane:
    """Two variables of a design, with the edges of their finest cells."""

    axes: tuple[int, int]  # indices of the variables x and y among `keys`
    edges: tuple[Floats, Floats]  # 2^levels + 1 edges of x and as many of y, SI units
    ranges: tuple[Range, ...]  # ranges of all variables, in the order of `keys`

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys of the variables."""
        return keys_of(len(self.ranges))

    @property
    def side(self) -> int:
        """The number of finest cells along each axis."""
        return len(self.edges[0]) - 1

    def at_full_width(self, key: str) -> bool:
        """Return whether a variable is free but not an axis, so that each cell may have its own value of it."""
        index = self.keys.index(key) if key in self.keys else None
        return index is not None and index not in self.axes and not self.ranges[index].fixed

    def coarsest_squares(self) -> Squares:
        """Return the plane as `COARSEST` by `COARSEST` cells, and the line K_p = 0 as pieces as long."""
        step = self.side // COARSEST
        marks = np.arange(0, self.side, step)
        i, j = (grid.ravel() for grid in np.meshgrid(marks, marks, indexing="ij"))
        squares, none = np.stack((i, i + step, j, j + step)), np.zeros_like(marks)
        lines = [[none, none, marks, marks + step], [marks, marks + step, none, none]]
        return np.concatenate([squares, *(lines[place] for place in (0, 1) if self.has_line(place))], axis=1)

    def has_line(self, place: int) -> bool:
        """Return whether the axis x or y (0 or 1) is a K_p that starts at 0."""
        return self.keys[self.axes[place]] == "gains.position" and bool(self.edges[place][0] == 0)

    def cells(self, squares: Squares) -> Cells:
        """Return the cells as boxes of all variables."""
        low = np.repeat([[bounds.min] for bounds in self.ranges], squares.shape[1], axis=1)
        high = np.repeat([[bounds.max] for bounds in self.ranges], squares.shape[1], axis=1)
        for axis, edges, ends in zip(self.axes, self.edges, (squares[:2], squares[2:]), strict=True):
            low[axis], high[axis] = edges[ends]
        return Cells(low, high)

    def areas(self, squares: Squares) -> Floats:
        """Return each cell's share of the finest cells of the plane, shape (n,); 0 for a piece of the line K_p = 0."""
        return (squares[1] - squares[0]) * (squares[3] - squares[2]) / self.side**2


def plane_errors(problem: Problem, x: str, y: str) -> list[Mistake]:
    """Return the reasons why vctune cannot find a region of the problem in the plane of x and y."""
    bounds, faults = dict(zip(keys_for(problem), ranges(problem), strict=True)), list[tuple[str, str]]()
    free = [key for key in bounds if not bounds[key].fixed]
    names = f"free are {', '.join(free)}" if free else "the problem fixes every number"
    if of_one_device(problem) is None:
        faults.append(("uncertainty", "a region is proved for one device; leave the table out of this problem"))
    if problem.worlds is not None and problem.worlds.walls:
        faults.append(("environment.walls", "is not decided for cells; leave it out of this problem"))
    if problem.stability.calm:
        faults.append(("stability.calm", "is simulated, and not decided for cells; leave it out of this problem"))
    if x == y:
        faults.append((x, "is both axes of the plane; choose another for x or y"))
    faults += [
        (key, f"is fixed at {bounds[key].min:g} and spans no plane; {names}")
        for key in dict.fromkeys((x, y))
        if bounds[key].fixed
    ]
    every = problem.device.kind.inverse or problem.worlds is not None or problem.stability.damping_ratio is not None
    faults += [
        (key, "is free but not an axis; fix it, or name it as x or y")
        for key in (bounds if every else KEYS[:2])
        if key not in (x, y) and not bounds[key].fixed
    ]
    return [Mistake("no-plane", key, message) for key, message in faults]


def plane(problem: Problem, x: str, y: str, levels: int, *, linear: bool = False) -> Plane:
    """Return the plane of two free variables of a problem, its edges equally spaced in the optimiser's coordinates, or
    in the variables themselves."""
    impedance, time = problem.transparency.reference_impedance, problem.device.sample_time
    coordinate_of = {c.index: c for c in coordinates(problem.in_units(impedance, time), integrator=True)}
    keys, bounds, edges = keys_for(problem), ranges(problem), list[Floats]()
    axes, units = (keys.index(x), keys.index(y)), Units(impedance, time, 1.0).to_si((1.0,) * len(keys))
    for axis in axes:
        along = coordinate_of[axis]
        inner = [along.to_x(z) * units[axis] for z in np.linspace(along.low, along.high, 2**levels + 1)[1:-1]]
        inner = np.linspace(bounds[axis].min, bounds[axis].max, 2**levels + 1)[1:-1].tolist() if linear else inner
        edges.append(np.array([bounds[axis].min, *(float(f"{x:.{DIGITS}g}") for x in inner), bounds[axis].max]))
    return Plane(axes, (edges[0], edges[1]), bounds)


def halved(squares: Squares, across: Flags) -> Squares:
    """Return both halves of each cell: first the lower halves of all cells, then the upper halves."""
    wide, high = squares[1] - squares[0] > 1, squares[3] - squares[2] > 1
    low_row = np.where(wide & (across | ~high), 0, 2)
    at = np.arange(squares.shape[1])
    first, second = squares.copy(), squares.copy()
    first[low_row + 1, at] = second[low_row, at] = (squares[low_row, at] + squares[low_row + 1, at]) // 2
    return np.concatenate((first, second), axis=1)
