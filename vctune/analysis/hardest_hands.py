"""Evaluate what hands require of a coupling, and find the hand that requires the most near a point, in double
precision."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from math import inf, pi
from typing import NamedTuple

import numpy as np

from vctune.analysis.climb import climbed
from vctune.analysis.extrema import Floats
from vctune.analysis.loops_in_hands import PER_DECADE
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains, SpringDamper
from vctune.model.hand_arrays import PlacesInHands
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.sampled.hand_loop import (
    AnyLoopInHand,
    loop_in_hand,
    met_in_hand,
    offered,
    required_in_hand,
)
from vctune.model.sampled.plant_in_hand import AnyPlantInHand, ServoInHand, delays_of, plant_in_hand
from vctune.model.sampled.several_devices import as_one
from vctune.model.sampled.worlds.late_sides import open_sides
from vctune.model.sampled.worlds.loop_in_walls import LEADS, disjuncts_in_walls, strip_in_walls
from vctune.model.sampled.worlds.loop_in_worlds import Offered, Seen, disjuncts, posed, room_of
from vctune.model.worlds import WorldsMet

FIRST_STEP = 0.2  # First step of the search for the worst hand, in the square roots of the shares of a hand's ranges
# Value of 1/ratio above which the search treats a coupling as active, that is, as one that supplies energy where it
# must absorb energy
DRIVEN = 1e6

# What an environment meets, for some shares of the coupling (`met_in_shares`)
MetInShares = dict[float, tuple[Offered, Seen, float]]


@np.errstate(all="ignore")
def needs_in_worlds(
    loop: AnyLoopInHand,
    device: Device,
    gains: Gains,
    coupling: AnyCoupling,
    theta: Floats,
    met: WorldsMet,
    share: float = 1.0,
) -> dict[str, Floats]:
    """Return 1/ratio for each margin."""
    factor, worlds, T, inverse = met.factor, met.worlds, device.sample_time, device.kind.inverse
    at, seen = met_in_hand(loop, device, gains, coupling, share, theta, FLOATS)
    reserve = 1.0 if inverse else factor
    found = disjuncts(at, worlds, T, seen, reserve, theta, FLOATS)
    need = _need(seen.lost / seen.size, at.resistance + reserve * worlds.low.damping)
    needs = {"resistive": need * (reserve / factor)}
    for name in posed(worlds, factor, inverse=inverse)[1:]:
        needs[name] = np.exp(-room_of(getattr(found, name), np.abs)) / factor
    return needs


def needs_in_hands(
    loop: AnyLoopInHand, device: Device, gains: Gains, coupling: AnyCoupling, theta: Floats, met: WorldsMet | None
) -> Floats:
    """Return 1/ratio in hands."""
    if met is not None and met.worlds.corner is not None:
        rooms = rooms_at_walls(met_in_shares(loop, device, gains, coupling, theta, met), device.sample_time, theta, met)
        return np.exp(-np.minimum.reduce(list(rooms.values()))) / met.factor
    if met is not None and not met.worlds.lossless:
        return _need_in_time(loop, device, gains, coupling, theta, met)
    if met is not None:
        shares = shares_of_coupling(met.factor) if device.kind.inverse else (1.0,)
        each = (needs_in_worlds(loop, device, gains, coupling, theta, met, share) for share in shares)
        return np.maximum.reduce([np.minimum.reduce(np.broadcast_arrays(*needs.values())) for needs in each])
    found = required_in_hand(loop, gains)
    with np.errstate(all="ignore"):
        return _need(np.asarray(found.lost / found.size), offered(coupling, device, theta, FLOATS))


@np.errstate(all="ignore")
def _need_in_time(
    loop: AnyLoopInHand, device: Device, gains: Gains, coupling: AnyCoupling, theta: Floats, met: WorldsMet
) -> Floats:
    """Return 1/ratio with environments that run late or step by Euler's rules, from the margins of `open_sides`."""
    planes = open_sides(met.worlds, device.sample_time, theta)
    rooms = [
        np.maximum.reduce([np.asarray(room_of(plane.terms(at, seen, left), np.abs)) for plane in planes])
        for at, seen, left in met_in_shares(loop, device, gains, coupling, theta, met).values()
    ]
    return np.exp(-np.minimum.reduce(rooms)) / met.factor


class AtWall(NamedTuple):
    """The share of the coupling and the l of the integration rule in a condition for walls."""

    share: float
    lead: float


def met_in_shares(
    loop: AnyLoopInHand, device: Device, gains: Gains, coupling: AnyCoupling, theta: Floats, met: WorldsMet
) -> MetInShares:
    """Return the impedance that an environment meets with some shares of the coupling."""
    found: MetInShares = {}
    for share in shares_of_coupling(met.factor):
        at, seen = met_in_hand(loop, device, gains, coupling, share, theta, FLOATS)
        found[share] = at, seen, 1.0 if isinstance(coupling, SpringDamper) else share
    return found


@np.errstate(all="ignore")
def rooms_at_walls(shares: MetInShares, sample_time: float, theta: Floats, met: WorldsMet) -> dict[AtWall, Floats]:
    """Return the relative reserve of the condition for walls, for some shares of the coupling and both integration
    rules."""
    worlds, rooms = met.worlds, dict[AtWall, Floats]()
    for share, (at, seen, left) in shares.items():
        strip = strip_in_walls(at, worlds, sample_time, seen, left, theta, FLOATS)
        for lead in LEADS:
            found = disjuncts_in_walls(strip, worlds, lead, sample_time, theta, FLOATS)
            each = [np.asarray(room_of(terms, np.abs)) for terms in found if terms is not None]
            rooms[AtWall(share, lead)] = np.maximum.reduce(each)
    return rooms


def tightest_at_wall(
    device: Device, gains: Gains, coupling: AnyCoupling, omega: float, hand: Hand, met: WorldsMet
) -> AtWall:
    """Return the share of a coupling and the integration rule with which walls have the least reserve at one place."""
    theta = np.array([min(omega * device.sample_time, pi)])
    loop = loop_in_hand(plant_in_hand(device, hand, delays_of(device), FLOATS), theta, FLOATS)
    rooms = rooms_at_walls(met_in_shares(loop, device, gains, coupling, theta, met), device.sample_time, theta, met)
    return min(rooms, key=lambda wall: float(np.nan_to_num(rooms[wall][0], nan=inf)))


def shares_of_coupling(factor: float) -> tuple[float, ...]:
    """Return the shares of a coupling that the double-precision search examines: 1, 1/g and one between them."""
    return (1.0,) if factor == 1 else (1 / factor, factor**-0.5, 1.0)


@np.errstate(all="ignore")
def _need(required: Floats, there: Floats) -> Floats:
    """Return 1/ratio as a function that is continuous where R changes its sign."""
    drives = np.where(required < there, 0.0, DRIVEN * (2 + (required - there) / (np.abs(required) - there)))
    return np.where(there < 0, drives, required / np.maximum(there, 1e-300))


@np.errstate(all="ignore")
def hardest_near(
    devices: Device | Sequence[Device],
    hands: Hands,
    gains: Gains,
    coupling: AnyCoupling,
    starts: PlacesInHands,
    met: WorldsMet | None = None,
) -> tuple[Floats, PlacesInHands]:
    """Climb from places to the greatest 1/ratio near them, in log theta and in the square root of each share."""
    each = [devices] * len(starts) if isinstance(devices, Device) else devices
    device, delays = as_one(each, (-1, 1, 1))
    numbers = {device: number for number, device in enumerate(each)}
    # the places of one device and one design compete
    owners = [numbers[device] for device in each] if np.ndim(gains.velocity) == 0 else range(len(starts))
    low, width = np.array([(low, high - low) for low, high in hands.ranges.values()]).T
    # what a hand requires of a servo is convex in the hand: a search that starts at a vertex stays there
    at_vertices = device.servo is not None and met is None
    free = np.flatnonzero((width > 0) & (not at_vertices))
    combinations = np.array([*product(range(3), repeat=free.size)], int).T
    beyond = np.array([*starts.hands.numbers.values()]) - low[:, None]
    starting = np.sqrt(beyond / np.where(width > 0, width, 1.0)[:, None])
    servo = plant_in_hand(device, hands.low, delays, FLOATS) if device.servo is not None else None

    def hand_at(roots: Floats) -> Hand:
        """Return the hands with given square roots of their shares of the box, shape (3, n, ...)."""
        return Hand(*(least + wide * root**2 for least, wide, root in zip(low, width, roots, strict=True)))

    def needs(nodes: Floats) -> Floats:
        """Return 1/ratio at each combination of the nodes of the roots and of the logarithm of the angle's factor."""
        roots = np.repeat(starting[:, :, None], combinations.shape[1], axis=2)
        for which, place, each in zip(free, combinations, nodes[:-1], strict=True):
            roots[which] = each[:, place]
        hand, theta = hand_at(roots[..., None]), np.minimum(starts.at[:, None] * np.exp(nodes[-1]), pi)[:, None, :]
        if isinstance(servo, ServoInHand):  # a hand cannot move a servo
            plant: AnyPlantInHand = replace(servo, hand=hand)
        else:
            plant = plant_in_hand(device, hand, delays, FLOATS)
        loop = loop_in_hand(plant, theta, FLOATS)
        return needs_in_hands(loop, device, gains, coupling, theta, met).reshape(starts.at.size, -1)

    shares = starting[free]
    need, climb = climbed(
        needs,
        np.vstack((shares, np.zeros(starts.at.size))),
        low=np.vstack((np.zeros_like(shares), np.full(starts.at.size, -inf))),
        high=np.vstack((np.ones_like(shares), np.log(pi / starts.at))),
        steps=np.array([*np.full(free.size, FIRST_STEP), 2.3 / PER_DECADE]),
        groups=[*np.zeros(free.size, int), 1],
        owners=owners,
        enough=1.0,
        smooth=met is None,  # one of several margins must be positive, and the maximum of the margins has kinks
    )
    roots = starting.copy()
    roots[free] = climb[:-1]
    return need, PlacesInHands(np.minimum(starts.at * np.exp(climb[-1]), pi), hand_at(roots))
