"""Random servos in boxes of hands, with the least drag that an oracle of their own says their coupling needs."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from math import inf

import numpy as np
from random_devices import decimal
from servo_oracle import Follower, Grip, Need, Virtual

from vctune.model.device import Device
from vctune.model.hands import Hand, Hands
from vctune.model.parts import ForceSensor, Servo

LONGEST = 80.0
"""Samples of delay."""


@dataclass(frozen=True)
class Case:
    """A servo, hands from low to high, a coupling with the least drag, and the angle that asks for it."""

    servo: Follower
    low: Grip
    high: Grip
    virtual: Virtual
    theta: float

    @property
    def device(self) -> Device:
        return device_of(self.servo)

    @property
    def hands(self) -> Hands:
        return Hands(Hand(*astuple(self.low)), Hand(*astuple(self.high)))


def servo_device(sample_time: float, servo: Servo, sensor: ForceSensor | None = None) -> Device:
    return Device(1.0, 0.0, sample_time, force_sensor=sensor, display="servo", servo=servo)


def device_of(servo: Follower) -> Device:
    command = "position" if servo.position else "velocity"
    sensor = None
    if servo.sensor_hz is not None or servo.sensor_delay:
        sensor = ForceSensor(servo.sensor_hz, servo.sensor_order, servo.sensor_delay)
    own = Servo(servo.delay, servo.bandwidth_hz, servo.order, command)
    return servo_device(servo.sample_time, own, sensor)


def random_servo(random: np.random.Generator) -> Follower:
    T = decimal(10 ** random.uniform(-3.3, -2.1))
    kind, sensor_hz = random.integers(4), None
    if kind >= 2:
        sensor_hz = decimal(10 ** random.uniform(1, 2.7))
    return Follower(
        sample_time=T,
        delay=decimal(T * 10 ** random.uniform(np.log10(0.2), np.log10(LONGEST))),
        bandwidth_hz=decimal(min(10 ** random.uniform(0.3, 2.3), 0.45 / T)),
        order=int(random.integers(1, 3)),
        position=bool(random.integers(2)),
        sensor_hz=sensor_hz,
        sensor_order=int(random.integers(1, 3)),
        sensor_delay=decimal(T * random.uniform(0, 4)) if random.integers(2) else 0.0,
    )


def random_case(random: np.random.Generator) -> Case:
    """Return one whose least drag is positive."""
    while True:
        servo = random_servo(random)
        high = 10 ** random.uniform([-2, 0, 0], [1.3, 2, 4.5])
        low = high * random.choice([0, 0, 0.3], 3)
        box = Grip(*map(decimal, low)), Grip(*map(decimal, high))
        damping = inf if random.integers(3) == 0 else decimal(10 ** random.uniform(0, 4))
        virtual = Virtual(damping, decimal(10 ** random.uniform(-1, 1.5)), 0.0)
        drag, theta = Need(servo, *box, virtual).most()
        if drag > 0:
            return Case(servo, *box, Virtual(damping, virtual.mass, drag), theta)
