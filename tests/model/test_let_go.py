"""Devices let go, in the form of the loop in a hand: enclosures of a box of them hold the polynomials' loop."""

from __future__ import annotations

import numpy as np

from vctune.model.device import Device
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.parts import Actuator, Structure
from vctune.model.sampled.let_go import plant_let_go, return_difference
from vctune.model.sampled.velocity_loop import sampled_plant
from vctune.proof.enclosures.array_intervals import Enclosure, between, decimal
from vctune.proof.enclosures.jets import ENCLOSURES, Jet, variables

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
        parts = return_difference(sampled_plant(one, 0, FLOATS, fractional=True), theta, FLOATS, position=False)
        inside = parts.velocity.abs2() / parts.open.abs2()
        assert np.all(np.abs(inside - sharp.mid) <= sharp.rad)


def test_a_modulus_has_finite_slopes_that_hold_at_0_too():
    """|re + j im| over a box around 0 and off it: no difference quotient is beyond the slopes."""
    rng = np.random.default_rng(1)
    middle = np.concatenate((np.zeros((2, 50)), rng.normal(size=(2, 150))), axis=1)
    rad = rng.uniform(0.0, 0.5, (2, 200))
    found = ENCLOSURES.modulus(*variables([Enclosure(m, r) for m, r in zip(middle, rad, strict=True)], [True, True]))
    assert isinstance(found, Jet)
    for _ in range(50):
        a, b = (middle + rad * rng.uniform(-1, 1, rad.shape) for _ in range(2))
        for row, slope in enumerate(found.slopes):
            c = a.copy()
            c[row] = b[row]
            rise = (np.hypot(*c) - np.hypot(*a)) / (c[row] - a[row])
            assert np.all(np.abs(rise - slope.mid) <= slope.rad + 1e-9)
        assert np.all(np.abs(np.hypot(*a) - found.value.mid) <= found.value.rad)
