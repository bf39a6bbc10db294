"""Simulated experiments as the object of simulation.json and the arrays of traces.npz: plain, finite or null."""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import Any

import numpy as np

from vctune.document.digest import experiments_digest
from vctune.document.reading import ProblemFile
from vctune.document.simulation import SCHEMA
from vctune.document.strict import finite
from vctune.model.experiment import Environment
from vctune.model.quantities import Coupling, Gains
from vctune.simulation.experiment import Run, Simulated
from vctune.simulation.motion import Floats, stroke_time
from vctune.simulation.run import Traces
from vctune.simulation.thinning import thinned
from vctune.version import __version__

TOLERANCE = 1.5e-3
"""By how much of the range that a figure shows a curve may differ: less than the line is wide. Half: more points in
simulation.json, the same picture. Twice: corners begin to show in print."""


def simulation_record(
    file: ProblemFile, gains: Gains, coupling: Coupling, simulated: list[Simulated]
) -> dict[str, Any]:
    """Return the JSON object of simulated experiments; every number in it is finite or null.

    Curves are thinned for drawing, to `TOLERANCE`.
    """
    return {
        "schema": SCHEMA,
        "problem": {
            "name": file.problem.name,
            "sha256": file.sha256,
            "experiments_sha256": experiments_digest(file.problem.experiments),
        },
        "gains": asdict(gains),
        "coupling": asdict(coupling),
        "experiments": [_experiment(one) for one in simulated],
        "versions": {"vctune": __version__},
    }


def trace_arrays(simulated: list[Simulated]) -> dict[str, Floats]:
    """Return every trace by experiment, run and quantity: "spring/design/force"."""
    return {
        f"{one.experiment.name}/{name}/{field.name}": getattr(made.traces, field.name)
        for one in simulated
        for name, made in (("baseline", one.baseline), ("design", one.design))
        if made is not None
        for field in fields(Traces)
        if field.name != "diverged"
    }


def _experiment(one: Simulated) -> dict[str, Any]:
    experiment, pid = one.experiment, one.experiment.baseline
    least, runs = one.least_virtual, {"baseline": one.baseline, "design": one.design}
    over, cycle = axis(experiment.environment), 2 * stroke_time(experiment.operator)
    curves = {name: _curve(made.traces, over, cycle) for name, made in runs.items() if made is not None}
    x_range, y_range = (max(np.ptp(curve[k]) for curve in curves.values()) for k in (0, 1))
    tolerance = (TOLERANCE * x_range or 1.0, TOLERANCE * y_range or 1.0)
    return {
        "name": experiment.name,
        "environment": asdict(experiment.environment),
        "axis": over,
        "samples": len(one.design.traces.time),
        "least_virtual": None
        if least is None or pid is None
        else {"share": least, "mass": least * pid.mass, "damping": least * pid.damping},
        **{
            name: None if made is None else _run(made) | {"curve": _thinned(curves[name], tolerance)}
            for name, made in runs.items()
        },
    }


def axis(environment: Environment) -> str:
    """Return over what an environment's force is drawn: position for a spring, velocity for the rest."""
    return "position" if environment.stiffness > 0 else "velocity"


def _run(made: Run) -> dict[str, Any]:
    measured = asdict(made.metrics) if made.metrics else None
    return {
        "diverged_s": made.traces.diverged,
        "metrics": finite(measured),
        "loop": {"stable": made.mode.radius < 1, "spectral_radius": made.mode.radius, "hz": made.mode.hz},
    }


def _curve(traces: Traces, name: str, cycle: float) -> tuple[Floats, Floats]:
    """Return position or velocity and the force over it, without the first cycle if there are more."""
    first = int(np.searchsorted(traces.time, cycle * (1 - 1e-9)))
    first = first if len(traces.time) - first > 1 else 0
    return getattr(traces, name)[first:], traces.force[first:]


def _thinned(curve: tuple[Floats, Floats], tolerance: tuple[float, float]) -> list[list[float]]:
    return [[float(f"{value:.5g}") for value in point] for point in np.transpose(curve)[thinned(*curve, tolerance)]]
