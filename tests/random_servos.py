"""Random servos with commands and force sensors of every kind, as the tables of a problem file."""

from __future__ import annotations

from math import pi, sqrt
from typing import Any

import numpy as np
from random_devices import decimal

LONGEST = 80.0
"""Samples of delay."""
LAG = {1: 1.0, 2: sqrt(2)}


def random_servo(random: np.random.Generator) -> dict[str, Any]:
    """Return a device's table."""
    T = decimal(10 ** random.uniform(-3.3, -2.1))
    servo = {
        "delay": decimal(T * 10 ** random.uniform(np.log10(0.2), np.log10(LONGEST))),
        "bandwidth_hz": decimal(min(10 ** random.uniform(0.3, 2.3), 0.45 / T)),
        "order": int(random.integers(1, 3)),
        "command": str(random.choice(["velocity", "position"])),
    }
    sensor: dict[str, Any] = {"delay": decimal(T * random.uniform(0, 4))} if random.integers(2) else {}
    if random.integers(2):
        sensor |= {"bandwidth_hz": decimal(10 ** random.uniform(1, 2.7)), "order": int(random.integers(1, 3))}
    return {"sample_time": T, "servo": servo} | ({"force_sensor": sensor} if sensor else {})


def latency_of(device: dict[str, Any]) -> float:
    """Return the time by which the force of a spring is late at rest, s."""
    servo, sensor = device["servo"], device.get("force_sensor", {})
    late = device["sample_time"] * (1.0 if servo["command"] == "position" else 0.5)
    for part in (servo, sensor):
        late += part.get("delay", 0.0)
        late += LAG[part["order"]] / (2 * pi * part["bandwidth_hz"]) if "bandwidth_hz" in part else 0.0
    return late
