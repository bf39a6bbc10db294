"""What a device feels like: closed forms where there are any, an independent model everywhere else."""

from __future__ import annotations

from dataclasses import astuple, replace
from math import inf, pi, sqrt

import numpy as np
import pytest
from arithmetic import DOUBLES
from frequency import demanded
from pushed_handle import Stepped

from vctune.analysis.feel import FREE_HZ, NO_LOOP, WALL_HZ, feel, sensor_miss, stiffness_in_contact
from vctune.document.schema.statement import device_table
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains, SpringDamper
from vctune.model.parts import Actuator, ForceSensor, Structure, VelocityEstimate

WHEEL = Device(0.4, 2.0, 1e-3)
LATE = replace(
    WHEEL,
    delay=3e-4,
    velocity=VelocityEstimate("difference", 200.0),
    actuator=Actuator(500.0),
    force_sensor=ForceSensor(500.0, 1, 4e-4),
)
FLEXIBLE = replace(LATE, structure=Structure(0.1, 120.0, 0.02))
COUPLING = Coupling(40.0, 0.08, 0.5)


def test_the_bare_device_is_a_mass_and_a_damper():
    bare = feel(WHEEL, *NO_LOOP)
    assert bare.tracking_bandwidth == 0 == feel(WHEEL, Gains(2.0, 0.0), COUPLING).tracking_bandwidth  # half at rest
    assert bare.mass == pytest.approx((0.4, 0.4)) and bare.damping == pytest.approx((2.0, 2.0))
    omega = 2 * pi * WALL_HZ
    assert bare.stiffness == pytest.approx(omega * abs(2.0 + 0.4j * omega))


def test_a_coupling_without_a_loop_is_not_felt():
    assert feel(WHEEL, Gains(0.0, 0.0), COUPLING) == feel(WHEEL, *NO_LOOP)


def test_what_the_force_sensor_misses():
    omega = np.array([1e-6, 1.0, 2 * pi * 500.0])
    s = 1j * omega
    expected = np.abs(1 - np.exp(-4e-4 * s) / (1 + s / (2 * pi * 500.0)))
    assert sensor_miss(LATE, omega) == pytest.approx(expected, rel=1e-6)
    assert sensor_miss(WHEEL, omega) is None


@pytest.mark.parametrize("device", [WHEEL, LATE, FLEXIBLE], ids=["ideal", "late", "flexible"])
def test_tracking_ends_where_an_independent_model_says(device):
    def tracked(hz):
        at = demanded({"device": device_table(device)}, (60.0, 3000.0), 2j * pi * hz, DOUBLES)
        return abs(1 - at.tracking)

    ends = feel(device, Gains(60.0, 3000.0), COUPLING).tracking_bandwidth
    assert tracked(ends) == pytest.approx(sqrt(0.5), rel=1e-5)
    assert all(tracked(ends * k / 200) > sqrt(0.5) for k in range(1, 200))


@pytest.mark.parametrize("device", [WHEEL, LATE, FLEXIBLE], ids=["ideal", "late", "flexible"])
@pytest.mark.parametrize("gains", [Gains(60.0, 3000.0), Gains(60.0, 0.0)], ids=["PI", "P"])
def test_numbers_are_those_of_a_stepped_loop(device, gains):
    felt, law = feel(device, gains, COUPLING), (device_table(device), astuple(gains), astuple(COUPLING))
    for k, hz in enumerate(FREE_HZ):
        Z = Stepped(*law, (0.0, 0.0, 0.0), 2 * pi * hz).felt()
        assert (felt.damping[k], felt.mass[k]) == pytest.approx((Z.real, Z.imag / (2 * pi * hz)), rel=1e-7)
    wall = Stepped(*law, (0.0, 0.0, inf), 2 * pi * WALL_HZ).felt()
    assert felt.stiffness == pytest.approx(2 * pi * WALL_HZ * abs(wall), rel=1e-7)


def test_nothing_is_said_beyond_the_nyquist_frequency():
    slow = replace(WHEEL, sample_time=0.1)
    felt = feel(slow, Gains(1.0, 1.0), COUPLING)
    assert felt.mass[0] is not None and felt.mass[1] is None and felt.damping[1] is None
    assert felt.stiffness is None


@pytest.mark.parametrize(
    ("device", "gains", "coupling", "stiffness"),
    [
        (WHEEL, Gains(40.0, 900.0), COUPLING, 900.0),
        (LATE, Gains(40.0, 900.0), COUPLING, 900.0),
        (replace(WHEEL, display="impedance"), Gains(0.0, 0.0), SpringDamper(3.0, 1200.0), 1200.0),
    ],
)
def test_a_wall_in_contact_is_the_spring_that_holds_it(device, gains, coupling, stiffness):
    assert stiffness_in_contact(device, gains, coupling) == pytest.approx(stiffness, rel=1e-6)
