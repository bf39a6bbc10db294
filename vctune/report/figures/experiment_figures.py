"""The experiments of simulation.json as a figure in the manner of the paper's figures 6 and 7, and as a table."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vctune.document.records.simulation_json import ExperimentRecord, RunRecord, SimulationRecord
from vctune.model.numbers.units import Units
from vctune.report.figures.style import BLUE, GREY, ORANGE, RED, STYLE, WIDTH, canvas

HEADINGS = ("experiment", "controller", "felt", "off by", "non-overlap", "residual", "ripple", "motor", "loop")


def simulation_figure(simulation: SimulationRecord) -> Figure:
    """Return a figure with an experiment in each row, a regular PID on the left and the design on the right."""
    with rc_context(STYLE):
        count, units = len(simulation.experiments), simulation.units
        figure = canvas(WIDTH, 1.95 * count + 0.2, left=0.72, right=0.12, top=0.3, gaps=(0.12, 0.62))
        rows = figure.subplots(count, 2, squeeze=False, sharey="row", sharex="row")
        for (left, right), experiment in zip(rows, simulation.experiments, strict=True):
            _draw(left, experiment, experiment.baseline, "regular PID", ORANGE, units)
            _draw(right, experiment, experiment.design, simulation.controller or "this design", BLUE, units)
            left.set_ylabel(f"{units.force_name}, {units.force}")
    return figure


def _draw(
    axes: Axes, experiment: ExperimentRecord, run: RunRecord | None, title: str, colour: str, units: Units
) -> None:
    axes.set_title(f"{experiment.name}: {title}", fontsize=8)
    axes.set_xlabel(
        {"position": f"position, {units.position}", "velocity": f"velocity, {units.speed}"}[experiment.axis]
    )
    if run is None:
        axes.text(0.5, 0.5, "no baseline in the file", transform=axes.transAxes, ha="center", color=GREY)
        return
    curve = np.array(run.curve)
    axes.plot(curve[:, 0], curve[:, 1], color=colour, linewidth=1.0)
    ends = np.linspace(curve[:, 0].min(), curve[:, 0].max(), 401)
    asked = _asked(experiment, ends)
    reached = (asked >= curve[:, 1].min()) & (asked <= curve[:, 1].max())
    axes.plot(ends[reached], asked[reached], color=RED, linewidth=1, linestyle="--")
    axes.locator_params(axis="x", nbins=3)
    axes.locator_params(axis="y", nbins=5)
    if run.diverged_s is not None:
        note = f"diverged from {run.diverged_s:.4g} s on"
        axes.text(0.5, 0.9, note, transform=axes.transAxes, ha="center", color=RED)


def _asked(experiment: ExperimentRecord, at: np.ndarray[Any, Any]) -> Any:
    """Return the force of the environment over the figure's axis, for rest or for constant speed."""
    environment = experiment.environment
    if experiment.axis == "velocity":
        return environment.damping * at
    force = environment.stiffness * (at - environment.zero)
    return np.maximum(force, 0.0) if environment.wall else force


def measured_rows(simulation: SimulationRecord) -> list[tuple[str, ...]]:
    """Return the rows of the table under `HEADINGS`, as texts."""
    return [
        (experiment.name, controller, *_cells(run, simulation.units, simulation.command_unit))
        for experiment in simulation.experiments
        for run, controller in (
            (experiment.baseline, "regular PID"),
            (experiment.design, simulation.controller or "this design"),
        )
        if run is not None
    ]


def simulation_finding(simulation: SimulationRecord) -> str:
    """Return the deviation of each felt number from the rendered one, with the design and with the regular PID; "" if
    the experiments render no number."""
    shown = [(one.name, _worst_off(one.design), _worst_off(one.baseline)) for one in simulation.experiments]
    lines = [
        f"{name}: off by {design}" + (f" ({baseline} with a regular PID)" if baseline else "")
        for name, design, baseline in shown
        if design
    ]
    whole = "; ".join(lines)
    return f"{whole[0].upper()}{whole[1:]}." if whole else ""


def _worst_off(run: RunRecord | None) -> str:
    """Return the greatest deviation of a felt number from the rendered one; "" without such a number."""
    fits = {} if run is None or run.metrics is None else run.metrics.fits
    off = [fit.value / fit.asked - 1 for fit in fits.values() if fit.value is not None and fit.asked]
    return f"{100 * max(off, key=abs):+.2g} %" if off else ""


def dwell_line(simulation: SimulationRecord) -> str:
    """Return the least dwell time of changing hands with which the loop stayed at rest; "" without such experiments."""
    changing = [(one.dwell_s, one.stayed) for one in simulation.experiments if one.dwell_s is not None]
    if not changing:
        return ""
    grew = max((dwell for dwell, stayed in changing if not stayed), default=0.0)
    rest = min((dwell for dwell, _ in changing if dwell > grew), default=None)
    if rest is None:
        return f"Simulated, not proved: with a hand that changed every {1e3 * grew:.4g} ms the loop grew."
    told = f"Simulated, not proved: hands that changed every {1e3 * rest:.4g} ms or slower stayed at rest"
    return f"{told}; every {1e3 * grew:.4g} ms one grew." if grew else f"{told}."


def _cells(run: RunRecord, units: Units, command_unit: str) -> tuple[str, ...]:
    stable = "stable" if run.loop.stable else f"unstable at {run.loop.hz:.4g} Hz"
    measured = run.metrics
    if measured is None:
        return (f"diverged from {run.diverged_s:.4g} s on", "", "", "", "", "", stable)
    fits = {name: (fit.value, fit.asked) for name, fit in measured.fits.items() if fit.value is not None}
    felt = ", ".join(f"{value:.5g} {units.of(name)}" for name, (value, _) in fits.items())
    off = ", ".join(f"{100 * (value / asked - 1):+.3g} %" for value, asked in fits.values() if asked)
    saturated = f", {measured.saturated:.1%} saturated" if measured.saturated else ""
    return (
        felt,
        off,
        *(_number(value, units.force) for value in (measured.non_overlap, measured.residual, measured.ripple)),
        _number(measured.peak_motor, command_unit) + saturated,
        stable,
    )


def _number(value: float | None, unit: str) -> str:
    return "" if value is None else f"{value:.3g} {unit}"
