"""The oracle of the sampled loop, and vctune's, against what was printed beforehand; and the oracle two other ways."""

from __future__ import annotations

import cmath
import math
from dataclasses import replace

import control
import numpy as np
import pytest
from agreement import all_to_all_digits, to_all_digits
from device_arithmetic import DIGITS, DOUBLES
from device_fixtures import GAINS, REAL_A, REAL_A_LATE_SENSOR, REAL_B, WHEEL, WHEEL_GAINS
from device_oracle import Gains, LowPass, Real, Structure, Velocity, hold, low_pass, mechanism
from device_pairs import device_of
from firmware import Device, spectral_radius
from sampled_device_oracle import LET_GO, Hand, circle, matrix_of, plant, pulses, seen_impedance, sensitivity

from vctune.analysis.sampled_loop import sensitivity_of
from vctune.proof.claims.sampled_poles import spectral_radius as proved_radius

HERTZ = (1, 10, 50, 100, 400, 500)
HAND_HERTZ = (1, 10, 100, 400, 499.999999)
HAND = Hand(mass=0.1, damping=5.0, stiffness=500.0)
EVERYTHING = replace(
    REAL_A_LATE_SENSOR,
    structure=Structure(0.1, 120.0, 0.02),
    actuator=LowPass(300.0, order=2),
    velocity=Velocity("difference", 150.0, filter_order=2),
    force_sensor=LowPass(200.0, order=2, delay=2.3e-3),
    delay=1.7e-3,
)


@pytest.mark.parametrize(
    ("device", "gains", "printed", "radius"),
    [
        (
            REAL_A,
            GAINS,
            ".00643075252, .164876966, 1.04935817, 1.88997878, .963973612, .963576622",
            ".9797662915784",
        ),
        (
            REAL_B,
            GAINS,
            ".00644114239, .165865196, .797931623, 1.01709167, 1.15184488, 1.11299713",
            ".9793483461890",
        ),
        (WHEEL, WHEEL_GAINS, ".00100550271, .032717941, .179000391, .368029577, 3.2695241, 9.31269179", None),
    ],
    ids=["a", "b", "wheel"],
)
def test_sensitivity_and_radius_let_go(device: Real, gains: Gains, printed: str, radius: str | None) -> None:
    for num in (DIGITS, DOUBLES):
        assert all_to_all_digits(printed, [abs(sensitivity(device, gains, hertz, num)) for hertz in HERTZ])
        assert radius is None or to_all_digits(radius, spectral_radius(device, gains, num=num))
    ours = device_of(device)
    assert all_to_all_digits(printed, list(sensitivity_of(ours, gains)(2 * math.pi * np.array(HERTZ))))
    assert radius is None or to_all_digits(radius, proved_radius(ours, gains))


@pytest.mark.parametrize(
    ("device", "gains", "hand", "printed", "radius"),
    [
        (
            WHEEL,
            WHEEL_GAINS,
            Hand(0, 2, 1000),
            "-3.30189871, -1.79708223, -1.43203308, .75885157, 16.66506962",
            ".971311321227",
        ),
        (WHEEL, WHEEL_GAINS, Hand(0, 5, 1000), "41.65673015", ".971431542196"),
        (
            WHEEL,
            WHEEL_GAINS,
            Hand(0.1, 5, 500),
            "-5.073865, -5.1123491, -48.7445991, 107.034006, 508.637387",
            ".972009890218",
        ),
        (
            REAL_A_LATE_SENSOR,
            GAINS,
            Hand(0.1, 5, 500),
            "-5.92496224, -4.67687430, -23.4782379, -1.42762575, -10.4771066",
            ".976809123701",
        ),
    ],
    ids=["damper and spring", "heavier damper", "with mass", "a and a late sensor"],
)
def test_devices_in_a_hand(device: Real, gains: Gains, hand: Hand, printed: str, radius: str) -> None:
    """-Re Z_seen and the spectral radius. vctune has no demand of known hands yet: this is of the oracle alone.

    Of the last row -10.4771067 and .976809123702 were printed, one too many in the last digit: 50 digits, doubles, the
    firmware's memory and the sum over aliases all say -10.47710663035 and .97680912370115.
    """
    hertz = HAND_HERTZ[-1:] if "," not in printed else HAND_HERTZ
    for num in (DIGITS, DOUBLES):
        assert all_to_all_digits(printed, [-seen_impedance(device, gains, hand, f, num).real for f in hertz])
        assert to_all_digits(radius, spectral_radius(device, gains, hand, num))


@pytest.mark.parametrize("device", [REAL_A, REAL_B, EVERYTHING], ids=["a", "b", "everything"])
@pytest.mark.parametrize("hand", [LET_GO, HAND, Hand(0, 5, 0)], ids=["let go", "hand", "damper"])
def test_the_plant_is_the_mechanism_of_the_frequency_model(device: Real, hand: Hand) -> None:
    """C (s - A)^{-1} B + D is A P_mu' and F_s f_h with f_h = -Z_h v_h, v_h = P_hu u / (1 + P_hh Z_h)."""
    body = plant(device, hand, DOUBLES)
    for hertz in (0.3, 20.0, 900.0):
        s = 2j * math.pi * hertz
        state = np.linalg.solve(s * np.eye(len(body.B)) - body.A, body.B)
        P_hh, P_hu, P_mh, P_mu = mechanism(device, s, DOUBLES)
        Z_h = hand.mass * s + hand.damping + hand.stiffness / s
        held = Z_h / (1 + P_hh * Z_h)
        push = low_pass(device.actuator, s, DOUBLES)
        F_s = low_pass(replace(device.force_sensor, delay=0.0), s, DOUBLES)
        assert state[1] == pytest.approx(push * (P_mu - P_mh * P_hu * held), rel=1e-9)
        assert state[0] * s == pytest.approx(state[1], rel=1e-9)
        assert body.force @ state + body.feed == pytest.approx(-F_s * push * P_hu * held, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("device", [REAL_A_LATE_SENSOR, EVERYTHING], ids=["a", "everything"])
def test_pulses_are_sums_over_the_aliases(device: Real) -> None:
    """G(e^{jwT}) = sum over k of A P H at j(w + 2 pi k / T): nothing of the state space is in it."""
    aliases = np.arange(-100_000, 100_001) / device.sample_time
    for hertz in (3.0, 100.0, 130.0, 480.0, 499.999999):
        s = 2j * math.pi * (hertz + aliases)
        P_hh, P_hu, P_mh, P_mu = mechanism(device, s, DOUBLES)
        Z_h = HAND.mass * s + HAND.damping + HAND.stiffness / s
        held = Z_h / (1 + P_hh * Z_h)
        push = low_pass(device.actuator, s, DOUBLES) * hold(device, s, DOUBLES)
        sensed = -push * P_hu * held * low_pass(device.force_sensor, s, DOUBLES)
        G_x, _, G_f = pulses(device, HAND, circle(device, hertz, DOUBLES), DOUBLES)
        assert G_x == pytest.approx(np.sum(push * (P_mu - P_mh * P_hu * held) / s), rel=1e-9)
        assert G_f == pytest.approx(np.sum(sensed), rel=1e-9)


@pytest.mark.parametrize(
    "device", [WHEEL, REAL_A_LATE_SENSOR, REAL_B, EVERYTHING], ids=["wheel", "a", "b", "everything"]
)
@pytest.mark.parametrize("hand", [LET_GO, HAND], ids=["let go", "hand"])
def test_the_firmware_s_memory_has_the_pulse_responses(device: Real, hand: Hand) -> None:
    """Delays by registers and split samples are delays by shifted time."""
    memory = Device(device, hand, DOUBLES)
    one = np.eye(memory.size)
    A = matrix_of(lambda m: memory.wait(m, 0.0), memory.size, DOUBLES)
    B = memory.wait(np.zeros(memory.size), 1.0)
    for hertz in (2.0, 90.0, 333.0):
        z = cmath.exp(2j * math.pi * hertz * device.sample_time)
        state = np.linalg.solve(z * one - A, B)
        rows = [np.array([read(e) for e in one]) for read in (memory.position, memory.velocity, memory.force)]
        for row, expected in zip(rows, pulses(device, hand, z, DOUBLES), strict=True):
            assert row @ state == pytest.approx(expected, rel=1e-7, abs=1e-12)


def test_the_rigid_plant_is_that_of_python_control() -> None:
    sampled = control.sample_system(control.tf([1], [0.4, 2.0, 0.0]), 1e-3, method="zoh")
    for hertz in HERTZ:
        z = circle(WHEEL, hertz, DOUBLES)
        assert pulses(WHEEL, LET_GO, z, DOUBLES)[0] == pytest.approx(complex(sampled(z)), rel=1e-6)


def test_delays_of_whole_samples_only_turn_the_phase() -> None:
    z = circle(REAL_A, 77.0)
    early, late = pulses(REAL_A, HAND, z), pulses(replace(REAL_A, delay=2.3e-3), HAND, z)
    for one, other in zip(early, late, strict=True):
        assert abs(one / z**2 - other) < 1e-35


def test_the_velocity_loop_alone_leaves_the_position_out() -> None:
    """With K_p = 0 the rigid loop is z = a - K_v (1 - a)/b, a = e^{-bT/m}; the integrator is not in it."""
    a = math.exp(-2.0 * 1e-3 / 0.4)
    expected = abs(a - 100.0 * (1 - a) / 2.0)
    assert float(spectral_radius(WHEEL, Gains(100.0, 0.0))) == pytest.approx(expected, rel=1e-12)
    assert spectral_radius(EVERYTHING, Gains(1.0, 0.0)) < 1
