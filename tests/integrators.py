"""Other ways to integrate friction, for comparison: Euler's steps, and SUNDIALS' variable steps as references."""

from __future__ import annotations

from functools import partial

import casadi as ca

from vctune.simulation.mechanics.friction import friction_force
from vctune.simulation.mechanics.stretches import SYMBOLS, Stretch, fixed_steps, push_at


def midpoint(substeps: int) -> Stretch:
    """Return the simulation's own scheme with so many steps a sample."""
    return partial(fixed_steps, substeps=substeps)


def euler(substeps: int) -> Stretch:
    """Return fixed steps of first order."""
    return partial(fixed_steps, substeps=substeps, theta=1.0)


def sundials(solver: str, tolerance: float = 1e-10) -> Stretch:
    """Return CVODES (variable-step BDF) or IDAS (DAE), started anew at each stretch, with a relative tolerance."""

    def stretch(scene, friction, begin, length):
        carriage = scene.carriage
        body, given, time = ca.SX.sym("body", 3), ca.SX.sym("given", 5), ca.SX.sym("time")
        rubbing, creep = friction_force(friction, body[1], body[2], SYMBOLS)
        force = given[0] + push_at(given[1:], begin + time * length)
        acceleration = (force - carriage.damping * body[1] - carriage.stiffness * body[0] - rubbing) / carriage.mass
        problem = {"x": body, "p": given, "t": time, "ode": length * ca.vertcat(body[1], acceleration, creep)}
        options = {"reltol": tolerance, "abstol": tolerance * 1e-3, "max_num_steps": 1_000_000}
        integrator = ca.integrator("reference", solver, problem, 0.0, 1.0, options)
        start = [ca.MX.sym("body", 3), ca.MX.sym("motor"), ca.MX.sym("push", 4)]
        return ca.Function("stretch", start, [integrator(x0=start[0], p=ca.vertcat(*start[1:]))["xf"]])

    return stretch
