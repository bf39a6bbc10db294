"""Devices that are evaluated together have the results that each has alone."""

from __future__ import annotations

import numpy as np
import pytest

from vctune.analysis.climb import CONSIDERED
from vctune.analysis.in_hands import least_ratios_in_hands, least_ratios_of_devices
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hand, Hands
from vctune.model.parts import Actuator, ForceSensor
from vctune.model.sampled.several_devices import alike, as_one

HANDS = Hands(Hand(0.0, 0.0, 0.0), Hand(0.5, 30.0, 3000.0))
LAW = Gains(80.0, 3000.0), Coupling(60.0, 0.1, 0.5)


def drawn():
    rng, found = np.random.default_rng(5), []
    for number in range(12):
        mass, damping, delay = rng.uniform(0.1, 1), rng.uniform(0, 3), rng.choice([0.0, 1e-3, 7e-4, 2.3e-3])
        sensor = (None, ForceSensor(delay=4e-4), ForceSensor(bandwidth_hz=200.0))[number % 3]
        actuator = Actuator(bandwidth_hz=rng.uniform(100, 300)) if number % 2 else None
        found.append(Device(mass, damping, 1e-3, delay, force_sensor=sensor, actuator=actuator))
    return found


def test_ratios_of_several_devices_are_those_of_each():
    devices = drawn()
    together = least_ratios_of_devices(devices, HANDS, *LAW)
    for device, found in zip(devices, together, strict=True):
        alone = least_ratios_in_hands(device, HANDS, *LAW)
        assert len(found) == len(alone)
        refined = [sum(each.ratio <= ratios[0].ratio / CONSIDERED for each in ratios) for ratios in (found, alone)]
        assert refined[0] == refined[1]
        ratios = ([each.ratio for each in ratios[: refined[0]]] for ratios in (found, alone))
        assert next(ratios) == pytest.approx(next(ratios), rel=1e-9)
        assert [each.omega for each in found[:1]] == pytest.approx([each.omega for each in alone[:1]], rel=1e-6)


def test_devices_are_joined_that_differ_in_numbers_alone():
    devices = drawn()
    groups = alike(devices)
    assert sorted(place for group in groups for place in group) == list(range(len(devices)))
    for group in groups:
        together = [devices[place] for place in group]
        joined = as_one(together, (-1, 1))
        for key, number in joined.device.numbers().items():
            each = np.broadcast_to(np.ravel(number), len(group))
            assert each.tolist() == [device.number(key) for device in together]
        assert len({(each.actuator is None, each.force_sensor is None) for each in together}) == 1
