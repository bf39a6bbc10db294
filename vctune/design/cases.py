"""The devices at which the optimiser poses the demands: the nominal one and, if it is uncertain, its box's vertices.

What lies between them is the prover's business: a device of the box that it refutes joins them.
"""

from __future__ import annotations

from dataclasses import replace

from vctune.analysis.demands import transparency_error
from vctune.document.problem import Problem
from vctune.model.quantities import Coupling, Device, Gains
from vctune.proof.devices import device_box


def with_device(problem: Problem, device: Device) -> Problem:
    """Return the problem of another device, known exactly."""
    return replace(problem, device=device, uncertainty=None)


def cases_of(problem: Problem) -> tuple[Problem, ...]:
    """Return the problem of each device, the nominal one first; the problem itself where nothing is uncertain."""
    if problem.uncertainty is None:
        return (problem,)
    box = device_box(problem.device, problem.uncertainty)
    return tuple(with_device(problem, device) for device in (problem.device, *box.corners()))


def counted_of(problem: Problem) -> tuple[Problem, ...]:
    """Return the cases whose greatest error is the objective."""
    worst = problem.uncertainty is not None and problem.uncertainty.objective == "worst"
    return cases_of(problem) if worst else (problem,)


def error_of(problem: Problem, gains: Gains, coupling: Coupling) -> float:
    """Return the objective of a design: its error on the nominal device, or the greatest of all cases."""
    return max(transparency_error(case, gains, coupling).error for case in counted_of(problem))
