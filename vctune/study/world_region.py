"""What may be rendered: the environments that given gains bear, as cells of a plane of their numbers.

A cell is a box of environments. It is feasible where the claim about a box of environments is proved of it, and
infeasible where each of its members holds a pole on the unit circle in some hand
(`vctune.proof.claims.worlds.world_cells`).
"""

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

MASS, DAMPING, STIFFNESS = range(3)
DECADES = (3.5, 1.5)
"""How many decades the plane reaches below and above the stiffest hand, and the others by what goes with it: for a
human hand springs of 1 N/m to 100 kN/m, masses of a gram to a hundred kilograms."""
PERIOD = 0.01
"""Time that relates a mass to a stiffness and a damping where no hand of the box states the others, s."""
GREATEST = 1e9
"""Stands for a mass or a stiffness without limit, of which one member is enough."""


def world_plane_errors(problem: Problem, x: str, y: str) -> list[Mistake]:
    """Return why there is no plane of environments of x and y.

    Parameters
    ----------
    problem : whose hands are to be met
    x, y : dotted keys, of which one at least is that of an environment
    """
    others = [key for key in (x, y) if key not in WORLD]
    said = f"is no number of an environment; those are {', '.join(WORLD)}"
    found = [Mistake("no-plane", key, said) for key in others]
    if problem.worlds is not None and not problem.worlds.lossless:
        said = (
            "asks for environments late or by Euler's rules, and the cells of a region are proved of the trapezoidal "
            "rule on "
            "time alone; leave rule and late out, or check single boxes with `vctune check`"
        )
        found.append(Mistake("no-plane", "environment", said))
    if x == y:
        found.append(Mistake("no-plane", x, "is both axes of the plane; choose another for x or y"))
    if problem.uncertainty is not None and problem.uncertainty.unmodelled:
        said = "is not proved with environments of a box; leave it out of this problem"
        found.append(Mistake("no-plane", "uncertainty.unmodelled", said))
    return found


def world_plane(problem: Problem, x: str, y: str, levels: int) -> Plane:
    """Return a plane of environments, from 0 and in logarithms; the number that is no axis has its stated range.

    A mass or a stiffness that is not stated is 0: the springs alone, or the masses.

    Parameters
    ----------
    problem : whose hands are to be met
    x, y : two of `WORLD`
    levels : the finest cell is 2^-levels of a side
    """
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
    """Return the least mass, damping and stiffness that a plane divides, and the greatest."""
    hand = problem.hands.high
    stiffness = hand.stiffness or hand.mass / PERIOD**2 or problem.device.mass / PERIOD**2
    mass = hand.mass or stiffness * PERIOD**2
    damping = hand.damping or stiffness * PERIOD
    below, above = DECADES
    return [(_round(size * 10**-below), _round(size * 10**above)) for size in (mass, damping, stiffness)]


def _round(value: float) -> float:
    return float(f"{value:.1g}")


def _edges(low: float, high: float, count: int) -> Floats:
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
    """Divide a plane of environments until each cell is decided or as small as the plane's edges allow.

    Parameters
    ----------
    problem : its device and hands, its uncertainty and safety factor; SI units
    gains, coupling : the design
    plane : of environments
    progress : told what share of the plane is decided
    stopped : whether to give up now
    squares : cells to begin with; None for the whole plane

    Returns
    -------
    Region
        Its cells are boxes of environments.
    """
    squares = plane.coarsest_squares() if squares is None else squares
    try:
        found = rendered(problem, gains, coupling, plane.ranges[DAMPING].min)
    except OutOfTimeError:
        none = np.full(squares.shape[1], Kind.UNDECIDED, np.intp)
        return Region(plane, squares, none, np.full(none.size, np.nan), interrupted=True)
    return divided(plane, squares, lambda some: judged(found, plane, some), _longer, progress, stopped)


def _longer(squares: Squares) -> Flags:
    """Return which cells are at least as long in x as in y."""
    return np.asarray(squares[1] - squares[0] >= squares[3] - squares[2])


def judged(found: Rendered, plane: Plane, squares: Squares) -> tuple[Kinds, Floats]:
    """Return what can be proved of each cell of a plane of environments, and a b_c of none.

    Parameters
    ----------
    found : the design
    plane, squares : the cells
    """
    kinds = np.full(squares.shape[1], Kind.FEASIBLE if found.every else Kind.UNDECIDED)
    if not found.every:
        cells = plane.cells(squares)
        each, missed = met(cells.low, cells.high), _missed(plane, cells.low, cells.high)
        hopeful, lost, between = found.estimated(each, missed)
        at = np.flatnonzero(hopeful)
        kinds[at[found.proved(each.subset(at))]] = Kind.FEASIBLE
        kinds[lost[found.refuted(missed.subset(lost), between)]] = Kind.INFEASIBLE
    return kinds, np.full(squares.shape[1], np.nan)


def _missed(plane: Plane, low: Floats, high: Floats) -> WorldCells:
    """Return what each member of a cell has: of a number that is no axis each has the whole range, the other way round.

    Parameters
    ----------
    plane : says what is an axis
    low, high : the cells
    """
    least, most = low.copy(), high.copy()
    least[DAMPING] = high[DAMPING] if DAMPING in plane.axes else low[DAMPING]
    most[DAMPING] = inf
    for number in {MASS, STIFFNESS} - set(plane.axes):
        least[number], most[number] = np.minimum(high[number], GREATEST), low[number]
    return WorldCells(least, most)
