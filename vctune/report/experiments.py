"""The experiments of simulation.json as a table, and what they find."""

from __future__ import annotations

from vctune.document.records.simulation_json import RunRecord, SimulationRecord
from vctune.model.numbers.units import Units

HEADINGS = ("experiment", "controller", "felt", "off by", "non-overlap", "residual", "ripple", "motor", "loop")


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
