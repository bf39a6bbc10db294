"""Re Z_c / R in the hands of a box up to Nyquist, in double precision (model/README.md, section 14)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from functools import lru_cache, partial
from itertools import product
from math import inf, pi, sqrt
from typing import ClassVar

import numpy as np

from vctune.analysis.extrema import Floats, local_minima
from vctune.analysis.resonance import with_resonance
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Coupling, Gains, series_coupling
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.problem import Problem
from vctune.model.sampled.any_hand import AnyHand, any_hand
from vctune.model.sampled.hand_loop import AnyLoopInHand, loop_in_hand, offered, required_in_hand, seen_in_hand
from vctune.model.sampled.loop_in_worlds import Seen, disjuncts, offered_at, posed, room_of
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.model.worlds import WorldsMet
from vctune.running import check_time

SHARES = (0.0, 0.01, 0.1, 0.4, 1.0)
"""Where the hands of a box are looked at first, as shares of each range: the worst is mostly at an end, and towards 0
much happens within little. Half or twice as many lead to the same designs, in more rounds or in more time."""
LOWEST, PER_DECADE = 1e-4, 24
"""Least angle omega T beside 0, and angles per decade. What is below the least is at its limit to 1e-8. Half as many
angles may miss one of two neighbouring extrema; twice as many are twice the time."""
SOFT = np.geomspace(1e-12, 1.0, 97)
"""Shares of the range of stiffness that are looked at at angle 0, where a soft spring and a late loop ask for drag, for
most at about K_p, small in slow loops. Half or twice as many find the same hand, which is looked at closer."""
SEARCHED = 6
"""Local minima over the angle that are looked at closer; half miss none of the reference problems' worst hands."""
SHARP = 0.03
"""Damping ratio below which the angles where a hand resonates with the device are looked at, which no grid meets. Half
and twice it lead to the same design of a display of hardly any damping."""
DRIVEN = 1e6
"""1/ratio from which on a coupling gives energy where none may be given. Half and twice it: the same designs."""
ROUNDS = 22
"""Steps of the closer look, each of which moves to the best neighbour or halves the distance: to 1e-4 of the first
distance, of which the ratio knows the square. Half: to 1e-2, and the prover finds what is missing, at its price."""


@dataclass(frozen=True, slots=True)
class LoopsInHands:
    """A loop in hands on the unit circle.

    Attributes
    ----------
    theta : omega T, rad, from 0 to pi, shape (n,)
    hands : their numbers, each of shape (h,)
    loop : of shape (h, n)
    """

    theta: Floats
    hands: Hand
    loop: AnyLoopInHand

    def required(self, gains: Gains) -> Floats:
        """Return R, of the shape of the loop; of the gains' shape before it if they are arrays (..., 1, 1)."""
        found = required_in_hand(self.loop, gains)
        with np.errstate(divide="ignore", invalid="ignore"):
            R = np.asarray(found.lost / found.size)
        return np.broadcast_to(R, np.broadcast_shapes(R.shape, np.shape(gains.velocity)))  # of a servo no gain is in it

    def seen(self, gains: Gains) -> Seen:
        """Return Z_seen, of the same shape as `required`."""
        found = seen_in_hand(self.loop, gains)
        shape = np.broadcast_shapes(np.shape(found.lost), np.shape(gains.velocity))
        return Seen(*(np.broadcast_to(part, shape) for part in found))


@dataclass(frozen=True, slots=True)
class LoopsInAnyHand:
    """The loop of an impedance display in any passive hand on the unit circle.

    Attributes
    ----------
    theta : omega T, rad, from 0 to pi, shape (n,)
    answers : of the device, of shape (1, n)
    """

    theta: Floats
    answers: AnyHand

    def required(self, gains: Gains) -> Floats:
        """Return R/s^2, of shape (1, n), inf where some hand makes the loop of K_v alone unstable.

        Of the gains' shape before it if they are arrays (..., 1, 1).
        """
        found = self.answers.required(gains)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where(found.size > 0, found.lost / found.size, inf))


@lru_cache(maxsize=64)
def loops_in_any_hand(device: Device, per_decade: int = PER_DECADE) -> LoopsInAnyHand:
    """Return the loop of an impedance display in any passive hand at some angles.

    Parameters
    ----------
    device : plain numbers
    per_decade : number of angles in each decade
    """
    theta = _angles(device, per_decade)
    return LoopsInAnyHand(theta, _answers(device, theta[None]))


def _answers(device: Device, theta: Floats) -> AnyHand:
    delays = delays_of(device)
    return any_hand(device, delays.loop, theta, FLOATS, fractional=delays.loop_fractional)


@lru_cache(maxsize=64)
def loops_in_hands(
    device: Device, hands: Hands, shares: tuple[float, ...] = SHARES, per_decade: int = PER_DECADE
) -> LoopsInHands:
    """Return the loop of a device in some hands of a box at some angles.

    Parameters
    ----------
    device : plain numbers
    hands : the box
    shares : of each range at which hands are looked at
    per_decade : number of angles in each decade
    """
    theta = _angles(device, per_decade)
    some = Hand(*np.array(list(product(*(_places(*ends, shares) for ends in _ranges(hands))))).T)
    plant = plant_in_hand(device, Hand(*(number[:, None] for number in astuple(some))), delays_of(device), FLOATS)
    return LoopsInHands(theta, some, loop_in_hand(plant, theta, FLOATS))


def _angles(device: Device, per_decade: int) -> Floats:
    theta = np.geomspace(LOWEST, np.pi, int(per_decade * np.log10(np.pi / LOWEST)))
    if device.structure is not None:
        theta = np.minimum(with_resonance(device, theta / device.sample_time) * device.sample_time, np.pi)
    return np.append(0.0, theta)


@lru_cache(maxsize=64)
def loops_at_rest(device: Device, hands: Hands, spacing: int = 1) -> LoopsInHands:
    """Return the loop of a device at angle 0 in soft springs; the spring that requires most depends on the gains.

    Parameters
    ----------
    device : plain numbers
    hands : the box
    spacing : of the stiffnesses that are looked at, in those of `SOFT`
    """
    low, high = hands.low, hands.high
    stiffness = np.unique(low.stiffness + (high.stiffness - low.stiffness) * np.append(0.0, SOFT[::spacing]))
    masses = np.unique((low.mass, high.mass))
    some = Hand(*(each.ravel() for each in np.meshgrid(masses, low.damping, stiffness, indexing="ij")))
    plant = plant_in_hand(device, Hand(*(number[:, None] for number in astuple(some))), delays_of(device), FLOATS)
    theta = np.zeros(1)
    return LoopsInHands(theta, some, loop_in_hand(plant, theta, FLOATS))


@dataclass(frozen=True, slots=True)
class RatioInHand:
    """The least Re Z_c / R in hands, next to a frequency.

    Attributes
    ----------
    ratio : inf where nothing is required
    omega : rad/s
    hand : in which it is least
    """

    ratio: float
    omega: float
    hand: Hand


@dataclass(frozen=True, slots=True)
class RatioInAnyHand:
    """The least Re(1/Z_c)/R of an impedance display in any passive hand, next to a frequency.

    Attributes
    ----------
    ratio : inf where nothing is required
    omega : rad/s
    """

    ratio: float
    omega: float
    hand: ClassVar[None] = None


def least_ratios(problem: Problem, gains: Gains, coupling: AnyCoupling) -> list[RatioInHand | RatioInAnyHand]:
    """Return the local minima of the ratio in the hands of a problem, lowest first of each kind.

    Parameters
    ----------
    problem : of one device, with hands to be met, or any on an impedance display
    gains, coupling : plain floats, in the problem's units
    """
    found: list[RatioInHand | RatioInAnyHand] = []
    if problem.hands_met is not None:
        found += least_ratios_in_hands(problem.device, problem.hands_met, gains, coupling, problem.worlds_met)
    if problem.any_hand:
        found += least_ratios_in_any_hand(problem.device, gains, coupling)
    return found


def least_ratios_in_hands(
    device: Device, hands: Hands, gains: Gains, coupling: AnyCoupling, met: WorldsMet | None = None
) -> list[RatioInHand]:
    """Return the local minima of Re Z_c / R over the angle in the worst hand at each, lowest first.

    Parameters
    ----------
    device : plain numbers
    hands : the box
    gains, coupling : a design, plain numbers
    met : the environments, of which `needs_in_worlds` says what the ratio is; None for every passive one

    Returns
    -------
    list of RatioInHand
        At least one.
    """
    where = loops_in_hands(device, hands)
    need = _needs(where.loop, device, gains, coupling, where.theta, met)
    hand = np.argmax(need, axis=0)
    worst = need[hand, np.arange(where.theta.size)]
    padded = np.concatenate(([-inf], worst, [-inf]))
    peaks = np.flatnonzero((padded[1:-1] >= padded[:-2]) & (padded[1:-1] >= padded[2:]))
    peaks = peaks[np.argsort(-worst[peaks], kind="stable")][:SEARCHED]
    starts = np.array([number[hand[peaks]] for number in astuple(where.hands)])
    theta, starts = np.append(where.theta[peaks], 0.0), np.column_stack((starts, _at_rest(device, hands, gains)))
    sharp = _resonant(device, hands, gains)
    theta, starts = np.append(theta, sharp[0]), np.column_stack((starts, sharp[1:]))
    return sorted(_closest(device, hands, gains, coupling, theta, starts, met), key=lambda each: each.ratio)


WINDOW = np.exp(np.linspace(-0.3, 0.3, 121))
"""Angles about a worst one, relative, at which the environments of a box are looked at. Half and twice as far, or as
many, lead to the same designs."""


def windows(
    problem: Problem, gains: Gains, coupling: AnyCoupling, worst: Sequence[RatioInHand | RatioInAnyHand]
) -> list[RatioInHand]:
    """Return the ends of the windows of angles in which a box of environments is not met, about the worst places.

    Between them one margin has to do where another ceases to: a demand in the middle alone moves the window along.

    Parameters
    ----------
    problem : of one device, with hands to be met
    gains, coupling : plain floats, in the problem's units
    worst : places of `least_ratios`
    """
    device, met, found = problem.device, problem.worlds_met, list[RatioInHand]()
    if met is None:
        return found
    for at in worst:
        if not isinstance(at, RatioInHand) or at.omega == 0 or at.ratio >= met.factor:
            continue
        theta = np.minimum(at.omega * device.sample_time * WINDOW, pi)
        loop = loop_in_hand(plant_in_hand(device, at.hand, delays_of(device), FLOATS), theta, FLOATS)
        fails, middle = _needs(loop, device, gains, coupling, theta, met) > 1 / met.factor, WINDOW.size // 2
        below, above = np.logical_and.accumulate(fails[middle::-1]), np.logical_and.accumulate(fails[middle:])
        first, last = middle - np.count_nonzero(below), middle + np.count_nonzero(above)
        for k in (max(first, 0), min(last, WINDOW.size - 1)):
            found.append(RatioInHand(at.ratio, float(theta[k] / device.sample_time), at.hand))
    return found


def ratio_at(
    device: Device, gains: Gains, coupling: AnyCoupling, omega: float, hand: Hand, met: WorldsMet | None = None
) -> float:
    """Return Re Z_c / R in one hand at one frequency; inf if R requires nothing.

    Parameters
    ----------
    device : plain numbers
    gains, coupling : a design, plain numbers
    omega : rad/s
    hand : held with
    met : the environments; None for every passive one
    """
    theta = np.array([omega * device.sample_time])
    loop = loop_in_hand(plant_in_hand(device, hand, delays_of(device), FLOATS), theta, FLOATS)
    return _inverse(float(_needs(loop, device, gains, coupling, theta, met)[0]))


def least_ratio_near(
    device: Device,
    hands: Hands,
    gains: Gains,
    coupling: AnyCoupling,
    omega: float,
    hand: Hand,
    met: WorldsMet | None = None,
) -> RatioInHand:
    """Return the local minimum of Re Z_c / R that is found from one frequency and hand.

    Parameters
    ----------
    device : plain numbers
    hands : the box
    gains, coupling : a design, plain numbers
    omega : rad/s
    hand : of the box
    met : the environments; None for every passive one
    """
    theta, start = np.array([omega * device.sample_time]), np.array(astuple(hand))[:, None]
    return _closest(device, hands, gains, coupling, theta, start, met)[0]


def least_ratios_in_any_hand(device: Device, gains: Gains, coupling: AnyCoupling) -> list[RatioInAnyHand]:
    """Return the local minima of Re(1/Z_c)/R of an impedance display in any passive hand, lowest first.

    Parameters
    ----------
    device : of an impedance display, plain numbers
    gains, coupling : a design, plain numbers

    Returns
    -------
    list of RatioInAnyHand
        One to `SEARCHED`; 0 where some hand makes the loop of K_v alone unstable.
    """
    first, ratio = np.zeros(1), partial(ratio_in_any_hand, device, gains, coupling)
    minima = local_minima(ratio, _angles(device, PER_DECADE)[1:])
    theta, value = np.append(first, minima.omega), np.append(ratio(first), minima.value)
    return [RatioInAnyHand(float(value[k]), float(theta[k] / device.sample_time)) for k in np.argsort(value)[:SEARCHED]]


def ratio_in_any_hand(device: Device, gains: Gains, coupling: AnyCoupling, theta: Floats) -> Floats:
    """Return Re(1/Z_c)/R of an impedance display in any passive hand; 0 where one makes the loop of K_v unstable.

    Parameters
    ----------
    device : of an impedance display, plain numbers
    gains, coupling : a design, plain numbers
    theta : omega T, rad
    """
    found = _answers(device, theta).required(gains)
    ratio = offered(coupling, device, theta, FLOATS) * found.size / np.maximum(found.lost, 1e-300)
    return np.where(found.size > 0, ratio, 0.0)


@np.errstate(all="ignore")
def needs_in_worlds(
    loop: AnyLoopInHand, device: Device, gains: Gains, coupling: Coupling, theta: Floats, met: WorldsMet
) -> dict[str, Floats]:
    """Return 1/ratio by each of the margins of which one must be positive (`vctune.model.sampled.loop_in_worlds`).

    By the real part the ratio is (Re Z_c + g b_1)/R, by a reactance g times the exponential of its room, so that g is
    enough in either case and a share is missing or to spare.

    Parameters
    ----------
    loop : in hands
    device : plain numbers
    gains, coupling : a design, plain numbers or arrays that broadcast against the loop
    theta : omega T, rad
    met : the environments, and g
    """
    factor, worlds, T = met.factor, met.worlds, device.sample_time
    seen, at = seen_in_hand(loop, gains), offered_at(coupling, T, theta, FLOATS)
    found = disjuncts(at, worlds, T, seen, factor, theta, FLOATS)
    needs = {"resistive": _need(seen.lost / seen.size, at.resistance + factor * worlds.low.damping)}
    for name in posed(worlds, factor)[1:]:
        needs[name] = np.exp(-room_of(getattr(found, name), np.abs)) / factor
    return needs


def _needs(
    loop: AnyLoopInHand, device: Device, gains: Gains, coupling: AnyCoupling, theta: Floats, met: WorldsMet | None
) -> Floats:
    """Return 1/ratio in hands."""
    if met is not None:
        needs = needs_in_worlds(loop, device, gains, series_coupling(coupling), theta, met)
        return np.minimum.reduce(np.broadcast_arrays(*needs.values()))
    found = required_in_hand(loop, gains)
    with np.errstate(all="ignore"):
        return _need(np.asarray(found.lost / found.size), offered(coupling, device, theta, FLOATS))


@np.errstate(all="ignore")
def _need(required: Floats, there: Floats) -> Floats:
    """Return 1/ratio, continuous where R changes its sign; of a coupling that drives, 0 or more than any other."""
    drives = np.where(required < there, 0.0, DRIVEN * (2 + (required - there) / (np.abs(required) - there)))
    return np.where(there < 0, drives, required / np.maximum(there, 1e-300))


def _resonant(device: Device, hands: Hands, gains: Gains) -> Floats:
    """Return angles at which hands resonate sharply with the device, and those hands: shape (4, n), n may be 0.

    The stiffest of them, where the angle is greatest and the damping ratio least, and one a hundredth as stiff.
    """
    found = []
    damping, hand = device.damping + hands.low.damping + gains.velocity, hands.low.damping
    for mass, share in product((hands.low.mass, hands.high.mass), (1.0, 0.01)):
        stiffness, moved = max(share * hands.high.stiffness, hands.low.stiffness), device.mass + mass
        theta = device.sample_time * sqrt((stiffness + gains.position) / moved)
        if damping < 2 * SHARP * sqrt(stiffness * moved) and theta < pi:
            found.append((theta, mass, hand, stiffness))
    return np.array(found).reshape(-1, 4).T


def _at_rest(device: Device, hands: Hands, gains: Gains) -> tuple[float, ...]:
    """Return the hand with the greatest requirement at angle 0."""
    where = loops_at_rest(device, hands)
    most = int(np.argmax(np.nan_to_num(where.required(gains).ravel(), nan=0.0)))
    return tuple(float(number[most]) for number in astuple(where.hands))


@np.errstate(all="ignore")
def hardest_near(
    device: Device,
    hands: Hands,
    gains: Gains,
    coupling: AnyCoupling,
    theta: Floats,
    starts: Floats,
    met: WorldsMet | None = None,
) -> tuple[Floats, Floats, Floats]:
    """Go from places to the greatest 1/ratio near them, all together: in log theta and in the root of each share.

    Parameters
    ----------
    device : plain numbers
    hands : the box
    gains, coupling : a design, or one for each place, arrays of shape (n, 1, 1)
    theta, starts : omega T in rad, shape (n,), and hands of the box, shape (3, n)
    met : the environments; None for every passive one

    Returns
    -------
    need, theta : 1/ratio and where, shape (n,)
    hands : in which, shape (3, n)
    """
    low, width = np.array([(low, high - low) for low, high in _ranges(hands)]).T
    safe = np.where(width > 0, width, 1.0)
    share = np.sqrt((starts - low[:, None]) / safe[:, None])
    step_hand, step_angle = np.full(theta.size, 0.2), np.full(theta.size, 2.3 / PER_DECADE)
    offsets = np.array(list(product((-1, 0, 1), repeat=3))).T
    turns = np.array([-1, 0, 1])
    best = np.full(theta.size, -inf)
    for _ in range(ROUNDS):
        check_time()
        near = np.clip(share[:, :, None] + offsets[:, None, :] * step_hand[:, None], 0.0, 1.0)
        angle = np.minimum(theta[:, None] * np.exp(turns * step_angle[:, None]), np.pi)
        hand = Hand(*((low[:, None, None] + width[:, None, None] * near**2)[..., None]))
        plant = plant_in_hand(device, hand, delays_of(device), FLOATS)
        loop = loop_in_hand(plant, angle[:, None, :], FLOATS)
        need = _needs(loop, device, gains, coupling, angle[:, None, :], met).reshape(theta.size, -1)
        need = np.nan_to_num(need, nan=-inf, posinf=inf)  # 0/0 at rest without an integrator asks for nothing
        at = np.argmax(need, axis=1)
        rows, (which, turn) = np.arange(theta.size), np.unravel_index(at, (offsets.shape[1], 3))
        better = need[rows, at] > best
        moved_hand = better & np.any(offsets[:, which] != 0, axis=0)
        moved_angle = better & (turns[turn] != 0)
        best = np.maximum(best, need[rows, at])
        share = np.where(better, near[:, rows, which], share)
        theta = np.where(better, angle[rows, turn], theta)
        step_hand = np.where(moved_hand, step_hand, step_hand / 2)
        step_angle = np.where(moved_angle, step_angle, step_angle / 2)
    return best, theta, low[:, None] + width[:, None] * share**2


def _closest(
    device: Device,
    hands: Hands,
    gains: Gains,
    coupling: AnyCoupling,
    theta: Floats,
    starts: Floats,
    met: WorldsMet | None,
) -> list[RatioInHand]:
    found = hardest_near(device, hands, gains, coupling, theta, starts, met)
    return [
        RatioInHand(_inverse(float(need)), float(at / device.sample_time), Hand(*map(float, hand)))
        for need, at, hand in zip(*found[:2], found[2].T, strict=True)
    ]


def _inverse(need: float) -> float:
    """Return the ratio, 0 where Re Z_c is."""
    return inf if need <= 0 else 1 / need if need < 1e200 else 0.0


def _ranges(hands: Hands) -> list[tuple[float, float]]:
    return list(zip(astuple(hands.low), astuple(hands.high), strict=True))


def _places(low: float, high: float, shares: tuple[float, ...]) -> Floats:
    """Return the places of a range at its shares; one where it has no width."""
    return np.unique(low + (high - low) * np.array(shares))
