"""Find the local minima of Re Z_c / R in the hands of a box up to Nyquist, in double precision (model/README.md,
section 14)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from math import exp, inf, log, pi, sqrt
from typing import ClassVar

import numpy as np

from vctune.analysis.extrema import Floats, last_to_hold, local_minima
from vctune.analysis.hardest_hands import hardest_near, needs_in_hands
from vctune.analysis.loops_in_hands import PER_DECADE, angles, answers, loops_at_rest, loops_in_any_hand, loops_in_hands
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains, SpringDamper
from vctune.model.hands import Hand, Hands, PlacesInHands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.problem import Problem
from vctune.model.sampled.hand_loop import loop_in_hand, offered
from vctune.model.sampled.plant_in_hand import alike, delays_of, plant_in_hand
from vctune.model.worlds import WorldsMet
from vctune.running import check_time

SEARCHED = 6  # Number of local minima over the angle that the code refines
# Damping ratio below which the code also evaluates the angles where a hand resonates with the device, because a grid
# would miss them
SHARP = 0.03

# Least multiple of a wall in any passive hand: angles per decade, rounds of narrowing, angles that are narrowed, and
# number of angles of each; the multiples between which it is sought, and halvings of their logarithm
DENSE, ZOOMS, NARROWED, WITHIN = 480, 3, 24, 9
CLIMBS, SETTLED = 6, 1e-6  # Number of times that a climb is taken up again, and relative gain below which it has ended
VERTICES = (0.0, 1.0)  # Shares of the ranges of hands on a servo, which requires the most in a vertex
LEAST_MULTIPLE, MOST_MULTIPLE, MULTIPLE_HALVINGS = 1e-6, 1e6, 50
DEVICES_AT_ONCE = 32  # Number of devices that the code evaluates together


@dataclass(frozen=True, slots=True)
class RatioInHand:
    """A local minimum of Re Z_c / R in hands."""

    ratio: float  # Re Z_c / R; inf if the hand requires nothing
    omega: float  # frequency of the minimum, rad/s
    hand: Hand  # hand of the minimum


@dataclass(frozen=True, slots=True)
class RatioInAnyHand:
    """A local minimum of Re(1/Z_c)/R of an impedance display in any passive hand."""

    ratio: float  # Re(1/Z_c)/R; inf if the hands require nothing
    omega: float  # frequency of the minimum, rad/s
    hand: ClassVar[None] = None


def least_ratios(problem: Problem, gains: Gains, coupling: AnyCoupling) -> list[RatioInHand | RatioInAnyHand]:
    """Return the local minima of the ratio in the hands of a problem."""
    return least_ratios_of_each([problem], gains, coupling)[0]


def least_ratios_of_each(
    problems: Sequence[Problem], gains: Gains, coupling: AnyCoupling
) -> list[list[RatioInHand | RatioInAnyHand]]:
    """Return the local minima of the ratio in the hands of several problems, as `least_ratios` does for one problem."""
    found: list[list[RatioInHand | RatioInAnyHand]] = [[] for _ in problems]
    hands, met = problems[0].hands_met, problems[0].worlds_met
    if hands is not None:
        devices = [problem.device for problem in problems]
        found = [[*ratios] for ratios in least_ratios_of_devices(devices, hands, gains, coupling, met)]
    for ratios, problem in zip(found, problems, strict=True):
        if problem.any_hand:
            ratios.extend(least_ratios_in_any_hand(problem.device, gains, coupling))
    return found


def least_on_grid(
    device: Device, hands: Hands, gains: Gains, coupling: AnyCoupling, met: WorldsMet | None = None
) -> RatioInHand:
    """Return the least ratio on the grid of hands and angles, with its place."""
    where = loops_in_hands(device, hands)
    need = np.nan_to_num(needs_in_hands(where.loop, device, gains, coupling, where.theta, met), nan=-inf, posinf=inf)
    hand, at = np.unravel_index(int(np.argmax(need)), need.shape)
    place = where.hands.mapped(lambda number: float(number[hand].item()))
    return RatioInHand(_inverse(float(need[hand, at])), float(where.theta[at]) / device.sample_time, place)


def least_ratios_in_hands(
    device: Device, hands: Hands, gains: Gains, coupling: AnyCoupling, met: WorldsMet | None = None
) -> list[RatioInHand]:
    """Return the local minima of Re Z_c / R over the angle, each in its worst hand, the lowest first."""
    return least_ratios_of_devices([device], hands, gains, coupling, met)[0]


def least_ratios_of_devices(
    devices: Sequence[Device], hands: Hands, gains: Gains, coupling: AnyCoupling, met: WorldsMet | None = None
) -> list[list[RatioInHand]]:
    """Return `least_ratios_in_hands` for several devices. The function evaluates devices of the same form together."""
    starts = [_steepest(device, hands, gains, coupling, met) for device in devices]
    found: list[list[RatioInHand]] = [[] for _ in devices]
    groups = (group[i : i + DEVICES_AT_ONCE] for group in alike(devices) for i in range(0, len(group), DEVICES_AT_ONCE))
    for group in groups:
        places = [place for place in group for _ in range(len(starts[place]))]
        first, *others = (starts[place] for place in group)
        each = [devices[place] for place in places]
        closest = _closest(each, hands, gains, coupling, first.joined(*others), met)
        for place, ratio in zip(places, closest, strict=True):
            found[place].append(ratio)
    ranked = [sorted(ratios, key=lambda each: each.ratio) for ratios in found]
    if met is None:
        for device, ratios in zip(devices, ranked, strict=True):
            ratios[0] = _followed(device, hands, gains, coupling, ratios[0])
    return ranked


def _followed(device: Device, hands: Hands, gains: Gains, coupling: AnyCoupling, best: RatioInHand) -> RatioInHand:
    """Climb again from where a climb has ended, until it ends there: along a sharp resonance steps become too short."""
    for _ in range(CLIMBS if best.ratio < inf and best.omega > 0 and device.servo is None else 0):
        (further,) = least_ratios_near([device], hands, gains, coupling, best.omega, best.hand)
        if not further.ratio < best.ratio * (1 - SETTLED):
            break
        best = further
    return best


def _steepest(
    device: Device, hands: Hands, gains: Gains, coupling: AnyCoupling, met: WorldsMet | None
) -> PlacesInHands:
    """Return the places to refine: the local minima in some hands, and places that a grid would miss."""
    check_time()
    vertices = device.servo is not None and met is None  # each peak stays at the vertex that is the worst at its angle
    where = loops_in_hands(device, hands, VERTICES, DENSE) if vertices else loops_in_hands(device, hands)
    need = needs_in_hands(where.loop, device, gains, coupling, where.theta, met)
    hand = np.argmax(need, axis=0)
    worst = need[hand, np.arange(where.theta.size)]
    padded = np.concatenate(([-inf], worst, [-inf]))
    peaks = np.flatnonzero((padded[1:-1] >= padded[:-2]) & (padded[1:-1] >= padded[2:]))
    peaks = peaks[np.argsort(-worst[peaks], kind="stable")][:SEARCHED]
    steepest = PlacesInHands(where.theta[peaks], where.hands.mapped(lambda number: number[hand[peaks]]))
    others = PlacesInHands.of([_at_rest(device, hands, gains), *_resonant(device, hands, gains)])
    return steepest.joined(others)


# Half-widths of the windows, of the logarithm of the angle, in which the code looks for the ends of a violation, and
# number of angles of each
REACHES, FEWEST, WINDOW = (0.3, 0.01, 3e-4), 4, np.linspace(-1, 1, 121)


def windows(
    problem: Problem,
    gains: Gains,
    coupling: AnyCoupling,
    worst: Sequence[RatioInHand | RatioInAnyHand],
    met: WorldsMet,
) -> list[RatioInHand]:
    """Return the ends and the middle of the windows of angles in which a design violates the constraint for a box of
    environments. A shift of the window alone mends an end."""
    device, found = problem.device, list[RatioInHand]()
    for at in worst:
        if not isinstance(at, RatioInHand) or at.omega == 0 or at.ratio >= met.factor:
            continue
        plant = plant_in_hand(device, at.hand, delays_of(device), FLOATS)
        for reach in REACHES:
            theta, middle = np.minimum(at.omega * device.sample_time * np.exp(reach * WINDOW), pi), WINDOW.size // 2
            needs = needs_in_hands(loop_in_hand(plant, theta, FLOATS), device, gains, coupling, theta, met)
            fails = needs > 1 / met.factor
            below, above = np.logical_and.accumulate(fails[middle::-1]), np.logical_and.accumulate(fails[middle:])
            first, last = middle - int(below.sum()), middle + int(above.sum())
            if last - first > FEWEST:
                break
        first, last = max(first, 0), min(last, WINDOW.size - 1)
        for k in (first, (first + last) // 2, last):
            found.append(RatioInHand(at.ratio, float(theta[k] / device.sample_time), at.hand))
    return found


def ratio_at(
    device: Device, gains: Gains, coupling: AnyCoupling, omega: float, hand: Hand, met: WorldsMet | None = None
) -> float:
    """Return Re Z_c / R in one hand at one frequency; inf if the hand requires nothing."""
    theta = np.array([omega * device.sample_time])
    loop = loop_in_hand(plant_in_hand(device, hand, delays_of(device), FLOATS), theta, FLOATS)
    return _inverse(float(needs_in_hands(loop, device, gains, coupling, theta, met)[0]))


def least_ratios_near(
    devices: Sequence[Device],
    hands: Hands,
    gains: Gains,
    coupling: AnyCoupling,
    omega: float,
    hand: Hand,
    met: WorldsMet | None = None,
) -> list[RatioInHand]:
    """Return the local minimum of Re Z_c / R of each device that a descent finds from one frequency and hand."""
    starts = PlacesInHands.of([(omega * devices[0].sample_time, hand)] * len(devices))
    return _closest(devices, hands, gains, coupling, starts, met)


def least_ratios_in_any_hand(device: Device, gains: Gains, coupling: AnyCoupling) -> list[RatioInAnyHand]:
    """Return the local minima of Re(1/Z_c)/R of an impedance display in any passive hand, lowest first."""
    first, ratio = np.zeros(1), partial(ratio_in_any_hand, device, gains, coupling)
    minima = local_minima(ratio, angles(device, PER_DECADE)[1:])
    theta, value = np.append(first, minima.omega), np.append(ratio(first), minima.value)
    return [RatioInAnyHand(float(value[k]), float(theta[k] / device.sample_time)) for k in np.argsort(value)[:SEARCHED]]


def ratio_in_any_hand(device: Device, gains: Gains, coupling: AnyCoupling, theta: Floats) -> Floats:
    """Return Re(1/Z_c)/R of an impedance display in any passive hand."""
    found = answers(device, theta).required(gains)
    ratio = offered(coupling, device, theta, FLOATS) * found.size / np.maximum(found.lost, 1e-300)
    return np.where(found.size > 0, ratio, 0.0)


def least_ratio_before_wall(device: Device, wall: SpringDamper) -> RatioInAnyHand:
    """Return the least multiple of a wall with which some passive hand is unstable."""

    def lines(theta: Floats) -> tuple[Floats, Floats]:
        return answers(device, theta).before_wall(wall, device.sample_time, theta, FLOATS)

    theta = loops_in_any_hand(device, DENSE).theta
    for zoom in range(ZOOMS):
        along, size2 = lines(theta)
        least = least_multiple(along, size2)
        margins = least_up_to(least, along, size2)
        if zoom + 1 == ZOOMS or least == inf:
            break
        # the margins are smooth in theta, unlike the multiple, of which each angle of an interval alone has one
        lowest = np.argsort(margins)[:NARROWED]
        ends = theta[np.maximum(lowest - 1, 0)], theta[np.minimum(lowest + 1, theta.size - 1)]
        theta = np.unique(np.linspace(*ends, WITHIN))
    at = float(theta[np.argmin(margins)])
    return RatioInAnyHand(least, 0.0 if least == inf else at / device.sample_time)


def least_up_to(most: float, along: Floats, size2: Floats) -> Floats:
    """Return the least of 1, w times `along` and w^2 times `size2` of `AnyHand.before_wall` over 0 < w <= most: no
    passive hand has a pole with such a share w of the wall where it is positive."""
    with np.errstate(all="ignore"):
        turning = np.where(size2 > 0, -along / (2 * size2), most)
    w = np.clip(turning, 0.0, most)
    return 1 + w * (along + w * size2)


def least_multiple(along: Floats, size2: Floats) -> float:
    """Return the least w with which the least of `least_up_to` over all angles is 0; inf if there is none."""
    low, high = log(LEAST_MULTIPLE), log(MOST_MULTIPLE)
    if not least_up_to(MOST_MULTIPLE, along, size2).min() < 0:
        return inf
    return exp(last_to_hold(lambda w: bool(least_up_to(exp(w), along, size2).min() > 0), low, high, MULTIPLE_HALVINGS))


def ratio_before_wall(device: Device, wall: SpringDamper, theta: Floats) -> Floats:
    """Return the least multiple w > 0 of a wall with which some passive hand has a pole at an angle; inf if there is
    none."""
    along, size2 = answers(device, theta).before_wall(wall, device.sample_time, theta, FLOATS)
    with np.errstate(all="ignore"):
        inverse = -0.5 * along + np.sqrt(0.25 * along * along - size2)
        return np.where(inverse > 0, 1 / inverse, inf)


def _resonant(device: Device, hands: Hands, gains: Gains) -> list[tuple[float, Hand]]:
    """Return angles at which hands resonate sharply with the device, and those hands."""
    found = []
    damping = device.damping + hands.low.damping + gains.velocity
    for mass, share in product((hands.low.mass, hands.high.mass), (1.0, 0.01)):
        stiffness, moved = max(share * hands.high.stiffness, hands.low.stiffness), device.mass + mass
        theta = device.sample_time * sqrt((stiffness + gains.position) / moved)
        if damping < 2 * SHARP * sqrt(stiffness * moved) and theta < pi:
            found.append((theta, replace(hands.low, mass=mass, stiffness=stiffness)))
    return found


def _at_rest(device: Device, hands: Hands, gains: Gains) -> tuple[float, Hand]:
    """Return the hand that requires the most at angle 0, or next to it, with the angle."""
    where = loops_at_rest(device, hands)
    most = int(np.argmax(np.nan_to_num(where.required(gains).ravel(), nan=0.0)))
    return float(where.theta[0]), where.hands.mapped(lambda number: float(number[most]))


def _closest(
    devices: Sequence[Device],
    hands: Hands,
    gains: Gains,
    coupling: AnyCoupling,
    starts: PlacesInHands,
    met: WorldsMet | None,
) -> list[RatioInHand]:
    needs, places = hardest_near(devices, hands, gains, coupling, starts, met)
    found = ((need, places[k].mapped(float)) for k, need in enumerate(needs))
    T = devices[0].sample_time
    return [RatioInHand(_inverse(float(need)), place.at / T, place.hands) for need, place in found]


def _inverse(need: float) -> float:
    """Return the ratio, given 1/ratio. The ratio is 0 where Re Z_c is 0."""
    return inf if need <= 0 else 1 / need if need < 1e200 else 0.0
