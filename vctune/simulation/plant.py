"""Describe a device with its parts, and the hand on it, by linear rates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import pi, sqrt

import numpy as np

from vctune.model.device import Device
from vctune.model.experiment import MovingHand
from vctune.model.loop.filters import drive_rows, drive_states, plain_low_pass_rates
from vctune.model.mechanism import MOTOR, Chain, Rates, chain, forces, motion
from vctune.model.numbers.arithmetic import FLOATS, Floats, Number
from vctune.model.numbers.matrices import exponential_less_one

# Inputs of the states. "command" is the held command that has arrived (a force, or a servo's velocity), and "friction"
# is the force of the friction. "push" is the force, N, that the hand's spring and damper would exert on a handle at
# rest at 0, followed by its derivatives
GIVEN = ("command", "friction", "push", "push_1", "push_2", "push_3")


@dataclass(frozen=True, slots=True)
class Plant:
    """Device and hand as d/dt (states, given) = rates @ (states, given), with `given` as in `GIVEN`; of several hands,
    every array has them as its last axis."""

    states: tuple[str, ...]  # names of the states: position and velocity of the motor first
    rates: Floats  # shape (n, n) for n states and given inputs
    units: Floats  # units in which the rates are of the order of 1 per sample, shape (n,)
    position: Floats  # rows of the handle's position and velocity, m, m/s
    velocity: Floats
    force: Floats  # row of f_h, the force of the hand on the handle, N
    sensed: Floats  # row of the sensor's force without its delay, N

    def change(self, time: float) -> Floats:
        """Return e^(rates t) - 1, the change of the states and of the given inputs over a time, s."""
        scaled = self.rates * self.units / self.units[:, None]
        rows = tuple(map(tuple, (scaled * time).tolist()))
        return np.array(exponential_less_one(rows, FLOATS), float) / self.units * self.units[:, None]


RowOf = dict[str, Floats]  # row of each state and given input, by name


def plant(device: Device, hand: MovingHand) -> Plant:
    """Return device and hand: a motor that carries the handle rigidly or on a spring, or a servo. The numbers of the
    hand are floats, or arrays of several hands."""
    servo, sensor, T = device.servo, device.sensing, device.sample_time
    if servo is None:
        of = chain(device, FLOATS)._replace(sensed=MOTOR)  # friction acts on the motor
        states = [*of.states, *drive_states(device)]
    else:
        states = ["position", "velocity", "velocity_rate"][: 1 + servo.order]
    states += ("sensed", "sensed_rate")[: sensor.order] if sensor.bandwidth_hz is not None else ()
    names = (*states, *GIVEN)
    row_of = dict(zip(names, np.eye(len(names)), strict=True))
    if hands := np.shape(hand.mass):
        row_of = {name: np.repeat(row[:, None], hands[0], axis=1) for name, row in row_of.items()}
    rates = {"position": row_of["velocity"], **{name: row_of[rate] for name, rate in pairwise(GIVEN[2:])}}
    units = {"position": 1.0, "velocity": 1 / T, "velocity_rate": 1 / T}
    if servo is None:
        position, velocity, force = _pushed(device, of, hand, row_of, rates)
        force_unit = device.mass / T**2
        units |= dict.fromkeys(of.velocities, 1 / T) | _bend_units(of, hand, T)
    else:
        position, velocity, force = _followed(servo.bandwidth(FLOATS), servo.order, hand, row_of, rates)
        force_unit = hand.mass / T**2 + hand.damping / T + hand.stiffness
        force_unit = force_unit + (force_unit == 0)
        units["command"] = 1 / T
    if sensor.bandwidth_hz is not None:
        rates |= _low_pass("sensed", sensor.bandwidth_hz, sensor.order, force, row_of)
    units |= {f"push_{k}": force_unit / T**k for k in (1, 2, 3)}
    return Plant(
        states=tuple(states),
        rates=np.array([rates.get(name, np.zeros((len(names), *hands))) for name in names]),
        units=np.array([np.broadcast_to(units.get(name, force_unit), hands) for name in names]),
        position=position,
        velocity=velocity,
        force=force,
        sensed=row_of.get("sensed", force),
    )


def _pushed(device: Device, of: Chain, hand: MovingHand, row_of: RowOf, rates: RowOf) -> tuple[Floats, Floats, Floats]:
    """Add the rates of a device that the hand pushes. Return the handle's position and velocity, and f_h."""
    rows: Rates = {name: {} for name in drive_states(device)}
    motor = _sum(drive_rows(rows, device, FLOATS, plain_low_pass_rates), row_of)
    rates |= {name: _sum(row, row_of) / device.sample_time for name, row in rows.items()}
    rates |= {name: _sum(row, row_of) for name, row in motion(of, 1.0).items()}
    pulls, masses, last = {name: _sum(row, row_of) for name, row in forces(of).items()}, of.masses, of.velocities[-1]
    pulls[MOTOR] = pulls[MOTOR] + motor - row_of["friction"]
    position, velocity = _sum(of.place, row_of), row_of[last]
    free, driven = row_of["push"] - hand.stiffness * position - hand.damping * velocity, pulls[last]
    mass = masses[last] + hand.mass
    rates |= {name: pulls[name] / masses[name] for name in of.velocities[:-1]}
    rates[last] = (driven + free) / mass
    return position, velocity, masses[last] / mass * free - hand.mass / mass * driven


def _followed(
    bandwidth_hz: float, order: int, hand: MovingHand, row_of: RowOf, rates: RowOf
) -> tuple[Floats, Floats, Floats]:
    """Add the rates of a servo, which the hand cannot push. f_h is the push minus M a + B v + K x of the hand."""
    rates |= _low_pass("velocity", bandwidth_hz, order, row_of["command"], row_of)
    position, velocity = row_of["position"], row_of["velocity"]
    resisting = hand.stiffness * position + hand.damping * velocity + hand.mass * rates["velocity"]
    return position, velocity, row_of["push"] - resisting


def _bend_units(of: Chain, hand: MovingHand, T: float) -> dict[str, float]:
    """Return the size of each bend's oscillation at a velocity of 1 m a sample, m."""
    masses = [*of.masses.values()]
    masses[-1] = masses[-1] + hand.mass
    found = {}
    for link, bend, ahead, behind in zip(of.links, of.bends, masses, masses[1:], strict=False):
        found[bend] = 1 / (1 + np.sqrt(link.stiffness * (1 / ahead + 1 / behind)) * T)
    return found


def _sum(shares: dict[str, Number], row_of: RowOf) -> Floats:
    return np.asarray(sum(share * row_of[name] for name, share in shares.items()))


def _low_pass(name: str, bandwidth_hz: float, order: int, source: Floats, row_of: RowOf) -> RowOf:
    """Return the rates of the states of a low-pass."""
    corner, value = 2 * pi * bandwidth_hz, row_of[name]
    if order == 1:
        return {name: corner * (source - value)}
    rate = row_of[f"{name}_rate"]
    return {name: corner * rate, f"{name}_rate": corner * (source - value - sqrt(2) * rate)}


def row_times(row: Floats, values: Sequence[Number]) -> Number:
    """Return the product of a row, shape (n,) or (n, hands), and n values. Factors of 0 are left out."""
    acts = np.asarray(np.atleast_2d(row.T).any(axis=0))
    total: Number = 0.0
    for factor, value, counts in zip(row.tolist() if row.ndim == 1 else row, values, acts, strict=True):
        if counts:
            total = total + factor * value
    return total
