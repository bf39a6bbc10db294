"""The whole loop in exact time: what passive pairs do to designs in it, and what a known hand asks for."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from device_arithmetic import DIGITS, DOUBLES
from device_fixtures import GAINS, REAL_A_LATE_SENSOR, REAL_B, WHEEL, WHEEL_COUPLING, WHEEL_GAINS
from device_oracle import Coupling, Gains, LowPass, Real, Structure, Velocity
from firmware import spectral_radius
from in_time import Environment, Loop, cancelling, passivity, random_environment, random_hand
from sampled_device_oracle import Hand

HAND = Hand(mass=0.1, damping=5.0, stiffness=500.0)
COUPLING = Coupling(damping=60.0, mass=0.2, drag=8.0)


def growth(loop: Loop) -> tuple[float, float]:
    """Return the spectral radius and its frequency (Hz)."""
    values = np.linalg.eigvals(loop.matrix())
    worst = values[np.argmax(np.abs(values))]
    return abs(worst), abs(np.angle(worst)) / (2 * math.pi * loop.real.sample_time)


@pytest.mark.parametrize("device", [WHEEL, REAL_A_LATE_SENSOR, REAL_B], ids=["wheel", "a", "b"])
@pytest.mark.parametrize("rule", ["trapezoid", "backward"])
def test_eigenvalues_are_where_the_impedances_cancel(device: Real, rule: str) -> None:
    """Z_c + Z_e + Z_seen = 0 at every eigenvalue of the loop in 50 digits (those at 0 are empty registers)."""
    environment = Environment(mass=0.3, damping=1.0, stiffness=2000.0, spring_rule=rule)
    loop = Loop(device, GAINS, COUPLING, HAND, environment, DIGITS)
    found = [z for z in DIGITS.eigenvalues(loop.matrix()) if abs(z) > 1e-3]
    assert len(found) >= 4
    assert max(abs(loop.unbalance(z)) for z in found) < 1e-25


def test_a_rigid_environment_is_the_loop_alone() -> None:
    """A wall of 1e12 N s/m keeps v_e at 0."""
    loop = Loop(WHEEL, WHEEL_GAINS, COUPLING, HAND, Environment(damping=1e12, stiffness=1.0))
    values = sorted(np.abs(np.linalg.eigvals(loop.matrix())))
    alone = float(spectral_radius(WHEEL, WHEEL_GAINS, HAND))
    assert min(abs(value - alone) for value in values) < 1e-8


def test_the_friction_wheel_with_a_500_hz_force_sensor_grows_at_48_hz() -> None:
    """A hand of 20 kN/m and a virtual mass of 0.16 kg."""
    pair = (Hand(stiffness=20000.0), Environment(mass=0.16))
    ideal = Loop(WHEEL, WHEEL_GAINS, WHEEL_COUPLING, *pair)
    slow = replace(ideal, real=replace(WHEEL, force_sensor=LowPass(500.0)))
    radius, hertz = growth(slow)
    assert radius > 1.0003
    assert 47.5 < hertz < 48.5
    assert growth(ideal)[0] < 0.99


def test_the_friction_wheel_grows_at_nyquist_in_human_hands() -> None:
    """From 5 N s/m or two grams on."""
    for hand in (Hand(damping=5.0), Hand(damping=30.0), Hand(mass=0.002, damping=1.0), Hand(0.0, 5.0, 1000.0)):
        radius, hertz = growth(Loop(WHEEL, WHEEL_GAINS, WHEEL_COUPLING, hand, Environment()))
        assert radius > 1.005
        assert hertz == pytest.approx(500.0)
    for hand in (Hand(damping=4.0), Hand(mass=0.001, damping=1.0)):
        assert growth(Loop(WHEEL, WHEEL_GAINS, WHEEL_COUPLING, hand, Environment()))[0] < 1


def random_device(rng: np.random.Generator) -> Real:
    """Return a device with about half of what a device may have."""
    mass, T = 10 ** rng.uniform(-1, 0.3), round(10 ** rng.uniform(-3.6, -2.7), 7)
    late = [round(rng.uniform(0, 2.5) * T, 7) if rng.random() < 0.5 else 0.0 for _ in range(2)]
    bands = [10 ** rng.uniform(2, 3) if rng.random() < 0.5 else None for _ in range(3)]
    orders = [int(rng.integers(1, 3)) for _ in range(3)]
    structure = Structure(mass / 4, 10 ** rng.uniform(1.5, 2.5), 0.03) if rng.random() < 0.4 else None
    return Real(
        mass=mass,
        damping=10 ** rng.uniform(-1, 1),
        sample_time=T,
        delay=late[0],
        velocity=Velocity(str(rng.choice(["measured", "difference"])), bands[0], orders[0]),
        actuator=LowPass(bands[1], orders[1]),
        force_sensor=LowPass(bands[2], orders[2], late[1]),
        structure=structure,
    )


def random_loop(rng: np.random.Generator) -> Loop:
    """Return a device with gains that are stable let go and in the hand, and a coupling."""
    while True:
        real, hand = random_device(rng), random_hand(rng)
        lag = 1.5 * real.sample_time + real.delay
        velocity = real.mass / lag * 10 ** rng.uniform(-1.5, -0.2)
        gains = Gains(velocity, velocity / lag * 10 ** rng.uniform(-3, -1) * int(rng.integers(2)))
        if spectral_radius(real, gains, num=DOUBLES) < 1 and spectral_radius(real, gains, hand, DOUBLES) < 1:
            damping, mass, drag = 10 ** rng.uniform([0, -2, -1], [3, 1, 2])
            return Loop(real, gains, Coupling(float(damping), float(mass), float(drag)), hand, Environment())


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(25))
def test_the_demand_is_necessary_and_sufficient(seed: int) -> None:
    """Re(Z_c + Z_seen) > 0 up to Nyquist: no passive environment grows; < 0 somewhere: the one that cancels Im does.

    Z_e is there lossless, or keeps some of the damping that would make it marginal.
    """
    rng = np.random.default_rng(seed)
    loop = random_loop(rng)
    nyquist = 0.5 / loop.real.sample_time * (1 - 1e-9)
    hertz = np.concatenate([np.geomspace(1e-3, nyquist, 500), np.linspace(0.5, nyquist, 500)])
    sums = [passivity(loop.real, loop.gains, loop.coupling, loop.hand, float(f)) for f in hertz]
    least = int(np.argmin(np.real(sums)))
    resistance, reactance = sums[least].real, sums[least].imag
    if resistance > 0:
        environments = [random_environment(rng) for _ in range(20)]
        assert max(replace(loop, environment=e).spectral_radius() for e in environments) < 1 + 1e-9
    else:
        lossless = cancelling(loop.real, reactance, float(hertz[least]))
        assert replace(loop, environment=lossless).spectral_radius() > 1
        marginal = replace(lossless, damping=-resistance)
        values = np.linalg.eigvals(replace(loop, environment=marginal).matrix())
        z = np.exp(2j * np.pi * hertz[least] * loop.real.sample_time)
        assert np.min(np.abs(values - z)) < 1e-6
