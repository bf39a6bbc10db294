"""The picture of a region: verdict of each cell, optimum, contours of the error, and the low-frequency limit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.path import Path
from matplotlib.ticker import LogLocator, MaxNLocator
from numpy.typing import NDArray

from vctune.analysis.demands import transparency_error
from vctune.analysis.extrema import Floats
from vctune.analysis.tracking import tracking_terms
from vctune.design.prepared import prepare
from vctune.design.search.grid import least_errors
from vctune.design.variables import point
from vctune.design.verdict.judge import IDLE
from vctune.model.gains import Gains
from vctune.model.numbers.keys import labelled
from vctune.model.numbers.units import Units
from vctune.model.problem import Problem
from vctune.report.figures.style import INK, ORANGE, PAPER, RED, STYLE, WIDTH, canvas, legend_above
from vctune.running import check_time
from vctune.study.plane import Plane, Squares
from vctune.study.region import Kind, Region
from vctune.study.region_check import Recheck
from vctune.study.region_record import Design

GOOD, BAD, OPEN = ("#b5d9f2", ""), ("#e58b2a", "///"), ("#6e6e78", "--")
"""Colours and hatchings that remain distinct in grey and for readers with a colour deficiency."""
FILLS = {Kind.FEASIBLE: GOOD, Kind.INFEASIBLE: BAD, Kind.UNDECIDED: OPEN}
LABELS = {kind: f"proved {kind.name.lower()}" for kind in FILLS} | {Kind.UNDECIDED: "undecided"}
WORLD_LABELS = {Kind.FEASIBLE: "may be rendered", Kind.INFEASIBLE: "refused in some hand", Kind.UNDECIDED: "undecided"}
STRIP, GAP = 0.03, 0.008
"""Height of the strip for the line K_p = 0, and distance of the strip from the plane."""
APART = (0.07, 0.035)
"""Least distance between the ticks on x and on y."""
MESH = 48


def region_figure(problem: Problem, region: Region, designs: Sequence[Design], marked: Design | None = None) -> Figure:
    """Return the figure of a region in the optimiser's coordinates; the areas of its cells count in these coordinates.

    Parameters
    ----------
    problem : problem; the figure shows contours of its error and, with any passive hand, the limit of K_p if the axes
        are K_v and K_p
    region : the cells and their verdicts; the title states if the computation was interrupted
    designs : optimal designs to mark
    marked : a given design, which the figure marks if it lies in the plane
    """
    plane = region.plane
    with rc_context(STYLE):
        interrupted = "interrupted: some of what is undecided was not looked at" * region.interrupted
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


def world_figure(problem: Problem, region: Region) -> Figure:
    """Return the map of environments with which given gains are stable: the Z-width of the device with these gains.

    Parameters
    ----------
    problem : problem; the figure shows its box of environments if it has one
    region : cells of environments
    """
    plane = region.plane
    with rc_context(STYLE):
        interrupted = "interrupted: some of what is undecided was not looked at" * region.interrupted
        figure, axes = _frame(plane, problem.units, interrupted, canvas(WIDTH, 3.8, left=0.78, top=0.6))
        for kind, fill in FILLS.items():
            _fill(axes, plane, region.squares[:, region.kinds == kind], fill, WORLD_LABELS[kind])
        if problem.worlds is not None:
            names = [plane.keys[axis].partition(".")[2] for axis in plane.axes]
            ends = [[getattr(end, name) for name in names] for end in (problem.worlds.low, problem.worlds.high)]
            (x, y), (X, Y) = ([_spot(plane, k, min(each[k], plane.edges[k][-1])) for k in (0, 1)] for each in ends)
            outline = Rectangle((x, y), X - x, Y - y, fill=False, edgecolor=INK, linewidth=1.6, label="[environment]")
            axes.add_patch(outline)
        legend_above(axes, 2)
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


def _frame(plane: Plane, units: Units, title: str = "", figure: Figure | None = None) -> tuple[Figure, Axes]:
    figure = figure or canvas(8.6, 5.2, left=0.95, right=2.1, top=0.35 if title else 0.15)
    axes = figure.subplots()
    axes.set_title(title, loc="left", pad=None if figure.get_figwidth() > WIDTH else 32)
    axes.grid(visible=False)
    for place, axis in enumerate(plane.axes):
        values, at = _marks(plane, place)
        low = -STRIP if plane.has_line(place) else 0.0
        keywords: Any = {
            "xy"[place] + part: value
            for part, value in (("lim", (low, 1)), ("label", labelled(plane.keys[axis], units)))
        }
        axes.set(**keywords)
        (axes.set_xticks, axes.set_yticks)[place](at, [_number(value) for value in values])
    return figure, axes


def _marks(plane: Plane, k: int) -> tuple[Floats, Floats]:
    """Return values for the ticks of an axis and their positions.

    The values are powers of ten, or round numbers if there are few powers, and 0.
    """
    edges = plane.edges[k]
    low = edges[edges > 0][0]
    values = 10.0 ** np.arange(np.ceil(np.log10(low)), np.floor(np.log10(edges[-1])) + 1)
    if len(values) < 3:
        values = np.array(LogLocator(subs=(1, 2, 5)).tick_values(low, edges[-1]))
    if edges[-1] < 3 * low:
        values = np.array(MaxNLocator(6).tick_values(low, edges[-1]))
    values = values[(values >= low) & (values <= edges[-1])]
    at = _place(plane, k, values)
    zero = [] if edges[0] > 0 else [-(STRIP + GAP) / 2 if plane.has_line(k) else 0.0]
    kept: list[int] = []
    for i in np.flatnonzero(np.isfinite(at)).tolist()[::-1]:  # from the top, where the ticks are farthest apart
        nearest = min((abs(at[i] - other) for other in [*zero, *at[kept[-1:]]]), default=1.0)
        kept += [i] if nearest >= APART[k] else []
    return np.concatenate((np.zeros(len(zero)), values[kept])), np.concatenate((zero, at[kept]))


def _number(value: float) -> str:
    exponent = round(np.log10(value)) if value > 0 else 0
    plain = -4 <= exponent <= 5 or not np.isclose(value, 10.0**exponent)
    return f"{value:g}" if plain else f"$10^{{{exponent}}}$"


def _place(plane: Plane, k: int, values: Floats) -> Floats:
    """Return the positions of values on an axis, from 0 to 1; nan outside."""
    edges = plane.edges[k]
    return np.interp(values, edges, np.linspace(0, 1, len(edges)), left=np.nan, right=np.nan)


def _spot(plane: Plane, k: int, value: float) -> float:
    """Return the position of a design on an axis; K_p = 0 lies on the strip."""
    on_line = value == 0 and plane.has_line(k)
    return -(STRIP + GAP) / 2 if on_line else float(_place(plane, k, np.array([value]))[0])


def _fill(axes: Axes, plane: Plane, squares: Squares, fill: tuple[str, str], label: str) -> None:
    """Draw cells as one path without seams, and those of the line K_p = 0 on the strip."""
    colour, hatch = fill
    lines = (squares[[0, 2]] == squares[[1, 3]]).any(axis=0)
    squares = np.concatenate([_joined(_joined(part, 1), 0) for part in (squares[:, lines], squares[:, ~lines])], axis=1)
    low, high = squares[[0, 2]] / (len(plane.edges[0]) - 1), squares[[1, 3]] / (len(plane.edges[0]) - 1)
    on_line = low == high
    (x0, y0), (x1, y1) = np.where(on_line, -STRIP, low), np.where(on_line, -GAP, high)
    corners = np.stack(
        [np.stack((x, y), axis=1) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0))], axis=1
    )
    codes = [Path.MOVETO, *[Path.LINETO] * 3, Path.CLOSEPOLY] * len(corners)
    cells = Path(corners.reshape(-1, 2), codes) if codes else Path(np.zeros((1, 2)))
    axes.add_patch(PathPatch(cells, facecolor=colour, hatch=hatch, linewidth=0, label=label))


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


def _marked(axes: Axes, plane: Plane, designs: Sequence[Design], mark: str, colour: str, label: str) -> None:
    spots = np.array(
        [[_spot(plane, k, point(*design)[axis]) for design in designs] for k, axis in enumerate(plane.axes)]
    )
    if designs and np.isfinite(spots).all(axis=0).any():
        x, y = spots
        axes.scatter(x, y, s=180, c=colour, marker=mark, edgecolors=INK, label=label, zorder=5, clip_on=False)


def _contours(axes: Axes, problem: Problem, region: Region) -> None:
    """Draw contours of the least error of any feasible coupling, where gains are proved feasible."""
    check_time()
    prepared, (marks, gains) = prepare(problem), _mesh(region.plane)
    K_v, K_p, *_ = prepared.units.to_dimensionless((gains.velocity, gains.position, 0.0, 0.0, 0.0))
    with np.errstate(all="ignore"):
        errors = least_errors(prepared.scaled, Gains(K_v, K_p)) * prepared.units.error
    check_time()
    sound = np.isfinite(errors) & _feasible(region)[np.ix_(marks, marks)]
    if sound.sum() < 4:
        return
    levels = np.unique([float(f"{level:.2g}") for level in np.quantile(errors[sound], (0.02, 0.1, 0.3, 0.6, 0.9))])
    place = marks / marks[-1]
    drawn = axes.contour(place, place, np.where(sound, errors, np.nan).T, levels=levels, colors=INK, linewidths=0.8)
    axes.clabel(drawn, fmt="%g", fontsize=8)
    if any(drawn.allsegs):
        axes.plot([], [], color=INK, linewidth=0.8, label="least error")


def _mesh(plane: Plane) -> tuple[NDArray[np.intp], Gains]:
    """Return the edges that form a mesh of a plane of gains, and the gains at its nodes."""
    marks = np.linspace(0, len(plane.edges[0]) - 1, MESH).astype(int)
    x, y = np.meshgrid(plane.edges[0][marks], plane.edges[1][marks], indexing="ij")
    return marks, Gains(x, y) if plane.axes == (0, 1) else Gains(y, x)


def _idle(problem: Problem, design: Design) -> bool:
    return problem.device.kind.own_loop and transparency_error(problem, *design).tracking > IDLE


def _idle_side(axes: Axes, problem: Problem, plane: Plane) -> None:
    """Draw the line beyond which velocity loops have hardly any effect."""
    marks, gains = _mesh(plane)
    with np.errstate(all="ignore"):
        tracking = tracking_terms(problem, gains)
    place = marks / marks[-1]
    drawn = axes.contour(place, place, tracking.T, levels=[IDLE], colors=RED, linewidths=1.2, linestyles=":")
    if any(drawn.allsegs):
        axes.plot([], [], ":", color=RED, linewidth=1.2, label=f"idle where |1 - G_he| > {IDLE:g}")


def _feasible(region: Region) -> NDArray[np.bool_]:
    """Return which nodes of the mesh belong to a cell that is proved feasible."""
    count = len(region.plane.edges[0])
    inside = np.zeros((count, count), bool)
    for x_low, x_high, y_low, y_high in region.squares[:, region.kinds == Kind.FEASIBLE].T:
        inside[x_low : x_high + 1, y_low : y_high + 1] = True
    return inside


def _limit(axes: Axes, problem: Problem, plane: Plane) -> None:
    """Draw tau K_p = b + K_v, beyond which Re G_hh < 0 at low frequencies."""
    device, swapped = problem.device, plane.axes == (1, 0)
    K_v = plane.edges[1 if swapped else 0]
    K_p = (device.damping + K_v) / device.loop_lag
    x, y = (K_p, K_v) if swapped else (K_v, K_p)
    at = _place(plane, 0, x), _place(plane, 1, y)
    if np.isfinite(sum(at)).any():
        axes.plot(*at, "--", color=INK, linewidth=1.4, label="τ K_p = b + K_v")
