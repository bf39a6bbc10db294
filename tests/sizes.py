"""How large a compiled NLP and a compiled step of a simulation are."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from vctune.design.nlp.nlp import assembled
from vctune.design.nlp.nlp_structure import NlpStructure
from vctune.simulation.mechanics.step import Step


@dataclass(frozen=True, slots=True)
class NlpSize:
    """Variables, constraints, and instructions of CasADi's machine for objective, demands and their derivatives."""

    variables: int
    constraints: int
    operations: int


def nlp_size(structure: NlpStructure) -> NlpSize:
    """Return the size of its NLP, with what a solver of second order needs."""
    nlp = assembled(structure)
    x, p, f, g = nlp["x"], nlp["p"], nlp["f"], nlp["g"]
    multipliers = ca.MX.sym("multipliers", g.shape[0])
    hessian, _ = ca.hessian(f + ca.dot(multipliers, g), x)
    made = (
        ca.Function("values", [x, p], [f, g]).expand(),
        ca.Function("slopes", [x, p], [ca.gradient(f, x), ca.jacobian(g, x)]).expand(),
        ca.Function("curvature", [x, p, multipliers], [hessian]).expand(),
    )
    return NlpSize(x.numel(), g.numel(), sum(part.n_instructions() for part in made))


def step_size(step: Step) -> tuple[int, int]:
    """Return the number of states of a simulation's step and of its instructions, every call in it taken apart."""
    return int(step.start.size), int(step.advance.expand().n_instructions())
