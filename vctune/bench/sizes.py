"""How large a compiled function is. Imports casadi by way of what it is given."""

from __future__ import annotations

from dataclasses import dataclass

from vctune.bench.dense import functions
from vctune.design.shape import Shape
from vctune.simulation.step import Step


@dataclass(frozen=True, slots=True)
class NlpSize:
    """Variables, constraints, and instructions of CasADi's machine for objective, demands and their derivatives."""

    variables: int
    constraints: int
    operations: int


def nlp_size(shape: Shape) -> NlpSize:
    """Return the size of a shape's NLP."""
    made = functions(shape)
    operations = sum(part.n_instructions() for part in (made.values, made.slopes, made.curvature))
    return NlpSize(made.values.numel_in(0), made.values.numel_out(1), operations)


def step_size(step: Step) -> tuple[int, int]:
    """Return the number of states of a simulation's step and of its instructions, every call in it taken apart."""
    flat = step.one.expand()
    return int(step.start.size), int(flat.n_instructions())
