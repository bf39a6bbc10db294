"""Random loops in boxes of hands whose least ratio an independent search knows, and is what it is asked to be."""

from __future__ import annotations

from dataclasses import astuple, dataclass, field, replace
from itertools import product
from math import inf, pi
from typing import Any

import numpy as np
import scipy.optimize
from device_arithmetic import DIGITS, DOUBLES
from device_oracle import Real
from device_pairs import real_of
from firmware import spectral_radius
from in_time import coupling_at, seen_at
from random_devices import decades, decimal, ordinary, ordinary_gains
from sampled_device_oracle import Hand as Held
from sampled_device_oracle import Output, exact, held, plant, split

from vctune.analysis.in_hands import least_ratios_in_hands
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hand, Hands
from vctune.proof.claims.margins_of_claims import Design

SHARES = (0.0, 1e-5, 1e-4, 1e-3, 0.01, 0.1, 0.4, 1.0)
FEWER = (0.0, 0.01, 0.1, 0.4, 1.0)
"""Of the range of stiffnesses, and of the others, where hands are looked at: soft springs matter at low frequencies."""
LEAST, ANGLES = 1e-4, 160
"""Least angle omega T, and how many there are from there on, logarithmic and even."""
LIMIT = 1e-12
"""Angle that stands for 0 in 50 digits."""
UNBOUNDED = 1e9
"""R/Re Z_c towards angle 0 that no coupling without drag meets, whatever its size."""
CLOSER = 4
"""Places that are looked at closer."""
REACH, AROUND, ZOOMS = 1.4, 41, 3
"""Angles around a place, as a ratio, how many there are, and how often they draw together."""
NEAR_THE_CIRCLE = 1e-7
"""A loop whose spectral radius is as near to 1 is drawn again."""
INSIDE = 0.02
"""Share of a range by which a hand is away from its ends if it is inside."""


@dataclass(frozen=True, order=True)
class Place:
    """R/Re Z_c, a hand and an angle omega T."""

    need: float
    hand: Hand = field(compare=False)
    theta: float = field(compare=False)


@dataclass(frozen=True)
class InHands:
    """A design, and what the oracles say of it.

    Attributes
    ----------
    hands : the box
    worst, omega : the hand and the frequency, rad/s, of the least ratio
    inside : in how many of the box's ranges that hand is away from the ends
    searched : least ratio as `least_ratios_in_hands` has it, over the one of the independent search
    """

    design: Design
    hands: Hands
    worst: Hand
    omega: float
    inside: int
    searched: float

    def scaled(self, factor: float) -> InHands:
        """Return it with a coupling, and so a least ratio, times a factor."""
        coupling = Coupling(*(factor * number for number in astuple(self.design.coupling)))
        return replace(self, design=replace(self.design, coupling=coupling))


def needs(real: Real, gains: Gains, coupling: Coupling, hand: Hand, theta: Any) -> np.ndarray:
    """Return R/Re Z_c in a hand at angles, in doubles (as `in_time.passivity`, all angles at once)."""
    one = Held(*astuple(hand))
    z, T = np.exp(1j * np.asarray(theta, float)), exact(real.sample_time)
    body = plant(real, one, DOUBLES)
    Phi, Gamma = held(real, one, T, DOUBLES, True)
    states = np.linalg.solve(z[:, None, None] * np.eye(len(Gamma)) - Phi, np.tile(Gamma, (len(z), 1))[..., None])

    def pulse(output: Output) -> np.ndarray:
        whole, rest = split(output.delay, T)
        Phi_h, Gamma_h = held(real, one, T - rest, DOUBLES, True)
        return ((states[..., 0] @ Phi_h.T + Gamma_h) @ output.C + output.D) / z ** (whole + 1)

    late, unit, t = exact(real.delay), np.eye(len(Gamma)), real.sample_time
    G_x = pulse(Output(unit[0], 0.0, late))
    measured = real.velocity.source == "measured"
    G_v = pulse(Output(unit[1], 0.0, late)) if measured else (1 - 1 / z) / t * G_x
    if real.velocity.filter_hz is not None:
        pole = np.exp(-2 * pi * real.velocity.filter_hz * t)
        G_v = G_v * ((1 - pole) / (1 - pole / z)) ** real.velocity.filter_order
    G_f = pulse(Output(body.force, body.feed, late + exact(real.force_sensor.delay)))
    # e^(j pi) is off the real axis by rounding, where the coupling's and the law's terms have their limits
    drive = gains.velocity + gains.position * t / 2 * (z + 1) / (z - 1)
    seen = -G_f * drive / (1 + gains.velocity * G_v + gains.position * G_x)
    return -seen.real / coupling_at(real, coupling, z, DOUBLES).real


def exact_need(real: Real, gains: Gains, coupling: Coupling, hand: Hand, omega: float) -> float:
    """Return R/Re Z_c in a hand at a frequency, in 50 digits."""
    T = DIGITS.number(real.sample_time)
    z = DIGITS.exp(DIGITS.i * DIGITS.number(max(omega, LIMIT / real.sample_time)) * T)
    seen = seen_at(real, gains, Held(*astuple(hand)), z, DIGITS)
    return float(-seen.real / coupling_at(real, coupling, z, DIGITS).real)


def angles(real: Real) -> np.ndarray:
    """Return angles from `LEAST` to pi, the even ones as many as the logarithmic."""
    found = [np.geomspace(LEAST, pi, ANGLES), np.linspace(0.01, pi, ANGLES)]
    if real.structure is not None:
        resonance = 2 * pi * real.structure.frequency_hz * real.sample_time
        found.append(resonance * (1 + np.geomspace(1e-3, 0.5, 20)))
        found.append(resonance * (1 - np.geomspace(1e-3, 0.5, 20)))
    together = np.unique(np.concatenate(found))
    return together[together <= pi]


def places(low: float, high: float, shares: tuple[float, ...]) -> list[float]:
    return sorted({low + (high - low) * share for share in shares})


def box_of(hands: Hands) -> np.ndarray:
    """Return the ends of each range, shape (3, 2)."""
    return np.array([astuple(hands.low), astuple(hands.high)]).T


def most_needed(real: Real, gains: Gains, coupling: Coupling, hands: Hands) -> Place:
    """Return where R/Re Z_c is greatest over the box and all angles: by a grid, then by simplices of hands."""
    theta, box = angles(real), box_of(hands)
    each = [places(*ends, shares) for ends, shares in zip(box, (FEWER, FEWER, SHARES), strict=True)]
    grid = [Hand(*map(float, some)) for some in product(*each)]
    found = np.array([needs(real, gains, coupling, hand, theta) for hand in grid])
    worst = np.concatenate(([-inf], found.max(axis=0), [-inf]))
    peaks = np.flatnonzero((worst[1:-1] >= worst[:-2]) & (worst[1:-1] >= worst[2:]))
    peaks = np.union1d(peaks[np.argsort(-worst[1 + peaks])][:CLOSER], [0])
    starts = [Place(float(worst[1 + at]), grid[int(np.argmax(found[:, at]))], float(theta[at])) for at in peaks]
    most = max(start.need for start in starts)
    worth = [start for start in starts if start.need > most / 1.5 or start.theta == LEAST]
    return max((_closer(real, gains, coupling, box, start) for start in worth), key=lambda place: place.need)


def _closer(real: Real, gains: Gains, coupling: Coupling, box: np.ndarray, start: Place) -> Place:
    """Go from a place to the greatest need near it, at each hand over the angles around."""
    low, width = box[:, 0], np.ptp(box, axis=1)
    free = np.flatnonzero(width > 0)

    def hand_at(share: np.ndarray) -> Hand:
        numbers = low.copy()
        numbers[free] += width[free] * np.clip(share, 0, 1) ** 3
        return Hand(*map(float, numbers))

    def at_best_angle(hand: Hand) -> tuple[float, float]:
        middle, reach, value = start.theta, REACH, -inf
        for _ in range(ZOOMS):
            theta = np.clip(middle * reach ** np.linspace(-1, 1, AROUND), LEAST, pi)
            found = needs(real, gains, coupling, hand, theta)
            at = int(np.argmax(found))
            middle, value, reach = float(theta[at]), float(found[at]), reach ** (3 / AROUND)
        return value, middle

    share = ((np.array(astuple(start.hand))[free] - low[free]) / width[free]) ** (1 / 3)
    for size in (0.1, 0.01):
        corners = share + np.vstack([np.zeros(len(share)), np.eye(len(share)) * size])
        corners = np.where(corners > 1, corners - 2 * size, corners)
        sought = scipy.optimize.minimize(
            lambda share: -at_best_angle(hand_at(share))[0],
            share,
            method="Nelder-Mead",
            bounds=[(0.0, 1.0)] * len(free),
            options={"initial_simplex": corners, "xatol": 1e-6, "fatol": 1e-10 * abs(start.need), "maxfev": 150},
        )
        share = sought.x
    hand = hand_at(share)
    return max(Place(value, hand, at) for hand in (hand, start.hand) for value, at in [at_best_angle(hand)])


def random_hands(rng: np.random.Generator, device: Device) -> Hands:
    """Return a box as human hands or of the device's own size; its least numbers are 0 half of the time."""
    m, T = device.mass, device.sample_time
    if rng.random() < 0.5:
        high = np.array([0.5, 30.0, 3000.0]) * 10 ** rng.uniform(-1, 0.3, 3)
    else:
        high = np.array([m, m / T, m / T**2]) * 10 ** rng.uniform([-2, -3, -5], [0.3, -0.7, -0.7])
    low = high * rng.uniform(0, 0.9, 3) * (rng.random(3) < 0.5)
    return Hands(Hand(*map(decimal, low)), Hand(*map(decimal, high)))


def stable(real: Real, gains: Gains, hands: Hands) -> bool | None:
    """Return whether the loop is stable in the box's corners and middle; None if that is too close to tell.

    Without an integrator and a hand's stiffness the position is free: a hundredth of the stiffest stands for none.
    """
    box = box_of(hands)
    if gains.position == 0:
        box[2, 0] = max(box[2, 0], 0.01 * box[2, 1])
    some = [Held(*numbers) for numbers in (*product(*box), box.mean(axis=1))]
    radius = max(spectral_radius(real, gains, hand, DOUBLES) for hand in some)
    return None if abs(radius - 1) < NEAR_THE_CIRCLE else radius < 1


def inside_of(hands: Hands, hand: Hand) -> int:
    """Return in how many ranges a hand is away from the ends."""
    box, numbers = box_of(hands), np.array(astuple(hand))
    width = np.ptp(box, axis=1)
    return int(np.sum((numbers > box[:, 0] + INSIDE * width) & (numbers < box[:, 1] - INSIDE * width)))


def in_hands(rng: np.random.Generator, *, inside: bool, integrator: bool = True) -> InHands:
    """Return a random design with a least ratio of 1 over a box of hands.

    Parameters
    ----------
    rng : source of all that is random
    inside : whether the worst hand is to be away from the ends of a range
    integrator : whether K_p > 0; without it the hands may have no stiffness
    """
    while True:
        device = replace(ordinary(rng, held=0.0), hold="zoh")
        gains, coupling = ordinary_gains(device, rng)
        hands = random_hands(rng, device)
        if not integrator:
            gains = replace(gains, position=0.0)
            hands = replace(hands, low=replace(hands.low, stiffness=0.0))
        if coupling.drag == 0 and hands.low.damping == 0:  # a soft enough spring is then too much for any coupling
            coupling = replace(coupling, drag=coupling.damping * decades(rng, -4, -0.5))
        real = real_of(device)
        if (gains.position == 0) == integrator or not stable(real, gains, hands):
            continue
        quick = least_ratios_in_hands(device, hands, gains, coupling)[0]
        if not 0 < quick.ratio < inf or (inside and not inside_of(hands, quick.hand)):
            continue
        found = most_needed(real, gains, coupling, hands)
        omega = found.theta / device.sample_time
        places = [(found.hand, omega), (found.hand, 0.0), (quick.hand, quick.omega)]
        needed = [(exact_need(real, gains, coupling, hand, omega), hand, omega) for hand, omega in places]
        need, worst, omega = max(needed, key=lambda each: each[0])
        if not 0 < need < UNBOUNDED or (inside and not inside_of(hands, worst)):
            continue
        found = InHands(
            Design(device, gains, coupling), hands, worst, omega, inside_of(hands, worst), quick.ratio * need
        )
        return found.scaled(need)
