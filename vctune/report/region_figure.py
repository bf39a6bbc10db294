"""The picture of a region: verdict of each cell, optimum, contours of the error, and the low-frequency limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
from vctune.model.problem import Problem
from vctune.report.style import INK, ORANGE, PAPER, RED, STYLE, canvas, decades_between, round_numbers
from vctune.report.typography import tick
from vctune.study.plane import Plane, Squares
from vctune.study.region import Kind, Region
from vctune.study.region_check import Design, RegionFinding

# Colours and hatchings that remain distinct in grey and for readers with a colour deficiency
GOOD, BAD, OPEN = ("#b5d9f2", ""), ("#e58b2a", "///"), ("#6e6e78", "--")
CELLS = {
    Kind.FEASIBLE: ("proved feasible", GOOD),
    Kind.INFEASIBLE: ("proved infeasible", BAD),
    Kind.UNDECIDED: ("undecided", OPEN),
}
# Height of the strip for the line K_p = 0, and distance of the strip from the plane, as shares of the plane
STRIP, GAP = 0.03, 0.008
APART = (0.07, 0.035)  # Least distance between the ticks on x and on y, as a share of the axis
MESH, PARTS = 48, 8  # Number of nodes along each axis of the mesh for contours, and of parts that fit into memory


@dataclass(frozen=True, slots=True)
class _Axis:
    """An axis in the optimiser's coordinate, in which the areas of cells are measured: from 0 to 1 along its edges."""

    edges: Floats
    line: bool  # whether a strip below 0 shows the line K_p = 0

    @property
    def low(self) -> float:
        """The lower end of the axis."""
        return -STRIP if self.line else 0.0

    def places(self, values: Floats) -> Floats:
        """Return the positions of values; nan outside the axis."""
        return np.interp(values, self.edges, np.linspace(0, 1, len(self.edges)), left=np.nan, right=np.nan)

    def place(self, value: float) -> float:
        """Return the position of a design; K_p = 0 lies on the strip."""
        return -(STRIP + GAP) / 2 if value == 0 and self.line else float(self.places(np.array([value]))[0])

    def ticks(self, apart: float) -> dict[float, str]:
        """Return the texts of the ticks by their positions."""
        low, high = float(self.edges[self.edges > 0][0]), float(self.edges[-1])
        values = round_numbers(low, high, 6) if high < 3 * low else decades_between(low, high, 99)
        found = {self.place(0.0): tick(0.0)} if self.edges[0] == 0 else {}
        for value in values[::-1]:  # from the top, where the ticks are farthest apart
            at = self.place(value)
            if low <= value <= high and min((abs(at - other) for other in found), default=1.0) >= apart:
                found[at] = tick(value)
        return found


def region_figure(problem: Problem, region: Region, designs: Sequence[Design], marked: Design | None = None) -> Figure:
    """Return the figure of a region."""
    plane, kind = region.plane, problem.device.kind
    with rc_context(STYLE):
        title = "interrupted: some undecided cells were not examined" if region.interrupted else ""
        figure, axes = _frame(plane, [labelled(plane.keys[axis], problem.units) for axis in plane.axes], title)
        for verdict, (label, fill) in CELLS.items():
            _fill(axes, plane, region.squares[:, region.kinds == verdict], fill, label)
        idle = [kind.own_loop and transparency_error(problem, *each).tracking > IDLE_TRACKING for each in designs]
        for label, of, colour in (("optimum", False, PAPER), ("optimum, idle", True, RED)):
            _marked(
                axes, plane, [each for each, is_idle in zip(designs, idle, strict=True) if is_idle is of], label, colour
            )
        _marked(axes, plane, [marked] if marked else [], "given gains", ORANGE, "X")
        if set(plane.axes) == {0, 1} and kind.own_loop:
            _idle_side(axes, problem, plane)
        if set(plane.axes) == {0, 1} and kind.banded:
            _contours(axes, problem, region)
            if problem.passive:
                _limit(axes, problem, plane)
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def lost_figure(again: RegionFinding) -> Figure:
    """Return the figure of a baseline's feasible cells and gain sets, each either proved again or lost."""
    plane, kept = again.region.plane, again.region.kinds == Kind.FEASIBLE
    with rc_context(STYLE):
        units = again.file.problem.units
        figure, axes = _frame(plane, [labelled(plane.keys[axis], units) for axis in plane.axes])
        _fill(axes, plane, again.region.squares[:, kept], GOOD, "proved again")
        _fill(axes, plane, again.lost_cells, BAD, "lost")
        for holds, mark, colour, words in ((True, "*", PAPER, "proved again"), (False, "X", RED, "lost")):
            sets = [design for design, proved in zip(again.designs, again.certified, strict=True) if proved is holds]
            _marked(axes, plane, sets, f"gain set, {words}", colour, mark)
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def _axes(plane: Plane) -> tuple[_Axis, _Axis]:
    x, y = (_Axis(edges, plane.has_line(k)) for k, edges in enumerate(plane.edges))
    return x, y


def _frame(plane: Plane, labels: Sequence[str], title: str = "") -> tuple[Figure, Axes]:
    figure = canvas(8.6, 5.2, left=0.95, right=2.1, top=0.35 if title else 0.15)
    axes = figure.subplots()
    axes.set_title(title, loc="left")
    axes.grid(visible=False)
    x, y = _axes(plane)
    axes.set(xlim=(x.low, 1), ylim=(y.low, 1), xlabel=labels[0], ylabel=labels[1])
    for axis, put, apart in ((x, axes.set_xticks, APART[0]), (y, axes.set_yticks, APART[1])):
        ticks = axis.ticks(apart)
        put(list(ticks), list(ticks.values()))
    return figure, axes


def _fill(axes: Axes, plane: Plane, squares: Squares, fill: tuple[str, str], label: str) -> None:
    """Draw cells as one path."""
    lines = (squares[[0, 2]] == squares[[1, 3]]).any(axis=0)
    squares = np.concatenate([_joined(_joined(part, 1), 0) for part in (squares[:, lines], squares[:, ~lines])], axis=1)
    low, high = squares[[0, 2]] / plane.side, squares[[1, 3]] / plane.side
    (x0, y0), (x1, y1) = np.where(low == high, -STRIP, low), np.where(low == high, -GAP, high)
    corners = np.stack([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]).transpose(2, 0, 1)
    codes = [Path.MOVETO, *[Path.LINETO] * 3, Path.CLOSEPOLY] * len(corners)
    drawn = Path(corners.reshape(-1, 2), codes) if codes else Path(np.zeros((1, 2)))
    axes.add_patch(PathPatch(drawn, facecolor=fill[0], hatch=fill[1], linewidth=0, label=label))


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


def _marked(axes: Axes, plane: Plane, designs: Sequence[Design], label: str, colour: str, mark: str = "*") -> None:
    """Mark the designs that lie on the plane."""
    at = list(zip(_axes(plane), plane.axes, strict=True))
    spots = np.array([[along.place(point(*design)[axis]) for along, axis in at] for design in designs]).reshape(-1, 2)
    if np.isfinite(spots).all(axis=1).any():
        axes.scatter(
            spots[:, 0], spots[:, 1], s=180, c=colour, marker=mark, edgecolors=INK, label=label, zorder=5, clip_on=False
        )


def _mesh(plane: Plane) -> tuple[NDArray[np.intp], Gains]:
    """Return the edges that form a mesh of a plane of gains, and the gains at its nodes."""
    marks = np.linspace(0, plane.side, MESH).astype(int)
    x, y = np.meshgrid(plane.edges[0][marks], plane.edges[1][marks], indexing="ij")
    return marks, Gains(x, y) if plane.axes == (0, 1) else Gains(y, x)


def _contours(axes: Axes, problem: Problem, region: Region) -> None:
    """Draw contours of the least error of any feasible coupling, where gains are proved feasible."""
    marks, gains = _mesh(region.plane)
    feasible = np.zeros((region.plane.side + 1,) * 2, bool)
    for x_low, x_high, y_low, y_high in region.squares[:, region.kinds == Kind.FEASIBLE].T:
        feasible[x_low : x_high + 1, y_low : y_high + 1] = True
    if (inside := feasible[np.ix_(marks, marks)]).sum() < 4:
        return
    prepared, along = prepare(problem), region.plane.axes.index(0)
    numbers = prepared.units.to_dimensionless((gains.velocity, gains.position, 0.0, 0.0, 0.0))
    parts = zip(*(np.array_split(np.asarray(each), PARTS, axis=along) for each in numbers[:2]), strict=True)
    with np.errstate(all="ignore"):
        errors = np.concatenate([least_errors(prepared.scaled, Gains(*part)) for part in parts], axis=along)
    errors *= prepared.units.error
    sound = np.isfinite(errors) & inside
    if sound.sum() < 4:
        return
    levels = np.unique([float(f"{level:.2g}") for level in np.quantile(errors[sound], (0.02, 0.1, 0.3, 0.6, 0.9))])
    at, shown = marks / region.plane.side, np.where(sound, errors, np.nan).T
    drawn = axes.contour(at, at, shown, levels=levels, colors=INK, linewidths=0.8)
    axes.clabel(drawn, fmt="%g", fontsize=8)
    if any(drawn.allsegs):
        axes.plot([], [], color=INK, linewidth=0.8, label="least error")


def _idle_side(axes: Axes, problem: Problem, plane: Plane) -> None:
    """Draw the line beyond which velocity loops have hardly any effect."""
    marks, gains = _mesh(plane)
    at = marks / plane.side
    with np.errstate(all="ignore"):
        tracking = tracking_terms(problem, gains).T
    drawn = axes.contour(at, at, tracking, levels=[IDLE_TRACKING], colors=RED, linewidths=1.2, linestyles=":")
    if any(drawn.allsegs):
        axes.plot([], [], ":", color=RED, linewidth=1.2, label=f"idle where |1 - G_he| > {IDLE_TRACKING:g}")


def _limit(axes: Axes, problem: Problem, plane: Plane) -> None:
    """Draw tau K_p = b + K_v, beyond which Re G_hh < 0 at low frequencies. tau is the lag of the drive: T/2, the delay
    and the actuator's lag."""
    device, along = problem.device, plane.axes.index(0)
    K_v = plane.edges[along]
    K_p = (device.damping + K_v) / float(lags(device, FLOATS).drive)
    at = [axis.places(K_v if k == along else K_p) for k, axis in enumerate(_axes(plane))]
    if np.isfinite(sum(at)).any():
        axes.plot(*at, "--", color=INK, linewidth=1.4, label="τ K_p = b + K_v")
