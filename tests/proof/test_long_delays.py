"""Ranges of delays over many samples: verdicts are those of a dense scan."""

from __future__ import annotations

from dataclasses import astuple, replace
from itertools import product
from math import ceil, floor

import numpy as np
import pytest
from world_loops import Plant, Whole, offered, seen

from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hand, Hands
from vctune.model.problem import Demands, Uncertainty
from vctune.proof.claims.every_hand import prove_hands
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.device_box import DeviceBox, device_box
from vctune.proof.engine.interval import Verdict

T, FACTOR = 1e-3, 1.05
APART = 0.04
"""Share by which designs miss the factor or have it to spare; the scan finds the least ratio to a hundredth."""
FEW, MANY = [(0, 2.0)], [pytest.param(number, 12.0, marks=pytest.mark.slow) for number in range(1, 13)]


def scanned(low: float, high: float) -> list[float]:
    """Return delays of a range, among them both sides of each whole number of samples."""
    whole = np.arange(ceil(low / T), floor(high / T) + 1)
    found = np.concatenate(((whole - 1e-6) * T, (whole + 1e-6) * T, np.linspace(low, high, 5)))
    return np.unique(found[(found >= low) & (found <= high)]).tolist()


def least_ratio(design: Design, box: DeviceBox, hands: Hands) -> float:
    """Return the least Re Z_c / R of a dense scan with a model of the loop that is not vctune's."""
    theta, least = np.geomspace(2e-6, np.pi * (1 - 1e-6), 250), np.inf
    reach = [np.subtract(most, low) * np.append(0, np.geomspace(1e-4, 1, 18)) + low for low, most in ends(hands)]
    each = product(scanned(box.low.delay, box.high.delay), reach[0][[0, -1]], reach[1][[0, -1]], reach[2])
    for delay, *hand in each:
        plant = Plant(T, delay, design.device.mass, design.device.damping)
        loop = Whole(plant, tuple(map(float, hand)), astuple(design.gains), astuple(design.coupling))
        need = np.maximum(-seen(loop, theta).real, 1e-300)
        least = min(least, float((offered(loop, theta).real / need).min()))
    return least


def ends(hands: Hands) -> list[tuple[float, float]]:
    return list(zip(astuple(hands.low), astuple(hands.high), strict=True))


def late(number: int, most: float) -> tuple[Design, DeviceBox, Hands]:
    """Return a random design on a device whose delay is uncertain by up to some samples, and random hands."""
    rng = np.random.default_rng((36, number))
    first, last = sorted(rng.uniform(0.2, most, 2))
    last += 0.6
    middle = float(f"{(first + last) / 2 * T:.6g}")
    device = Device(rng.uniform(0.2, 1), rng.uniform(0.5, 5), T, middle)
    width = (last - first) / (last + first)
    box = device_box(device, Uncertainty(half_widths=(("delay", width),), objective="nominal"))
    hands = Hands(Hand(0.0, rng.uniform(0, 2), 0.0), Hand(rng.uniform(0.1, 0.5), 20.0, rng.uniform(200, 3000)))
    K_v = rng.uniform(2, 40) * device.mass / (1 + last)
    gains = Gains(K_v, rng.choice((0.0, K_v * rng.uniform(5, 50))))
    return Design(device, gains, Coupling(20.0, 0.2, 0.3)), box, hands


@pytest.mark.parametrize(("number", "most"), [*FEW, *MANY])
def test_verdicts_for_late_devices_are_those_of_a_dense_scan(number, most):
    design, box, hands = late(number, most)
    least = least_ratio(design, box, hands)
    for side, expected in ((APART, Verdict.PROVED), (-APART, Verdict.REFUTED)):
        scale = FACTOR * (1 + side) / least
        coupling = Coupling(*(scale * x for x in astuple(design.coupling)))
        demands = Demands(design.device, (1.0, 10.0), FACTOR, 100.0, passive=False, hands=hands)
        found = prove_hands(replace(design, coupling=coupling), demands, box)
        assert found.verdict is expected
        if expected is Verdict.REFUTED:
            assert found.device is not None
            assert box.low.delay <= found.device.delay <= box.high.delay
            at = Whole(
                Plant(T, found.device.delay, found.device.mass, found.device.damping),
                astuple(found.hand),
                astuple(design.gains),
                astuple(coupling),
            )
            theta = np.array([found.witness * T])
            assert offered(at, theta).real + FACTOR * seen(at, theta).real < 1e-9
