"""The picture of a region: verdict of each cell, optimum, contours of the error, and the low-frequency limit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from numpy.typing import NDArray

from vctune.analysis.demands import tracking_terms, transparency_error
from vctune.analysis.extrema import Floats
from vctune.design.prepared import prepare
from vctune.design.search.grid import least_errors
from vctune.design.variables import point
from vctune.design.verdict.judge import IDLE_TRACKING
from vctune.model.gains import Gains
from vctune.model.loop.limits import lags
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.keys import labelled
from vctune.model.numbers.units import Units
from vctune.model.problem import Problem
from vctune.report.style import INK, ORANGE, PAPER, RED, STYLE, canvas, decades_between, round_numbers
from vctune.report.typography import tick
from vctune.running import check_time
from vctune.study.plane import Plane, Squares
from vctune.study.region import Kind, Region
from vctune.study.region_check import Recheck
from vctune.study.region_record import Design

# Colours and hatchings that remain distinct in grey and for readers with a colour deficiency
GOOD, BAD, OPEN = ("#b5d9f2", ""), ("#e58b2a", "///"), ("#6e6e78", "--")
FILLS = {Kind.FEASIBLE: GOOD, Kind.INFEASIBLE: BAD, Kind.UNDECIDED: OPEN}
LABELS = {kind: f"proved {kind.name.lower()}" for kind in FILLS} | {Kind.UNDECIDED: "undecided"}
# Height of the strip for the line K_p = 0, and distance of the strip from the plane, as shares of the plane
STRIP, GAP = 0.03, 0.008
INTERRUPTED = "interrupted: some undecided cells were not examined"
APART = (0.07, 0.035)  # Least distance between the ticks on x and on y, as a share of the axis
# Number of nodes along each axis of the mesh for contours, and number of parts between which the code checks the time
# limit
MESH, STEPS = 48, 8


def region_figure(problem: Problem, region: Region, designs: Sequence[Design], marked: Design | None = None) -> Figure:
    """Return the figure of a region in the optimiser's coordinates, in which the areas of cells are measured."""
    plane = region.plane
    with rc_context(STYLE):
        interrupted = INTERRUPTED * region.interrupted
        figure, axes = _frame(plane, problem.units, interrupted)
        for kind, fill in FILLS.items():
            _fill(axes, plane, region.squares[:, region.kinds == kind], fill, LABELS[kind])
        for label, of, colour in (("optimum", False, PAPER), ("optimum, idle", True, RED)):
            _marked(axes, plane, [design for design in designs if _idle(problem, design) is of], "*", colour, label)
        _marked(axes, plane, [marked] if marked else [], "X", ORANGE, "given gains")
        if set(plane.axes) == {0, 1} and problem.device.kind.own_loop:
            _idle_side(axes, problem, plane)
        if set(plane.axes) == {0, 1} and problem.device.kind.banded:
            _contours(axes, problem, region)
            if problem.passive:
                _limit(axes, problem, plane)
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def lost_figure(again: Recheck) -> Figure:
    """Return the figure of a baseline's feasible cells and gain sets, each either proved again or lost."""
    plane, kept = again.region.plane, again.region.kinds == Kind.FEASIBLE
    with rc_context(STYLE):
        figure, axes = _frame(plane, again.units)
        _fill(axes, plane, again.region.squares[:, kept], GOOD, "proved again")
        _fill(axes, plane, again.region.squares[:, ~kept], BAD, "lost")
        for holds, mark, colour, label in (
            (True, "*", PAPER, "gain set, proved again"),
            (False, "X", RED, "gain set, lost"),
        ):
            listed = zip(again.designs, again.certified, strict=True)
            _marked(axes, plane, [design for design, certified in listed if certified is holds], mark, colour, label)
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def _frame(plane: Plane, units: Units, title: str = "") -> tuple[Figure, Axes]:
    figure = canvas(8.6, 5.2, left=0.95, right=2.1, top=0.35 if title else 0.15)
    axes = figure.subplots()
    axes.set_title(title, loc="left")
    axes.grid(visible=False)
    for k, axis in enumerate(plane.axes):
        values, at = marks(plane, k)
        keywords: Any = {"xy"[k] + "lim": (lowest(plane, k), 1), "xy"[k] + "label": labelled(plane.keys[axis], units)}
        axes.set(**keywords)
        (axes.set_xticks, axes.set_yticks)[k](at, [tick(value) for value in values])
    return figure, axes


def _fill(axes: Axes, plane: Plane, squares: Squares, fill: tuple[str, str], label: str) -> None:
    """Draw cells as one path."""
    colour, hatch = fill
    corners = cells(plane, squares)
    codes = [Path.MOVETO, *[Path.LINETO] * 3, Path.CLOSEPOLY] * len(corners)
    drawn = Path(corners.reshape(-1, 2), codes) if codes else Path(np.zeros((1, 2)))
    axes.add_patch(PathPatch(drawn, facecolor=colour, hatch=hatch, linewidth=0, label=label))


def _marked(axes: Axes, plane: Plane, designs: Sequence[Design], mark: str, colour: str, label: str) -> None:
    spots = np.array(
        [[spot(plane, k, point(*design)[axis]) for design in designs] for k, axis in enumerate(plane.axes)]
    )
    if designs and np.isfinite(spots).all(axis=0).any():
        x, y = spots
        axes.scatter(x, y, s=180, c=colour, marker=mark, edgecolors=INK, label=label, zorder=5, clip_on=False)


def _contours(axes: Axes, problem: Problem, region: Region) -> None:
    """Draw contours of the least error of any feasible coupling, where gains are proved feasible."""
    marks, gains = _mesh(region.plane)
    feasible = _feasible(region)[np.ix_(marks, marks)]
    if feasible.sum() < 4:
        return
    sound = np.isfinite(errors := _least_errors(problem, gains)) & feasible
    if sound.sum() < 4:
        return
    levels = np.unique([float(f"{level:.2g}") for level in np.quantile(errors[sound], (0.02, 0.1, 0.3, 0.6, 0.9))])
    place = marks / marks[-1]
    drawn = axes.contour(place, place, np.where(sound, errors, np.nan).T, levels=levels, colors=INK, linewidths=0.8)
    axes.clabel(drawn, fmt="%g", fontsize=8)
    if any(drawn.allsegs):
        axes.plot([], [], color=INK, linewidth=0.8, label="least error")


def _least_errors(problem: Problem, gains: Gains) -> NDArray[np.float64]:
    """Return the least error of any feasible coupling at each node of a mesh, step by step within the time limit."""
    prepared, found = prepare(problem), []
    numbers = prepared.units.to_dimensionless((gains.velocity, gains.position, 0.0, 0.0, 0.0))
    K_v, K_p = (np.asarray(each) for each in numbers[:2])
    along_K_v = int(K_v[0, 0] == K_v[-1, 0])
    with np.errstate(all="ignore"):
        for part in zip(*(np.array_split(each, STEPS, axis=along_K_v) for each in (K_v, K_p)), strict=True):
            check_time()
            found.append(least_errors(prepared.scaled, Gains(*part)))
    check_time()
    return np.concatenate(found, axis=along_K_v) * prepared.units.error


def _mesh(plane: Plane) -> tuple[NDArray[np.intp], Gains]:
    """Return the edges that form a mesh of a plane of gains, and the gains at its nodes."""
    marks = np.linspace(0, len(plane.edges[0]) - 1, MESH).astype(int)
    x, y = np.meshgrid(plane.edges[0][marks], plane.edges[1][marks], indexing="ij")
    return marks, Gains(x, y) if plane.axes == (0, 1) else Gains(y, x)


def _idle(problem: Problem, design: Design) -> bool:
    return problem.device.kind.own_loop and transparency_error(problem, *design).tracking > IDLE_TRACKING


def _idle_side(axes: Axes, problem: Problem, plane: Plane) -> None:
    """Draw the line beyond which velocity loops have hardly any effect."""
    marks, gains = _mesh(plane)
    with np.errstate(all="ignore"):
        tracking = tracking_terms(problem, gains)
    place = marks / marks[-1]
    drawn = axes.contour(place, place, tracking.T, levels=[IDLE_TRACKING], colors=RED, linewidths=1.2, linestyles=":")
    if any(drawn.allsegs):
        axes.plot([], [], ":", color=RED, linewidth=1.2, label=f"idle where |1 - G_he| > {IDLE_TRACKING:g}")


def _feasible(region: Region) -> NDArray[np.bool_]:
    """Return which nodes of the mesh belong to a cell that is proved feasible."""
    count = len(region.plane.edges[0])
    inside = np.zeros((count, count), bool)
    for x_low, x_high, y_low, y_high in region.squares[:, region.kinds == Kind.FEASIBLE].T:
        inside[x_low : x_high + 1, y_low : y_high + 1] = True
    return inside


def _limit(axes: Axes, problem: Problem, plane: Plane) -> None:
    """Draw tau K_p = b + K_v, beyond which Re G_hh < 0 at low frequencies. tau is the lag of the drive: T/2, the delay
    and the actuator's lag."""
    device, swapped = problem.device, plane.axes == (1, 0)
    K_v = plane.edges[1 if swapped else 0]
    K_p = (device.damping + K_v) / float(lags(device, FLOATS).drive)
    x, y = (K_p, K_v) if swapped else (K_v, K_p)
    at = place(plane, 0, x), place(plane, 1, y)
    if np.isfinite(sum(at)).any():
        axes.plot(*at, "--", color=INK, linewidth=1.4, label="τ K_p = b + K_v")


def marks(plane: Plane, k: int) -> tuple[Floats, Floats]:
    """Return the values of the ticks on an axis and their positions."""
    edges = plane.edges[k]
    low = edges[edges > 0][0]
    values = 10.0 ** np.arange(np.ceil(np.log10(low)), np.floor(np.log10(edges[-1])) + 1)
    if len(values) < 3:
        values = np.array(decades_between(low, edges[-1]))
    if edges[-1] < 3 * low:
        values = np.array(round_numbers(low, edges[-1], 6))
    values = values[(values >= low) & (values <= edges[-1])]
    at = place(plane, k, values)
    zero = [] if edges[0] > 0 else [-(STRIP + GAP) / 2 if plane.has_line(k) else 0.0]
    kept: list[int] = []
    for i in np.flatnonzero(np.isfinite(at)).tolist()[::-1]:  # from the top, where the ticks are farthest apart
        nearest = min((abs(at[i] - other) for other in [*zero, *at[kept[-1:]]]), default=1.0)
        kept += [i] if nearest >= APART[k] else []
    return np.concatenate((np.zeros(len(zero)), values[kept])), np.concatenate((zero, at[kept]))


def lowest(plane: Plane, k: int) -> float:
    """Return the lower end of an axis, or of its strip if the axis has one."""
    return -STRIP if plane.has_line(k) else 0.0


def place(plane: Plane, k: int, values: Floats) -> Floats:
    """Return the positions of values on an axis, between 0 and 1; nan for values outside the axis."""
    edges = plane.edges[k]
    return np.interp(values, edges, np.linspace(0, 1, len(edges)), left=np.nan, right=np.nan)


def spot(plane: Plane, k: int, value: float) -> float:
    """Return the position of a design or of an environment on an axis; K_p = 0 lies on the strip."""
    on_line = value == 0 and plane.has_line(k)
    return -(STRIP + GAP) / 2 if on_line else float(place(plane, k, np.array([value]))[0])


def _joined(squares: Squares, along: int) -> Squares:
    """Join cells that touch along an axis, 0 or 1, and have the same extent across it."""
    low, high = 2 * along, 2 * along + 1
    start, end = 2 - low, 3 - low
    ordered = squares[:, np.lexsort(squares[[low, end, start]])]
    apart = (ordered[low, 1:] != ordered[high, :-1]) | (np.diff(ordered[[start, end]]) != 0).any(axis=0)
    first = np.flatnonzero(np.append(True, apart))[: ordered.shape[1]]
    joined = ordered[:, first]
    joined[high] = ordered[high, np.append(first[1:] - 1, -1)[: len(first)]]
    return joined


def cells(plane: Plane, squares: Squares) -> Floats:
    """Return the corners of joined cells, shape (joined cells, 5, 2); the last corner repeats the first."""
    lines = (squares[[0, 2]] == squares[[1, 3]]).any(axis=0)
    squares = np.concatenate([_joined(_joined(part, 1), 0) for part in (squares[:, lines], squares[:, ~lines])], axis=1)
    low, high = squares[[0, 2]] / (len(plane.edges[0]) - 1), squares[[1, 3]] / (len(plane.edges[0]) - 1)
    on_line = low == high
    (x0, y0), (x1, y1) = np.where(on_line, -STRIP, low), np.where(on_line, -GAP, high)
    return np.stack([np.stack((x, y), axis=1) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0))], axis=1)
