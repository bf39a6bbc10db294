"""The phases of the parts: together they are the phase of the loop and of the force path, by formulas of their own."""

from __future__ import annotations

from dataclasses import replace
from math import atan, pi, tau

import numpy as np
import pytest
from device_arithmetic import DOUBLES
from device_oracle import response_at
from device_pairs import real_of

from vctune.analysis.margins import loop_margins
from vctune.analysis.phases import (
    ACTUATOR,
    DELAY,
    ESTIMATE,
    HOLD,
    LAW,
    SENSOR,
    SENSOR_DELAY,
    crossover,
    force_phases,
    loop_phases,
    sensor_miss,
)
from vctune.analysis.sampled_loop import loop_gain
from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.parts import Actuator, ForceSensor, Structure, VelocityEstimate

RIGID = Device(0.4, 2.0, 1e-3, 3e-4)
LATE = replace(
    RIGID,
    velocity=VelocityEstimate("difference", 200.0),
    actuator=Actuator(500.0),
    force_sensor=ForceSensor(500.0, 1, 4e-4),
)
FLEXIBLE = replace(LATE, structure=Structure(0.1, 120.0, 0.02))
DEVICES = {
    "ideal": Device(0.4, 2.0, 1e-3),
    "delayed": RIGID,
    "lag": Device(0.4, 2.0, 1e-3, hold="lag"),
    "late": LATE,
    "flexible": FLEXIBLE,
    "second order": replace(LATE, actuator=Actuator(400.0, 2), velocity=VelocityEstimate("measured", 250.0, 2)),
}
LAWS = {"PI": Gains(60.0, 3000.0), "P": Gains(60.0, 0.0)}


def force_path(device, gains, omega):
    return response_at(real_of(device), gains, 1j * omega, DOUBLES).q


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("name", DEVICES)
def test_the_shares_are_the_phase_of_the_loop_and_of_the_force_path(name, law):
    device, gains = DEVICES[name], LAWS[law]
    for hz in (0.5, 10.0, 60.0, 100.0, 118.0, 130.0, 300.0, 499.0):
        loop, force = loop_phases(device, gains, tau * hz), force_phases(device, gains, tau * hz)
        L = loop_gain(device, gains, np.array([tau * hz]))[0]
        assert np.exp(1j * loop.total) == pytest.approx(L / abs(L))
        q = force_path(device, gains, tau * hz)
        assert np.exp(1j * force.total) == pytest.approx(q / abs(q))


@pytest.mark.parametrize("name", DEVICES)
def test_what_is_left_at_the_crossover_is_the_phase_margin(name):
    device, gains = DEVICES[name], Gains(60.0, 1000.0)
    omega = crossover(device, gains)
    above = np.geomspace(omega * (1 + 1e-6), pi / device.sample_time, 2000)
    assert np.abs(loop_gain(device, gains, np.array([omega]))) == pytest.approx(1.0, abs=1e-7)
    assert (np.abs(loop_gain(device, gains, above)) < 1).all()
    margin = loop_margins(device, gains).phase
    if name != "flexible":  # it crosses three times
        assert pi + loop_phases(device, gains, omega).total == pytest.approx(margin)


def test_shares_in_closed_form():
    omega, gains = tau * 50.0, LAWS["PI"]
    loop = loop_phases(LATE, gains, omega).shares
    assert loop[HOLD] == pytest.approx(-omega * 1e-3 / 2)
    assert loop[DELAY] == pytest.approx(-omega * 3e-4)
    assert loop[ACTUATOR] == pytest.approx(-atan(50 / 500))
    assert loop[LAW] == pytest.approx(-atan(3000 / 60 / omega))
    assert SENSOR not in loop
    force = force_phases(LATE, gains, omega).shares
    assert force[SENSOR] == pytest.approx(-atan(50 / 500))
    assert force[SENSOR_DELAY] == pytest.approx(-omega * 4e-4)
    assert ESTIMATE not in force
    lag = replace(RIGID, hold="lag", delay=0.0)
    assert force_phases(lag, gains, omega).shares[HOLD] == pytest.approx(-atan(omega * 1e-3 / 2))
    assert loop_phases(lag, gains, omega).shares[HOLD] == pytest.approx(-omega * 1e-3 / 2), "what runs holds"


def test_what_is_absent_has_no_share():
    shares = loop_phases(DEVICES["ideal"], LAWS["P"], 100.0).shares
    assert not {LAW, ESTIMATE, DELAY, ACTUATOR} & set(shares)


def test_a_loop_that_crosses_nowhere():
    assert crossover(RIGID, Gains(0.0, 0.0)) is None
    assert crossover(RIGID, Gains(1e-3, 0.0)) is None


def test_what_the_force_sensor_misses():
    omega = np.array([1e-6, 1.0, tau * 500.0])
    s = 1j * omega
    expected = np.abs(1 - np.exp(-4e-4 * s) / (1 + s / (tau * 500.0)))
    assert sensor_miss(LATE, omega) == pytest.approx(expected, rel=1e-6)
    assert sensor_miss(RIGID, omega) is None


def test_a_change_of_units_changes_nothing():
    gains = LAWS["PI"]
    there, same = FLEXIBLE.in_units(20.0, 3e-3), Gains(60.0 / 20.0, 3000.0 / 20.0 * 3e-3)
    omega = crossover(FLEXIBLE, gains)
    assert crossover(there, same) == pytest.approx(omega * 3e-3)
    assert loop_phases(there, same, omega * 3e-3).shares == pytest.approx(loop_phases(FLEXIBLE, gains, omega).shares)
