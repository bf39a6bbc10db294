"""The devices whose numbers were worked out when their theory was written, and two of their designs."""

from __future__ import annotations

from dataclasses import replace

from device_oracle import Coupling, Gains, LowPass, Real, Structure, Velocity

BARE = Real(mass=0.4, damping=2.0, sample_time=1e-3, delay=3e-4)
GAINS = Gains(velocity=150.0, position=3000.0)
REAL_A = replace(
    BARE,
    actuator=LowPass(bandwidth_hz=500.0),
    velocity=Velocity(source="difference", filter_hz=200.0),
    force_sensor=LowPass(bandwidth_hz=500.0),
)
REAL_B = replace(BARE, structure=Structure(handle_mass=0.1, frequency_hz=120.0, damping_ratio=0.02))
REAL_A_LATE_SENSOR = replace(REAL_A, force_sensor=LowPass(bandwidth_hz=500.0, delay=4e-4))

WHEEL = Real(mass=0.4, damping=2.0, sample_time=1e-3)
WHEEL_GAINS = Gains(velocity=714.08906, position=19575.807)
WHEEL_COUPLING = Coupling(damping=38.2, mass=0.0808)

LATE = Real(
    mass=0.4,
    damping=2.0,
    sample_time=2.5e-4,
    delay=1e-4,
    actuator=LowPass(bandwidth_hz=800.0),
    force_sensor=LowPass(bandwidth_hz=500.0, order=2, delay=3e-4),
)
LATE_GAINS = Gains(velocity=400.0, position=5000.0)
