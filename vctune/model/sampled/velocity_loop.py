"""Evaluate the exact sampled velocity loop that nobody holds, with any real delay (model/README.md, section 14)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce
from typing import NamedTuple

from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.hands import Hand
from vctune.model.loop.filters import drive_rows, drive_states, pushed
from vctune.model.mechanism import MOTOR, POSITION, Chain, Combination, Rates, chain, combined
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import add, times
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

    plant: PlantInHand  # its first state is the sensed position, its second the velocity of the centre of mass
    sensed: tuple[tuple[int, Number], ...] = ()  # further states in the sensed velocity, each with its share

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
    parts, mass, sensed = _about_centre_of_mass(device, device.structure, ops)
    return PlantLetGo(over_sample(parts, replace(device, mass=mass), delays, ops, let_go=True), sensed)


class Flexible(NamedTuple):
    """A flexible device about its centre of mass, where an uncertain mass does not move a single resonance."""

    parts: MechanismInHand
    mass: Number  # mass with the load of the handle
    sensed: tuple[tuple[int, Number], ...]


def _about_centre_of_mass(device: Device, structure: Structure, ops: Arithmetic) -> Flexible:
    """Return the equations in the velocity V of the centre of mass, and the bends with their rates.

    What is behind spring k is a share s_k of the mass: the motor moves with V - sum s_k rate_k, the handle with
    V + sum (1 - s_k) rate_k.
    """
    T = device.sample_time
    one = 0 * T + 1  # a number of the arithmetic, so that the code encloses the quotient below
    mass = device.mass if structure.load is None else device.mass + structure.load.mass
    of = chain(device, ops).in_units(mass, T)
    links, bends, held = of.links, of.bends, 0 if of.held is None else of.held
    rates = [name.replace("bend", "bending") for name in bends]
    behind = [reduce(add, (link.mass for link in links[k:])) for k in range(len(links))]
    shares = [1 - behind[0], *(link.mass for link in links)]
    motor: Combination = {MOTOR: 1} | {rate: -share for rate, share in zip(rates, behind, strict=True)}
    handle: Combination = {MOTOR: 1} | {rate: 1 - share for rate, share in zip(rates, behind, strict=True)}
    pulls = [{bends[k]: link.stiffness, rates[k]: link.viscosity} for k, link in enumerate(links)]
    sensed = motor if of.sensed == MOTOR else handle
    rows: Rates = {POSITION: sensed | {MOTOR: one}, MOTOR: combined((motor, -of.damping), (handle, -held))}
    for k, rate in enumerate(rates):
        rows[bends[k]] = {rate: one}
        ahead = (pulls[k - 1], 1 / shares[k]) if k > 0 else (motor, of.damping / shares[0])
        ends = rate == rates[-1]
        behind_it = (handle, times(held, -1 / shares[-1])) if ends else (pulls[k + 1], 1 / shares[k + 1])
        rows[rate] = combined((_relative(device, structure, of, k), -1), ahead, behind_it)
    rows |= {name: {} for name in drive_states(device)}
    force = drive_rows(rows, device, ops)
    rows[MOTOR] |= pushed(force, one)
    rows[rates[0]] |= pushed(force, -1 / shares[0])
    names = list(rows)
    return Flexible(MechanismInHand.of(rows), mass, tuple((names.index(rate), sensed[rate]) for rate in rates))


def _relative(device: Device, structure: Structure, of: Chain, k: int) -> Combination:
    """Return how a spring accelerates the masses at its ends towards each other; a single one by its resonance."""
    link, bend = of.links[k], of.bends[k]
    rate = bend.replace("bend", "bending")
    if len(of.links) > 1:
        ahead = of.links[k - 1].mass if k > 0 else of.motor
        both = 1 / ahead + 1 / link.mass
        return {bend: link.stiffness * both, rate: link.viscosity * both}
    if structure.load is None:
        return {bend: link.swing2, rate: link.decay}
    handle, load = structure.handle_mass, structure.load.mass
    heavier = handle / (handle + load) * ((device.mass + load) / device.mass)
    return {bend: link.swing2 * heavier, rate: link.decay * heavier}


def return_difference(of: PlantLetGo, theta: Number, ops: Arithmetic, *, position: bool) -> ReturnDifference:
    """Evaluate the parts of the return difference F at z = e^{j theta}."""
    plant, at = of.plant, circle(theta, ops)
    unit = plant.sample_time / plant.mass

    def pair(even: Number, odd: Number) -> Pair:
        return Pair(even, at.sin * odd)

    equal = equations(plant.rates, plant.step, plant.push, plant.older, at.cos, at.square)
    # nothing holds the position: its column is (1, 0, 0, ...) if the unknown is 2 j s times the position
    rows = [[EvenOdd(1, 0, at.square) if row == 0 else None, *others[1:]] for row, others in enumerate(equal)]
    solved = {state: pair(found.even, found.odd) for state, found in numerators(rows, ops).items()}
    delayed, back = at.late(plant.delays.loop, pair), pair(at.cos, -1)
    open_loop, travel = solved[len(plant.push)], solved[0] * delayed * back
    sensed = solved[1]
    for state, share in of.sensed:
        sensed = sensed + solved[state].scaled(share)
    velocity = travel if plant.difference else sensed * delayed
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
