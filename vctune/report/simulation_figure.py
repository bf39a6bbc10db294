"""The figure of the experiments of simulation.json, in the manner of the paper's figures 6 and 7."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from vctune.document.records.simulation_json import ExperimentRecord, RunRecord, SimulationRecord
from vctune.report.design_figures import Shown
from vctune.report.experiments import simulation_finding
from vctune.report.style import BLUE, GREY, ORANGE, RED, WIDTH, canvas, round_numbers
from vctune.report.typography import words


def simulation_figure(simulation: SimulationRecord) -> Shown:
    """Return a figure with an experiment in each row, a regular PID on the left and the design on the right."""
    count, units = len(simulation.experiments), simulation.units
    figure = canvas(WIDTH, 2.1 * count + 0.2, left=0.72, right=0.12, top=0.3, gaps=(0.08, 0.75))
    panels = figure.subplots(count, 2, squeeze=False, sharey="row")
    for (left, right), experiment in zip(panels, simulation.experiments, strict=True):
        _draw(left, experiment, experiment.baseline, "regular PID", ORANGE)
        _draw(right, experiment, experiment.design, "this design", BLUE)
        left.set_ylabel(f"{units.force_name}, {units.force}")
        ends = [axes.get_xlim() for axes in (left, right) if axes.lines] or [(0.0, 1.0)]
        named = {"position": f"position, {units.position}", "velocity": f"velocity, {units.speed}"}
        xlim = min(low for low, _ in ends), max(high for _, high in ends)
        for axes in (left, right):
            axes.set(xlim=xlim, xlabel=named[experiment.axis])
            axes.set_xticks(round_numbers(*xlim, 3))
    title = "The design and a regular PID in simulated experiments"
    return Shown("simulation", title, simulation_finding(simulation), words("simulation"), figure)


def _draw(axes: Axes, experiment: ExperimentRecord, run: RunRecord | None, title: str, colour: str) -> None:
    axes.set_title(f"{experiment.name}: {title}", fontsize=8)
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
