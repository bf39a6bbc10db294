"""Sample a device in a hand as rows of named states, for hands whose damping changes between samples."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from vctune.model.device import Device
from vctune.model.hands import Hand
from vctune.model.loop.device_response import mechanism
from vctune.model.loop.drive import drive_states
from vctune.model.loop.filters import low_pass_coefficients
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import Vector, add, nothing, times
from vctune.model.sampled.changing.named_rows import COMMAND, Chain, Row, late, low_passed, sensed, timing, total
from vctune.model.sampled.plant_in_hand import mechanism_in_hand

PULL = "K x"  # Name of the force of the hand's spring


FELT = ("felt", "felt rate")  # States of the force sensor's low-pass


class HeldPlant(NamedTuple):
    """A device in a hand over one sample, as rows over the states and the command."""

    change: dict[str, Row]  # change over a sample, for the states that hardly change
    memory: dict[str, Row]  # next value, for all other states
    position: Row  # position and velocity that the firmware reads or estimates
    velocity: Row
    moved: Row  # change of the position over a sample
    felt: Row  # sensed force, with the force of a servo's firmware spring; a resisting force is positive
    rest: Row  # states at rest for q = 1 and v_e = 0
    spring: Number  # k_eq, the sensed force at rest for q = 1; 0 for a velocity loop with K_p = 0


def held_plant(
    plain: Device, device: Device, stiffness: Number | None, hand: Hand, before: Number, ops: Arithmetic
) -> HeldPlant:
    """Return a device with a velocity loop in a hand."""
    body, sensing = (_body(device, each, ops) for each in (hand, replace(hand, damping=before)))
    if stiffness is None:
        one = replace(hand, stiffness=device.mass / (device.sample_time * device.sample_time))
        units = (_body(device, each, ops) for each in (one, replace(one, damping=before)))
        spring = hand.stiffness * (device.sample_time * device.sample_time) / device.mass
        body, sensing = (_by_pull(own, unit, spring) for own, unit in zip((body, sensing), units, strict=True))
    memory, times_of = dict[str, Row](), timing(plain, device)
    now, older = (late(memory, COMMAND, {COMMAND: 1}, times_of.whole + ago) for ago in (0, 1))
    chain = body.chain
    change = dict(zip(chain.names, chain.over(1, times_of.older, now, older, ops), strict=True))
    travel, estimate = change["position"], plain.velocity
    velocity: Row = {"velocity": 1}
    if estimate is not None and estimate.source == "difference":
        memory["difference"], velocity = travel, {"difference": 1}
    if estimate is not None and estimate.filter_hz is not None:
        share, _ = low_pass_coefficients(device.velocity.filter_hz, device.sample_time, ops)  # type: ignore[union-attr]
        velocity = low_passed(memory, "velocity", velocity, share, estimate.filter_order)
    meeting = sensing if times_of.within is None else body  # within a sample, the present hand acts
    felt = sensed(memory, chain, times_of, (now, older), (meeting.weights, meeting.feed), ops)
    if stiffness is None:
        del change["position"]
        return HeldPlant(change, memory, {}, velocity, travel, felt, {}, 0)
    rest, spring = _at_rest(device, stiffness, hand, body, [*change, *memory], ops)
    return HeldPlant(change, memory, {"position": 1}, velocity, travel, felt, rest, spring)


class _Body(NamedTuple):
    """A mechanism in a hand, x' = A x + b u, and its sensed force."""

    chain: Chain  # A and b
    weights: Row  # coefficients of the states and of the acting command in the sensed force
    feed: Number


def _body(device: Device, hand: Hand, ops: Arithmetic) -> _Body:
    parts = mechanism_in_hand(device, hand, ops)
    rows = {name: (*row, push) for name, row, push in zip(parts.names, parts.rates, parts.push, strict=True)}
    for name, inertia in parts.inertia.items():
        rows[name] = tuple(x if nothing(x) else x / inertia for x in rows[name])
    handle = rows[parts.handle]
    for name, carried in parts.sensed.items():
        rows[name] = tuple(add(x, times(-carried, y)) for x, y in zip(rows[name], handle, strict=True))
    chain = Chain(tuple(parts.names), tuple(row[:-1] for row in rows.values()), tuple(row[-1] for row in rows.values()))
    if parts.felt_inertia is None:
        return _Body(chain, dict(parts.felt), 0)
    at = parts.names.index(parts.handle)
    accelerated = dict(zip(parts.names, parts.rates[at], strict=True))
    weights = total([(1, parts.felt), (parts.felt_inertia, accelerated)])
    return _Body(chain, weights, times(parts.felt_inertia, parts.push[at]))


def _by_pull(own: _Body, unit: _Body, spring: Number) -> _Body:
    """Return a body with the force of the hand's spring as a state, so that nothing depends on the position."""
    chain, at = own.chain, own.chain.names.index("position")

    def row(name: str, one: Vector, other: Vector) -> Vector:
        return (other[at], *(0 if place == at else x for place, x in enumerate(one)))

    rows = [row(name, *both) for name, *both in zip(chain.names, chain.rates, unit.chain.rates, strict=True)]
    pulled = tuple(times(spring, x) for x in rows[at])
    weights = {PULL: unit.weights["position"]} if "position" in unit.weights else {}
    weights |= {name: x for name, x in own.weights.items() if name != "position"}
    return _Body(Chain((PULL, *chain.names), (pulled, *rows), (0, *chain.push)), weights, own.feed)


def _at_rest(
    device: Device, stiffness: Number, hand: Hand, body: _Body, names: list[str], ops: Arithmetic
) -> tuple[Row, Number]:
    """Return the states at rest for q = 1, and k_eq, the stiffness of K_p, the structure and the hand's spring in
    series."""
    T, m = device.sample_time, device.mass
    unit = T * T / m
    k, k_p = hand.stiffness * unit, stiffness * unit
    if device.structure is None:
        kappa = k_p / (k + k_p)
        rest = {"position": kappa}
    else:
        k_s = mechanism(device, device.structure, ops).stiffness * unit
        share = 1 / (1 + k / k_s)  # stiffness of the hand and the structure in series, divided by the hand's stiffness
        kappa = k_p / (k * share + k_p)
        rest = {"position": kappa, "bend": kappa * share * (k / k_s)}
        kappa = kappa * share
    spring = k * kappa
    held = {name: spring for name in names if name.startswith((COMMAND, "sensed")) or name in drive_states(device)}
    filtered = {name: spring / body.weights["felt"] for name in names if name in FELT}
    return rest | held | filtered, spring
