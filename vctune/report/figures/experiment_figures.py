"""The experiments of simulation.json as a figure in the manner of the paper's figures 6 and 7, and as a table."""

from __future__ import annotations

from typing import Any

import numpy as np

from vctune.document.records.simulation_json import ExperimentRecord, RunRecord, SimulationRecord
from vctune.model.numbers.units import Units
from vctune.report.figures.style import WIDTH
from vctune.report.svg.drawing import Drawing
from vctune.report.svg.elements import BLUE, GREY, ORANGE, RED, text
from vctune.report.svg.panel import Panel
from vctune.report.svg.scales import round_numbers

HEADINGS = ("experiment", "controller", "felt", "off by", "non-overlap", "residual", "ripple", "motor", "loop")


def simulation_figure(simulation: SimulationRecord) -> Drawing:
    """Return a figure with an experiment in each row, a regular PID on the left and the design on the right."""
    count, units = len(simulation.experiments), simulation.units
    drawing = Drawing(WIDTH, 1.95 * count + 0.2, left=0.72, right=0.12, top=0.3)
    panels = drawing.divide(count, 2, (0.12, 0.62))
    for left, right, experiment in zip(panels[::2], panels[1::2], simulation.experiments, strict=True):
        _draw(left, experiment, experiment.baseline, "regular PID", ORANGE, units)
        _draw(right, experiment, experiment.design, "this design", BLUE, units)
        left.set(ylabel=f"{units.force_name}, {units.force}")
        for panel in (left, right):
            panel.x.limits, panel.y.limits = (
                (min(low for low, _ in ends), max(high for _, high in ends))
                for ends in ((left.get_xlim(), right.get_xlim()), (left.get_ylim(), right.get_ylim()))
            )
            panel.set_xticks(round_numbers(*panel.get_xlim(), 3))
            panel.set_yticks(round_numbers(*panel.get_ylim(), 5))
        right.y.words = [""] * len(right.y.ticks or ())
    return drawing


def _draw(
    panel: Panel, experiment: ExperimentRecord, run: RunRecord | None, title: str, colour: str, units: Units
) -> None:
    named = {"position": f"position, {units.position}", "velocity": f"velocity, {units.speed}"}
    panel.set(title=f"{experiment.name}: {title}", xlabel=named[experiment.axis])
    left, top, width, height = panel.box
    if run is None:
        words = "no baseline in the file"
        panel.over.append(text(left + width / 2, top + height / 2, words, ha="center", colour=GREY))
        return
    curve = np.array(run.curve)
    panel.plot(curve[:, 0], curve[:, 1], color=colour, linewidth=1.0)
    ends = np.linspace(curve[:, 0].min(), curve[:, 0].max(), 401)
    asked = _asked(experiment, ends)
    reached = (asked >= curve[:, 1].min()) & (asked <= curve[:, 1].max())
    panel.plot(ends[reached], asked[reached], color=RED, linewidth=1, linestyle="--")
    if run.diverged_s is not None:
        note = f"diverged from {run.diverged_s:.4g} s on"
        panel.over.append(text(left + width / 2, top + 0.1 * height, note, ha="center", colour=RED))


def _asked(experiment: ExperimentRecord, at: np.ndarray[Any, Any]) -> Any:
    """Return the force of the environment over the figure's axis: over position at rest, or over constant velocity."""
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
