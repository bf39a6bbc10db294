"""The experiments of simulation.json: their table, what they find, and a figure like the paper's figures 6 and 7."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from vctune.model.numbers.units import Units
from vctune.report.style import BLUE, GREY, ORANGE, RED, WIDTH
from vctune.report.templates import Shown, words
from vctune.simulation.oscillation import Motion
from vctune.simulation.simulation_record import ExperimentRecord, RunRecord, SimulationRecord

HEADINGS = (
    "experiment",
    "controller",
    "felt",
    "off by",
    "non-overlap",
    "residual",
    "ripple",
    "motor",
    "trace",
    "linear loop",
)


def measured_rows(simulation: SimulationRecord) -> list[tuple[str, ...]]:
    """Return the rows of the table under `HEADINGS`, as texts."""
    return [
        (experiment.name, controller, *_cells(run, simulation.units, simulation.command_unit))
        for experiment in simulation.experiments
        for run, controller in (
            (experiment.baseline, "regular PID"),
            (experiment.design, "this design"),
        )
        if run is not None
    ]


def simulation_finding(simulation: SimulationRecord) -> str:
    """Return the deviation of each felt value from the rendered value, with the design and with the regular PID; "" if
    the experiments render no value."""
    shown = [(one.name, _worst_off(one.design), _worst_off(one.baseline)) for one in simulation.experiments]
    lines = [
        f"{name}: off by {design}" + (f" ({baseline} with a regular PID)" if baseline else "")
        for name, design, baseline in shown
        if design
    ]
    whole = "; ".join(lines)
    return f"{whole[0].upper()}{whole[1:]}." if whole else ""


def _worst_off(run: RunRecord | None) -> str:
    """Return the greatest deviation of a felt value from the rendered value; "" if there is no such value."""
    fits = {} if run is None or run.metrics is None else run.metrics.fits
    off = [fit.value / fit.asked - 1 for fit in fits.values() if fit.value is not None and fit.asked]
    return f"{100 * max(off, key=abs):+.2g} %" if off else ""


def _cells(run: RunRecord, units: Units, command_unit: str) -> tuple[str, ...]:
    stable = "stable" if run.loop.stable else f"unstable at {run.loop.hz:.4g} Hz"
    measured = run.metrics
    if measured is None:
        return (f"diverged from {run.diverged_s:.4g} s on", "", "", "", "", "", "diverges", stable)
    fits = {name: (fit.value, fit.asked) for name, fit in measured.fits.items() if fit.value is not None}
    felt = ", ".join(f"{value:.5g} {units.of(name)}" for name, (value, _) in fits.items())
    off = ", ".join(f"{100 * (value / asked - 1):+.3g} %" for value, asked in fits.values() if asked)
    saturated = f", {measured.saturated:.1%} saturated" if measured.saturated else ""
    return (
        felt,
        off,
        *(_number(value, units.force) for value in (measured.non_overlap, measured.residual, measured.ripple)),
        _number(measured.peak_motor, command_unit) + saturated,
        _motion(run.motion, units),
        stable,
    )


def _motion(motion: Motion | None, units: Units) -> str:
    """Return what a trace does, in words."""
    if motion is None:
        return ""
    if motion.frequency_hz is None or motion.amplitude_m is None:
        return motion.kind
    unit = {"m": "um", "rad": "urad"}[units.position]
    return f"{motion.kind} at {motion.frequency_hz:.3g} Hz, {1e6 * motion.amplitude_m:.3g} {unit}"


def _number(value: float | None, unit: str) -> str:
    return "" if value is None else f"{value:.3g} {unit}"


def simulation_figure(simulation: SimulationRecord) -> Shown:
    """Return a figure with an experiment in each row, a regular PID on the left and the design on the right."""
    count, units = len(simulation.experiments), simulation.units
    named = {"position": f"position, {units.position}", "velocity": f"velocity, {units.speed}"}
    compared = any(experiment.baseline is not None for experiment in simulation.experiments)
    figure = Figure(figsize=(WIDTH if compared else WIDTH / 2, 2.2 * count))
    panels = figure.subplots(count, 2 if compared else 1, squeeze=False, sharex="row", sharey="row")
    for row, experiment in zip(panels, simulation.experiments, strict=True):
        if compared:
            _draw(row[0], experiment, experiment.baseline, "regular PID", ORANGE)
        _draw(row[-1], experiment, experiment.design, "this design", BLUE)
        row[0].set(ylabel=f"{units.force_name}, {units.force}")
        for axes in row:
            axes.set(xlabel=named[experiment.axis])
        row[0].xaxis.set_major_locator(MaxNLocator(4))
    title = "The design and a regular PID in simulated experiments" if compared else "The design in experiments"
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
    asked = _asked(experiment, run, ends)
    reached = (asked >= curve[:, 1].min()) & (asked <= curve[:, 1].max())
    axes.plot(ends[reached], asked[reached], color=RED, linewidth=1, linestyle="--")
    if run.diverged_s is not None:
        axes.text(0.5, 0.9, f"diverged from {run.diverged_s:.4g} s on", color=RED, **note)


def _asked(experiment: ExperimentRecord, run: RunRecord, at: np.ndarray[Any, Any]) -> Any:
    """Return the rendered force over the figure's axis: over position at rest, or over constant velocity."""
    environment = experiment.environment
    if experiment.axis == "velocity":
        return environment.damping * at
    fits = {} if run.metrics is None else run.metrics.fits
    stiffness = fits["stiffness"].asked if "stiffness" in fits else environment.stiffness
    force = (stiffness or 0.0) * (at - environment.zero)
    return np.maximum(force, 0.0) if environment.wall else force
