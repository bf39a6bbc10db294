"""Describe one run: a device with its friction, a hand, and one of the two controllers of an experiment."""

from __future__ import annotations

from dataclasses import dataclass, replace

from vctune.model.device import Device
from vctune.model.experiment import Baseline, Environment, Experiment, Friction, Operator
from vctune.model.gains import AnyCoupling, Gains, SpringDamper
from vctune.model.loop.device_response import mechanism
from vctune.model.loop.filters import low_pass_coefficients
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.parts import VelocityEstimate
from vctune.simulation.controller import Law


@dataclass(frozen=True, slots=True)
class Scene:
    """Everything that a run needs."""

    device: Device  # device with all its parts; the simulation always uses the real zero-order hold
    operator: Operator  # the hand
    friction: Friction | None  # friction of the device; None without friction
    law: Law  # the firmware
    force_noise: float  # standard deviation of the force samples' noise, N, and seed of the noise
    seed: int


@dataclass(frozen=True, slots=True)
class Equilibrium:
    """The state of a scene at the start."""

    position: float  # position of the motor, and of the handle relative to the motor, m
    bend: float
    reference: float  # x_e, m
    motor: float  # command of the motor, N, or of a servo, m/s or m
    hand: float  # force of the hand, N


def equilibrium(scene: Scene) -> Equilibrium:
    """Return the equilibrium at the start of the motion. All springs from hand to environment are in series."""
    at_rest = _at_rest(scene)
    return replace(at_rest, motor=at_rest.reference) if scene.law.command == "position" else at_rest


def _at_rest(scene: Scene) -> Equilibrium:
    """Return the equilibrium at the start of the motion without a position command."""
    hand, law, begin = scene.operator, scene.law, scene.operator.start
    rendered, holding_stiffness = law.environment, holding(law)
    if hand.stiffness == 0 or rendered.stiffness == 0:
        return Equilibrium(begin, 0.0, begin, 0.0, 0.0)
    compliance = 1 / hand.stiffness + 1 / rendered.stiffness + (1 / holding_stiffness if holding_stiffness > 0 else 0.0)
    structure, give = scene.device.structure, 0.0
    if structure is not None and holding_stiffness > 0:
        give = 1 / mechanism(scene.device, structure, FLOATS).stiffness
        compliance = compliance + give
    force = (begin - rendered.zero) / compliance
    if rendered.wall and force < 0:
        return Equilibrium(begin, 0.0, begin, 0.0, 0.0)
    motor = -force if holding_stiffness > 0 else 0.0
    handle, bend = begin - force / hand.stiffness, force * give
    return Equilibrium(handle - bend, bend, rendered.zero + force / rendered.stiffness, motor, force)


def holding(law: Law) -> float:
    """Return the stiffness between motor and rendered environment at rest, N/m: K_p, or the stiffness of the coupling's
    spring. It is 0 for a servo."""
    return law.coupling.stiffness if isinstance(law.coupling, SpringDamper) else law.position


def designed_scene(device: Device, gains: Gains, coupling: AnyCoupling, experiment: Experiment) -> Scene:
    """Return the scene with the velocity loop and the coupling of a design (paper's figures b)."""
    return _scene(device, experiment, gains, coupling)


def baseline_scene(device: Device, experiment: Experiment, pid: Baseline) -> Scene:
    """Return the scene with a regular PID and its virtual mass and damping (paper's figures a)."""
    scene = _scene(device, experiment, Gains(pid.kd, pid.kp), None)
    law = replace(scene.law, integral=pid.ki, virtual_mass=pid.mass, virtual_damping=pid.damping)
    return replace(scene, law=law)


def designed_law(device: Device, gains: Gains, coupling: AnyCoupling | None, environment: Environment) -> Law:
    """Return the firmware of a design, without a limit and with an ideal encoder."""
    estimate = device.velocity or VelocityEstimate()
    weight = None
    if estimate.filter_hz is not None:
        weight, _ = low_pass_coefficients(estimate.filter_hz, device.sample_time, FLOATS)
    return Law(
        sample_time=device.sample_time,
        velocity=gains.velocity,
        position=gains.position,
        integral=0.0,
        coupling=coupling,
        virtual_mass=0.0,
        virtual_damping=0.0,
        environment=environment,
        position_resolution=0.0,
        difference=estimate.source == "difference",
        smoothing=None if weight is None else float(weight),
        low_passes=0 if weight is None else estimate.filter_order,
        limit=None,
        command=device.commanded,
    )


def _scene(device: Device, experiment: Experiment, gains: Gains, coupling: AnyCoupling | None) -> Scene:
    """Return the scene of an experiment with given gains and, if there is one, a coupling."""
    sensors = experiment.sensors
    law = replace(
        designed_law(device, gains, coupling, experiment.environment),
        position_resolution=sensors.position_resolution,
        limit=experiment.limit,
    )
    return Scene(
        device=device,
        operator=experiment.operator,
        friction=experiment.friction,
        law=law,
        force_noise=sensors.force_noise,
        seed=sensors.seed,
    )
