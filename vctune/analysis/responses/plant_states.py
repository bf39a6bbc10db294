"""Build the states of a device in a hand over one sample, including the states of delays, from the matrices of
`vctune.model.sampled`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import comb
from typing import Any

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.analysis.responses.states import INPUT, Row, filtered, late, total
from vctune.model.device import Device
from vctune.model.hands import Hand
from vctune.model.loop.filters import low_pass_coefficients
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.matrices import scaled
from vctune.model.sampled.plant_in_hand import Mechanism, mechanism_in_hand
from vctune.model.sampled.servo_plant import servo_rates
from vctune.model.sampled.state_space import stepped
from vctune.model.sampled.velocity_loop import split_delay


@dataclass(frozen=True, slots=True)
class PlantStates:
    """The response of a device in a hand to a command, sample by sample."""

    states: dict[str, Row]  # next value of each state
    position: Row  # position and velocity of the motor that the firmware reads or estimates
    velocity: Row
    moved: Row  # change of the position over the next sample
    felt: Row  # sensed force of the hand, with the sign of Z_seen: a resisting force is positive


@dataclass(frozen=True, slots=True)
class _Chain:
    """The system x' = A x + b u with T = 1."""

    names: tuple[str, ...]  # names of the states x
    rates: Floats  # A and b
    push: Floats
    units: Floats  # SI units of the states

    def over(self, share: float, older: float, now: Row, before: Row) -> list[Row]:
        """Return the change of the states, in SI units, over a share of a sample."""
        n = len(self.names)
        rates = [[0 if x == 0 else float(x) for x in (*row, b)] for row, b in zip(self.rates, self.push, strict=True)]
        matrix = scaled((*map(tuple, rates), (0,) * (n + 1)), share)
        step, newer, left = stepped(matrix, older / share if older > 0 else None, FLOATS)
        return [
            total(
                [
                    *((step[i][j] * unit / self.units[j], {self.names[j]: 1.0}) for j in range(n)),
                    (newer[i] * unit, now),
                    (left[i] * unit, before),
                ]
            )
            for i, unit in enumerate(self.units)
        ]

    def after(self, moved: list[Row]) -> list[Row]:
        """Return the states, in SI units, from their changes."""
        return [total([(1.0, {name: 1.0}), (1.0, row)]) for name, row in zip(self.names, moved, strict=True)]

    def weighted(self, weights: Any, rows: list[Row]) -> Row:
        """Return a weighted sum of the dimensionless states as a row over the states in SI units."""
        return total((w / unit, row) for w, unit, row in zip(weights, self.units, rows, strict=True))


@dataclass(frozen=True, slots=True)
class _Timing:
    """Timing of the commands and of the sensed forces."""

    now: Row  # the newer and the older command of a sample
    before: Row
    older: float  # part of the sample in which the older command acts
    sensed: int  # number of whole samples by which the sensor is late
    within: float | None  # time within a sample at which the sensor samples, in (0, 1); None for the end of the sample
    carried: bool  # whether the older command acts at that time


def _timing(
    states: dict[str, Row], command: Row, device: Device, sensor_delay: float, *, later: bool = False
) -> _Timing:
    """Return the timing of a device's commands, and add the states that store the commands."""
    T, delay = float(device.sample_time), float(device.latency)
    whole, older = split_delay(delay, T)
    sensed, part = split_delay(sensor_delay, T)
    together, _ = split_delay(delay + sensor_delay, T)
    now, before = (late(states, "command", command, whole + later + samples) for samples in (0, 1))
    return _Timing(now, before, older, sensed, 1 - part if part > 0 else None, together > whole + sensed)


def _sensed(states: dict[str, Row], chain: _Chain, at: _Timing, weights: Floats, feed: float) -> Row:
    """Return the sensed value of a sum of the dimensionless states and of the input that acts just before sensing."""
    if at.within is None:
        rows, acting = chain.after([{} for _ in chain.names]), at.before
    elif at.carried:
        rows, acting = chain.after(chain.over(at.within, 0.0, at.before, {})), at.before
    else:
        rows, acting = chain.after(chain.over(at.within, at.older, at.now, at.before)), at.now
    felt = total([(1.0, chain.weighted(weights, rows)), (feed, acting)])
    return late(states, "sensed", felt, at.sensed + (at.within is not None))


def plant_states(device: Device, hand: Hand) -> PlantStates:
    """Return a device in a hand over one sample, from its held command to the signals that its firmware knows."""
    T, states = float(device.sample_time), dict[str, Row]()
    parts = mechanism_in_hand(device, hand, FLOATS)
    chain = _in_hand(parts, T, float(device.mass))
    at = _timing(states, {INPUT: 1.0}, device, float(device.sensing.delay))
    moved = chain.over(1.0, at.older, at.now, at.before)
    states |= dict(zip(chain.names, chain.after(moved), strict=True))
    velocity: Row = {"velocity": 1.0}
    if _differenced(device):
        states["difference"], velocity = total([(1 / T, moved[0])]), {"difference": 1.0}
    share, order = _low_pass(device)
    velocity = filtered(states, "velocity", velocity, share, order)
    weights, feed = np.array([parts.felt.get(name, 0) for name in parts.names], float), 0.0
    if parts.felt_inertia is not None:
        row = parts.names.index(parts.handle)
        weights, feed = weights + parts.felt_inertia * np.array(parts.rates[row], float), parts.push[row]
        feed *= parts.felt_inertia
    return PlantStates(states, {"position": 1.0}, velocity, moved[0], _sensed(states, chain, at, weights, feed))


def velocity_states(device: Device, hand: Hand) -> PlantStates:
    """Return a device in a hand as `plant_states` does, but without duplicate states, for a law that needs only the
    velocity estimate."""
    T, states = float(device.sample_time), dict[str, Row]()
    chain = _in_hand(mechanism_in_hand(device, hand, FLOATS), T, float(device.mass))
    share, order = _low_pass(device)
    memory = {f"command[k-{ago}]": -comb(order, ago) * (share - 1) ** ago for ago in range(1, order + 1)}
    command = {INPUT: share**order, **memory}
    late(states, "command", command, order)
    at = _timing(states, command, device, 0.0, later=_differenced(device))
    moved = chain.over(1.0, at.older, at.now, at.before)
    states |= dict(zip(chain.names, chain.after(moved), strict=True))
    velocity = total([(1 / T, moved[0])]) if _differenced(device) else {"velocity": 1.0}
    return PlantStates(states, {}, velocity, moved[0], {})


def _differenced(device: Device) -> bool:
    """Return whether the firmware's velocity is the difference of positions."""
    estimate = device.velocity
    return not device.kind.senses_force or (estimate is not None and estimate.source == "difference")


def _low_pass(device: Device) -> tuple[float, int]:
    """Return the coefficient a of the firmware's low-passes of the velocity, and the number of low-passes."""
    estimate = device.velocity
    if estimate is None or estimate.filter_hz is None:
        return 1.0, 0
    share, _ = low_pass_coefficients(float(estimate.filter_hz), float(device.sample_time), FLOATS)
    return share, estimate.filter_order


def _in_hand(parts: Mechanism, sample_time: float, mass: float) -> _Chain:
    """Return the mechanism in the form x' = E^-1 (A x + b u)."""
    rates, push = np.array(parts.rates, float), np.array(parts.push, float)
    for name, inertia in parts.inertia.items():
        row = parts.names.index(name)
        rates[row], push[row] = rates[row] / inertia, push[row] / inertia
    handle = parts.names.index(parts.handle)
    for name, sensed in parts.sensed.items():
        row = parts.names.index(name)
        rates[row], push[row] = rates[row] - sensed * rates[handle], push[row] - sensed * push[handle]
    speed = sample_time / mass
    units = {"position": speed * sample_time, "bend": speed * sample_time, "velocity": speed, "handle": speed}
    return _Chain(tuple(parts.names), rates, push, np.array([units.get(name, 1.0) for name in parts.names]))


def servo_states(device: Device, hand: Hand) -> PlantStates:
    """Return a servo over one sample, from the commanded velocity to the sensed force of a hand."""
    servo, share = device.servo, device.sensing.filter_coefficient
    assert servo is not None
    states: dict[str, Row] = {}
    command: Row = {INPUT: 1.0}
    if servo.command == "position":
        command = total([(0.5, command), (0.5, late(states, "commanded", command, 1))])
    felt, chain = _felt_of_servo(states, device, hand, command)
    if share is not None:
        felt = filtered(states, "sensed", felt, float(share), 1)
    if servo.stiffness is not None:
        pull, inner = Hand(0.0, 0.0, servo.stiffness), dict[str, Row]()
        pulled, _ = _felt_of_servo(inner, device.sensing_at_once, pull, command)
        own = {name: f"{name} pulled" for name in inner if device.senses_late}
        states |= {own.get(name, name): _renamed(row, own) for name, row in inner.items()}
        felt = total([(1.0, felt), (1.0, _renamed(pulled, own))])
    moved = total([(1.0, states["position"]), (-1.0, {"position": 1.0})])
    return PlantStates(states, {"position": 1.0}, {chain.names[1]: 1.0}, moved, felt)


def _felt_of_servo(states: dict[str, Row], device: Device, hand: Hand, command: Row) -> tuple[Row, _Chain]:
    """Return the sensed value of M a + B v + K x."""
    T, servo = float(device.sample_time), device.servo
    assert servo is not None
    driven = np.array(servo_rates(device, FLOATS)[0], float)
    n = len(driven) + 1
    names = ("position", *(f"velocity {number}" for number in range(1, n)))
    rates = np.zeros((n, n))
    rates[0, 1], rates[1:, 1:] = 1.0, driven
    push = np.append(0.0, -driven.sum(axis=1))  # at rest, a command of 1 makes all of these states 1
    chain = _Chain(names, rates, push, np.array([T] + [1.0] * (n - 1)))
    late_as_one = replace(device, servo=replace(servo, delay=device.sensed_latency))  # only the delays' sum matters
    at = _timing(states, command, late_as_one, 0.0)
    states |= dict(zip(names, chain.after(chain.over(1.0, at.older, at.now, at.before)), strict=True))
    weights = hand.mass / T * chain.rates[1]
    weights[0], weights[1] = weights[0] + hand.stiffness * T, weights[1] + hand.damping
    return _sensed(states, chain, at, weights, hand.mass / T * chain.push[1]), chain


def _renamed(row: Row, names: dict[str, str]) -> Row:
    return {names.get(name, name): x for name, x in row.items()}
