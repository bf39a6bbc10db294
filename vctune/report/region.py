"""The picture of a region: what is proved where, the optimum, contours of the error, the low-frequency limit."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from vctune.analysis.extrema import Floats
from vctune.design.grid import least_errors
from vctune.design.variables import KEYS, point
from vctune.document.problem import Problem
from vctune.model.quantities import Coupling, Gains
from vctune.report.figures import BLUE, GREEN, GREY, INK, ORANGE, RED, STYLE
from vctune.study.plane import Plane, Squares
from vctune.study.region import Kind, Region

COLOURS = {Kind.FEASIBLE: GREEN, Kind.INFEASIBLE: RED, Kind.UNDECIDED: GREY}
LABELS = {kind: f"proved {kind.name.lower()}" for kind in COLOURS} | {Kind.UNDECIDED: "undecided"}
STRIP = 0.02
"""Height of the strip that stands for the line K_p = 0."""
MESH = 48
UNITS = {"gains.velocity": "K_v, N s/m", "gains.position": "K_p, N/m", "coupling.damping": "b_c, N s/m"}
UNITS |= {"coupling.mass": "m_c, kg", "coupling.drag": "b_0, N s/m"}


def region_figure(problem: Problem, region: Region, designs: list[tuple[Gains, Coupling]]) -> Figure:
    """Return the cells in the optimiser's coordinates, in which their areas are counted."""
    plane = region.plane
    with rc_context(STYLE):
        figure, axes = _frame(plane)
        for kind, colour in COLOURS.items():
            _fill(axes, plane, region.squares[:, region.kinds == kind], colour, LABELS[kind])
        for gains, coupling in designs:
            values = point(gains, coupling)
            x, y = (_place(plane, k, np.array([values[axis]]))[0] for k, axis in enumerate(plane.axes))
            axes.plot(x, y, "*", color=ORANGE, markeredgecolor=INK, markersize=14, label="optimum", zorder=5)
        if set(plane.axes) == {0, 1}:
            _contours(axes, problem, plane)
            _limit(axes, problem, plane)
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def lost_figure(region: Region) -> Figure:
    """Return what is still proved of a baseline's feasible cells, and what has lost its proof."""
    kept = region.kinds == Kind.FEASIBLE
    with rc_context(STYLE):
        figure, axes = _frame(region.plane)
        _fill(axes, region.plane, region.squares[:, kept], GREEN, "proved again")
        _fill(axes, region.plane, region.squares[:, ~kept], RED, "lost")
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def _frame(plane: Plane) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(8.6, 5.6), layout="constrained")
    axes = figure.subplots()
    axes.set(xlim=(-STRIP, 1), ylim=(-STRIP, 1))
    axes.grid(visible=False)
    for place, axis in enumerate(plane.axes):
        values = _marks(plane.edges[place])
        setter: Any = (axes.set_xticks, axes.set_yticks)[place]
        setter(_place(plane, place, values), [f"{value:g}" for value in values])
        (axes.set_xlabel, axes.set_ylabel)[place](UNITS[KEYS[axis]])
    return figure, axes


def _marks(edges: Floats) -> Floats:
    """Return the powers of ten between the edges, or their ends and middle where there are none."""
    low = edges[edges > 0][0]
    powers = 10.0 ** np.arange(np.ceil(np.log10(low)), np.floor(np.log10(edges[-1])) + 1)
    if len(powers) < 2:
        powers = np.array([float(f"{edges[len(edges) * k // 4]:.3g}") for k in (1, 2, 3)])
    powers = powers[:: max(1, len(powers) // 8)]
    return np.concatenate(([0.0], powers)) if edges[0] == 0 else powers


def _place(plane: Plane, k: int, values: Floats) -> Floats:
    """Return where values of an axis lie between 0 and 1; nan outside."""
    edges = plane.edges[k]
    return np.interp(values, edges, np.linspace(0, 1, len(edges)), left=np.nan, right=np.nan)


def _fill(axes: Axes, plane: Plane, squares: Squares, colour: str, label: str) -> None:
    side = len(plane.edges[0]) - 1
    x0, x1, y0, y1 = squares / side
    x0, y0 = np.where(x0 == x1, -STRIP, x0), np.where(y0 == y1, -STRIP, y0)
    corners = np.stack([np.stack((x, y), axis=1) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))], axis=1)
    axes.add_collection(PolyCollection(list(corners), facecolors=colour, edgecolors="none", alpha=0.45, label=label))


def _contours(axes: Axes, problem: Problem, plane: Plane) -> None:
    """Draw the least error that any admissible coupling gives."""
    impedance, time = problem.transparency.reference_impedance, problem.device.sample_time
    marks = np.linspace(0, len(plane.edges[0]) - 1, MESH).astype(int)
    x, y = np.meshgrid(plane.edges[0][marks], plane.edges[1][marks], indexing="ij")
    K_v, K_p = (x, y) if plane.axes == (0, 1) else (y, x)
    scaled = problem.in_units(impedance, time)
    with np.errstate(all="ignore"):
        errors = least_errors(scaled, Gains(K_v / impedance, K_p * time / impedance))
    sound = np.isfinite(errors)
    if sound.sum() < 4:
        return
    levels = np.unique([float(f"{level:.2g}") for level in np.quantile(errors[sound], (0.02, 0.1, 0.3, 0.6, 0.9))])
    place = marks / marks[-1]
    drawn = axes.contour(place, place, np.where(sound, errors, np.nan).T, levels=levels, colors=BLUE, linewidths=1)
    axes.clabel(drawn, fmt="%g", fontsize=8)
    axes.plot([], [], color=BLUE, linewidth=1, label="least error")


def _limit(axes: Axes, problem: Problem, plane: Plane) -> None:
    """Draw tau K_p = b + K_v, beyond which Re G_hh < 0 at low frequencies."""
    device, swapped = problem.device, plane.axes == (1, 0)
    K_v = plane.edges[1 if swapped else 0]
    K_p = (device.damping + K_v) / device.lag
    x, y = (K_p, K_v) if swapped else (K_v, K_p)
    axes.plot(_place(plane, 0, x), _place(plane, 1, y), color=INK, linewidth=1.2, label="τ K_p = b + K_v")
