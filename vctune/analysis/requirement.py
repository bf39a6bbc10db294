"""What a claim requires of the coupling, R, and what the coupling offers, over frequency and in double precision."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import astuple, dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.demands import response
from vctune.analysis.extrema import Floats
from vctune.analysis.loops_in_hands import PER_DECADE, LoopsInHands, loops_in_any_hand, loops_in_hands
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains, coupling_impedance, series_coupling
from vctune.model.hands import Hand, Hands, PlacesInHands
from vctune.model.loop.llewellyn import required_resistance
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.problem import Problem
from vctune.model.sampled.hand_loop import offered
from vctune.proof.claims.any_hand import ANY_HAND
from vctune.proof.claims.band import PASSIVE
from vctune.proof.claims.claim import ClaimId
from vctune.proof.claims.hands import HANDS

Indices = NDArray[np.intp]
# Number of loops whose arrays, with a hundred hands at a hundred angles each, fit into the processor's cache
LOOPS_AT_ONCE = 16


@dataclass(frozen=True, slots=True)
class Requirement:
    """What a claim requires of some designs, at frequencies of the band or at angles of the sampled loop."""

    claim: ClaimId
    device: Device
    places: Floats  # omega, rad/s, on the band; otherwise theta = omega T, rad
    # R in the worst hand, shape (designs, places): of Re Z_c, N s/m, or of Re(1/Z_c)/sin^2(theta/2), m/(N s); inf where
    # no coupling suffices, nan or not positive where every coupling does
    required: Floats
    hands: Hand | None = None  # hands of the grid, and which of them is the worst, shape (designs, places)
    worst: Indices | None = None

    @property
    def omega(self) -> Floats:
        """The frequencies that the coupling sees, rad/s: those of the firmware's integrator for a sampled loop."""
        return self.places if self.claim == PASSIVE.id else np.tan(self.places / 2) * (2 / self.device.sample_time)

    def offered(self, coupling: AnyCoupling) -> Floats:
        """Return what a coupling offers, in the unit of `required`."""
        if self.claim == PASSIVE.id:
            return np.asarray(coupling_impedance(series_coupling(coupling), self.places).re)
        return np.asarray(offered(coupling, self.device, self.places, FLOATS))

    def at(self, index: Indices) -> Floats | PlacesInHands:
        """Return one place of each design, in its worst hand if the claim is about hands."""
        if self.hands is None or self.worst is None:
            return self.places[index]
        hand = self.worst[np.arange(len(index)), index]
        return PlacesInHands(self.places[index], self.hands.mapped(lambda number: number[hand]))


def requirements(problem: Problem, gains: Gains, omega: Floats) -> Iterator[Requirement]:
    """Yield the requirement of each claim of a problem that compares the coupling with R, for gains of shape (n, 1);
    `omega` is the grid of the band."""
    device = problem.device
    if problem.hands_met is not None:
        yield in_hands(device, problem.hands_met, gains)
    if problem.any_hand:
        yield in_any_hand(device, gains)
    if problem.passive and not problem.alone:
        yield on_band(device, gains, omega)


def on_band(device: Device, gains: Gains, omega: Floats) -> Requirement:
    """Return the requirement of any passive hand in the frequency model."""
    loop = response(device, gains, omega)
    with np.errstate(all="ignore"):
        required = np.where(loop.resistance > 0, required_resistance(loop, FLOATS), inf)
    return Requirement(PASSIVE.id, device, omega, np.atleast_2d(required))


def in_any_hand(device: Device, gains: Gains, per_decade: int = PER_DECADE) -> Requirement:
    """Return the requirement of any passive hand on an impedance display."""
    loops = loops_in_any_hand(device, per_decade)
    return Requirement(ANY_HAND.id, device, loops.theta, loops.required(gains))


def in_hands(device: Device, hands: Hands, gains: Gains, per_decade: int = PER_DECADE) -> Requirement:
    """Return the requirement of the worst hand of a box at each angle."""
    loops = loops_in_hands(device, hands, per_decade=per_decade)
    numbers = np.column_stack([np.ravel(each) for each in np.broadcast_arrays(*astuple(gains))])
    distinct, position = np.unique(numbers, axis=0, return_inverse=True)
    parts = np.array_split(distinct, range(LOOPS_AT_ONCE, len(distinct), LOOPS_AT_ONCE))
    found = [_worst(loops, Gains(*part.T[:, :, None, None])) for part in parts]
    required, worst = (np.concatenate(part)[position.ravel()] for part in zip(*found, strict=True))
    return Requirement(HANDS.id, device, loops.theta, required, loops.hands, worst)


def _worst(loops: LoopsInHands, gains: Gains) -> tuple[Floats, Indices]:
    """Return R in the worst hand, and which hand that is, for gains of shape (n, 1, 1)."""
    R = np.nan_to_num(loops.required(gains), nan=0.0)
    return R.max(axis=1), R.argmax(axis=1).astype(np.intp)
