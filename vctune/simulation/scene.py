"""One run: a device with its friction, a hand, and one of the two controllers of an experiment."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, pi

from vctune.model.experiment import Baseline, Experiment, Friction, Operator
from vctune.model.quantities import Coupling, Device, Gains
from vctune.simulation.controller import Law
from vctune.simulation.friction import Carriage


@dataclass(frozen=True, slots=True)
class Scene:
    """What a run consists of.

    Attributes
    ----------
    device : its hold is always the real, zero-order one
    operator : the hand
    friction : of the device; None for none
    law : the firmware
    force_noise, seed : of the force samples, N
    """

    device: Device
    operator: Operator
    friction: Friction | None
    law: Law
    force_noise: float
    seed: int

    @property
    def carriage(self) -> Carriage:
        """Device and hand, which move as one."""
        device, hand = self.device, self.operator
        return Carriage(device.mass + hand.mass, device.damping + hand.damping, hand.stiffness)


@dataclass(frozen=True, slots=True)
class Equilibrium:
    """Where a scene starts, at rest: handle x and environment x_e, m, and the motor's force, N."""

    position: float
    reference: float
    motor: float


def equilibrium(scene: Scene) -> Equilibrium:
    """Return the equilibrium at the start of the motion: the springs of hand, controller and environment in a row.

    Without a position gain the controller holds nothing, and the handle starts where hand and environment agree.
    """
    hand, law, begin = scene.operator, scene.law, scene.operator.start
    rendered = law.environment
    if hand.stiffness == 0 or rendered.stiffness == 0:
        return Equilibrium(begin, begin, 0.0)
    compliance = 1 / hand.stiffness + 1 / rendered.stiffness + (1 / law.position if law.position > 0 else 0.0)
    force = (begin - rendered.zero) / compliance
    if rendered.wall and force < 0:
        return Equilibrium(begin, begin, 0.0)
    motor = -force if law.position > 0 else 0.0
    return Equilibrium(begin - force / hand.stiffness, rendered.zero + force / rendered.stiffness, motor)


def designed_scene(device: Device, gains: Gains, coupling: Coupling, experiment: Experiment) -> Scene:
    """Return the scene with the velocity loop and the coupling of a design (paper's figures b).

    Parameters
    ----------
    device : Device
    gains, coupling : the design
    experiment : what it is tried in
    """
    return _scene(device, experiment, gains, 0.0, coupling, 0.0, 0.0)


def baseline_scene(device: Device, experiment: Experiment, pid: Baseline) -> Scene:
    """Return the scene with a regular PID and its virtual mass and damping (paper's figures a).

    Parameters
    ----------
    device : Device
    experiment : what it is tried in
    pid : the regular controller
    """
    return _scene(device, experiment, Gains(pid.kd, pid.kp), pid.ki, None, pid.mass, pid.damping)


def _scene(
    device: Device,
    experiment: Experiment,
    gains: Gains,
    integral: float,
    coupling: Coupling | None,
    mass: float,
    damping: float,
) -> Scene:
    sensors = experiment.sensors
    law = Law(
        sample_time=device.sample_time,
        velocity=gains.velocity,
        position=gains.position,
        integral=integral,
        coupling=coupling,
        virtual_mass=mass,
        virtual_damping=damping,
        environment=experiment.environment,
        position_resolution=sensors.position_resolution,
        smoothing=None if sensors.filter_hz is None else 1 - exp(-2 * pi * sensors.filter_hz * device.sample_time),
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
