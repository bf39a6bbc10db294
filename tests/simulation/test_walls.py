"""Walls that are rigid or have a mass, and what a trace does beside the linear loop."""

from __future__ import annotations

import tomllib
from math import pi

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import vctune
from vctune.exit_codes import ExitCode
from vctune.report.experiments import simulation_figure
from vctune.simulation.oscillation import motion_of

KNOB = """device = { display = "impedance", mass = 0.1, damping = 0.5, sample_time = 1e-3 }
environment = { stiffness = inf }
coupling = { stiffness = 400.0, damping = 0.0 }
[[experiment]]
name = "press"
environment = { stiffness = inf%s }
operator = { motion = "sine", to = 0.02, speed = 0.05, cycles = 1, stiffness = 500.0, damping = 2.0 }
"""
TOOL = """device = { mass = 0.8, damping = 3.0, sample_time = 5e-4 }
environment = { mass = { min = 0.03, max = 1.0 }, stiffness = { max = 5000.0 }, walls = true }
gains = { velocity = 280.0, position = 36000.0 }
coupling = { damping = 27.0, mass = 0.11, drag = 1.2 }
[[experiment]]
name = "wall"
environment = { mass = 0.03, stiffness = 3000.0, zero = 0.02, wall = true }
operator = { to = 0.03, speed = 0.05, mass = 0.1, damping = 5.0, stiffness = 500.0 }
"""
BUZZ = """environment = { stiffness = inf }
stability = { criterion = "hands" }
coupling = { stiffness = 3000.0, damping = 5.0 }
[device]
display = "impedance"
mass = 0.05
damping = 0.3
sample_time = 1e-3
delay = 5e-4
velocity = { filter_hz = 50.0 }
[operator]
mass = { min = 0.0, max = 0.1 }
damping = { min = 0.0, max = 5.0 }
stiffness = { min = 0.0, max = 500.0 }
[[experiment]]
name = "wall"
environment = { stiffness = inf, wall = true }
operator = { motion = "sine", from = -0.005, to = 0.003, speed = 0.02, damping = 0.5, stiffness = 500.0 }
%s
"""


@pytest.mark.parametrize("more", ["", ", wall = true, zero = 0.005"])
def test_a_rigid_wall_is_the_spring_of_the_coupling(more: str) -> None:
    """Device and hand by SciPy's integrator, pushed back by 400 N/m from the surface on as sampled."""
    (done,) = vctune.simulate(vctune.problem(tomllib.loads(KNOB % more))).experiments
    found, (T, zero), x, kept = done.design.traces, (1e-3, 0.005 if more else 0.0), np.zeros(2), []
    stroke = pi / 2 * 0.02 / 0.05

    def rates(t: float, x: np.ndarray, push: float) -> list[float]:
        hand = 0.01 * (1 - np.cos(pi * t / stroke)), 0.01 * pi / stroke * np.sin(pi * t / stroke)
        felt = 500.0 * (hand[0] - x[0]) + 2.0 * (hand[1] - x[1])
        return [x[1], (felt - 0.5 * x[1] - push) / 0.1]

    for k in range(len(found.time)):
        kept.append(x[0])
        depth = x[0] - zero
        push = 400.0 * (max(depth, 0.0) if more else depth)
        x = solve_ivp(rates, (k * T, (k + 1) * T), x, args=(push,), rtol=1e-9, atol=1e-12).y[:, -1]
    assert np.abs(found.position - kept).max() < 1e-7
    fit = done.design.metrics.fits["stiffness"]
    assert fit.asked == 400.0 and fit.value == pytest.approx(400.0, rel=0.01)
    assert done.design.calm and done.design.mode.radius < 1


def test_the_felt_stiffness_of_a_wall_with_a_mass_is_that_in_contact() -> None:
    (done,) = vctune.simulate(vctune.problem(tomllib.loads(TOOL))).experiments
    assert done.experiment.environment.rule == "trapezoid"  # as it is proved
    fits, traces = done.design.metrics.fits, done.design.traces
    assert 2500.0 < fits["stiffness"].value < 3000.0
    inside = (traces.position > 0.0205) & (traces.time > 1.5)
    slope = np.polyfit(traces.position[inside], traces.force[inside], 1)[0]
    assert fits["stiffness"].value == pytest.approx(slope, rel=0.05)


def test_a_trace_is_told_apart_from_the_linear_loop() -> None:
    """With dry friction the handle comes to rest in a contact whose linear loop grows, and without it buzzes."""
    dry = vctune.simulate(vctune.problem(tomllib.loads(BUZZ % "friction = { coulomb = 0.2 }")))
    free = vctune.simulate(vctune.problem(tomllib.loads(BUZZ % "")))
    (rubbed,), (plain,) = dry.experiments, free.experiments
    assert rubbed.design.mode.radius > 1 and plain.design.mode.radius > 1
    assert rubbed.design.motion.kind == "settles"
    assert plain.design.motion.kind == "buzzes"
    assert plain.design.motion.frequency_hz == pytest.approx(plain.design.mode.hz, rel=0.3)
    assert dry.exit_code == free.exit_code == ExitCode.FAILED
    assert len(simulation_figure(dry.measured()).figure.axes) == 1  # no empty panels for a PID that no file states


@pytest.mark.parametrize("hz", [20.0, 55.0])
@pytest.mark.parametrize("growth", [-8.0, 0.0, 1.0])
def test_what_a_trace_does(hz: float, growth: float) -> None:
    """An oscillation of 30 um on a motion of 10 mm: it decays, stays or grows."""
    t = np.arange(0.0, 4.0, 1e-3)
    slow = 5e-3 * (1 - np.cos(2 * pi * t / 4))
    assert motion_of(slow, 1e-3, 4.0, 0.01, 0.0).kind == "calm"
    size = 3e-5 * np.exp(growth * (t - 1.0)) * (t > 1.0)
    found = motion_of(slow + size * np.sin(2 * pi * hz * t), 1e-3, 4.0, 0.01, 0.0)
    assert found.kind == ("buzzes" if growth >= 0 else "settles")
    if growth == 0:
        assert found.frequency_hz == pytest.approx(hz, rel=0.03)
        assert found.amplitude_m == pytest.approx(3e-5, rel=0.1)
    assert motion_of(slow + 1e-6 * np.sin(2 * pi * hz * t), 1e-3, 4.0, 0.01, 0.0).kind == "calm"
