"""The simulation of a servo between samples: what it and the hand do is integrated by SciPy from event to event.

How a loop grows from sample to sample is in `test_growth`.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from math import floor, pi

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline

from vctune import InputError, simulate
from vctune.document.building import problem as problem_of
from vctune.model.device import Device
from vctune.model.experiment import Environment, Experiment, MovingHand, Sensors
from vctune.model.gains import Coupling, Gains
from vctune.model.parts import ForceSensor, Servo
from vctune.report.experiments import HEADINGS, measured_rows
from vctune.simulation.run import run
from vctune.simulation.scene import Scene, designed_scene, equilibrium, intended_motion

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
FILTERED = ARM | {
    "device": {
        "sample_time": 0.002,
        "servo": {"delay": 0.032, "bandwidth_hz": 20.0, "order": 2, "stiffness": 50.0},
        "force_sensor": {"filter_coefficient": 0.2},
    }
}
"""A servo whose firmware filters the sensed samples and has a spring."""


def scene_of(device: Device, coupling: Coupling, environment=SPRING, operator=HAND, **changes) -> Scene:
    told = Experiment("servo", environment, operator, None, Sensors(0.0, 0.0, 0), None, None)
    return designed_scene(device, NO_GAINS, coupling, replace(told, **changes))


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


# what it has not


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
