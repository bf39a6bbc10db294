"""The simulation against matrix exponentials, closed forms and conservation laws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import parts_in_time
import pytest
from conftest import ROOT
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

from vctune.document.reading import read_gains, read_problem
from vctune.model.device import Device
from vctune.model.experiment import Baseline, Environment, Experiment, Friction, MovingHand, Sensors
from vctune.model.gains import Coupling, Gains
from vctune.model.parts import Structure, VelocityEstimate
from vctune.simulation.controller import FLOATS, Measurement, at_rest, control, controller_of
from vctune.simulation.plant import GIVEN, plant
from vctune.simulation.run import run
from vctune.simulation.sample import (
    COLUMNS,
    INPUT_NAMES,
    LEAST_STEPS,
    MOST_STEPS,
    SAMPLES_PER_CALL,
    STEPS_PER_RADIAN,
    Sliding,
    build,
    friction_force,
    friction_step,
    slide,
    steps_per_sample,
)
from vctune.simulation.scene import (
    baseline_scene,
    designed_scene,
    intended_motion,
    push_matrix,
    sample_count,
    stroke_time,
)
from vctune.simulation.two_runs import fastest_mode, loop_matrix

DEVICE = Device(0.4, 2.0, 1e-3, 0.0, "zoh")
GAINS = Gains(150.0, 6000.0)
COUPLING = Coupling(160.0, 0.35, 0.0)
NOTHING = Environment(0.0, 0.0, 0.0, 0.0, False)
SPRING = Environment(0.0, 0.0, 200.0, 0.0, False)
PERFECT = Sensors(0.0, 0.0, 0)
HAND = MovingHand("reciprocate", 0.0, 0.01, 0.05, 1, 0.0, 2.0, 1000.0)
PID = Baseline(2000.0, 0.0, 20.0, 1.0, 20.0)


def lugre(stiffness=1e5, mass=0.4, **changes):
    return Friction(**{"coulomb": 0.3, "stiction": 0.4, "stribeck_velocity": 0.005, "stiffness": stiffness,
                       "damping": (stiffness * mass) ** 0.5, **changes})  # fmt: skip


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


@pytest.mark.parametrize("order", [1, 2])
def test_the_firmware_in_floats_is_the_compiled_one(order):
    """The function that a person would port gives the trace of the run: quantiser, filters, wall and limit included."""
    wall = Environment(0.05, 3.0, 20000.0, 0.006, True)
    e = experiment(wall, HAND, lugre(), Sensors(1e-5, 0.0, 0), limit=2.0)
    device = replace(DEVICE, velocity=VelocityEstimate("difference", 100.0, order))
    scene = designed_scene(device, GAINS, COUPLING, e)
    traces = run(scene)
    c = controller_of(scene.law)
    state = at_rest(c, 0.0, 0.0)
    for k, motor in enumerate(traces.motor):
        seen = Measurement(traces.position[k], traces.velocity[k], traces.force[k])
        state, command = control(c, state, seen, FLOATS)
        assert command.given == pytest.approx(motor, rel=1e-9, abs=1e-9)
        assert command.environment == pytest.approx(traces.environment_force[k], rel=1e-9, abs=1e-9)
    assert np.abs(traces.motor).max() == 2.0
    assert traces.environment_force.max() > 1


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


@given(st.integers(0, 2**32 - 1), st.floats(-5, -1))
def test_the_push_is_the_force_of_spring_and_damper_on_the_cubic(seed, decades):
    """At any time between two samples, on SciPy's cubic with the positions and velocities of both."""
    T, (x, v, next_x, next_v) = 10.0**decades, np.random.default_rng(seed).normal(size=4)
    cubic = CubicHermiteSpline([0.0, T], [x, next_x], [v, next_v])
    push = push_matrix(HAND, T) @ [x, v, next_x, next_v]
    scale = HAND.stiffness * (abs(x) + abs(next_x)) + HAND.damping * (abs(x) + abs(next_x)) / T
    scale += (HAND.stiffness * T + HAND.damping) * (abs(v) + abs(next_v))
    for order in range(4):
        derivative = HAND.stiffness * cubic(0.0, order) + HAND.damping * cubic(0.0, order + 1)
        assert push[order] == pytest.approx(derivative, abs=100e-15 * scale / T**order)
    for time in np.linspace(0.0, T, 5):
        force = HAND.stiffness * cubic(time) + HAND.damping * cubic(time, 1)
        pushed = push[0] + time * (push[1] + time / 2 * (push[2] + time / 3 * push[3]))
        assert pushed == pytest.approx(force, abs=100e-15 * scale)


# friction


def test_the_default_steps_resolve_the_bristles_oscillation():
    """As many steps per radian of a mass on the bristles, within both limits; the mass of a flexible motor alone."""
    scene = designed_scene(DEVICE, GAINS, COUPLING, experiment(operator=replace(HAND, mass=0.1)))

    def steps(radians_per_sample, mass=0.5, of=scene):
        return steps_per_sample(of, lugre(mass * (radians_per_sample / 1e-3) ** 2))

    assert steps(1 - 1e-12) == STEPS_PER_RADIAN
    assert steps(0.5 + 1e-9) == STEPS_PER_RADIAN / 2 + 1
    assert (steps(1e-3), steps(1e3)) == (LEAST_STEPS, MOST_STEPS)
    flexible = replace(scene, device=replace(DEVICE, structure=Structure(0.1, 200.0, 0.05)))
    assert steps(1 - 1e-12, mass=0.3, of=flexible) == STEPS_PER_RADIAN


def slid(friction, mass, velocity, command, time, count):
    """Where a free mass slides under a constant command: its position, its velocity and the bristles' force."""
    moving, h = plant(Device(mass, 0.0, 1e-3), replace(HAND, damping=0.0, stiffness=0.0)), time / count
    change = moving.change(h)
    start = Sliding([0.0, velocity, command, *[0.0] * (len(GIVEN) - 1)], 0.0, velocity)
    end = slide(lambda at: friction_step(change, h, friction, at, FLOATS), start, count)
    return np.array([end.values[0], end.values[1], end.z * friction.stiffness])


def test_steady_sliding_follows_stribeck():
    friction, v = lugre(), 0.004
    g = 0.3 + 0.1 * np.exp(-((v / 0.005) ** 2))
    force, creep = friction_force(friction, -v, -g / friction.stiffness, FLOATS)
    assert (force, creep) == (pytest.approx(-g), pytest.approx(0.0, abs=1e-15))


def test_bristles_are_springs_at_rest():
    """Under less than the stiction a handle comes to rest where the bristles carry the push."""
    friction = lugre(1e4)
    _, v, force = slid(friction, 0.4, 0.0, 0.1, 3.0, 30_000)
    assert force == pytest.approx(0.1, rel=1e-3)
    assert abs(v) < 1e-5


@given(st.floats(3, 8), st.floats(-5, 1), st.floats(-6, -1), st.floats(-1, 1), st.floats(0, 1000))
def test_no_step_creates_energy_in_a_free_slide(stiffness, speed, h, bristle, k):
    """Kinetic, bristle and spring energy never rise, however stiff, fast and coarse."""
    friction, h = lugre(10.0**stiffness), 10.0**h
    change = plant(Device(0.4, 0.0, 1e-3), replace(HAND, damping=0.0, stiffness=k)).change(h)
    speed = 10.0**speed
    at = Sliding([0.0, speed, *[0.0] * len(GIVEN)], bristle * 0.4 / friction.stiffness, speed)

    def energy(at):
        x, v, *_ = at.values
        return (0.4 * v**2 + friction.stiffness * at.z**2 + k * x**2) / 2

    first = before = energy(at)
    for _ in range(300):
        at = friction_step(change, h, friction, at, FLOATS)
        after = energy(at)
        assert after <= before + 1e-12 * first
        before = after


def test_friction_takes_its_work_out_of_a_slide():
    """Coulomb friction alone stops m = 0.4 kg at v = 1 m/s after m v^2/(2 F); the bristles' stretch is 3e-6 m."""
    friction = lugre(1e5, stiction=0.3)
    x, v, _ = slid(friction, 0.4, 1.0, 0.0, 2.0, 40_000)
    assert x == pytest.approx(0.4 / (2 * 0.3), rel=1e-4)
    assert abs(v) < 1e-3


@pytest.mark.parametrize("controller", ["design", "baseline"])
def test_default_step_is_within_a_tenth_of_a_millinewton_of_a_stiff_solver(controller):
    hand = replace(HAND, end=0.02, speed=0.02)
    e = experiment(replace(SPRING, zero=0.01), hand, lugre())
    scene = designed_scene(DEVICE, GAINS, COUPLING, e)
    if controller == "baseline":
        scene = baseline_scene(DEVICE, e, PID)
    reference = parts_in_time.simulate(scene, 150)["force"]
    assert np.abs(run(scene).force[:150] - reference).max() < 1e-4


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


def test_divergence_is_said_with_its_time():
    """A hand of 0.5 kg on a light coupling oscillates at the Nyquist frequency: finite until it goes astray."""
    scene = designed_scene(DEVICE, GAINS, Coupling(16.0, 0.02, 0.0), experiment(operator=replace(HAND, mass=0.5)))
    mode, traces = fastest_mode(scene), run(scene)
    assert mode.radius > 1
    assert traces.diverged == pytest.approx(len(traces.time) * 1e-3)
    assert np.abs(traces.position - traces.intended).max() < 1e3 * 0.01
    assert len(traces.time) < 50
    assert all(np.isfinite(getattr(traces, name)).all() for name in ("position", "force", "motor"))


def test_a_run_starts_in_equilibrium():
    """At rest under the spring's force nothing happens while the hand does not move."""
    step = build(designed_scene(DEVICE, GAINS, COUPLING, experiment(replace(SPRING, zero=0.02), HAND, lugre())))
    states, records = (
        np.asarray(made) for made in step.chunk()(step.start, np.zeros((len(INPUT_NAMES), SAMPLES_PER_CALL)))
    )
    assert records[COLUMNS.index("force")] == pytest.approx(-0.02 / (1 / 1000 + 1 / 200 + 1 / 6000))
    assert np.abs(states - step.start[:, None]).max() < 1e-10


def test_length_of_a_run_does_not_depend_on_the_chunk():
    hand = replace(HAND, end=0.02, speed=0.011)
    assert len(run(designed_scene(DEVICE, GAINS, COUPLING, experiment(operator=hand))).time) > SAMPLES_PER_CALL
    assert sample_count(hand, 1e-3) == len(run(designed_scene(DEVICE, GAINS, COUPLING, experiment(operator=hand))).time)


def test_sampled_loop_without_a_hand_is_the_designs():
    """With a hand that hardly holds, the fastest mode is the larger of the loop's and the free coupling's."""
    from vctune.analysis.sampled_loop import spectral_radius

    ghost = replace(HAND, mass=0.0, damping=1e-9, stiffness=1e-9)
    scene = designed_scene(DEVICE, GAINS, Coupling(1e6, 1e-6, 1e3), experiment(NOTHING, ghost))
    moduli = np.abs(np.linalg.eigvals(loop_matrix(scene)))
    assert np.min(np.abs(moduli - spectral_radius(DEVICE, GAINS))) < 1e-9


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
