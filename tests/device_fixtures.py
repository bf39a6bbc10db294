"""Devices whose numbers were worked out when their theory was written, and their gains."""

from __future__ import annotations

from dataclasses import replace

from device_oracle import Gains, LowPass, Real, Velocity

BARE = Real(mass=0.4, damping=2.0, sample_time=1e-3, delay=3e-4)
GAINS = Gains(velocity=150.0, position=3000.0)
REAL_A = replace(
    BARE,
    actuator=LowPass(bandwidth_hz=500.0),
    velocity=Velocity(source="difference", filter_hz=200.0),
    force_sensor=LowPass(bandwidth_hz=500.0),
)
REAL_A_LATE_SENSOR = replace(REAL_A, force_sensor=LowPass(bandwidth_hz=500.0, delay=4e-4))

WHEEL = Real(mass=0.4, damping=2.0, sample_time=1e-3)
WHEEL_GAINS = Gains(velocity=714.08906, position=19575.807)
