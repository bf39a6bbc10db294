"""Describe one run: a device with its friction, a hand, and one of the two controllers of an experiment."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil, pi

import numpy as np

from vctune.model.device import Device
from vctune.model.experiment import Baseline, Environment, Experiment, Friction, MovingHand
from vctune.model.gains import AnyCoupling, Gains, SpringDamper
from vctune.model.loop.filters import force_sections, velocity_sections
from vctune.model.mechanism import chain
from vctune.model.numbers.arithmetic import FLOATS, Floats
from vctune.simulation.controller import Law


@dataclass(frozen=True, slots=True)
class Scene:
    """Everything that a run needs."""

    device: Device  # device with all its parts; the simulation always uses the real zero-order hold
    operator: MovingHand  # the hand
    friction: Friction | None  # friction of the device; None without friction
    law: Law  # the firmware
    force_noise: float  # standard deviation of the force samples' noise, N, and seed of the noise
    seed: int
    force_resolution: float = 0.0  # step of the force sensor, N; 0 for none


@dataclass(frozen=True, slots=True)
class Equilibrium:
    """The state of a scene at the start."""

    position: float  # position of the motor, and of the handle relative to the motor, m
    bend: float
    reference: float  # x_e, m
    motor: float  # command of the motor, N, or of a servo, m/s or m
    hand: float  # force of the hand, N

    def sensed(self, device: Device) -> float:
        """Return the position that the firmware reads."""
        return self.position + self.bend if device.at_handle else self.position


def equilibrium(scene: Scene) -> Equilibrium:
    """Return the equilibrium at the start of the motion. All springs from hand to environment are in series."""
    at_rest = _at_rest(scene)
    return replace(at_rest, motor=at_rest.reference) if scene.law.command == "position" else at_rest


def _at_rest(scene: Scene) -> Equilibrium:
    """Return the equilibrium at the start of the motion without a position command; a kick starts without forces."""
    hand, law = scene.operator, scene.law
    begin = hand.end if hand.motion == "hold" else hand.start
    if hand.motion == "kick":
        return Equilibrium(begin, 0.0, begin, 0.0, 0.0)
    rendered, holding_stiffness = law.environment, holding(law)
    if hand.stiffness == 0 or rendered.stiffness == 0:
        return Equilibrium(begin, 0.0, begin, 0.0, 0.0)
    compliance = 1 / hand.stiffness + 1 / rendered.stiffness + (1 / holding_stiffness if holding_stiffness > 0 else 0.0)
    give = float(chain(scene.device, FLOATS).give) if holding_stiffness > 0 else 0.0
    compliance += 0.0 if scene.device.at_handle else give  # what holds the handle itself does not give
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
        difference=device.differences,
        velocity_filter=tuple(section.mapped(float) for section in velocity_sections(device, FLOATS)),
        force_filter=tuple(section.mapped(float) for section in force_sections(device)),
        limit=None,
        command=device.commanded,
        rule=device.rule,
        own_stiffness=0.0 if device.servo is None else float(device.servo.stiffness or 0.0),
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
        force_resolution=device.sensing.resolution or 0.0,
    )


STAYS, WATCHED = 10.0, 2.0  # Duration of a run in which the hand stays, and of its evaluated end, s
RAMP = 0.1  # Share of a stroke's time that a hand with the motion "reciprocate" takes at each end to gain or lose speed


@dataclass(frozen=True, slots=True)
class IntendedMotion:
    """The intended motion at consecutive samples."""

    position: Floats  # x_i, m, and its derivative v_i, m/s, at each sample, shape (number of samples,)
    velocity: Floats


def initial_velocity(operator: MovingHand) -> float:
    """Return the velocity of the handle at the start, m/s."""
    if operator.motion != "kick":
        return 0.0
    return operator.speed if operator.end >= operator.start else -operator.speed


def evaluated_from(operator: MovingHand) -> float:
    """Return the time from which a run is evaluated, s: without the first of several cycles, or without the motion
    before a handle is at rest."""
    if operator.stays:
        return STAYS - WATCHED
    return 2 * stroke_time(operator) if operator.cycles > 1 else 0.0


def stroke_time(operator: MovingHand) -> float:
    """Return the time of a stroke from one end of the intended motion to the other, s."""
    travel = abs(operator.end - operator.start)
    # a sine has the mean speed 2/pi; the ramps of the other motion have half its greatest speed
    mean_over_greatest = 1 - RAMP if operator.motion == "reciprocate" else 2 / pi
    return travel / (mean_over_greatest * operator.speed)


def sample_count(operator: MovingHand, sample_time: float) -> int:
    """Return the number of samples of a run: one at the start of each sample interval, and none at the end of the
    last."""
    seconds = STAYS if operator.stays else 2 * operator.cycles * stroke_time(operator)
    # a rounding above a whole number must not add a sample
    return max(1, ceil(seconds / sample_time * (1 - 1e-12)))


def intended_motion(operator: MovingHand, sample_time: float, first: int, last: int) -> IntendedMotion:
    """Return the intended motion at the samples `first` to `last`, both included."""
    if operator.stays:
        return IntendedMotion(np.full(last - first + 1, float(operator.end)), np.zeros(last - first + 1))
    time, travel = stroke_time(operator), operator.end - operator.start
    strokes = np.arange(first, last + 1) * (sample_time / time)  # number of strokes since the start
    phase = np.mod(strokes, 2.0)  # 0 to 1 from start to end, 1 to 2 back
    back = phase > 1
    from_start = np.where(back, 2 - phase, phase)
    if operator.motion == "sine":
        share, rate = (1 - np.cos(pi * from_start)) / 2, pi / 2 * np.sin(pi * from_start)
    else:
        share, rate = _ramped(from_start)
    return IntendedMotion(operator.start + travel * share, np.where(back, -1.0, 1.0) * rate * (travel / time))


def _ramped(u: Floats) -> tuple[Floats, Floats]:
    """Return the share of the travel at the share u of a stroke's time, and the derivative of that share."""
    top = 1 / (1 - RAMP)
    to_nearer_end = np.minimum(u, 1 - u)
    rate = top * np.minimum(to_nearer_end / RAMP, 1.0)
    from_end = np.where(
        to_nearer_end < RAMP, top * to_nearer_end * to_nearer_end / (2 * RAMP), top * (to_nearer_end - RAMP / 2)
    )
    return np.where(u <= 0.5, from_end, 1 - from_end), rate


def push_matrix(operator: MovingHand, sample_time: float) -> Floats:
    """Return the matrix that gives the push of the hand at a sample, and its derivatives, from the intended motion."""
    T, k, b = sample_time, operator.stiffness, operator.damping
    # rows of the cubic's value and derivatives at the sample
    position = np.array([1.0, 0.0, 0.0, 0.0])
    velocity = np.array([0.0, 1.0, 0.0, 0.0])
    second = np.array([-6.0, -4.0 * T, 6.0, -2.0 * T]) / T**2
    third = np.array([12.0, 6.0 * T, -12.0, 6.0 * T]) / T**3
    return np.array([k * position + b * velocity, k * velocity + b * second, k * second + b * third, k * third])
