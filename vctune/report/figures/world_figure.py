"""Draw the map of the environments with which a design is stable, and place the cells of a plane in it."""

from __future__ import annotations

from math import nan

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.model.numbers.keys import labelled
from vctune.model.problem import Problem
from vctune.report.figures.style import WIDTH
from vctune.report.svg.drawing import Drawing
from vctune.report.svg.elements import INK, text
from vctune.report.svg.labels import legend
from vctune.report.svg.scales import decades_between, round_numbers
from vctune.report.typography import tick
from vctune.study.plane import Plane, Squares
from vctune.study.region import Kind, Region

# Colours and hatchings that remain distinct in grey and for readers with a colour deficiency
GOOD, BAD, OPEN = ("#b5d9f2", ""), ("#e58b2a", "///"), ("#6e6e78", "--")
FILLS = {Kind.FEASIBLE: GOOD, Kind.INFEASIBLE: BAD, Kind.UNDECIDED: OPEN}
LABELS = {kind: f"proved {kind.name.lower()}" for kind in FILLS} | {Kind.UNDECIDED: "undecided"}
WORLD_LABELS = {Kind.FEASIBLE: "may be rendered", Kind.INFEASIBLE: "refused in some hand", Kind.UNDECIDED: "undecided"}
# Height of the strip for the line K_p = 0, and distance of the strip from the plane, as shares of the plane
STRIP, GAP = 0.03, 0.008
INTERRUPTED = "interrupted: some undecided cells were not examined"
APART = (0.07, 0.035)  # Least distance between the ticks on x and on y, as a share of the axis


def world_figure(problem: Problem, region: Region) -> Drawing:
    """Return the map of environments with which given gains are stable: the Z-width of the device with these gains."""
    plane, drawing = region.plane, Drawing(WIDTH, 3.8, left=0.78, top=0.6)
    (panel,) = drawing.divide()
    panel.grid = False
    for k, scale in enumerate((panel.x, panel.y)):
        values, at = marks(plane, k)
        scale.limits, scale.label = (lowest(plane, k), 1.0), labelled(plane.keys[plane.axes[k]], problem.units)
        scale.ticks, scale.words = at.tolist(), [tick(value) for value in values]
    for kind, (colour, hatch) in FILLS.items():
        corners = cells(plane, region.squares[:, region.kinds == kind])
        x, y = np.concatenate((corners, np.full((len(corners), 1, 2), nan)), axis=1).reshape(-1, 2).T
        edge = INK if hatch else colour
        panel.fill(x, y, facecolor=colour, hatch=hatch, edgecolor=edge, linewidth=0, label=WORLD_LABELS[kind])
    if problem.worlds is not None:
        names = [plane.keys[axis].partition(".")[2] for axis in plane.axes]
        ends = [[getattr(end, name) for name in names] for end in (problem.worlds.low, problem.worlds.high)]
        low, top = ([spot(plane, k, min(each[k], plane.edges[k][-1])) for k in (0, 1)] for each in ends)
        across, up = ([low[k], top[k]] for k in (0, 1))
        panel.plot([across[k] for k in (0, 1, 1, 0, 0)], [up[k] for k in (0, 0, 1, 1, 0)], label="[environment]")
    words, _, high = legend(panel.marks, 2)
    panel.over.append(f'<g transform="translate({panel.box[0]:.1f} {panel.box[1] - high - 4:.1f})">{words}</g>')
    if region.interrupted:
        drawing.over.append(text(panel.box[0], 12.0, INTERRUPTED, size=8))
    return drawing


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
