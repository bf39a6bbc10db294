"""Evaluate what hands require of a coupling, and find the hand that requires the most near a point, in double
precision."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from itertools import combinations, product
from math import inf, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats
from vctune.analysis.loops_in_hands import PER_DECADE
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import Hand, Hands, PlacesInHands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.sampled.hand_loop import (
    AnyLoopInHand,
    loop_in_hand,
    met_in_hand,
    offered,
    required_in_hand,
)
from vctune.model.sampled.loop_in_worlds import (
    LEADS,
    ZOffered,
    ZSeen,
    disjuncts,
    disjuncts_in_walls,
    margin_names,
    room_of,
    strip_in_walls,
)
from vctune.model.sampled.plant_in_hand import AnyPlantInHand, ServoInHand, as_one, delays_of, plant_in_hand
from vctune.model.worlds import WorldsMet
from vctune.running import check_time

# Greatest number of stencils of a climb, by whether 1/ratio is smooth
ROUNDS = {True: 16, False: 22}
LEAST_STEP = 1e-4  # Step at which a climb ends, relative to its first step
SHRINK = 8.0  # Greatest factor by which a leap reduces the steps
LEAP = 4.0  # Greatest length of a leap, in steps
TRIALS = 3  # Number of failed leaps after which a climb only moves and halves its steps
# Relative difference of values that a climb ignores when it examines a leap, because this difference is as small as the
# effect of `LEAST_STEP`
RESOLVED = 1e-8
FLATTEST = 1e-6  # Least curvature of a parabola in any direction, relative to its greatest curvature
CONSIDERED = 0.75  # Share of the greatest value below which a climb may end early


@np.errstate(all="ignore")
def climbed(
    values: Callable[[Floats], Floats],
    starts: Floats,
    low: Floats,
    high: Floats,
    steps: Floats,
    groups: Sequence[int],
    owners: Sequence[int],
    *,
    enough: float = inf,
    smooth: bool = True,
) -> tuple[Floats, Floats]:
    """Climb from each start to a maximum near it."""
    count, climbs = starts.shape
    stencil = np.array([*product(range(3), repeat=count)]).T
    middle, every, least = stencil.shape[1] // 2, np.arange(climbs), LEAST_STEP * steps[:, None]
    kin, owned = np.equal.outer(groups, groups), [np.equal(owners, owner) for owner in sorted({*owners})]
    going = np.full(climbs, True)
    centre, place, step = starts, starts, np.repeat(steps[:, None], climbs, axis=1)
    best, leapt_from, moved = np.full(climbs, -inf), step, np.full(starts.shape, False)
    leapt, failures = np.full(climbs, False), np.full(climbs, 0 if smooth else TRIALS)
    for _ in range(ROUNDS[smooth]):
        check_time()
        nodes = np.clip(centre[..., None] + np.array([-1, 0, 1]) * step[..., None], low[..., None], high[..., None])
        found = np.nan_to_num(values(nodes), nan=-inf, posinf=inf)  # 0/0 is not a value
        at = np.where(found[:, middle] >= found.max(axis=1), middle, np.argmax(found, axis=1))
        there, value = np.take_along_axis(nodes, stencil[:, at, None], axis=2)[..., 0], found[every, at]
        failed, better = leapt & (found[:, middle] < best - RESOLVED * np.abs(best)), going & (value > best)
        again, moved = moved, better & (there != place)
        best, place = np.maximum(best, value), np.where(better, there, place)
        failures += failed
        step = np.where(failed & ~better, leapt_from, step)
        leapt_from, centre = step, place
        longer = np.where(again & moved & smooth, 2 * step, step)
        step = np.where(kin @ moved & ~failed, longer, step / 2)
        hopeful = np.flatnonzero((failures < TRIALS) & ~failed)
        leapt = np.full(climbs, False)
        if hopeful.size:
            before = leapt_from[:, hopeful]
            predicted, shift = _parabola(found[hopeful], nodes[:, hopeful], LEAP * before)
            leapt[hopeful] = leaps = predicted >= best[hopeful]
            which, shift = hopeful[leaps], shift[:, leaps]
            centre, step = centre.copy(), step.copy()
            centre[:, which] = np.clip(nodes[:, which, 1] + shift, low[:, which], high[:, which])
            step[:, which] = np.clip(np.abs(shift) / 2, before[:, leaps] / SHRINK, before[:, leaps])
        for own in owned:
            top = min(float(best[own].max()), enough)
            awaited = own & (best >= (top * CONSIDERED if top > 0 else top / CONSIDERED))
            going[own] &= not np.all(step[:, awaited] < least)
        if not going.any():
            break
    return best, place


def _parabola(found: Floats, nodes: Floats, reach: Floats) -> tuple[Floats, Floats]:
    """Return the place near the middle node at which the parabola through each stencil is greatest."""
    count, climbs = nodes.shape[:2]
    axes, (lines, planes) = range(count), _through_middle(count)
    first, second = np.triu_indices(count, 1)
    below, above = (nodes[..., 1] - nodes[..., 0]).T, (nodes[..., 2] - nodes[..., 1]).T  # shape (n, d)
    inside, whole = (below > 0) & (above > 0), below + above
    # first and second derivatives of the parabola through three nodes at unequal distances
    slopes = np.stack([-above / (below * whole), (above - below) / (below * above), below / (above * whole)], axis=-1)
    bends = 2 * np.stack([1 / (below * whole), -1 / (below * above), 1 / (above * whole)], axis=-1)
    gradient = np.where(inside, np.sum(slopes * found[:, lines], axis=-1), 0.0)
    hessian = np.zeros((climbs, count, count))
    hessian[:, axes, axes] = np.where(inside, np.sum(bends * found[:, lines], axis=-1), -1.0)
    if first.size:
        mixed = np.einsum("npab,npa,npb->np", found[:, planes], slopes[:, first], slopes[:, second])
        mixed = np.where(inside[:, first] & inside[:, second], mixed, 0.0)
        hessian[:, first, second] = hessian[:, second, first] = mixed
    finite = np.isfinite(hessian).all(axis=(1, 2)) & np.isfinite(gradient).all(axis=1)
    gradient[~finite], hessian[~finite] = 0.0, -np.eye(count)
    unit = reach.T  # in units of the reach, the coordinates are comparable
    curvatures, directions = np.linalg.eigh(hessian * unit[:, :, None] * unit[:, None, :])
    sharpness = np.abs(curvatures)
    rise = np.einsum("nij,ni->nj", directions, gradient * unit)
    leap = rise / np.maximum(sharpness, FLATTEST * sharpness.max(axis=1, keepdims=True))
    shift = np.clip(np.einsum("nij,nj->ni", directions, leap) * unit, -unit, unit)
    gained = np.sum(gradient * shift, axis=1) + np.einsum("ni,nij,nj->n", shift, hessian, shift) / 2
    return found[:, 3**count // 2] + np.where(finite, gained, 0.0), shift.T


@cache
def _through_middle(count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the nodes of a stencil on the lines through its middle along each coordinate, and on the planes through it
    along each pair of coordinates."""
    index, pairs = np.arange(3**count).reshape((3,) * count), combinations(range(count), 2)
    lines = np.array([np.moveaxis(index, i, -1)[(1,) * (count - 1)] for i in range(count)])
    planes = [np.moveaxis(index, pair, (-2, -1))[(1,) * (count - 2)] for pair in pairs]
    return lines, np.array(planes, np.intp).reshape(-1, 3, 3)


FIRST_STEP = 0.2  # First step of the search for the worst hand, in the square roots of the shares of a hand's ranges
# Greatest distance of the log of a start's angle from a resonance, for the climb to follow the resonance as the hand
# changes: along it 1/ratio is a narrow curved ridge in the angle, the mass and the stiffness
BESIDE = 0.5
# Value of 1/ratio above which the search treats a coupling as active, that is, as one that supplies energy where it
# must absorb energy
DRIVEN = 1e6

# What an environment meets, for some shares of the coupling (`met_in_shares`)
MetInShares = dict[float, tuple[ZOffered, ZSeen, float]]


@np.errstate(all="ignore")
def needs_in_worlds(
    loop: AnyLoopInHand,
    device: Device,
    gains: Gains,
    coupling: AnyCoupling,
    theta: Floats,
    met: WorldsMet,
) -> dict[str, Floats]:
    """Return 1/ratio for each margin."""
    factor, worlds, T = met.factor, met.worlds, device.sample_time
    at, seen = met_in_hand(loop, device, gains, coupling, theta, FLOATS)
    found = disjuncts(at, worlds, T, seen, factor, theta, FLOATS)
    needs = {"resistive": _need(seen.lost / seen.size, at.resistance + factor * worlds.low.damping)}
    for name in margin_names(worlds, factor)[1:]:
        needs[name] = np.exp(-room_of(getattr(found, name), np.abs)) / factor
    return needs


def needs_in_hands(
    loop: AnyLoopInHand, device: Device, gains: Gains, coupling: AnyCoupling, theta: Floats, met: WorldsMet | None
) -> Floats:
    """Return 1/ratio in hands."""
    if met is not None and met.worlds.corner is not None:
        rooms = rooms_at_walls(met_in_shares(loop, device, gains, coupling, theta, met), device.sample_time, theta, met)
        return np.exp(-np.minimum.reduce(list(rooms.values()))) / met.factor
    if met is not None:
        needs = needs_in_worlds(loop, device, gains, coupling, theta, met)
        return np.asarray(np.minimum.reduce(np.broadcast_arrays(*needs.values())))
    found = required_in_hand(loop, gains)
    with np.errstate(all="ignore"):
        return _need(np.asarray(found.lost / found.size), offered(coupling, device, theta, FLOATS))


class AtWall(NamedTuple):
    """The share of the coupling and the l of the integration rule in a condition for walls."""

    share: float
    lead: float


def met_in_shares(
    loop: AnyLoopInHand, device: Device, gains: Gains, coupling: AnyCoupling, theta: Floats, met: WorldsMet
) -> MetInShares:
    """Return the impedance that an environment meets with some shares of the coupling."""
    at, seen = met_in_hand(loop, device, gains, coupling, theta, FLOATS)
    return {share: (at, seen, share) for share in shares_of_coupling(met.factor)}


@np.errstate(all="ignore")
def rooms_at_walls(shares: MetInShares, sample_time: float, theta: Floats, met: WorldsMet) -> dict[AtWall, Floats]:
    """Return the relative reserve of the condition for walls, for some shares of the coupling and both integration
    rules."""
    worlds, rooms = met.worlds, dict[AtWall, Floats]()
    for share, (at, seen, left) in shares.items():
        strip = strip_in_walls(at, worlds, sample_time, seen, left, theta, FLOATS)
        for lead in LEADS:
            found = disjuncts_in_walls(strip, worlds, lead, sample_time, theta, FLOATS)
            each = [np.asarray(room_of(terms, np.abs)) for terms in found if terms]
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

    def resonance(hand: Hand) -> Floats:
        """Return the angle at which a hand resonates with the mass of the device."""
        return np.asarray(device.sample_time * np.sqrt((hand.stiffness + gains.position) / (device.mass + hand.mass)))

    at_start = resonance(hand_at(starting[:, :, None, None]))
    resonant = device.servo is None and met is None
    beside = (np.abs(np.log(starts.at[:, None, None] / at_start)) < BESIDE) & resonant

    def followed(hand: Hand) -> Floats:
        """Return the factor by which the resonance of each climb that begins beside one moves with the hand."""
        return np.where(beside, resonance(hand) / np.where(beside, at_start, 1.0), 1.0)

    def needs(nodes: Floats) -> Floats:
        """Return 1/ratio at each combination of the nodes of the roots and of the logarithm of the angle's factor."""
        roots = np.repeat(starting[:, :, None], combinations.shape[1], axis=2)
        for which, place, each in zip(free, combinations, nodes[:-1], strict=True):
            roots[which] = each[:, place]
        hand = hand_at(roots[..., None])
        theta = np.minimum((starts.at[:, None] * np.exp(nodes[-1]))[:, None, :] * followed(hand), pi)
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
    moved = followed(hand_at(roots[:, :, None, None]))[:, 0, 0]
    return need, PlacesInHands(np.minimum(starts.at * np.exp(climb[-1]) * moved, pi), hand_at(roots))
