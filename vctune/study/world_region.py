"""Find the environments that given gains can render, as cells of a plane of two parameters of an environment."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple
from math import inf

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.design.rendered import Rendered, met, rendered
from vctune.document.text.errors import Mistake
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.numbers.keys import WORLD
from vctune.model.problem import Problem, Range
from vctune.proof.claims.worlds.world_cells import WorldCells
from vctune.proof.enclosures.array_intervals import Flags
from vctune.running import OutOfTimeError
from vctune.study.plane import DIGITS, Plane, Squares
from vctune.study.region import Kind, Kinds, Progress, Region, divided

WORLD_MASS, WORLD_DAMPING, WORLD_STIFFNESS = range(3)  # rows of a box of environments
# Number of decades that the plane reaches below and above the greatest mass, damping and stiffness of the hands
DECADES = (3.5, 1.5)
# Time, s, from which the plane computes the scale of a mass, damping or stiffness that is 0 for all hands
PERIOD = 0.01
GREATEST = 1e9  # Value that represents an unlimited mass or stiffness


def world_plane_errors(problem: Problem, x: str, y: str) -> list[Mistake]:
    """Return the reasons why there is no plane of environments over x and y."""
    others = [key for key in (x, y) if key not in WORLD]
    message = f"is no number of an environment; those are {', '.join(WORLD)}"
    mistakes = [Mistake("no-plane", key, message) for key in others]
    if problem.worlds is not None and not problem.worlds.lossless:
        message = (
            "asks for environments late or by Euler's rules, and the cells of a region are proved of the trapezoidal "
            "rule on "
            "time alone; leave rule and late out, or check single boxes with `vctune check`"
        )
        mistakes.append(Mistake("no-plane", "environment", message))
    if x == y:
        mistakes.append(Mistake("no-plane", x, "is both axes of the plane; choose another for x or y"))
    if problem.uncertainty is not None and problem.uncertainty.unmodelled:
        message = "is not proved with environments of a box; leave it out of this problem"
        mistakes.append(Mistake("no-plane", "uncertainty.unmodelled", message))
    return mistakes


def world_plane(problem: Problem, x: str, y: str, levels: int) -> Plane:
    """Return a plane of environments with logarithmic axes that begin at 0; other parameters have their stated
    range."""
    stated = problem.worlds
    ranges = [Range(0.0, 0.0), Range(0.0, inf), Range(0.0, 0.0)]
    if stated is not None:
        ends = zip(astuple(stated.low), astuple(stated.high), strict=True)
        ranges = [Range(low, high) for low, high in ends]
    axes = WORLD.index(x), WORLD.index(y)
    spans = _spans(problem)
    for axis in axes:
        reach = [end for end in (ranges[axis].min, ranges[axis].max) if 0 < end < inf]
        low, high = spans[axis]
        spans[axis] = min([low, *(end / 10 for end in reach)]), max([high, *(10 * end for end in reach)])
        ranges[axis] = Range(0.0, spans[axis][1])
    first, second = (_edges(*spans[axis], 2**levels) for axis in axes)
    return Plane(axes, (first, second), tuple(ranges))


def _spans(problem: Problem) -> list[tuple[float, float]]:
    """Return the lower and upper ends of the axes of mass, damping and stiffness, before `[environment]` extends
    them."""
    hand = problem.hands.high
    stiffness = hand.stiffness or hand.mass / PERIOD**2 or problem.device.mass / PERIOD**2
    mass = hand.mass or stiffness * PERIOD**2
    damping = hand.damping or stiffness * PERIOD
    below, above = DECADES
    return [(_round(scale * 10**-below), _round(scale * 10**above)) for scale in (mass, damping, stiffness)]


def _round(value: float) -> float:
    """Return a value with one significant digit."""
    return float(f"{value:.1g}")


def _edges(low: float, high: float, count: int) -> Floats:
    """Return the edges of an axis: 0, and then geometrically spaced values."""
    inner = [float(f"{x:.{DIGITS}g}") for x in np.geomspace(low, high, count)[:-1]]
    return np.array([0.0, *inner, high])


def world_region(
    problem: Problem,
    gains: Gains,
    coupling: AnyCoupling,
    plane: Plane,
    progress: Progress = lambda stage: None,
    stopped: Callable[[], bool] = lambda: False,
    squares: Squares | None = None,
) -> Region:
    """Divide a plane of environments until each cell is decided or as small as the plane's edges permit."""
    squares = plane.coarsest_squares() if squares is None else squares
    try:
        prepared_design = rendered(problem, gains, coupling, plane.ranges[WORLD_DAMPING].min)
    except OutOfTimeError:
        undecided = np.full(squares.shape[1], Kind.UNDECIDED, np.intp)
        return Region(plane, squares, undecided, np.full(undecided.size, np.nan), interrupted=True)
    return divided(plane, squares, lambda part: judged(prepared_design, plane, part), _longer, progress, stopped)


def _longer(squares: Squares) -> Flags:
    """Return the cells that are at least as long in x as in y."""
    return np.asarray(squares[1] - squares[0] >= squares[3] - squares[2])


def judged(prepared_design: Rendered, plane: Plane, squares: Squares) -> tuple[Kinds, Floats]:
    """Return the verdict on each cell of a plane of environments. The second result, b_c, is nan for each cell."""
    kinds = np.full(squares.shape[1], Kind.FEASIBLE if prepared_design.every else Kind.UNDECIDED)
    if not prepared_design.every:
        cells = plane.cells(squares)
        worst_members, common_ends = met(cells.low, cells.high), _common_ends(plane, cells.low, cells.high)
        hopeful, lost, angles = prepared_design.estimated(worst_members, common_ends)
        indices = np.flatnonzero(hopeful)
        kinds[indices[prepared_design.proved(worst_members.subset(indices))]] = Kind.FEASIBLE
        kinds[lost[prepared_design.refuted(common_ends.subset(lost), angles)]] = Kind.INFEASIBLE
    return kinds, np.full(squares.shape[1], np.nan)


def _common_ends(plane: Plane, low: Floats, high: Floats) -> WorldCells:
    """For each cell, return the ends of what the environments of all its points have in common."""
    least, most = low.copy(), high.copy()
    least[WORLD_DAMPING] = high[WORLD_DAMPING] if WORLD_DAMPING in plane.axes else low[WORLD_DAMPING]
    most[WORLD_DAMPING] = inf
    for number in {WORLD_MASS, WORLD_STIFFNESS} - set(plane.axes):
        least[number], most[number] = np.minimum(high[number], GREATEST), low[number]
    return WorldCells(least, most)
