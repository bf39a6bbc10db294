"""The simulation of devices as they are: velocity estimate, actuator, force sensor and a handle on a spring.

Against events that scipy integrates between (`parts_in_time`); the radius by which a loop grows is in `test_growth`.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import parts_in_time
import pytest
from command import run as vctune
from command import strict
from conftest import ROOT, for_passive_hands, mostly_slow
from scipy.integrate import trapezoid

from vctune.model.device import Device
from vctune.model.experiment import Baseline, Environment, Experiment, Friction, MovingHand, Sensors
from vctune.model.gains import Coupling, Gains
from vctune.model.parts import Actuator, ForceSensor, Structure, VelocityEstimate
from vctune.simulation import compiled
from vctune.simulation.compiled import INPUT_NAMES, SAMPLES_PER_CALL, build
from vctune.simulation.controller import FLOATS, Measurement, at_rest, control, controller_of
from vctune.simulation.friction import Sliding, friction_step
from vctune.simulation.metrics import metrics
from vctune.simulation.plant import plant
from vctune.simulation.run import run
from vctune.simulation.sample import COLUMNS
from vctune.simulation.scene import Scene, baseline_scene, designed_scene

IDEAL = Device(0.4, 2.0, 1e-3)
EVERYTHING = Device(
    0.4,
    2.0,
    1e-3,
    0.3e-3,
    "zoh",
    None,
    VelocityEstimate("difference", 150.0, 2),
    Actuator(300.0, 2),
    ForceSensor(300.0, 2, 0.4e-3),
    Structure(0.1, 200.0, 0.05),
)
GAINS, COUPLING = Gains(60.0, 1500.0), Coupling(60.0, 0.3, 8.0)
SPRING = Environment(0.0, 0.0, 200.0, 0.0, False)
PERFECT = Sensors(0.0, 0.0, 0)
HAND = MovingHand("reciprocate", 0.0, 0.01, 0.05, 1, 0.05, 2.0, 1000.0)
PID = Baseline(2000.0, 0.0, 20.0, 1.0, 20.0)
LUGRE = Friction(0.3, 0.4, 0.005, 2e4, (2e4 * 0.4) ** 0.5)
DEVICES = {
    "velocity": replace(IDEAL, velocity=EVERYTHING.velocity),
    "actuator": replace(IDEAL, actuator=Actuator(300.0)),
    "second order": replace(IDEAL, actuator=EVERYTHING.actuator, delay=1e-3),
    "filtered force": replace(IDEAL, force_sensor=ForceSensor(300.0)),
    "force late by samples": replace(IDEAL, force_sensor=ForceSensor(delay=2e-3)),
    "late force": replace(IDEAL, delay=1.4e-3, force_sensor=ForceSensor(delay=1.3e-3)),
    "force sensed as a command arrives": replace(IDEAL, delay=0.3e-3, force_sensor=ForceSensor(delay=0.7e-3)),
    "flexible": replace(IDEAL, structure=EVERYTHING.structure),
    "handle sensed": replace(
        IDEAL, structure=replace(EVERYTHING.structure, damping_ratio=0.3), velocity=VelocityEstimate(at="handle")
    ),
    "everything": EVERYTHING,
    "everything later": replace(EVERYTHING, delay=2.7e-3, force_sensor=ForceSensor(400.0, 1, 3.8e-3)),
}


def experiment(environment=SPRING, operator=HAND, friction=None, sensors=PERFECT, limit=None, baseline=PID):
    return Experiment("test", environment, operator, friction, sensors, limit, baseline)


def scene_of(device, environment=SPRING, operator=HAND, friction=None, **changes) -> Scene:
    return designed_scene(device, GAINS, COUPLING, experiment(environment, operator, friction, **changes))


def stiffness_of(device) -> float:
    """Return the stiffness of the spring of a device."""
    handle = device.structure.handle_mass
    return (device.mass - handle) * handle / device.mass * (2 * np.pi * device.structure.frequency_hz) ** 2


def in_steps(monkeypatch, count):
    """Integrate friction in so many steps a sample."""
    monkeypatch.setattr(compiled, "steps_per_sample", lambda friction, device, hand: count)


# in time


def differs(scene: Scene, samples: int) -> dict[str, float]:
    """Return by how much a run differs from the events, as a share of each trace's greatest value."""
    expected, traces = parts_in_time.simulate(scene, samples), run(scene)
    gaps = {}
    for name, values in expected.items():
        found = getattr(traces, name)
        found = getattr(traces, name.removeprefix("motor_")) if found is None else found
        gaps[name] = float(np.abs(found[:samples] - values).max() / np.abs(values).max())
    return gaps


@pytest.mark.slow
@pytest.mark.parametrize("device", DEVICES.values(), ids=DEVICES)
@pytest.mark.parametrize("hand_mass", [0.0, 0.05])
@pytest.mark.parametrize("controller", ["design", "baseline"])
def test_linear_scene_is_the_exact_response_from_event_to_event(device, hand_mass, controller):
    e = experiment(Environment(0.2, 3.0, 200.0, 0.0, False), replace(HAND, mass=hand_mass))
    scene = designed_scene(device, GAINS, COUPLING, e)
    if controller == "baseline":
        scene = baseline_scene(device, e, replace(PID, ki=300.0))
    assert max(differs(scene, 200).values()) < 1e-9


@pytest.mark.parametrize("name", mostly_slow(DEVICES, ["everything"]))
@pytest.mark.parametrize("hand_mass", mostly_slow([0.0, 0.05], [0.05]))
def test_friction_is_that_of_a_stiff_solver(name, hand_mass, monkeypatch):
    """LSODA at 1e-10 between events; the default steps and four times as many."""
    scene = scene_of(DEVICES[name], operator=replace(HAND, mass=hand_mass), friction=LUGRE)
    assert max(differs(scene, 60).values()) < 1e-4
    in_steps(monkeypatch, 400)
    assert max(differs(scene, 60).values()) < 1e-6


@pytest.mark.parametrize("h", [1e-6, 1e-5, 1e-3, 0.1])
@pytest.mark.parametrize("stiffness", [1e3, 1e6, 1e8])
def test_no_step_creates_energy_in_a_free_slide(h, stiffness):
    """Kinetic energy and that of bristles, handle and hand never rises, without a command."""
    friction = replace(LUGRE, stiffness=stiffness, damping=(stiffness * 0.4) ** 0.5)
    parts_of = (EVERYTHING, replace(IDEAL, structure=EVERYTHING.structure))
    for damped, hand_mass in itertools.product(parts_of, (0.0, 0.3)):
        device, hand = replace(damped, damping=0.0), replace(HAND, mass=hand_mass, damping=0.0)
        moving, handle_mass = plant(device, hand), device.structure.handle_mass
        motor, spring = device.mass - handle_mass, stiffness_of(device)
        change = moving.change(h)
        at = Sliding([0.0, 0.3, 1e-3, -0.2, *[0.0] * (len(change) - 4)], 1e-4, 0.3)

        def energy(at, motor=motor, spring=spring, handle_mass=handle_mass, hand=hand):
            x, v, bend, handle_v = at.values[:4]
            kinetic = motor * v * v + (handle_mass + hand.mass) * handle_v**2
            return (kinetic + spring * bend**2 + hand.stiffness * (x + bend) ** 2 + stiffness * at.z**2) / 2

        first = before = energy(at)
        for _ in range(300):
            at = friction_step(change, h, friction, at, FLOATS)
            after = energy(at)
            assert after <= before + 1e-11 * first
            before = after


# runs


@pytest.mark.parametrize("friction", [None, LUGRE], ids=["no friction", "friction"])
@pytest.mark.parametrize("device", DEVICES.values(), ids=DEVICES)
def test_a_run_starts_in_equilibrium(device, friction):
    """All springs in a row: nothing happens while the hand does not move."""
    step = build(scene_of(device, replace(SPRING, zero=0.02), friction=friction))
    states, records = (
        np.asarray(made) for made in step.chunk()(step.start, np.zeros((len(INPUT_NAMES), SAMPLES_PER_CALL)))
    )
    compliance = 1 / 1000 + 1 / 200 + 1 / GAINS.position
    if device.structure is not None and not device.at_handle:  # what the handle is held by does not give
        compliance += 1 / stiffness_of(device)
    assert records[COLUMNS.index("force")] == pytest.approx(-0.02 / compliance)
    assert np.abs(states - step.start[:, None]).max() < 1e-10


def test_the_encoder_has_not_moved_when_a_run_starts():
    """The first difference is 0 wherever between two marks the motor stands."""
    still = {"environment": replace(SPRING, zero=0.02), "sensors": Sensors(3.7e-4, 0.0, 0)}
    measured, differenced = (
        run(scene_of(replace(IDEAL, velocity=VelocityEstimate(source)), **still)).motor[0]
        for source in ("measured", "difference")
    )
    assert measured == differenced


def test_the_firmware_sees_the_motor_and_the_hand_the_handle():
    """What is recorded of the motor, given to the firmware in floats, which a person would port, is the run's command:
    quantiser, filters, wall and limit included. Position is the handle's."""
    device = replace(EVERYTHING, force_sensor=ForceSensor(delay=2e-3))
    wall = Environment(0.05, 3.0, 2000.0, 0.006, True)
    scene = scene_of(device, wall, friction=LUGRE, sensors=Sensors(1e-5, 0.0, 0), limit=2.0)
    traces = run(scene)
    assert traces.motor_position is not None and traces.motor_velocity is not None
    c = controller_of(scene.law)
    state = at_rest(c, 0.0, 0.0)
    for k, motor in enumerate(traces.motor):
        felt = traces.force[k - 2] if k >= 2 else 0.0
        seen = Measurement(traces.motor_position[k], traces.motor_velocity[k], felt)
        state, command = control(c, state, seen, FLOATS)
        assert command.given == pytest.approx(motor, rel=1e-9, abs=1e-9)
        assert command.environment == pytest.approx(traces.environment_force[k], rel=1e-9, abs=1e-9)
    assert np.abs(traces.motor).max() == 2.0 and traces.environment_force.max() > 1
    bend = traces.position - traces.motor_position
    assert 1e-5 < np.abs(bend).max() < 1e-3
    given = trapezoid(traces.motor * traces.motor_velocity, traces.time)
    assert metrics(traces, wall, HAND, 2.0).motor_energy == pytest.approx(given, rel=1e-3)


def test_a_rigid_device_has_no_motor_of_its_own():
    assert run(scene_of(replace(EVERYTHING, structure=None))).motor_position is None


def test_the_command_runs_the_device_of_the_file(tmp_path):
    problem, gains = (ROOT / folder / "flexible-handle.toml" for folder in ("problems", "tests/gains"))
    text = for_passive_hands(problem.read_text()) + '[[experiment]]\nname = "spring"\n'
    text += "environment = { stiffness = 200.0 }\noperator = { to = 0.005, cycles = 1 }\n"
    (tmp_path / "real.toml").write_text(text + "friction = { coulomb = 0.3 }\n")
    done = vctune("simulate", "real.toml", gains, "--json", cwd=tmp_path)
    assert done.stderr.endswith("[other-version]\n")  # the criterion of the gains is another
    run_of = strict(done.stdout)["experiments"][-1]["design"]
    assert run_of["loop"]["stable"] and run_of["diverged_s"] is None
    with np.load(tmp_path / "results/flexible-handle/traces.npz") as traces:
        bend = traces["spring/design/position"] - traces["spring/design/motor_position"]
        assert np.abs(bend).max() > 1e-6
