"""Find how far a coupling is from its limit with a box of environments, in double precision (model/README.md, sections
18 and 19).

In one hand at one angle, an environment of the box puts a pole on the unit circle for the multiples y of the coupling
in an interval. Over the angles and the hands these intervals are the multiples at which something fails.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import exp, inf, log, pi
from typing import NamedTuple

import numpy as np

from vctune.analysis.before_wall import worst_before_wall
from vctune.analysis.extrema import Floats, last_to_hold, with_resonance
from vctune.analysis.hardest_hands import needs_in_hands, rooms_at_walls
from vctune.analysis.in_hands import RatioInHand
from vctune.analysis.worst_hand import ANGLES, WORST, Place, first_hands, suspects_of_nominal, zoomed
from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains, SpringDamper, series_coupling
from vctune.model.hands import Hand, Hands, hands_as_one
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.sampled.hand_loop import loop_in_hand, met_in_hand, seen_in_hand
from vctune.model.sampled.loop_in_worlds import offered_at, real_at_nyquist
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.model.worlds import Worlds, WorldsMet
from vctune.proof.claims.claim import Suspect
from vctune.running import check_time

ENDLESS = 1e100  # in place of an infinite multiple
TURNS, PER_TURN = 6, 16  # of the angles beside the turns of a delay, and number of angles in each
ROUNDING = 1e-9  # relative, where lines cross
LEAST_RESISTANCE = 1e-9  # Least Re Z_c that is told from 0, over |Im Z_c|
# Step between shares of the coupling that are tried for the condition of walls, the least of them, and halvings
WALL_STEP, LEAST_SHARE, HALVINGS = 1.05, 1e-3, 12


class _Failing(NamedTuple):
    """Intervals of multiples at which something fails, each between two adjacent angles in one hand."""

    low: Floats  # shape (hands, steps)
    high: Floats
    theta: Floats  # angle of the high end, rad


def least_ratio_in_worlds(
    device: Device, hands: Hands, gains: Gains, coupling: AnyCoupling, worlds: Worlds
) -> RatioInHand:
    """Return the number by which the coupling may be divided before something fails; below 1, the one by which it must
    be divided so that nothing does."""
    tried, every = first_hands(hands), angles_of(device)

    def worst_of(near: list[Hand], angles: Floats, best: Place) -> Place:
        return _limit(LoopsInWorlds.of(device, gains, near, worlds, angles).failing(coupling), near, best)

    first = LoopsInWorlds.of(device, gains, tried, worlds, every).failing(coupling)
    found = _limit(first, tried, Place(0.0, 0.0, tried[0]))
    reached = np.max(np.where(first.high <= max(found.value, 1.0), first.high, 0.0), axis=1)
    starts = [found, *(Place(float(reached[n]), 0.0, tried[n]) for n in np.argsort(-reached)[:WORST])]
    found = max([found, *(zoomed(worst_of, hands, start, every) for start in starts)], key=lambda limit: limit.value)
    return RatioInHand(1 / found.value if found.value > 0 else inf, found.theta / device.sample_time, found.hand)


def suspects(design: Design, demands: Demands, devices: Sequence[Device]) -> Iterator[Suspect]:
    """Yield the suspects of the nominal response, and hands in which one of a disc seems to be at its limit.

    It is what `vctune.proof.certificate.certify` asks for.
    """
    if demands.hands is not None and demands.rigid and isinstance(design.coupling, SpringDamper):
        for device in devices:
            wall = worst_before_wall(device, design.coupling, demands.hands)
            if wall.value < demands.factor:
                yield Suspect(device, wall.hand, (wall.theta, wall.theta))
        return
    yield from suspects_of_nominal(design, demands, devices)
    if demands.worlds is None or demands.hands is None:
        return
    for device in devices:
        if device.servo is not None and device.servo.radii:
            law = design.gains, design.coupling
            at = least_ratio_in_worlds(device, demands.hands, *law, demands.worlds)
            theta = min(at.omega * device.sample_time, pi)
            yield Suspect(device, at.hand, (theta, theta))


def ratio_in_these(
    device: Device, hands: Sequence[Hand], gains: Gains, coupling: AnyCoupling, worlds: Worlds | None
) -> float:
    """Return the least ratio in given hands on a grid of angles: with environments that of `least_ratio_in_worlds`, and
    otherwise Re Z_c / R."""
    theta = angles_of(device)
    if worlds is not None:
        return LoopsInWorlds.of(device, gains, hands, worlds, theta).ratio(coupling)
    plant = plant_in_hand(device, hands_as_one(hands, (-1, 1)), delays_of(device), FLOATS)
    need = float(np.nanmax(needs_in_hands(loop_in_hand(plant, theta, FLOATS), device, gains, coupling, theta, None)))
    return 1 / need if need > 0 else inf


def angles_of(device: Device) -> Floats:
    """Return angles up to pi, dense enough for the turns of a delay and for the resonance of a structure."""
    turns = TURNS + device.sensed_latency / device.sample_time
    theta = np.union1d(ANGLES, np.linspace(0.0, pi, int(PER_TURN * turns) + 1)[1:])
    return np.minimum(with_resonance(device, theta / device.sample_time) * device.sample_time, pi)


@dataclass(frozen=True, slots=True)
class LoopsInWorlds:
    """The loop of a device in some hands at some angles, with the environments that it meets."""

    device: Device
    hands: Sequence[Hand]
    worlds: Worlds
    angles: Floats  # rad, shape (n,)
    lost: Floats  # R, N s/m, shape (hands, n)
    held: Floats  # -Im Z_seen
    blur: Floats | None = None  # radius of a disc around Z_seen; None without one

    @classmethod
    def of(
        cls, device: Device, gains: Gains, hands: Sequence[Hand], worlds: Worlds, angles: Floats | None = None
    ) -> LoopsInWorlds:
        """Return the loop with given gains, at angles that are dense enough for its limit if none are given."""
        check_time()
        theta = angles_of(device) if angles is None else angles
        plant = plant_in_hand(device, hands_as_one(hands, (-1, 1)), delays_of(device), FLOATS)
        seen = seen_in_hand(loop_in_hand(plant, theta, FLOATS), gains)
        with np.errstate(all="ignore"):
            parts = [np.asarray(seen.lost / seen.size), np.asarray(seen.swing / seen.size) / np.sin(theta / 2)]
        parts += [] if isinstance(seen.blur, int) else [np.asarray(seen.blur)]
        return cls(device, hands, worlds, theta, *(np.broadcast_to(part, (len(hands), theta.size)) for part in parts))

    @np.errstate(all="ignore")
    def failing(self, coupling: AnyCoupling) -> _Failing:
        """Return the multiples y at which y Z_c + Z_seen is minus the impedance of some environment."""
        angles, low, high, T = self.angles, self.worlds.low, self.worlds.high, self.device.sample_time
        series, rule, u = series_coupling(coupling), self.device.rule, 2 / T * np.tan(angles / 2)
        at = offered_at(series, T, rule, angles, FLOATS)
        own = np.asarray(at.reactance) / np.cos(angles / 2)
        light, soft, heavy, stiff = map(float, (low.mass, low.stiffness, high.mass, high.stiffness))
        # y Im Z_c at which the reactance leaves the box, at its heaviest and at its stiffest environment
        most = np.full_like(self.held, -inf) if heavy == inf else self.held - heavy * u + soft / u
        least = np.full_like(self.held, inf) if stiff == inf else self.held - light * u + stiff / u
        # A rigid coupling without drag has no resistance; a little keeps the quotient by it finite
        real = np.maximum(np.asarray(at.resistance), LEAST_RESISTANCE * np.abs(own))
        loss = self.lost - float(low.damping)

        def within(sides: Floats | float, front: Floats | float) -> _Failing:
            """Return the multiples within the box, its sides and its front moved outwards."""
            heaviest = 0.0 if heavy == inf else (most - sides) / own
            stiffest = ENDLESS if stiff == inf else (least + sides) / own
            above, below = (np.broadcast_to(each, self.held.shape).copy() for each in (heaviest, stiffest))
            if angles[-1] == pi and real_at_nyquist(series, rule, self.worlds):
                above[:, -1], below[:, -1] = 0.0, ENDLESS
            return _between(above, below, (loss + front) / real, angles)

        if self.blur is None:
            return within(0.0, 0.0)
        found = [within(self.blur, 0.0), within(0.0, self.blur)]
        for corner, endless in ((most, heavy == inf), (least, stiff == inf)):
            if not endless:
                found.append(_in_disc(real, own, loss, corner, self.blur, angles))
        return _Failing(*(np.concatenate([each[k] for each in found], axis=1) for k in range(3)))

    def least_stable(self, coupling: AnyCoupling, others: Sequence[LoopsInWorlds], room: float) -> float:
        """Return the least multiple of a coupling beyond which nothing fails up to `room` times as much, here and in
        other loops; 0 if nothing fails near 0."""
        failing = [loop.failing(coupling) for loop in (self, *others)]
        low, high = (np.concatenate([each[end][each.low < inf] for each in failing]) for end in (0, 1))
        order = np.argsort(low)
        low, reach = low[order], np.maximum.accumulate(np.append(0.0, high[order]))
        return float(reach[np.flatnonzero(np.append(low, inf) > reach * room)[0]])

    def limits(self, coupling: AnyCoupling) -> list[Place]:
        """Return for each hand alone the multiple of a coupling beyond which nothing fails, and where; 0 if nothing
        fails."""
        found = self.failing(coupling)
        parts = [_Failing(*(numbers[[k]] for numbers in found)) for k in range(len(self.hands))]
        nowhere = Place(0.0, 0.0, self.hands[0])
        return [_limit(part, [hand], nowhere._replace(hand=hand)) for part, hand in zip(parts, self.hands, strict=True)]

    def ratio(self, coupling: AnyCoupling) -> float:
        """Return the number by which a coupling may be divided in these hands, as `least_ratio_in_worlds` does."""
        found = _limit(self.failing(coupling), self.hands, Place(0.0, 0.0, self.hands[0]))
        return 1 / found.value if found.value > 0 else inf


def _in_disc(real: Floats, own: Floats, loss: Floats, corner: Floats, radius: Floats, angles: Floats) -> _Failing:
    """Return the multiples at which y Z_c lies in a disc around a corner of the box, at each angle."""
    square, along = real * real + own * own, real * loss + own * corner
    root = along * along - square * (loss * loss + corner * corner - radius * radius)
    spread = np.sqrt(np.maximum(root, 0.0))
    low, high = np.maximum((along - spread) / square, 0.0), (along + spread) / square
    fails = (root >= 0) & (high >= 0)
    theta = np.broadcast_to(angles, low.shape)
    return _Failing(np.where(fails, low, inf), np.where(fails, high, -inf), theta)


def _between(above: Floats, below: Floats, resistive: Floats, angles: Floats) -> _Failing:
    """Return the least and the greatest y >= 0 with above <= y <= below and y <= resistive between adjacent angles.

    There the three are nearly lines, so that such a y is least and greatest at an angle or where two lines cross.
    """
    possible = [np.maximum(of[:, :-1], of[:, 1:]) >= 0 for of in (below, resistive)]
    hand, step = np.nonzero(possible[0] & possible[1])
    lines = [(of[hand, step], of[hand, step + 1]) for of in (above, below, resistive)]
    crossings = np.subtract(lines[0], lines[2]), np.subtract(lines[1], lines[2]), lines[1]
    shares = [np.clip(start / (start - end), 0.0, 1.0) for start, end in crossings]
    low, high, theta = np.full(hand.size, inf), np.full(hand.size, -inf), angles[step]
    for share in (0.0, 1.0, *shares):
        first, last, real = (start + share * (end - start) for start, end in lines)
        first, last = np.maximum(first, 0.0), np.minimum(last, real)
        fails = first <= last * (1 + ROUNDING)
        low = np.where(fails, np.minimum(low, first), low)
        theta = np.where(fails & (last > high), angles[step] + share * np.diff(angles)[step], theta)
        high = np.where(fails, np.maximum(high, last), high)
    every = [np.broadcast_to(of, above[:, 1:].shape).copy() for of in (inf, -inf, angles[:-1])]
    for whole, part in zip(every, (low, high, theta), strict=True):
        whole[hand, step] = part
    return _Failing(*every)


def _limit(failing: _Failing, hands: Sequence[Hand], known: Place) -> Place:
    """Return the end of the failing multiples that include 1, or else the greatest failing one below 1, 0 if nothing
    fails; a known limit above 1 is joined to what fails."""
    order = np.argsort(failing.low, axis=None)
    low, high = (each.ravel()[order] for each in (failing.low, failing.high))
    level = max(known.value, 1.0)
    end, reach = int(np.searchsorted(low, level * (1 + ROUNDING), side="right")), np.maximum.accumulate(high)
    if end == 0:
        return known
    if reach[end - 1] >= 1:  # what overlaps joins
        gaps = np.flatnonzero(low[end:] > np.maximum(reach[end - 1 : -1], level) * (1 + ROUNDING))
        end += int(gaps[0]) if gaps.size else low.size - end
    at = int(np.argmax(high[:end]))
    if high[at] <= known.value:
        return known
    hand, step = np.unravel_index(order[at], failing.low.shape)
    return Place(float(high[at]), float(failing.theta[hand, step]), hands[hand])


@np.errstate(all="ignore")
def least_ratio_with_walls(
    device: Device, hands: Hands, gains: Gains, coupling: AnyCoupling, met: WorldsMet
) -> RatioInHand:
    """Return `least_ratio_in_worlds` for the condition of walls."""

    def worst_of(near: list[Hand], angles: Floats, best: Place) -> Place:
        check_time()
        plant = plant_in_hand(device, hands_as_one(near, (-1, 1)), delays_of(device), FLOATS)
        at, seen = met_in_hand(loop_in_hand(plant, angles, FLOATS), device, gains, coupling, angles, FLOATS)

        def room(share: float) -> Floats:
            rooms = rooms_at_walls({share: (at, seen, share)}, device.sample_time, angles, met)
            return np.broadcast_to(np.nan_to_num(np.minimum.reduce(list(rooms.values())), nan=inf), shape)

        def holds(share: float) -> bool:
            return bool(room(share).min() > 0)

        shape = len(near), angles.size
        good = bad = max(best.value, 1.0 if best is start else 0.0)
        if best is start and holds(bad):
            while holds(bad):
                good, bad = bad, bad / WALL_STEP
                if bad < LEAST_SHARE:
                    return best
        elif best is not start and holds(good):
            return best
        else:
            while not holds(good):
                good, bad = good * WALL_STEP, good
                if good > 1 / LEAST_SHARE:
                    return Place(inf, 0.0, near[0])
        good = exp(last_to_hold(lambda x: holds(exp(x)), log(good), log(bad), HALVINGS))
        hand, angle = np.unravel_index(int(np.argmin(room(bad))), shape)
        return Place(good, float(angles[angle]), near[hand])

    start = Place(0.0, 0.0, hands.low)
    found, every = worst_of(first_hands(hands), angles_of(device), start), angles_of(device)
    if found is not start and found.value < inf:
        found = zoomed(worst_of, hands, found, every)
    return RatioInHand(1 / found.value if found.value > 0 else inf, found.theta / device.sample_time, found.hand)
