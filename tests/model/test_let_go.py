"""Devices that nobody holds: enclosures of a box of them hold the loop of each device in it."""

from __future__ import annotations

import numpy as np

from vctune.model.device import Device
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.parts import Actuator, Structure
from vctune.model.sampled.velocity_loop import plant_let_go, return_difference
from vctune.proof.enclosures.intervals import ENCLOSURES, Enclosure, between, decimal

KEYS = ("mass", "damping", "delay", "actuator.bandwidth_hz", "structure.frequency_hz", "structure.handle_mass")

EXAMPLE = Device(0.4, 2.0, 1e-3, delay=3e-4, actuator=Actuator(400.0, 1), structure=Structure(0.1, 60.0, 0.05))


def wide(sample, device, theta, width):
    """|F|^2 of a device known to +-width, and how wide its enclosure is relative to what it encloses at the middle."""
    numbers = {key: between(device.number(key) * (1 - width), device.number(key) * (1 + width)) for key in KEYS}
    plant = sample(device.converted(decimal).with_numbers(numbers), 0, ENCLOSURES, fractional=True)
    found = return_difference(plant, Enclosure(theta), ENCLOSURES, position=False)
    return found.velocity.abs2() * found.open.abs2().reciprocal()


def test_a_box_of_devices_is_enclosed():
    device = EXAMPLE
    theta, rng = np.linspace(0.2, 3.0, 15), np.random.default_rng(0)
    sharp = wide(plant_let_go, device, theta, 0.002)
    for _ in range(200):
        one = device.with_numbers({key: device.number(key) * (1 + rng.uniform(-0.002, 0.002)) for key in KEYS})
        parts = return_difference(plant_let_go(one, 0, FLOATS, fractional=True), theta, FLOATS, position=False)
        inside = parts.velocity.abs2() / parts.open.abs2()
        assert np.all(np.abs(inside - sharp.mid) <= sharp.rad)
