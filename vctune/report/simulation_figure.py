"""The figure of the experiments of simulation.json, in the manner of the paper's figures 6 and 7."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from vctune.document.records.simulation_json import ExperimentRecord, RunRecord, SimulationRecord
from vctune.report.experiments import simulation_finding
from vctune.report.style import BLUE, GREY, ORANGE, RED, WIDTH
from vctune.report.templates import Shown, words


def simulation_figure(simulation: SimulationRecord) -> Shown:
    """Return a figure with an experiment in each row, a regular PID on the left and the design on the right."""
    count, units = len(simulation.experiments), simulation.units
    named = {"position": f"position, {units.position}", "velocity": f"velocity, {units.speed}"}
    figure = Figure(figsize=(WIDTH, 2.2 * count))
    panels = figure.subplots(count, 2, squeeze=False, sharex="row", sharey="row")
    for (left, right), experiment in zip(panels, simulation.experiments, strict=True):
        _draw(left, experiment, experiment.baseline, "regular PID", ORANGE)
        _draw(right, experiment, experiment.design, "this design", BLUE)
        left.set(ylabel=f"{units.force_name}, {units.force}", xlabel=named[experiment.axis])
        right.set(xlabel=named[experiment.axis])
        left.xaxis.set_major_locator(MaxNLocator(4))
    title = "The design and a regular PID in simulated experiments"
    return Shown("simulation", title, simulation_finding(simulation), words("simulation"), figure)


def _draw(axes: Axes, experiment: ExperimentRecord, run: RunRecord | None, title: str, colour: str) -> None:
    axes.set_title(f"{experiment.name}: {title}")
    note: dict[str, Any] = {"transform": axes.transAxes, "ha": "center", "fontsize": 8}
    if run is None:
        axes.text(0.5, 0.5, "no baseline in the file", color=GREY, **note)
        return
    curve = np.array(run.curve)
    axes.plot(curve[:, 0], curve[:, 1], color=colour, linewidth=1.0)
    ends = np.linspace(curve[:, 0].min(), curve[:, 0].max(), 401)
    asked = _asked(experiment, ends)
    reached = (asked >= curve[:, 1].min()) & (asked <= curve[:, 1].max())
    axes.plot(ends[reached], asked[reached], color=RED, linewidth=1, linestyle="--")
    if run.diverged_s is not None:
        axes.text(0.5, 0.9, f"diverged from {run.diverged_s:.4g} s on", color=RED, **note)


def _asked(experiment: ExperimentRecord, at: np.ndarray[Any, Any]) -> Any:
    """Return the force of the environment over the figure's axis: over position at rest, or over constant velocity."""
    environment = experiment.environment
    if experiment.axis == "velocity":
        return environment.damping * at
    force = environment.stiffness * (at - environment.zero)
    return np.maximum(force, 0.0) if environment.wall else force
