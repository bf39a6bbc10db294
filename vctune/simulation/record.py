"""Simulated experiments as the object of simulation.json and the arrays of traces.npz: plain, finite or null."""

from __future__ import annotations

import itertools
from dataclasses import asdict, fields
from typing import Any

import numpy as np

from vctune.document.digest import experiments_digest
from vctune.document.experiment import Environment
from vctune.document.reading import ProblemFile
from vctune.document.simulation import SCHEMA
from vctune.document.strict import finite
from vctune.model.quantities import Coupling, Gains
from vctune.simulation.experiment import Run, Simulated
from vctune.simulation.motion import Floats, stroke_time
from vctune.simulation.run import Traces
from vctune.version import __version__

CURVE_BINS = 800


def simulation_record(
    file: ProblemFile, gains: Gains, coupling: Coupling, simulated: list[Simulated]
) -> dict[str, Any]:
    """Return the JSON object of simulated experiments; every number in it is finite or null.

    Curves are thinned for drawing: of each of `CURVE_BINS` equal times the least and the greatest force.
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
    least = one.least_virtual
    return {
        "name": experiment.name,
        "environment": asdict(experiment.environment),
        "axis": axis(experiment.environment),
        "samples": len(one.design.traces.time),
        "least_virtual": None
        if least is None or pid is None
        else {"share": least, "mass": least * pid.mass, "damping": least * pid.damping},
        "baseline": _run(one, one.baseline) if one.baseline else None,
        "design": _run(one, one.design),
    }


def axis(environment: Environment) -> str:
    """Return over what an environment's force is drawn: position for a spring, velocity for the rest."""
    return "position" if environment.stiffness > 0 else "velocity"


def _run(one: Simulated, made: Run) -> dict[str, Any]:
    measured = asdict(made.metrics) if made.metrics else None
    return {
        "diverged_s": made.traces.diverged,
        "metrics": finite(measured),
        "loop": {"stable": made.mode.radius < 1, "spectral_radius": made.mode.radius, "hz": made.mode.hz},
        "curve": _curve(made.traces, axis(one.experiment.environment), 2 * stroke_time(one.experiment.operator)),
    }


def _curve(traces: Traces, name: str, cycle: float) -> list[list[float]]:
    """Return the thinned curve of force over position or velocity, without the first cycle if there are more."""
    first = int(np.searchsorted(traces.time, cycle * (1 - 1e-9)))
    first = first if len(traces.time) - first > 1 else 0
    abscissa, force = getattr(traces, name)[first:], traces.force[first:]
    edges = np.linspace(0, len(force), min(CURVE_BINS, len(force)) + 1).astype(int)
    bins = [(int(low), force[low:high]) for low, high in itertools.pairwise(edges)]
    kept = sorted({low + int(extreme(part)) for low, part in bins for extreme in (np.argmin, np.argmax)})
    return [[float(f"{x:.5g}"), float(f"{f:.5g}")] for x, f in zip(abscissa[kept], force[kept], strict=True)]
