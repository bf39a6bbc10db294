"""Pictures of a region of gains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.ticker import MaxNLocator

from vctune.analysis.demands import tracking_terms, transparency_error
from vctune.analysis.extrema import Floats
from vctune.design.judging.judge import IDLE_TRACKING
from vctune.design.prepared import prepare
from vctune.design.search.grid import least_errors
from vctune.design.variables import point
from vctune.document.measured_points import MeasuredPoint
from vctune.model.gains import Gains
from vctune.model.problem import Problem
from vctune.report.region_lines import RATIOS, Line, drawable, lines, mesh_of
from vctune.report.style import INK, ORANGE, PAPER, RED, STYLE, WIDTH, log_ticks, text_of_ticks
from vctune.study.plane import Plane, Squares
from vctune.study.region import Kind, Region
from vctune.study.region_check import GivenDesign, RegionFinding

# Colours and hatchings that remain distinct in grey and for readers with a colour deficiency
GOOD, BAD, OPEN = ("#b5d9f2", ""), ("#e58b2a", "///"), ("#6e6e78", "--")
CELLS = {
    Kind.FEASIBLE: ("proved feasible", GOOD),
    Kind.INFEASIBLE: ("proved infeasible", BAD),
    Kind.UNDECIDED: ("undecided", OPEN),
}
# Height of the strip for the line K_p = 0, and distance of the strip from the plane, as shares of the plane
STRIP, GAP = 0.03, 0.008
LINES = "--", "-.", (0, (1, 1)), (0, (5, 1, 1, 1, 1, 1))  # dashes of the limits of the literature
EVEN = 1e-6  # Relative difference of the steps of an even axis
APART = 0.06  # Least distance between ticks, as a share of the axis
LABEL_ROOM = 0.04  # Least distance of a label from a border and another one's line; twice as far along a line
MESH = 48  # Number of nodes along each axis of the mesh for contours


@dataclass(frozen=True, slots=True)
class _Axis:
    """An axis in the optimiser's coordinate, in which the areas of cells are measured: from 0 to 1 along its edges."""

    edges: Floats
    line: bool  # whether a strip below 0 shows the line K_p = 0

    def places(self, values: Floats | float) -> Floats:
        """Return the positions of values; nan outside the axis. K_p = 0 lies on the strip."""
        found = np.interp(values, self.edges, np.linspace(0, 1, len(self.edges)), left=np.nan, right=np.nan)
        return np.where((np.asarray(values) == 0) & self.line, -(STRIP + GAP) / 2, found)

    def ticks(self) -> dict[float, str]:
        """Return the texts of the ticks by their positions."""
        low, high = float(self.edges[self.edges > 0][0]), float(self.edges[-1])
        steps = np.diff(self.edges)
        even = high < 3 * low or np.ptp(steps) <= EVEN * steps.max()
        round_ones = MaxNLocator(6) if even else log_ticks(low, high)
        inside = [value for value in round_ones.tick_values(low, high)[::-1] if low <= value <= high]
        found: dict[float, float] = {}
        for value in ([0.0] if self.edges[0] == 0 else []) + inside:  # from the top, where the ticks are farthest apart
            at = float(self.places(value))
            if all(abs(at - other) >= APART for other in found):
                found[at] = value
        return dict(zip(found, text_of_ticks(list(found.values())), strict=True))


def region_figure(
    problem: Problem,
    region: Region,
    designs: Sequence[GivenDesign],
    marked: GivenDesign | None = None,
    measured: Sequence[MeasuredPoint] = (),
    *,
    contours: bool = True,
) -> Figure:
    """Return the figure of a region, with contours of the error, limits of the literature and measured points."""
    plane, kind = region.plane, problem.device.kind
    with rc_context(STYLE | {"font.size": 8, "legend.fontsize": 7}):
        title = "interrupted: some undecided cells were not examined" if region.interrupted else ""
        figure, axes = _frame(problem, plane, title)
        for verdict, (label, fill) in CELLS.items():
            _fill(axes, plane, region.squares[:, region.kinds == verdict], fill, label)
        idle = [kind.own_loop and transparency_error(problem, *each).tracking > IDLE_TRACKING for each in designs]
        for label, of, colour in (("optimum", False, PAPER), ("optimum, idle", True, RED)):
            chosen = [each for each, is_idle in zip(designs, idle, strict=True) if is_idle is of]
            _marked(axes, plane, chosen, label, colour)
        _marked(axes, plane, [marked] if marked else [], "given gains", ORANGE, "X")
        if contours and set(plane.axes) == {0, 1} and kind.banded:
            _contours(axes, problem, region)
        elif contours:
            _contours_of_designs(axes, problem, region)
        for line, style in zip(lines(problem), LINES, strict=False):
            _limit(axes, plane, line, style)
        _measured(axes, plane, measured)
        figure.legend(loc="outside upper center", ncols=2)
    return figure


def lost_figure(again: RegionFinding) -> Figure:
    """Return the figure of a baseline's feasible cells and gain sets, each either proved again or lost."""
    plane, kept = again.region.plane, again.region.kinds == Kind.FEASIBLE
    with rc_context(STYLE | {"font.size": 8, "legend.fontsize": 7}):
        figure, axes = _frame(again.file.problem, plane)
        _fill(axes, plane, again.region.squares[:, kept], GOOD, "proved again")
        _fill(axes, plane, again.lost_cells, BAD, "lost")
        for holds, mark, colour, words in ((True, "*", PAPER, "proved again"), (False, "X", RED, "lost")):
            sets = [design for design, proved in zip(again.designs, again.certified, strict=True) if proved is holds]
            _marked(axes, plane, sets, f"gain set, {words}", colour, mark)
        figure.legend(loc="outside upper center", ncols=2)
    return figure


def _axes(plane: Plane) -> tuple[_Axis, _Axis]:
    x, y = (_Axis(edges, plane.has_line(k)) for k, edges in enumerate(plane.edges))
    return x, y


def _frame(problem: Problem, plane: Plane, title: str = "") -> tuple[Figure, Axes]:
    figure = Figure(figsize=(WIDTH, 4.0))
    axes = figure.subplots()
    axes.set_title(title, loc="left")
    axes.grid(visible=False)
    for name, along, axis in zip("xy", _axes(plane), plane.axes, strict=True):
        ticks, low = along.ticks(), -STRIP if along.line else 0.0
        label = problem.device.kind.labelled(plane.keys[axis], problem.units)
        axes.set(**{f"{name}lim": (low, 1), f"{name}label": label})
        axes.set(**{f"{name}ticks": list(ticks), f"{name}ticklabels": list(ticks.values())})
    return figure, axes


def _fill(axes: Axes, plane: Plane, squares: Squares, fill: tuple[str, str], label: str) -> None:
    """Draw cells as one path, which has no seams; a cell on the line K_p = 0 lies on the strip."""
    low, high = squares[[0, 2]] / plane.side, squares[[1, 3]] / plane.side
    (x0, y0), (x1, y1) = np.where(low == high, -STRIP, low), np.where(low == high, -GAP, high)
    corners = np.stack([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]).transpose(2, 0, 1)
    codes = [Path.MOVETO, *[Path.LINETO] * 3, Path.CLOSEPOLY] * len(corners)
    drawn = Path(corners.reshape(-1, 2), codes) if codes else Path(np.zeros((1, 2)))
    axes.add_patch(PathPatch(drawn, facecolor=fill[0], hatch=fill[1], linewidth=0, label=label))


def _marked(axes: Axes, plane: Plane, designs: Sequence[GivenDesign], label: str, colour: str, mark: str = "*") -> None:
    """Mark the designs that lie on the plane."""
    at = list(zip(_axes(plane), plane.axes, strict=True))
    spots = [tuple(along.places(point(*design)[axis]) for along, axis in at) for design in designs]
    if np.isfinite(spots).any():
        x, y = zip(*spots, strict=True)
        axes.scatter(x, y, s=180, c=colour, marker=mark, edgecolors=INK, label=label, zorder=5, clip_on=False)


def _contours(axes: Axes, problem: Problem, region: Region) -> None:
    """Draw contours of the least error of any feasible coupling, where gains are proved feasible, and the line beyond
    which velocity loops have hardly any effect."""
    plane, prepared, upright = region.plane, prepare(problem), region.plane.axes == (0, 1)
    marks = np.linspace(0, plane.side, MESH).astype(int)
    velocity, position = (plane.edges[plane.axes.index(axis)][marks] for axis in (0, 1))
    gains, at = Gains(*np.meshgrid(velocity, position, indexing="ij")), marks / plane.side
    scaled = prepared.units.to_dimensionless((gains.velocity, gains.position, 0.0, 0.0, 0.0))[:2]
    with np.errstate(all="ignore"):  # one velocity after the other: all would need too much memory
        rows = (Gains(*(np.atleast_2d(each) for each in row)) for row in zip(*scaled, strict=True))
        errors = prepared.units.error * np.concatenate([least_errors(prepared.scaled, row) for row in rows])
        tracking = tracking_terms(problem, gains)
    feasible = np.zeros((plane.side + 1,) * 2, bool)
    for x_low, x_high, y_low, y_high in region.squares[:, region.kinds == Kind.FEASIBLE].T:
        feasible[x_low : x_high + 1, y_low : y_high + 1] = True
    inside = feasible[np.ix_(marks, marks)]
    sound = np.isfinite(errors) & (inside if upright else inside.T)
    if sound.sum() >= 4:
        levels = {float(f"{level:.2g}") for level in np.quantile(errors[sound], (0.02, 0.1, 0.3, 0.6, 0.9))}
        shown = np.where(sound, errors, np.nan)
        _lines(axes, at, shown.T if upright else shown, sorted(levels), INK, "least error", "-")
    shown = tracking.T if upright else tracking
    _lines(axes, at, shown, [IDLE_TRACKING], RED, f"idle where |1 - G_he| > {IDLE_TRACKING:g}", ":")


def _lines(
    axes: Axes, at: Floats, values: Floats, levels: Sequence[float], colour: str, label: str, dashes: str
) -> None:
    """Draw contours; those of several levels state them, where no other level and no border is in the way."""
    drawn = axes.contour(at, at, values, levels=levels, colors=colour, linewidths=1.0, linestyles=dashes)
    others = [np.array(text.get_position()) for text in axes.texts]
    for text in axes.clabel(drawn, fmt="%g", fontsize=8) if len(levels) > 1 else ():
        place = np.array(text.get_position())
        room = [place.min(), 1 - place.max(), *(np.max(np.abs(place - other) / (2, 1)) for other in others)]
        if min(room) < LABEL_ROOM:
            text.remove()
        else:
            others.append(place)
    if any(len(each) for each in drawn.allsegs):
        axes.plot([], [], dashes, color=colour, linewidth=1.0, label=label)


def _limit(axes: Axes, plane: Plane, line: Line, style: Any) -> None:
    """Draw a limit of the literature."""
    values = drawable(plane, line)
    if values is None:
        return
    at = [axis.places(value) for axis, value in zip(_axes(plane), values, strict=True)]
    if np.isfinite(sum(at)).any():
        axes.plot(*at, linestyle=style, color=INK, linewidth=1.4, label=line.label)


def _contours_of_designs(axes: Axes, problem: Problem, region: Region) -> None:
    """Draw contours of the error and of the least damping ratio of single designs, where they are proved feasible."""
    mesh = mesh_of(problem, region)
    if mesh is None or np.isfinite(mesh.error).sum() < 4:
        return
    levels = {float(f"{level:.2g}") for level in np.nanquantile(mesh.error, (0.02, 0.1, 0.3, 0.6, 0.9))}
    _lines(axes, mesh.at, mesh.error.T, sorted(levels), INK, "error", "-")
    ratio = np.where(np.isinf(mesh.ratio), RATIOS[-1] * 2, mesh.ratio)
    if np.isfinite(ratio).sum() >= 4:
        _lines(axes, mesh.at, ratio.T, RATIOS, RED, "least damping ratio", ":")


def _measured(axes: Axes, plane: Plane, points: Sequence[MeasuredPoint]) -> None:
    """Mark measured points."""
    along = _axes(plane)
    for stable, mark, label in ((True, "o", "measured stable"), (False, "x", "measured unstable")):
        some = [(float(along[0].places(p.x)), float(along[1].places(p.y))) for p in points if p.stable is stable]
        if some:
            x, y = zip(*some, strict=True)
            fill, edge = (PAPER, INK) if stable else (INK, None)
            axes.scatter(x, y, 26, fill, marker=mark, edgecolors=edge, label=label, zorder=4, clip_on=False)
