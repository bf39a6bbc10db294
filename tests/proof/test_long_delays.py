"""Ranges of delays over many samples: the whole samples are one row of the boxes, and the rest of the delay another."""

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
from vctune.model.parts import ForceSensor
from vctune.model.problem import Demands, Uncertainty
from vctune.proof.claims.delay_parts import DELAY_ROWS, parts_of
from vctune.proof.claims.every_hand import boxes_over, prove_hands
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.device_box import DeviceBox, device_box
from vctune.proof.engine.boxes import SAMPLES_BEFORE
from vctune.proof.engine.interval import Verdict

T, FACTOR = 1e-3, 1.05
APART = 0.04
"""Share by which designs miss the factor or have it to spare; the scan finds the least ratio to a hundredth."""
FEW, MANY = [(0, 2.0)], [pytest.param(number, 12.0, marks=pytest.mark.slow) for number in range(1, 13)]


def scanned(low: float, high: float) -> list[float]:
    """Return delays of a range, among them both sides of each whole number of samples."""
    whole = np.arange(ceil(low / T), floor(high / T) + 1)
    found = np.concatenate(((whole - 1e-6) * T, (whole + 1e-6) * T, np.linspace(low, high, 9)))
    return np.unique(found[(found >= low) & (found <= high)]).tolist()


def least_ratio(design: Design, box: DeviceBox, hands: Hands) -> float:
    """Return the least Re Z_c / R of a dense scan with a model of the loop that is not vctune's."""
    theta, least = np.geomspace(2e-3, np.pi * (1 - 1e-6), 250), np.inf
    reach = [np.subtract(most, low) * np.array((0, 0.02, 0.2, 0.5, 1)) + low for low, most in ends(hands)]
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
    gains = Gains(K_v, rng.choice((0.0, K_v * rng.uniform(0.1, 5))))
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


@pytest.mark.parametrize(("low", "high"), [(0.26, 4.9), (0.0, 1.0), (2.5, 4.0), (25.0, 75.0)])
def test_boxes_hold_exactly_the_delays_of_a_range(low, high):
    one = np.array([1.0])
    rows = {"operator.mass": (0 * one, one), "device.delay": (low * T * one, high * T * one)}
    device = Device(1.0, 1.0, T, low * T)
    (part,) = parts_of(device, rows, apart=True)
    delay, whole = part.names.index("device.delay"), part.names.index(SAMPLES_BEFORE)
    rng, boxes = np.random.default_rng(3), boxes_over(part)
    for samples in (*rng.uniform(low, high, 200), low, high, *range(ceil(low), floor(high) + 1)):
        rest = (samples - floor(samples)) * T
        held = (part.low[whole] <= floor(samples)) & (part.high[whole] >= floor(samples))
        assert np.any(held & (part.low[delay] <= rest + 1e-15) & (part.high[delay] >= rest - 1e-15))
    while len(boxes) and np.any(wide := boxes.low[1 + whole] < boxes.high[1 + whole]):
        halves = boxes.subset(wide).halved(np.full(wide.sum(), 1 + whole))
        assert np.all(halves.low <= halves.high)
        kept = boxes.subset(~wide)
        boxes = replace(
            boxes,
            low=np.concatenate((kept.low, halves.low), axis=1),
            high=np.concatenate((kept.high, halves.high), axis=1),
            owner=np.concatenate((kept.owner, halves.owner)),
            whole_samples=np.concatenate((kept.whole_samples, halves.whole_samples)),
        )
    found = {int(x) for x in boxes.low[1 + whole]}
    assert found == set(range(floor(low), floor(high) + 1))
    totals = boxes.low[1 + whole] * T + boxes.low[1 + delay], boxes.high[1 + whole] * T + boxes.high[1 + delay]
    assert totals[0].min() >= low * T - 2e-12 * high * T
    assert totals[1].max() <= high * T * (1 + 2e-12)


def test_a_late_sensor_keeps_one_part_for_each_number_of_whole_samples():
    one = np.array([1.0])
    rows = {"operator.mass": (0 * one, one), DELAY_ROWS[0]: (0.5 * T * one, 3.5 * T * one)}
    filtered = Device(1.0, 1.0, T, 2 * T, force_sensor=ForceSensor(bandwidth_hz=100.0))
    assert len(parts_of(filtered, rows, apart=True)) == 1
    assert len(parts_of(replace(filtered, force_sensor=ForceSensor(delay=2.5e-4)), rows, apart=True)) > 4


def test_fifty_samples_take_as_many_boxes_as_some_single_ones():
    """Where the loop is slow, a box covers many whole samples: 50 separate proofs would take 30 times as many."""
    device, hands = Device(1.0, 5.0, T, 0.05), Hands(Hand(0.0, 0.0, 0.0), Hand(0.2, 10.0, 300.0))
    design, boxes = Design(device, Gains(0.05, 0.0), Coupling(5.0, 0.5, 0.3)), []
    for width in (1e-5, 0.5):
        box = device_box(device, Uncertainty(half_widths=(("delay", width),), objective="nominal"))
        demands = Demands(device, (1.0, 10.0), FACTOR, 100.0, passive=False, hands=hands)
        found = prove_hands(design, demands, box)
        assert found.verdict is Verdict.PROVED
        boxes.append(found.boxes)
    assert boxes[1] < 10 * boxes[0]
