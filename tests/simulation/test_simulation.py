"""The simulation against matrix exponentials, closed forms and conservation laws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import parts_in_time
import pytest
from conftest import ROOT

from vctune.document.reading import read_gains, read_problem
from vctune.model.device import Device
from vctune.model.experiment import Baseline, Environment, Experiment, MovingHand, Sensors
from vctune.model.gains import Coupling, Gains
from vctune.simulation.compiled import SAMPLES_PER_CALL
from vctune.simulation.controller import FLOATS, Measurement, at_rest, control, controller_of
from vctune.simulation.run import run
from vctune.simulation.scene import (
    baseline_scene,
    designed_scene,
    intended_motion,
    sample_count,
    stroke_time,
)

DEVICE = Device(0.4, 2.0, 1e-3, 0.0, "zoh")
GAINS = Gains(150.0, 6000.0)
COUPLING = Coupling(160.0, 0.35, 0.0)
NOTHING = Environment(0.0, 0.0, 0.0, 0.0, False)
SPRING = Environment(0.0, 0.0, 200.0, 0.0, False)
PERFECT = Sensors(0.0, 0.0, 0)
HAND = MovingHand("reciprocate", 0.0, 0.01, 0.05, 1, 0.0, 2.0, 1000.0)
PID = Baseline(2000.0, 0.0, 20.0, 1.0, 20.0)


def experiment(environment=SPRING, operator=HAND, friction=None, sensors=PERFECT, limit=None, baseline=PID):
    return Experiment("test", environment, operator, friction, sensors, limit, baseline)


@pytest.mark.parametrize("controller", ["design", "baseline"])
def test_the_firmware_solves_its_equations_of_a_sample(controller):
    """The unknowns of model/README.md at the end of each sample, v_e, v_c, x_e and where the spring is, by NumPy."""
    T, zero = DEVICE.sample_time, 0.001
    e, coupling = experiment(Environment(0.3, 4.0, 500.0, zero, False)), Coupling(160.0, 0.35, 0.7)
    if controller == "design":
        scene, (K_v, K_p, K_i), (m_v, b_v) = (
            designed_scene(DEVICE, GAINS, coupling, e),
            (150.0, 6000.0, 0.0),
            (0.0, 0.0),
        )
        b_c, m_c, b_0 = 160.0, 0.35, 0.7
    else:
        scene = baseline_scene(DEVICE, e, replace(PID, ki=300.0))
        (K_v, K_p, K_i), (m_v, b_v), (b_c, m_c, b_0) = (20.0, 2000.0, 300.0), (1.0, 20.0), (0.0, 1.0, 0.0)
    A = np.array(
        [
            [(m_v + 0.3) / T + b_v + 4.0 + b_0 + b_c, -b_c, 0, 500.0],
            [-b_c / 2, m_c / T + b_c / 2, 0, 0],
            [-T / 2, 0, 1, 0],
            [-T, 0, 0, 1],
        ]
    )
    c = controller_of(scene.law)
    state, v_e, v_c, x_e, y, missed = at_rest(c, 0.0, 0.0), 0.0, 0.0, 0.0, 0.0, 0.0
    for x, v, force in np.random.default_rng(4).normal(size=(200, 3)) * [1e-3, 1e-2, 1.0]:
        right = [force + 500.0 * zero + (m_v + 0.3) / T * v_e, m_c / T * v_c + b_c / 2 * (v_e - v_c), x_e + T / 2 * v_e]
        v_e, v_c, x_e, y = np.linalg.solve(A, [*right, y])
        missed += T * (x_e - x)
        state, command = control(c, state, Measurement(x, v, force), FLOATS)
        expected = K_v * (v_e - v) + K_p * (x_e - x) + K_i * missed
        assert command.given == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("motion", ["reciprocate", "sine"])
def test_intended_motion(motion):
    hand = replace(HAND, motion=motion, start=0.02, end=-0.03, speed=0.1, cycles=2)
    T = 1e-4
    count = sample_count(hand, T)
    path = intended_motion(hand, T, 0, count)
    assert (path.position.max(), path.position.min()) == pytest.approx((0.02, -0.03), abs=1e-6)
    assert np.abs(path.velocity).max() == pytest.approx(0.1, rel=1e-4)
    assert count * T == pytest.approx(4 * stroke_time(hand), abs=T)
    middle = (path.position[2:] - path.position[:-2]) / (2 * T)
    assert np.abs(middle - path.velocity[1:-1]).max() < 1e-4
    part = intended_motion(hand, T, 777, 800)
    assert np.array_equal(part.position, path.position[777:801])


# friction


@pytest.mark.slow
def test_default_step_in_the_papers_experiments():
    """The friction wheel's own experiments, both controllers; quantisers apart, which turn any error into a quantum."""
    file = read_problem(ROOT / "problems/friction-wheel.toml").problem
    design = read_gains(ROOT / "tests/gains/friction-wheel.toml")
    for one in file.experiments:
        e = replace(one, sensors=PERFECT, operator=replace(one.operator, cycles=2))
        for scene in (
            designed_scene(file.device, design.gains, design.coupling, e),
            baseline_scene(file.device, e, e.baseline),
        ):
            reference = parts_in_time.simulate(scene, 600)["force"]
            assert np.abs(run(scene).force[:600] - reference).max() < 1e-4


# runs


def test_noise_comes_from_its_seed():
    def made(seed, noise=0.1):
        return run(designed_scene(DEVICE, GAINS, COUPLING, experiment(sensors=Sensors(0.0, noise, seed)))).motor

    assert np.array_equal(made(1), made(1))
    assert not np.array_equal(made(1), made(2))
    assert np.array_equal(made(1, 0.0), made(2, 0.0))


def test_length_of_a_run_does_not_depend_on_the_chunk():
    hand = replace(HAND, end=0.02, speed=0.011)
    assert len(run(designed_scene(DEVICE, GAINS, COUPLING, experiment(operator=hand))).time) > SAMPLES_PER_CALL
    assert sample_count(hand, 1e-3) == len(run(designed_scene(DEVICE, GAINS, COUPLING, experiment(operator=hand))).time)


@pytest.mark.parametrize("rule", ["backward", "trapezoid", "explicit"])
@pytest.mark.parametrize("late", [1, 2, 5])
@pytest.mark.parametrize(
    "parts", [(0.3, 0.0, 0.0), (0.0, 4.0, 500.0), (0.3, 4.0, 500.0)], ids=["mass", "spring", "all"]
)
def test_a_late_environment_gives_the_force_of_earlier_samples(rule, late: int, parts) -> None:
    """Each part of the force, from all v_e of the run by NumPy's sums, is the one of `late` samples before."""
    T, (mass, damping, stiffness), zero = DEVICE.sample_time, parts, 0.002
    scene = designed_scene(DEVICE, GAINS, COUPLING, experiment(Environment(*parts, zero, False, rule, late)))
    c, force, v = controller_of(scene.law), [], []
    state = at_rest(c, 0.0, 0.0)
    for x, velocity, pushed in np.random.default_rng(5).normal(size=(60, 3)) * [1e-3, 1e-2, 1.0]:
        state, command = control(c, state, Measurement(x, velocity, pushed), FLOATS)
        force.append(command.environment)
        v.append(state.desired)
    speed = np.array(v)
    before = np.concatenate([[0.0], speed[:-1]])
    place = T * np.cumsum({"backward": speed, "trapezoid": (speed + before) / 2, "explicit": before}[rule])
    inertia = mass * (speed - before) / T
    if rule == "trapezoid":  # F_k + F_(k-1) = 2 m (v_k - v_(k-1))/T
        signs = (-1.0) ** np.arange(60)
        inertia = signs * np.cumsum(signs * 2 * inertia)
    # the difference of explicit Euler looks ahead by one sample
    own = np.concatenate([inertia[1:], [0.0]]) if rule == "explicit" else inertia
    expected = own + damping * speed + stiffness * (place - zero)
    assert np.array(force[late:]) == pytest.approx(expected[:-late], rel=1e-9, abs=1e-9)
    # the spring rests at 0 before the run; nothing else acts before the first v_e has had its effect
    own_first = late - (rule == "explicit")
    assert np.array(force[:own_first]) == pytest.approx(np.zeros(own_first), abs=1e-12)
