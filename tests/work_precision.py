"""Error against processor time of every way to integrate the friction.

`OMP_NUM_THREADS=1 python tests/work_precision.py` writes results/work-precision.csv and .svg.

The friction wheel's spring experiment, one cycle, without quantisation, with its regular PID and with its design. The
error is the greatest difference of the hand's force from CVODES at a tolerance of 1e-12. scipy's solvers integrate
the same samples with the same firmware, restarted at each sample, where the motor's force jumps. The last
column says how many times faster the midpoint rule is at the same error. Takes some minutes.
"""

from __future__ import annotations

import csv
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import process_time

import numpy as np
from integrators import euler, midpoint, sundials
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

from vctune.document.reading import read_gains, read_problem
from vctune.report.figures.with_matplotlib import svg
from vctune.simulation.firmware.controller import Measurement, State, control
from vctune.simulation.firmware.operations import FLOATS
from vctune.simulation.mechanics.friction import friction_force
from vctune.simulation.mechanics.intended_motion import intended_motion, push_matrix
from vctune.simulation.run import run
from vctune.simulation.scene import baseline_scene, designed_scene, equilibrium

ROOT = Path(__file__).parent.parent
OURS = [
    *((scheme.__name__, 2**k, scheme(2**k)) for scheme in (midpoint, euler) for k in range(9)),
    *((name, 10.0**-k, sundials(name, 10.0**-k)) for name in ("cvodes", "idas") for k in range(4, 12)),
]
"""Schemes that run in the simulation, with their setting."""
SCIPY = [("LSODA", 10.0**-k) for k in (3, 4, 6, 8)] + [("BDF", 1e-3), ("BDF", 1e-5)]
REPEATING = 1.0
COLOURS = {
    "midpoint": "#3b82d0",
    "euler": "#2f9e62",
    "cvodes": "#d6453d",
    "idas": "#e08a1e",
    "LSODA": "#8a8f98",
    "BDF": "#444444",
}


def scenes():
    """Return the two scenes of the comparison: name to scene."""
    problem = read_problem(ROOT / "problems/friction-wheel.toml").problem
    design = read_gains(ROOT / "results/friction-wheel/gains.toml")
    spring = next(one for one in problem.experiments if one.name == "spring")
    spring = replace(
        spring, operator=replace(spring.operator, cycles=1), sensors=replace(spring.sensors, position_resolution=0.0)
    )
    return {
        "design": designed_scene(problem.device, design.gains, design.coupling, spring),
        "baseline": baseline_scene(problem.device, spring, replace(spring.baseline, mass=0.5, damping=10.0)),
    }


def scipy_forces(scene, solver, tolerance, samples):
    """Return the hand's force with solve_ivp restarted at each; no delay, no hand mass."""
    T, carriage, friction = scene.device.sample_time, scene.carriage, scene.friction
    motion = intended_motion(scene.operator, T, 0, samples)
    matrix, hand, begin = push_matrix(scene.operator, T), scene.operator, equilibrium(scene)
    body, state, forces = np.array([begin.position, 0.0, 0.0]), State(begin.reference, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), []
    for k in range(samples):
        nodes = [motion.position[k], motion.velocity[k], motion.position[k + 1], motion.velocity[k + 1]]
        push = matrix @ nodes
        force = push[0] - hand.stiffness * body[0] - hand.damping * body[1]
        state, command = control(scene.law, state, Measurement(body[0], body[1], force), FLOATS)
        forces.append(force)

        def rates(t, y, push=push, motor=command.force):
            rubbing, creep = friction_force(friction, y[1], y[2], FLOATS)
            given = motor + push[0] + t * (push[1] + t / 2 * (push[2] + t / 3 * push[3]))
            return [
                y[1],
                (given - carriage.damping * y[1] - carriage.stiffness * y[0] - rubbing) / carriage.mass,
                creep,
            ]

        body = solve_ivp(rates, (0, T), body, method=solver, rtol=tolerance, atol=tolerance * 1e-3).y[:, -1]
    return np.array(forces)


def timed(work, *arguments):
    """Return what work(*arguments) returns and the least processor time that it took, s, of a second's repeats."""
    times = []
    while len(times) < 2 or sum(times) < REPEATING:
        began = process_time()
        made = work(*arguments)
        times.append(process_time() - began)
    return made, min(times)


def measure():
    """Return the rows: controller, scheme, setting, greatest error in N, seconds."""
    rows = []
    for name, scene in scenes().items():
        exact = run(scene, stretch=sundials("cvodes", 1e-12)).force
        for scheme, setting, stretch in OURS:
            traces, seconds = timed(partial(run, stretch=stretch), scene)
            rows.append([name, scheme, setting, np.abs(traces.force - exact).max(), seconds])
        for solver, tolerance in SCIPY:
            force, seconds = timed(scipy_forces, scene, solver, tolerance, len(exact))
            rows.append([name, solver, tolerance, np.abs(force - exact).max(), seconds])
    return rows


def advantage(rows, row):
    """Return how many times the midpoint rule is faster than a row at the row's error; None beyond its curve."""
    curve = sorted((other[3], other[4]) for other in rows if other[:2] == [row[0], "midpoint"])
    errors, seconds = np.log(np.array(curve)).T
    if not errors[0] <= np.log(row[3]) <= errors[-1]:
        return None
    return row[4] / np.exp(np.interp(np.log(row[3]), errors, seconds))


def draw(rows):
    """Return the figure of the rows."""
    figure = Figure(figsize=(9, 4.2), layout="constrained")
    for axes, name in zip(figure.subplots(1, 2, sharey=True), ("baseline", "design"), strict=True):
        for (scheme, colour), mark in zip(COLOURS.items(), "os^Dv*P", strict=False):
            points = sorted((row[4], row[3]) for row in rows if row[:2] == [name, scheme])
            axes.loglog(
                *zip(*points, strict=True), marker=mark, color=colour, label=scheme, markersize=4, linewidth=1.2
            )
        axes.axhline(1e-4, color="#8a8f98", linewidth=1, linestyle=":")
        axes.set(title=f"spring, {name}", xlabel="processor time, s")
        axes.grid(alpha=0.3)
    axes.legend()
    figure.axes[0].set_ylabel("greatest error of the hand's force, N")
    return figure


if __name__ == "__main__":
    measured = measure()
    with (ROOT / "results/work-precision.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(
            ["controller", "scheme", "setting", "error_N", "cpu_seconds", "midpoint_times_faster_at_this_error"]
        )
        for row in measured:
            times = advantage(measured, row)
            writer.writerow([*row[:3], f"{row[3]:.3g}", f"{row[4]:.3g}", "" if times is None else f"{times:.3g}"])
    (ROOT / "results/work-precision.svg").write_text(svg(draw(measured), "work-precision"))
