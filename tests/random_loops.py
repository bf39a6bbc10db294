"""Random designs of ordinary devices whose least ratio the oracles know, and is what it is asked to be."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi

import numpy as np
import pytest
from device_pairs import real_of
from device_scan import exact, frequencies, least, ratio, required, sampled_radius, unstable_model_poles
from random_devices import ordinary, ordinary_gains

from vctune.model.gains import Coupling, Gains
from vctune.proof.claims.margins_of_claims import Design

NEAR_THE_AXIS = 1e-6
"""A loop whose spectral radius is as near to 1 is drawn again: the oracles judge in doubles."""
EDGE = 1.05
"""How far, as a ratio, the worst frequency stays from the edges of a band if it is to be inside it."""
LOUDER = 4.0
"""By how much gains may be raised where an unstable loop is wanted."""


@dataclass(frozen=True)
class Drawn:
    """A design, and what the oracles say of it.

    Attributes
    ----------
    band : of its least ratio, rad/s
    worst : where that is, rad/s
    stable, stable_model : whether the sampled loops and the frequency model's are, let go and in the operator's hand
    """

    design: Design
    band: tuple[float, float]
    worst: float
    stable: bool
    stable_model: bool


def drawn(rng: np.random.Generator, share: float, *, inside: bool, stable: bool = True) -> Drawn:
    """Return a random design with a given least ratio.

    Parameters
    ----------
    rng : source of all that is random
    share : the least ratio
    inside : whether it is to be at an interior frequency
    stable : whether all loops are to be stable; else the sampled one is not, let go or held
    """
    while True:
        device = ordinary(rng)
        gains, coupling = ordinary_gains(device, rng)
        if not stable:
            louder = LOUDER ** rng.uniform(0, 1)
            gains = Gains(gains.velocity * louder, gains.position * louder)
        real, nyquist = real_of(device), pi / device.sample_time
        low, high = nyquist * 10 ** rng.uniform(-3.5, -2), nyquist * 10 ** rng.uniform(-1.3, -0.1)
        grid = frequencies(real, low, high)
        if not (required(real, gains, grid)[1] > 0).all():
            continue
        smallest, worst = least(lambda w, r=real, g=gains, c=coupling: ratio(r, g, c, w), grid)
        if not 0 < smallest < inf or (inside and not low * EDGE < worst < high / EDGE):
            continue
        held = [False] if device.operator is None else [False, True]
        radius = max(sampled_radius(real, gains, held=h) for h in held)
        poles = [unstable_model_poles(real, gains, held=h) for h in held]
        unclear = abs(radius - 1) < NEAR_THE_AXIS or any(abs(n - round(n)) > 1e-2 for n in poles)
        if unclear or (radius < 1) != stable or (stable and any(map(round, poles))):
            continue
        scale = share / float(exact(real, gains, coupling, worst)[0])
        scaled = Coupling(coupling.damping * scale, coupling.mass * scale, coupling.drag * scale)
        assert float(exact(real, gains, scaled, worst)[0]) == pytest.approx(share, rel=1e-12)
        return Drawn(Design(device, gains, scaled), (low, high), worst, radius < 1, not any(map(round, poles)))
