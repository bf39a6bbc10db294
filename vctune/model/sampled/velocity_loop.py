"""Evaluate the exact sampled velocity loop that nobody holds, with any real delay (model/README.md, section 14)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.hands import Hand, LeastOperator
from vctune.model.loop.filters import Rows, drive_rows, drive_states, pushed
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import add, nothing, times
from vctune.model.numbers.pair import EvenOdd, Pair
from vctune.model.parts import Structure
from vctune.model.sampled.circle import circle
from vctune.model.sampled.plant_in_hand import (
    Delays,
    MechanismInHand,
    PlantInHand,
    equations,
    mechanism_in_hand,
    numerators,
    over_sample,
)


@dataclass(frozen=True, slots=True)
class ReturnDifference:
    """F = open + K_v velocity + K_p position, dimensionless, at one or several points of the unit circle."""

    open: Pair
    velocity: Pair
    position: Pair

    def closed(self, gains: Gains) -> Pair:
        """Return F for the given gains."""
        return self.open + self.velocity.scaled(gains.velocity) + self.position.scaled(gains.position)


@dataclass(frozen=True, slots=True)
class PlantLetGo:
    """A device without a hand over one sample."""

    plant: PlantInHand  # its first state is the motor's position, its second the velocity of the centre of mass
    handle_share: Number | None = None  # handle's share of the mass; None for a rigid device

    @property
    def states(self) -> int:
        """The number of states of device and low-passes, without the position."""
        return len(self.plant.push) - 1 + self.plant.filter_poles


def plant_let_go(device: Device, whole_samples: Number, ops: Arithmetic, *, fractional: bool) -> PlantLetGo:
    """Sample a device without a hand exactly."""
    device, delays = device.sensing_at_once, Delays(whole_samples, fractional, whole_samples, fractional)
    if device.structure is None:
        parts = mechanism_in_hand(device, Hand(0, 0, 0), ops)
        return PlantLetGo(over_sample(parts, device, delays, ops, let_go=True))
    parts, mass, handle_share = _about_centre_of_mass(device, device.structure, ops)
    return PlantLetGo(over_sample(parts, replace(device, mass=mass), delays, ops, let_go=True), handle_share)


class Flexible(NamedTuple):
    """A flexible device about its centre of mass, where an uncertain mass does not move the resonance."""

    parts: MechanismInHand
    mass: Number  # mass with the load of the handle, and the handle's share of it
    handle_share: Number


def _about_centre_of_mass(device: Device, structure: Structure, ops: Arithmetic) -> Flexible:
    T, load = device.sample_time, structure.load or LeastOperator(0, 0)
    one = 0 * T + 1  # a number of the arithmetic, so that the code encloses the quotient below
    mass, handle = add(device.mass, load.mass), add(structure.handle_mass, load.mass)
    handle_share, resonance = handle / mass, 2 * ops.pi * structure.frequency_hz * T
    motor_share, damping, held = 1 - handle_share, device.damping * T / mass, times(load.damping, T / mass)
    stiffness, loss = resonance * resonance, 2 * structure.damping_ratio * resonance
    if not nothing(load.mass):
        factor = structure.handle_mass / handle * (mass / device.mass)
        stiffness, loss = stiffness * factor, loss * factor
    rows: Rows = {name: {} for name in ("position", "velocity", "bend", "bending", *drive_states(device))}
    rows["position"] = {"velocity": one, "bending": handle_share}
    rows["velocity"] = {
        "velocity": -add(damping, held),
        "bending": add(times(held, motor_share), -damping * handle_share),
    }
    rows["bend"]["bending"] = one
    rows["bending"] = {
        "velocity": add(times(held, 1 / handle_share), -damping / motor_share),
        "bend": -stiffness,
        "bending": -add(loss + damping * handle_share / motor_share, times(held, motor_share / handle_share)),
    }
    force = drive_rows(rows, device, ops)
    rows["velocity"] |= pushed(force, one)
    rows["bending"] |= pushed(force, 1 / motor_share)
    return Flexible(MechanismInHand.of(rows), mass, handle_share)


def return_difference(of: PlantLetGo, theta: Number, ops: Arithmetic, *, position: bool) -> ReturnDifference:
    """Evaluate the parts of the return difference F at z = e^{j theta}."""
    plant, at = of.plant, circle(theta, ops)
    unit = plant.sample_time / plant.mass

    def pair(even: Number, odd: Number) -> Pair:
        return Pair(even, at.sin * odd)

    equal = equations(plant.rates, plant.step, plant.push, plant.older, at.cos, at.square)
    # nothing holds the position: its column is (1, 0, 0, ...) if the unknown is 2 j s times the position
    rows = [[EvenOdd(1, 0, at.square) if row == 0 else None, *others[1:]] for row, others in enumerate(equal)]
    solved = {state: pair(found.even, found.odd) for state, found in numerators(rows).items()}
    delayed, back = at.late(plant.delays.loop, pair), pair(at.cos, -1)
    open_loop, travel = solved[len(plant.push)], solved[0] * delayed * back
    motor = solved[1] if of.handle_share is None else solved[1] + solved[3].scaled(of.handle_share)
    velocity = travel if plant.difference else motor * delayed
    for section in plant.filters:
        once = pair(*section.below(at.cos, at.square))
        velocity = velocity * pair(*section.above(at.cos, at.square))
        open_loop, travel = open_loop * once, travel * once
    if not position:
        return ReturnDifference(open_loop, velocity.scaled(unit), Pair(0, 0))
    difference = pair(2 * at.square, 2 * at.cos)  # 1 - 1/z: the position is the travel in one sample over 1 - 1/z
    return ReturnDifference(
        open_loop * difference, velocity.scaled(unit) * difference, travel.scaled(unit * plant.sample_time)
    )


def unturned(of: PlantLetGo, F: Pair, theta: Number, ops: Arithmetic) -> Pair:
    """Return F z^(-n/2) with n states: a polynomial in 1/z, which makes no turn around 0 if no pole is outside."""
    half = theta * (of.states / 2)
    return F * Pair(ops.cos(half), -ops.sin(half))


def sensitivity_abs2(parts: ReturnDifference, gains: Gains) -> Number:
    """Return |S|^2 = |F_0/F|^2 of the sampled loop, where F_0 is the return difference with both gains 0."""
    return parts.open.abs2() / parts.closed(gains).abs2()


def difference_slope(theta: Number, ops: Arithmetic) -> Pair:
    """Return (1 - e^{-j theta})/theta, regular at theta = 0."""
    half = theta / 2
    return Pair(ops.sin(half) * ops.sinc(half), ops.sinc(theta))
