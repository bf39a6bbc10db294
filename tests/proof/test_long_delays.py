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
from vctune.proof.engine.boxes import SAMPLES_BEFORE, Boxes
from vctune.proof.engine.branching import Decided
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


@pytest.mark.parametrize(("low", "high"), [(0.26, 4.9), (0.0, 1.0), (2.5, 4.0), (25.0, 75.0)])
def test_boxes_hold_exactly_the_delays_of_a_range(low, high):
    one, tested = np.array([1.0]), []
    rows = {"operator.mass": (0 * one, one), "device.delay": (low * T * one, high * T * one)}
    (part,) = parts_of(Device(1.0, 1.0, T, low * T), rows, apart=True)
    delay, whole = (1 + part.names.index(name) for name in ("device.delay", SAMPLES_BEFORE))

    def negative(boxes: Boxes) -> Decided:
        """Return that the margin is negative in the middle, and least at the upper ends."""
        tested.append(boxes)
        none = np.zeros(len(boxes), bool)
        middle = 0.5 * (boxes.low + boxes.high)
        return Decided(none, ~none, middle, 1.0 + 0 * middle, ~none, 1.0 + 0 * middle, 0.0 + none)

    rng, boxes = np.random.default_rng(3), boxes_over(part)
    boxes = boxes.subset(boxes.low[0] == boxes.low[0, 5])
    samples = np.array([*rng.uniform(low, high, 300), low, high, *range(ceil(low), floor(high) + 1)])
    samples = samples + 1e-12  # so that no whole number is a rounding error short
    found = set()
    for _ in range(14):
        decided = part.within(negative)(boxes)
        seen_by = tested[-1]
        total = decided.point[whole] + decided.point[delay] / T
        assert np.all((low - 1e-9 <= total[decided.fails]) & (total[decided.fails] <= high + 1e-9))
        assert not np.any(decided.point[whole] % 1, where=decided.fails)
        held = _held(boxes, whole, delay, samples)
        assert np.all(held.any(axis=1))
        assert np.all((_held(seen_by, whole, delay, samples) & ~decided.proved) == held)
        several = boxes.low[whole] < boxes.high[whole]
        faces = (several & (decided.side[whole] != 0)) | (decided.side[delay] != 0)
        assert np.all(boxes.high[whole, faces] * T + boxes.high[delay, faces] <= high * T * (1 + 1e-11))
        assert np.all(boxes.low[whole, faces] * T + boxes.low[delay, faces] >= low * T - 1e-11 * high * T)
        found |= set(decided.point[whole, decided.fails].tolist())
        boxes = boxes.subset(~decided.proved)
        boxes = boxes.halved(rng.choice((whole, delay), len(boxes), p=(0.6, 0.4)))
        assert np.all(boxes.low <= boxes.high)
    assert found <= set(range(floor(low), floor(high) + 1))
    assert len(found) > 1


def _held(boxes: Boxes, whole: int, delay: int, samples: np.ndarray) -> np.ndarray:
    """Return which delays, in samples, lie in which boxes."""
    count, rest = np.floor(samples)[:, None], (samples % 1)[:, None] * T
    inside = (boxes.low[whole] <= count) & (count <= boxes.high[whole])
    return inside & (boxes.low[delay] <= rest + 1e-14) & (rest - 1e-14 <= boxes.high[delay])


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
