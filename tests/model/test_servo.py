"""A servo in a hand against matrix exponentials that share nothing with it, closed forms and published digits."""

from __future__ import annotations

from dataclasses import astuple, replace
from math import pi, sqrt

import draws
import numpy as np
import pytest
from balls import BALLS, PRECISION, ball
from conftest import mostly_slow
from devices import device_of
from flint import arb, ctx
from loop import Loop
from loop import seen as oracle

from vctune.document.schema.statement import device_table
from vctune.model.device import Device
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.parts import ForceSensor, Servo
from vctune.model.sampled.impedance_display import Required
from vctune.model.sampled.servo_in_hand import blur_of, demand_of, seen_of_servo
from vctune.model.sampled.servo_plant import sensed_delay, servo_plant
from vctune.model.servo import latency
from vctune.proof.claims.delays import sensed_force_jumps

HERTZ = (1e-3, 0.1, 1, 5, 10, 20, 60)


def servo_device(sample_time: float, servo: Servo, sensor: ForceSensor | None = None) -> Device:
    return Device(1.0, 0.0, sample_time, force_sensor=sensor, display="servo", servo=servo)


A = servo_device(2e-3, Servo(delay=0.032, bandwidth_hz=20.0, order=2))
B = servo_device(2e-3, Servo(delay=0.0143, bandwidth_hz=30.0))
C = servo_device(4e-3, Servo(delay=0.012, bandwidth_hz=15.0, order=2, command="position"), ForceSensor(50.0))
FIXTURES = [
    (A, (0, 0, 1000), (44.253953, 44.248342, 43.694485, 31.287214, 4.738985, -3.007118, 0.164645)),
    (A, (2, 0, 0), (-3e-6, -0.0348, -3.436361, -61.47393, -36.83928, 93.854644, -47.240732)),
    (A, (1, 10, 500), (12.126975, 12.110637, 10.513408, -16.815416, -6.823624, 39.469186, -22.657759)),
    (B, (0, 0, 1000), (20.605165, 20.604454, 20.534157, 18.893469, 14.468014, 3.894364, 0.647521)),
    (B, (1, 10, 500), (0.302582, 0.295773, -0.375838, -15.187569, -45.893114, -37.779813, -116.51817)),
    (C, (0, 0, 1000), (34.188371, 34.185855, 33.936595, 27.836116, 11.059068, -3.250114, -0.018043)),
    (C, (1, 10, 500), (7.094184, 7.081771, 5.861895, -18.113364, -32.605817, 51.297978, 2.513068)),
]
UNIT_HANDS = [Hand(*map(float, unit)) for unit in np.eye(3)]


def seen(device: Device, hand: Hand, theta: np.ndarray) -> np.ndarray:
    """Return what the oracle says of Z_seen."""
    return oracle(Loop(device_table(device), hand=astuple(hand)), np.exp(1j * theta))


def required_of_servo(plant, hand, theta, ops) -> Required:
    seen = seen_of_servo(plant, hand, theta, ops)
    return Required(blur_of(plant, seen, theta, ops) - 0.5 * seen.odd, 1)


def latency_of(device: draws.Tables) -> float:
    """Return the time by which the force of a spring is late at rest, s."""
    late = device["sample_time"] * (1.0 if device["servo"].get("command") == "position" else 0.5)
    for part in (device["servo"], device.get("force_sensor", {})):
        late += part.get("delay", 0.0)
        lag = {1: 1.0, 2: sqrt(2)}[part.get("order", 1)]
        late += lag / (2 * pi * part["bandwidth_hz"]) if "bandwidth_hz" in part else 0.0
    return late


def plant_of(device: Device):
    return servo_plant(device, sensed_delay(device), FLOATS)


def seen_at(device: Device, hand: Hand, theta: np.ndarray) -> np.ndarray:
    """Return Z_seen as one complex number."""
    found = seen_of_servo(plant_of(device), hand, theta, FLOATS)
    s = np.sin(theta / 2)
    return (found.even + 1j * s * found.odd) / (2j * s)


def required_at(device: Device, hand: Hand, theta: np.ndarray) -> np.ndarray:
    found = required_of_servo(plant_of(device), hand, theta, FLOATS)
    return found.lost / found.size


@pytest.mark.parametrize(("device", "hand", "expected"), FIXTURES)
def test_digits(device, hand, expected):
    theta = 2 * pi * np.array(HERTZ) * device.sample_time
    found = required_at(device, Hand(*hand), theta)
    assert np.abs(found - expected).max() < 5.1e-7
    exact = servo_plant(device.converted(ball), sensed_delay(device), BALLS)
    for hertz, value in zip(HERTZ, expected, strict=True):
        theta_ball = 2 * arb.pi() * ball(hertz) * ball(device.sample_time)
        one = required_of_servo(exact, Hand(*map(ball, hand)), theta_ball, BALLS)
        assert abs(one.lost / one.size - ball(value)) < 5.1e-7


@pytest.mark.parametrize("filtered", [False, True])
@pytest.mark.parametrize("number", mostly_slow(range(100), range(4)))
def test_matrix_exponentials(number, filtered):
    """Servo, then hand, then sensor, each with its own delay; a filter of the samples multiplies the force."""
    random = np.random.default_rng((71, number))
    table, share = draws.servo(random), float(random.uniform(0.02, 0.9)) if filtered else 1.0
    if filtered:
        table["force_sensor"] = table.get("force_sensor", {}) | {"filter_coefficient": share}
    device, theta = device_of(table), np.concatenate((10 ** random.uniform(-2, 0.49, 20), [pi]))
    for hand in UNIT_HANDS:
        expected = seen(device, hand, theta)
        size = np.abs(expected).max()
        assert np.abs(seen_at(device, hand, theta) - expected).max() < 1e-8 * size
        assert np.abs(required_at(device, hand, theta) + expected.real).max() < 1e-8 * size
    later = latency_of(table) + table["sample_time"] * (1 - share) / share
    assert required_at(device, Hand(0.0, 0.0, 1000.0), np.zeros(1)) == pytest.approx(1000 * later, rel=1e-9)


@pytest.mark.parametrize("whole", [1, 3])
@pytest.mark.parametrize("order", [1, 2])
def test_whole_samples(whole, order):
    """A force is sensed just before the new command acts: the mass of order 1 jumps there, nothing else does."""
    T, theta = 1e-3, np.array([0.3, 1.5, pi])
    hand = Hand(1.0, 2.0, 300.0)
    at, below = (servo_device(T, Servo(delay, 30.0, order)) for delay in (whole * T, (whole - 1e-9) * T))
    for device in (at, below):
        assert seen_at(device, hand, theta) == pytest.approx(seen(device, hand, theta), rel=1e-9)
    jump = seen_at(at, hand, theta) - seen_at(below, hand, theta)
    z = np.exp(1j * theta)
    expected = (z ** (-whole - 1) - z**-whole) * 2 * pi * 30.0 if order == 1 else 0 * z
    assert np.abs(jump - expected).max() < 1e-4
    assert sensed_force_jumps(at, Hands(Hand(0.0, 0.0, 0.0), hand)) == (order == 1)


@pytest.mark.parametrize("number", range(4))
def test_at_rest_the_drag_is_stiffness_times_latency(number):
    table = draws.servo(np.random.default_rng((72, number)))
    device = device_of(table)
    with ctx.workprec(PRECISION):
        exact = device.converted(ball)
        parts, plant = latency(exact, BALLS), servo_plant(exact, sensed_delay(device), BALLS)
        required = required_of_servo(plant, Hand(ball(2.0), ball(7.0), ball(1000.0)), arb(0), BALLS)
        assert abs(required.lost / required.size - (1000 * parts.total - 7)) < 1e-20
    assert float(parts.total) == pytest.approx(latency_of(table), rel=1e-14)
    hands = Hands(Hand(0.0, 0.0, 0.0), Hand(2.0, 30.0, 1000.0))
    assert demand_of(device, hands).at(np.zeros(1)) == pytest.approx(1000 * latency_of(table), rel=1e-9)


LATE = ForceSensor(50.0, 2, 0.004, 0.2)
"""Of bandwidth, order, delay and share of the filter; a filter of 0.2 at 2 ms is 8 ms late."""
LATE_SERVO = Servo(0.03, 20.0, 2, command="position")


@pytest.mark.parametrize(
    ("servo", "sensor", "parts"),
    [
        (LATE_SERVO, LATE, (1.0, 1.0, 30.0, 11.2539540, 8.5015816, 8.0)),
        (replace(LATE_SERVO, order=1), LATE, (1.0, 1.0, 30.0, 7.9577472, 8.5015816, 8.0)),
        (LATE_SERVO, replace(LATE, order=1), (1.0, 1.0, 30.0, 11.2539540, 7.1830989, 8.0)),
        (LATE_SERVO, replace(LATE, delay=0.0), (1.0, 1.0, 30.0, 11.2539540, 4.5015816, 8.0)),
        (LATE_SERVO, replace(LATE, bandwidth_hz=None), (1.0, 1.0, 30.0, 11.2539540, 4.0, 8.0)),
        (LATE_SERVO, replace(LATE, filter_coefficient=None), (1.0, 1.0, 30.0, 11.2539540, 8.5015816, 0.0)),
        (replace(LATE_SERVO, command="velocity"), None, (1.0, 0.0, 30.0, 11.2539540, 0.0, 0.0)),
    ],
)
def test_each_part_of_the_latency_is_the_one_computed_by_hand(servo: Servo, sensor: ForceSensor | None, parts) -> None:
    """In ms: 1/(2 pi f) of order 1, sqrt(2) times as much of order 2, for the servo and for the sensor."""
    found = latency(servo_device(2e-3, servo, sensor), FLOATS)
    shown = (found.hold, found.interpolation, found.delay, found.lag, found.sensor, found.filter)
    assert 1e3 * np.array(shown) == pytest.approx(parts, abs=1e-6)
    assert 1e3 * found.total == pytest.approx(sum(parts), abs=1e-6)
