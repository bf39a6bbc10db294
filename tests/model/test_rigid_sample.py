"""A rigid device and hand over a sample: the closed form against functions of matrices, in 128 bits and over boxes."""

from __future__ import annotations

import numpy as np
import pytest
from balls import BALLS, PRECISION, ball
from flint import ctx

from vctune.model.device import Device
from vctune.model.hands import Hand
from vctune.model.sampled.plant_in_hand import Delays, PlantInHand, plant_in_hand
from vctune.proof.enclosures.intervals import ENCLOSURES, Enclosure, between
from vctune.proof.enclosures.taylor import Taylor
from vctune.proof.enclosures.taylor import variables as polynomials
from vctune.proof.enclosures.taylor_functions import TAYLOR

T, DELAYS = 1e-3, Delays(2, True, 2, True)
KINDS = {"soft": 1e-4, "usual": 0.1, "stiff": 1.2}
"""sqrt(K/(m + M)) T at most."""


def drawn(rng, reach, count):
    """Return m, b, the delay, M, B and K of rigid devices in hands."""
    mass, carried, older = rng.uniform(0.05, 2, count), rng.uniform(0, 1, count), rng.uniform(0, 1, count)
    damping, held = (reach * (mass + carried) / T * rng.uniform(0, 0.5, count) for _ in range(2))
    return mass, damping, (2 + older) * T, carried, held, (mass + carried) * (reach * rng.uniform(0, 1, count) / T) ** 2


def plant(numbers, ops):
    mass, damping, delay, *hand = numbers
    found = plant_in_hand(Device(mass, damping, T, delay), Hand(*hand), DELAYS, ops)
    assert isinstance(found, PlantInHand)
    return found


def entries(found):
    """Return Q, b_1 and the sensed parts, in order."""
    return [x for row in found.step for x in row] + [*found.older, *found.felt_inertia[0], *found.felt_inertia[1]]


def exactly(numbers):
    """Return the same by functions of matrices, in 128 bits."""
    with ctx.workprec(PRECISION):
        mass, damping, delay, *hand = map(ball, numbers)
        device = Device(mass, damping, ball(T), delay)
        return [float(x) for x in entries(plant_in_hand(device, Hand(*hand), DELAYS, BALLS))]


def enclosed(x, at, place):
    """Return an enclosure of a number at points of its boxes, each row between -1 and 1, shape (rows, n)."""
    if isinstance(x, Taylor):
        i, j = np.triu_indices(x.row_count)
        terms = np.vstack((np.ones((1, at.shape[1])), at, at[i] * at[j]))
        rest = x.radii.sum(axis=0)
        return ((x.coefficients * terms).sum(axis=0) - rest * (1 + 1e-12) - 1e-300)[place], (
            (x.coefficients * terms).sum(axis=0) + rest * (1 + 1e-12) + 1e-300
        )[place]
    value = x if isinstance(x, Enclosure) else Enclosure(float(x))
    mid, rad = (np.broadcast_to(part, at.shape[1])[place] for part in (value.mid, value.rad))
    return mid - rad, mid + rad


@pytest.mark.parametrize("arithmetic", ["enclosures", "polynomials"])
@pytest.mark.parametrize("kind", KINDS)
def test_boxes_hold_what_each_of_their_devices_has(kind, arithmetic):
    rng, count = np.random.default_rng(2), 60
    low, other = drawn(rng, KINDS[kind], count), drawn(rng, KINDS[kind], count)
    share = 10.0 ** rng.uniform(-6, -0.5, count)
    rows = [
        between(np.minimum(a, c), np.maximum(a, c))
        for a, b in zip(low, other, strict=True)
        for c in [a + share * (b - a)]
    ]
    made = {
        "enclosures": lambda: rows,
        "polynomials": lambda: polynomials(rows, [True] * 6),
    }
    ops = TAYLOR if arithmetic == "polynomials" else ENCLOSURES
    found = entries(plant(made[arithmetic](), ops))
    at = rng.uniform(-1, 1, (6, count)) * 0.999
    at[:, ::3] = np.sign(at[:, ::3]) * 0.999999
    for k in range(0, count, 4):
        numbers = [float(row.mid[k] + e * row.rad[k]) for row, e in zip(rows, at[:, k], strict=True)]
        exact = exactly(numbers)
        # the decimals of a box are within a rounding of its doubles
        for x, value in zip(found, exact, strict=True):
            least, most = enclosed(x, at, k)
            slack = 1e-15 * max(abs(value), 1.0)
            assert least - slack <= value <= most + slack
