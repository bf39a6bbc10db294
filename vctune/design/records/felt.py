"""What the hand feels of a design: its numbers, how they are computed and how they are told."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf, pi, prod
from typing import Annotated

import numpy as np

from vctune.analysis.feel import FREE_HZ, NO_LOOP, WALL_HZ, feel
from vctune.analysis.felt_impedance import impedance_felt
from vctune.design.judging.judge import Judgement
from vctune.document.records.part import GRAMS, Nullable, RecordPart, Row, text
from vctune.model.device import Device
from vctune.model.fields import Shown
from vctune.model.gains import AnyCoupling, Coupling, Gains, SpringDamper
from vctune.model.loop.filters import force_sections
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.units import Units
from vctune.model.problem import Problem
from vctune.model.sampled.loop_in_worlds import offered_at
from vctune.model.sections import rows_of_sections
from vctune.model.worlds import World
from vctune.simulation.controller import coupling_coefficients

# Least angle and number of angles over which the power of noise is summed, and what keeps a quotient finite at Nyquist
LOWEST, ANGLES, TINY = 1e-8, 4000, 1e-12
RENDERED = 0.1  # Greatest difference of the felt stiffness of a rendered wall from the wall's own, relative


class InHandRecord(RecordPart):
    """What the hand feels, in the sampled loop in double precision; null for what does not exist."""

    limp: bool = False  # whether K_p holds no static force: its spring is nothing in the transparency band
    mass_1hz: Nullable = None  # of free motion: with the design, and of the bare device
    damping_1hz: Nullable = None
    bare_mass_1hz: Nullable = None
    behind: str | None = None  # the environment with which it is felt; null for nothing, without [environment]
    felt_wall_10hz: Nullable = None  # stiffness that is felt of the stiffest wall, the least tool's inertia apart
    wall: Nullable = None
    count: Nullable = None  # force of one count of the encoder, N
    first_speed: Nullable = (
        None  # command of a servo at rest in the first sample of 1 N, m/s, and its acceleration, m/s2
    )
    first_acceleration: Nullable = None
    noise_speed: Nullable = None  # command of a servo that the noise of the sensor causes, root mean square, m/s
    noise_acceleration: Nullable = None  # and of its steps, over the sample, m/s2

    def rows(self, units: Units) -> Iterator[Row]:
        """Yield free motion, the stiffest wall, the force of a count and what a unit of force commands."""
        if self.mass_1hz is not None and self.damping_1hz is not None:
            value, unit = weighed(self.mass_1hz, units)
            held = f"{_short(abs(self.damping_1hz))} {units.damping}"
            drives = " that drive" if self.damping_1hz < 0 else ""
            felt, bare = f"{unit} and {held}{drives} at 1 Hz", self.bare_mass_1hz
            felt += "" if self.behind is None else f" with {self.behind} behind"
            felt += "" if bare is None else f"; the bare device {' '.join(weighed(bare, units))}"
            yield Row("feels like", value, felt)
        if self.felt_wall_10hz is not None and self.wall is not None:
            rendered = abs(self.felt_wall_10hz - self.wall) <= RENDERED * self.wall
            verdict = f"{'rendered' if rendered else 'stable, but not rendered'} to {100 * RENDERED:g} %"
            stated = f"{units.stiffness} of the wall of {text(self.wall)} {units.stiffness} at 10 Hz: {verdict}"
            stated += "" if self.behind in (None, "nothing") else f"; with {self.behind}, whose inertia is left out"
            yield Row("stiffest wall felt", text(self.felt_wall_10hz, 4), stated)
        if self.count is not None:
            yield Row("count of the encoder", text(self.count, 3), f"{units.force} without filters, in its sample")
        if self.first_speed is not None and self.first_acceleration is not None:
            more = f"{units.speed}, {text(self.first_acceleration, 3)} {units.acceleration}, in its first sample"
            yield Row(f"1 {units.force} from rest", text(self.first_speed, 3), f"{more}, with nothing behind")
        if self.noise_speed is not None and self.noise_acceleration is not None:
            more = f"{units.speed} rms, {text(self.noise_acceleration, 3)} {units.acceleration} from sample to sample"
            yield Row("noise at the command", text(self.noise_speed, 3), f"{more}, with nothing behind")


class FeltRecord(RecordPart):
    """How a design feels, in physical units (`vctune.analysis.feel`); null without a design, or if it does not exist,
    for example above Nyquist."""

    felt_mass_1hz: Annotated[Nullable, Shown("mass felt at 1 Hz", of="mass")]
    felt_mass_10hz: Annotated[Nullable, Shown("mass felt at 10 Hz", of="mass")]
    felt_damping_1hz: Annotated[Nullable, Shown("damping felt at 1 Hz", of="damping")]
    felt_damping_10hz: Annotated[Nullable, Shown("damping felt at 10 Hz", of="damping")]
    stiffest_wall: Annotated[Nullable, Shown("|force/motion| of a rigid wall, at 10 Hz", of="stiffness")]
    tracking_bandwidth_hz: Annotated[Nullable, Shown("bandwidth of tracking", of="frequency")]


def weighed(mass: float, units: Units) -> tuple[str, str]:
    """Return a mass felt at 1 Hz and its unit, which is g for a light one; a negative one is felt as a spring."""
    if mass < 0:
        return _short(-mass * (2 * pi) ** 2), f"{units.stiffness} of a spring"
    light = units.mass == "kg" and abs(mass) < GRAMS
    return _short(1e3 * mass if light else mass), "g" if light else units.mass


def _short(value: float) -> str:
    return f"{float(text(value, 3 if abs(value) >= 100 else 2)):g}"


def in_hand_record(problem: Problem, judgement: Judgement) -> InHandRecord:
    """Return what the hand feels of a design."""
    gains, coupling, device = judgement.gains, judgement.coupling, problem.device
    found: dict[str, bool | float | str] = {}
    if device.kind.own_loop and not device.kind.inverse and gains.closed:
        found["limp"] = judgement.limp
    if problem.nyquist > (omega := 2 * pi * FREE_HZ[0]):
        least = problem.worlds.low if problem.worlds is not None else None
        free = _felt(problem, gains, coupling, omega, least)
        found |= {} if least is None else {"behind": least.in_words(problem.units)}
        found |= {"mass_1hz": free.imag / omega, "damping_1hz": free.real}
        if device.servo is None:
            found["bare_mass_1hz"] = _felt(problem, *NO_LOOP, omega).imag / omega
    wall = problem.worlds.high.stiffness if problem.worlds is not None and problem.worlds.walls else inf
    if wall < inf and problem.nyquist > (omega := 2 * pi * WALL_HZ):
        low = problem.worlds.low if problem.worlds is not None else World(0.0, 0.0, 0.0)
        felt = _felt(problem, gains, coupling, omega, World(low.mass, low.damping, wall))
        found |= {"felt_wall_10hz": omega * (omega * low.mass - felt.imag), "wall": wall}
    if device.servo is not None and not isinstance(coupling, SpringDamper):
        speed, acceleration = first_command(device, coupling)
        found |= {"first_speed": speed, "first_acceleration": acceleration}
        if device.sensing.noise is not None and coupling.drag > 0:
            noise = noise_at_command(device, coupling)
            found |= dict(zip(("noise_speed", "noise_acceleration"), noise, strict=True))
    if device.velocity is not None and device.velocity.resolution is not None:
        found["count"] = device.velocity.resolution * _stiffness_of_a_count(gains, coupling, device.sample_time)
    return InHandRecord.model_validate(found)


def first_command(device: Device, coupling: Coupling) -> tuple[float, float]:
    """Return the velocity that a servo at rest is commanded in the first sample of a unit of sensed force, through the
    firmware's filter and with nothing behind, and its rate over this sample."""
    share, T = prod(float(section.now) for section in force_sections(device)), device.sample_time
    speed = share / coupling_coefficients(coupling, T, rule=device.rule)["resistance"]
    return speed, speed / T


def noise_at_command(device: Device, coupling: Coupling) -> tuple[float, float]:
    """Return the root mean squares of the velocity that the noise of the force sensor commands a servo at rest with
    nothing behind, and of its steps over a sample."""
    T, rule = device.sample_time, device.rule
    theta = np.append(0.0, np.geomspace(LOWEST, pi, ANGLES))
    offered = offered_at(coupling, T, rule, theta[1:], FLOATS)
    law = offered.resistance + 1j * offered.reactance / np.maximum(np.cos(theta[1:] / 2), TINY)
    z = np.exp(1j * theta[1:])
    passed = [np.polyval(row[:3], z) / np.polyval(row[3:], z) for row in rows_of_sections(force_sections(device))]
    power = np.abs(np.prod([*passed, 1 / law], axis=0)) ** 2
    power = np.append(power[0], power)
    step = np.abs(2 * np.sin(theta / 2) / T) ** 2 * power
    noise = float(device.sensing.noise or 0.0)
    speed, rate = (
        noise * float(np.sqrt(0.5 * ((each[1:] + each[:-1]) * np.diff(theta)).sum() / pi)) for each in (power, step)
    )
    return speed, rate


def _felt(problem: Problem, gains: Gains, coupling: AnyCoupling, omega: float, world: World | None = None) -> complex:
    """Return the impedance that the hand feels in front of a virtual environment, N s/m."""
    met = world or World(0.0, 0.0, 0.0)
    return complex(impedance_felt(problem.device, gains, coupling, np.array([omega]), met)[0])


def _stiffness_of_a_count(gains: Gains, coupling: AnyCoupling, sample_time: float) -> float:
    """Return the force on the motor that a step of the position causes in its sample, without filters, N/m."""
    if isinstance(coupling, SpringDamper):
        return (gains.velocity + coupling.damping) / sample_time + coupling.stiffness
    return gains.velocity / sample_time + gains.position


def felt_record(device: Device, gains: Gains, coupling: AnyCoupling) -> FeltRecord:
    """Return the mass and damping that the hand feels, the stiffest wall, and the tracking bandwidth."""
    felt = feel(device, gains, coupling)
    numbers = (*felt.mass, *felt.damping, felt.stiffness, felt.tracking_bandwidth)
    return FeltRecord(**dict(zip(FeltRecord.model_fields, numbers, strict=True)))
