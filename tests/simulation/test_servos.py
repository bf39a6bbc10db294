"""The simulation of a servo: against loops that are sampled elsewhere, in time, and against its certificate.

`oracles/loop.py` has the loop. What a servo does between samples, and what the hand does to it, is integrated by SciPy
from event to event.
"""

from __future__ import annotations

from dataclasses import astuple, replace
from fractions import Fraction
from math import floor, log, pi

import numpy as np
import pytest
from conftest import mostly_slow
from device_pairs import device_of
from kinds import servo
from loop import Loop, matrix
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline

from vctune import InputError, simulate
from vctune.design.judging.judge import Status, judge
from vctune.document.building import problem as problem_of
from vctune.model.device import Device
from vctune.model.experiment import Environment, Experiment, MovingHand, Sensors
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hand
from vctune.model.parts import ForceSensor, Servo
from vctune.report.experiments import HEADINGS, measured_rows
from vctune.simulation.compiled import INPUT_NAMES, SAMPLES_PER_CALL, build
from vctune.simulation.run import run
from vctune.simulation.scene import Scene, designed_scene, equilibrium, intended_motion
from vctune.simulation.together import matrices_of
from vctune.simulation.two_runs import STANDING, fastest_mode

NO_GAINS = Gains(0.0, 0.0)
HAND = MovingHand("sine", 0.0, 0.02, 0.05, 1, 0.5, 5.0, 600.0)
SPRING = Environment(0.0, 0.0, 300.0, 0.0, False)


def stated(device: dict, coupling: tuple[float, float, float], hand: tuple[float, float, float]) -> dict:
    """Return a problem with hands from nothing to a mass, a damping and a stiffness."""
    return {
        "device": device,
        "operator": {name: {"min": 0.0, "max": most} for name, most in zip(NUMBERS, hand, strict=True)},
        "coupling": dict(zip(("damping", "mass", "drag"), coupling, strict=True)),
        "stability": {"safety_factor": 1.05},
    }


NUMBERS = ("mass", "damping", "stiffness")
ARM = stated(
    {"sample_time": 0.002, "servo": {"delay": 0.032, "bandwidth_hz": 20.0, "order": 2}},
    (296.3374, 2.6683607, 46.471299), (2.0, 30.0, 1000.0),
)  # fmt: skip
WALKER = stated(
    {
        "sample_time": 0.004, "servo": {"command": "position", "delay": 0.012, "bandwidth_hz": 15.0, "order": 2},
        "force_sensor": {"bandwidth_hz": 50.0},
    },
    (176.96772, 1.23461, 35.901379), (2.0, 30.0, 1000.0),
)  # fmt: skip
CONTACT = stated(
    {
        "sample_time": 0.001, "servo": {"delay": 0.004, "bandwidth_hz": 40.0},
        "force_sensor": {"bandwidth_hz": 200.0, "order": 2},
    },
    (1943.9452, 2.8515397, 302.56473), (5.0, 100.0, 30000.0),
)  # fmt: skip
FILTERED = ARM | {
    "device": {
        "sample_time": 0.002,
        "servo": {"delay": 0.032, "bandwidth_hz": 20.0, "order": 2, "stiffness": 50.0},
        "force_sensor": {"filter_coefficient": 0.2},
    }
}
"""A servo whose firmware filters the sensed samples and has a spring."""
PROVED = {"arm": ARM, "walker": WALKER, "contact": CONTACT}
"""Designs of `vctune solve`, at the edge of their safety factor."""


def scene_of(device: Device, coupling: Coupling, environment=SPRING, operator=HAND, **changes) -> Scene:
    told = Experiment("servo", environment, operator, None, Sensors(0.0, 0.0, 0), None, None)
    return designed_scene(device, NO_GAINS, coupling, replace(told, **changes))


def decades(rng: np.random.Generator, low: float, high: float, absent: float = 0.0) -> float:
    return 0.0 if rng.random() < absent else float(10.0 ** rng.uniform(low, high))


def random_loop(seed: int) -> tuple[np.ndarray, Scene]:
    """Return a loop as the oracle and as the simulation have it, at times with the filter and spring of a firmware."""
    rng = np.random.default_rng(seed)
    device = servo(rng)
    if rng.random() < 0.3:
        device.setdefault("force_sensor", {})["filter_coefficient"] = float(rng.uniform(0.02, 0.6))
    if rng.random() < 0.3 and device["servo"]["command"] == "velocity":
        device["servo"]["stiffness"] = decades(rng, 1, 3.5)
    hand = (decades(rng, -2, 1, 0.3), decades(rng, -1, 2, 0.3), decades(rng, 1, 4, 0.3))
    coupling = (decades(rng, 0, 4), decades(rng, -2, 1), decades(rng, -1, 2.5))
    world = (decades(rng, -2, 1, 0.5), decades(rng, -1, 2, 0.5), decades(rng, 0, 4, 0.5))
    operator = replace(HAND, mass=hand[0], damping=hand[1], stiffness=hand[2])
    scene = scene_of(device_of(device), Coupling(*coupling), Environment(*world, 0.0, False, "trapezoid"), operator)
    return matrix(Loop(device, coupling=coupling, hand=hand, world=world)), scene


def top_of(step: np.ndarray) -> complex:
    """Return the largest eigenvalue, positions that nothing holds apart."""
    values = np.linalg.eigvals(step)
    values = values[np.abs(values - 1) > STANDING]
    return complex(values[np.argmax(np.abs(values))])


# the loop


@pytest.mark.parametrize("seed", mostly_slow(range(100), range(12)))
def test_loop_grows_and_oscillates_as_the_oracle_says(seed):
    step, scene = random_loop(seed)
    top, mode = top_of(step), fastest_mode(scene)
    assert mode.radius == pytest.approx(abs(top), rel=1e-10)
    found = mode.radius * np.exp(2j * pi * mode.hz * scene.device.sample_time)
    assert np.abs(np.linalg.eigvals(step) - found).min() < 1e-6 * abs(top)  # of two that are as large, either


def test_both_kinds_of_loops_were_there():
    grow = [abs(top_of(random_loop(seed)[0])) > 1 for seed in range(20)]
    assert 3 < sum(grow) < 17


@pytest.mark.parametrize("seed", range(6))
def test_motion_grows_and_turns_in_time_by_the_largest_root(seed):
    """Left to itself in the mode that grows the fastest, each sample is the last one times the oracle's root."""
    step, scene = random_loop(seed)
    hand = Hand(scene.operator.mass, scene.operator.damping, scene.operator.stiffness)
    values, vectors = np.linalg.eig(matrices_of(scene, [hand])[0])
    top = top_of(step)
    mode = vectors[:, np.argmin(np.abs(values - top))]
    samples = int(min(SAMPLES_PER_CALL, 1 + 8 / abs(log(abs(top)))))
    states, _ = build(scene).chunk()(mode.real, np.zeros((len(INPUT_NAMES), SAMPLES_PER_CALL)))
    for k in (samples // 2, samples - 1):
        expected = (top ** (k + 1) * mode).real
        assert np.abs(np.asarray(states)[:, k] - expected).max() < 1e-7 * abs(top) ** (k + 1)


# between samples


def reconstructed(scene: Scene, given: np.ndarray) -> dict[str, np.ndarray]:
    """Return position, velocity and sensed force at the samples after commands, integrated from event to event."""
    servo, sensor, hand = scene.device.servo, scene.device.force_sensor, scene.operator
    T, w, begin = scene.device.sample_time, 2 * pi * servo.bandwidth_hz, equilibrium(scene)
    count = len(given)
    motion = intended_motion(hand, T, 0, count + 1)
    wanted = CubicHermiteSpline(np.arange(count + 2) * T, motion.position, motion.velocity)
    if servo.command == "position":
        given = np.diff(np.concatenate([[begin.reference], given])) / T
    delay, felt_delay = (Fraction(repr(each)) / Fraction(repr(T)) for each in (servo.delay, sensor.delay))
    corner = 2 * pi * sensor.bandwidth_hz

    def rates(time, state, command):
        x, v, dv, f, df = state
        pull = (command - v) * w
        acceleration, turning = (pull, 0.0) if servo.order == 1 else (w * dv, pull - 2**0.5 * w * dv)
        push = hand.stiffness * (wanted(time) - x) + hand.damping * (wanted(time, 1) - v) - hand.mass * acceleration
        if sensor.order == 1:
            return [v, acceleration, turning, corner * (push - f), 0.0]
        return [v, acceleration, turning, corner * df, corner * (push - f - 2**0.5 * df)]

    # a command acts from k + delay on, what is sensed at k was there at k - felt_delay
    events = sorted({Fraction(k) for k in range(count)} | {k + delay for k in range(count)})
    state, felt = np.array([begin.position, 0.0, 0.0, begin.hand, 0.0]), {}
    found = {"position": [], "velocity": []}
    sensed_at = [k - felt_delay for k in range(count)]
    edges = sorted({*events, *(at for at in sensed_at if at > 0)})
    for now, then in zip(edges, [*edges[1:], edges[-1] + 1], strict=True):
        if now.denominator == 1 and now < count:
            found["position"].append(state[0])
            found["velocity"].append(state[1])
        felt[now] = state[3]
        acting = floor(now - delay)
        command = given[acting] if 0 <= acting < count else (0.0 if acting < 0 else given[-1])
        span = (float(now * Fraction(repr(T))), float(then * Fraction(repr(T))))
        state = solve_ivp(rates, span, state, args=(command,), rtol=1e-11, atol=1e-13, method="DOP853").y[:, -1]
    found["sensed"] = [felt[at] if at > 0 else begin.hand for at in sensed_at]
    return {name: np.array(values) for name, values in found.items()}


@pytest.mark.parametrize("command", ["velocity", "position"])
@pytest.mark.parametrize("order", [1, 2])
def test_between_samples_it_follows_its_command_and_is_sensed(command, order):
    """Delays of parts of samples, filters of both orders, a hand with a mass that begins to move."""
    T = 0.004
    sensor = ForceSensor(40.0, 3 - order, 0.0052)
    device = Device(1.0, 0.0, T, force_sensor=sensor, display="servo", servo=Servo(0.0094, 12.0, order, command))
    operator = replace(HAND, speed=0.2, start=0.005)
    scene = scene_of(device, Coupling(200.0, 2.0, 40.0), SPRING, operator)
    traces = run(scene)
    found = reconstructed(scene, traces.motor[:60])
    for name, values in found.items():
        known = getattr(traces, name)[: len(values)]
        assert np.abs(known - values).max() < 1e-8 * np.abs(known).max(), name


def test_it_starts_at_rest_where_hand_and_environment_agree():
    for tables in (ARM, WALKER, FILTERED):
        problem = problem_of(tables).problem
        still = MovingHand("sine", 0.02, 0.02 + 1e-9, 0.05, 50, 1.0, 5.0, 600.0)
        traces = run(scene_of(problem.device, problem.fixed_design[1], operator=still))
        assert np.abs(traces.velocity).max() < 1e-7
        assert traces.force[0] == pytest.approx(0.02 / (1 / 600 + 1 / 300))


# the certificate


def hand_within(rng: np.random.Generator, hands) -> MovingHand:
    """Return a hand of the box, one of its vertices every other time."""
    share = rng.integers(2, size=3) if rng.random() < 0.5 else rng.random(3)
    low, high = np.array(astuple(hands.low)), np.array(astuple(hands.high))
    return replace(HAND, **dict(zip(NUMBERS, low + share * (high - low), strict=True)))


def passive(rng: np.random.Generator) -> Environment:
    """Return springs, masses and dampers of any size and either rule, alone and together; walls too."""
    mass, damping, stiffness = decades(rng, -3, 2, 0.4), decades(rng, -2, 3, 0.4), decades(rng, 0, 6, 0.4)
    if rng.random() < 0.2:
        return Environment(mass, damping, max(stiffness, 100.0), 0.0, True)
    return Environment(mass, damping, stiffness, 0.0, False, str(rng.choice(["trapezoid", "backward"])))


def growing(tables: dict, count: int, seed: int = 3) -> list[float]:
    """Return the growth of the loops that grow, of a design in random hands before random environments."""
    rng = np.random.default_rng(seed)
    problem = problem_of(tables).problem
    coupling = problem.fixed_design[1]
    loops = [scene_of(problem.device, coupling, passive(rng), hand_within(rng, problem.hands)) for _ in range(count)]
    return [mode.radius for mode in map(fastest_mode, loops) if mode.radius > 1 + 1e-9]


@pytest.mark.parametrize(
    "name, count", [("arm", 40), *(pytest.param(name, 200, marks=pytest.mark.slow) for name in PROVED)]
)
def test_a_proved_design_decays_in_hands_and_before_environments(name, count):
    tables = PROVED[name]
    problem = problem_of(tables).problem
    assert judge(problem, *problem.fixed_design).status is Status.CERTIFIED
    assert growing(tables, count) == []
    light = tables["coupling"] | {"drag": 0.1 * tables["coupling"]["drag"]}
    assert growing(tables | {"coupling": light}, count)  # they do tell


# what it has not


@pytest.mark.parametrize(
    ("table", "key", "reason"),
    [
        ({"friction": {"coulomb": 0.3}}, "friction", "whatever rubs"),
        ({"sensors": {"position_resolution": 1e-5}}, "sensors.position_resolution", "reads no position"),
        ({"actuator": {"limit": 3.0}}, "actuator.limit", "commands no force"),
        ({"baseline": {"kp": 1.0, "kd": 1.0, "mass": 1.0, "damping": 1.0}}, "baseline", "commands a force"),
    ],
)
def test_what_an_experiment_of_a_servo_has_not_is_refused_with_the_reason(table, key, reason):
    with pytest.raises(InputError) as refused:
        problem_of(ARM | {"experiment": [{"name": "servo", **table}]})
    assert f"experiment[0].{key}: means nothing with [device.servo]: " in str(refused.value)
    assert reason in str(refused.value)


def test_gains_of_a_servo_are_refused_and_its_coupling_is_taken():
    tables = ARM | {"experiment": [{"name": "servo", "sensors": {"force_noise": 0.01}, "operator": {"cycles": 1}}]}
    simulation = simulate(tables, NO_GAINS, Coupling(**ARM["coupling"]))
    assert simulation.stable and simulation.experiments[0].design.metrics.motor_energy is None
    with pytest.raises(InputError, match=r"gains\.velocity: a servo has none"):
        simulate(tables, Gains(1.0, 0.0), Coupling(**ARM["coupling"]))


def test_commands_are_shown_in_their_unit():
    for tables, unit in ((ARM, "m/s"), (WALKER, "m")):
        simulation = simulate(tables | {"experiment": [{"name": "servo", "operator": {"cycles": 1}}]})
        record = simulation.measured()
        assert record.command_unit == unit
        assert measured_rows(record)[0][HEADINGS.index("motor")].endswith(f" {unit}")
