"""Find the environment, late or stepped by Euler's rules, with which the motion of a refuted loop grows
(model/README.md, section 20)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import astuple
from functools import partial
from itertools import combinations, product
from math import inf, pi

import numpy as np

from vctune.analysis.destabilising import GrowingEnvironment, impedance_met, zero_near
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import Hand
from vctune.model.sampled.worlds.loop_in_late_worlds import LEADING
from vctune.model.worlds import Worlds

LEAST_ANGLE = 1e-6  # Least distance, rad, of an angle from 0 and pi at which the code follows a pole
STEPS_TO_CORNER = 6  # Number of steps from a member to a corner
FARTHEST_MOVE = 0.3  # Greatest move of a pole in one step, relative to the pole's angle
GROWTH = 1e-9  # Growth per radian above which the code reports that a motion grows
OUTSIDE = 1e-9  # Share of a range by which rounding may put a member outside the range
# Determinant of two factors, relative to the square of the greater factor, below which the code treats the factors as
# parallel
PARALLEL = 1e-12

Member = tuple[float, float, float]  # Mass, damping and stiffness of an environment of the box


@np.errstate(all="ignore")
def growing_in_time(
    device: Device, gains: Gains, coupling: AnyCoupling, hand: Hand, omega: float, worlds: Worlds
) -> GrowingEnvironment | None:
    """Return the environment of a box with which the motion in a hand grows, for a frequency at which a member holds a
    pole."""
    T = device.sample_time
    theta, alone = min(max(omega * T, LEAST_ANGLE), pi - LEAST_ANGLE), impedance_met(device, gains, coupling, hand)

    def unbalance(pole_angle: complex, *, member: Member) -> complex:
        return alone(pole_angle) + complex(np.array(member) @ environment_factors(pole_angle, T, worlds))

    start = member_of_impedance(-alone(theta), environment_factors(theta, T, worlds), worlds)
    if start is None:
        return None
    poles = [held for corner in _corners(worlds, start) for held in _poles_towards(corner, unbalance, theta, start)]
    growing = [(pole_angle, member) for pole_angle, member in poles if pole_angle.imag < -GROWTH * abs(pole_angle)]
    if not growing:
        return None
    # the motion z^k, z = e^(j pole_angle), grows by -Im in a sample; the angle modulo 2 pi gives the aliased frequency,
    # at most Nyquist
    pole_angle, (mass, damping, stiffness) = min(growing, key=lambda held: held[0].imag)
    of_mass = mass > 0
    return GrowingEnvironment(
        kind="mass" if of_mass else "spring",
        value=mass if of_mass else stiffness,
        damping=damping,
        growth=-pole_angle.imag / T,
        omega=abs((pole_angle.real + pi) % (2 * pi) - pi) / T,
        stiffness=stiffness if of_mass else 0.0,
        rule=worlds.rule,
        late=worlds.late,
    )


def environment_factors(pole_angle: complex, sample_time: float, worlds: Worlds) -> np.ndarray:
    """Return z^-n f_m, z^-n and z^-n f_k, which multiply mass, damping and stiffness (model/README.md, section 20)."""
    z = np.exp(1j * pole_angle)
    f_m = {0: 2 * (z - 1) / (z + 1), 1: z - 1, -1: 1 - 1 / z}[LEADING[worlds.rule]] / sample_time
    return np.asarray(z**-worlds.late * np.array([f_m, 1.0, 1 / f_m]))


def member_of_impedance(impedance: complex, factors: np.ndarray, worlds: Worlds) -> Member | None:
    """Return a member with this impedance. One of the member's three values is at a finite end of its range, and
    determines the other two values."""
    low, high = (np.array(astuple(end), float) for end in (worlds.low, worlds.high))
    scale = np.where(high < inf, (high - low) + np.abs(high), np.abs(low) + np.abs(impedance / factors))
    slack = OUTSIDE * scale
    for solved in combinations(range(3), 2):
        (fixed,) = {0, 1, 2} - set(solved)
        real_and_imaginary = np.array([factors[list(solved)].real, factors[list(solved)].imag])
        if abs(np.linalg.det(real_and_imaginary)) < PARALLEL * np.abs(real_and_imaginary).max() ** 2:
            continue
        for end in (low, high):
            if end[fixed] == inf:
                continue
            member = end.copy()
            rest = impedance - factors[fixed] * end[fixed]
            member[list(solved)] = np.linalg.solve(real_and_imaginary, [rest.real, rest.imag])
            if np.all(member >= low - slack) and np.all(member <= high + slack):
                mass, damping, stiffness = np.clip(member, low, high).tolist()
                return mass, damping, stiffness
    return None


def _corners(worlds: Worlds, start: Member) -> Iterator[Member]:
    """Yield the corners of the box. A value without an upper limit keeps its value at the start."""
    ends = zip(astuple(worlds.low), astuple(worlds.high), start, strict=True)
    yield from product(*((low, high if high < inf else at_start) for low, high, at_start in ends))


def _poles_towards(
    corner: Member, unbalance: Callable[..., complex], theta: float, start: Member
) -> Iterator[tuple[complex, Member]]:
    """Yield the angle of a pole and the member that holds the pole, step by step on the way to a corner, as far as the
    code can follow the pole."""
    pole_angle: complex = complex(theta)
    for share in np.arange(1, STEPS_TO_CORNER + 1) / STEPS_TO_CORNER:
        mass, damping, stiffness = ((1 - share) * a + share * b for a, b in zip(start, corner, strict=True))
        member = float(mass), float(damping), float(stiffness)
        zero = zero_near(partial(unbalance, member=member), pole_angle)
        if zero is None or abs(zero - pole_angle) > FARTHEST_MOVE * abs(pole_angle):
            return
        pole_angle = zero
        yield pole_angle, member
