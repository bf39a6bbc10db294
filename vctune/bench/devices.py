"""Make random devices over ten decades of mass, damping, sample time, delay, bounds and bands."""

from __future__ import annotations

from typing import Any

import numpy as np

from vctune.document.reading import pose
from vctune.model.problem import Problem

MOST_DELAY = 150.0  # Greatest delay of a device, in samples


def device(seed: int, number: int) -> tuple[dict[str, Any], Problem]:
    """Return the device with a given index in the series of a seed, as a document and as a problem."""
    rng = np.random.default_rng((seed, number))
    for _ in range(100):
        document = _document(rng)
        problem, _ = pose(document, f"device {number}")
        if problem is not None:
            return document, problem
    raise AssertionError("no random document makes a problem")


def _document(rng: np.random.Generator) -> dict[str, Any]:
    def decades(low: float, high: float) -> float:
        return float(f"{10 ** rng.uniform(low, high):.6g}")

    def chance(share: float) -> bool:
        return bool(rng.random() < share)

    mass, T = decades(-5, 5), decades(-8, 2)
    found: dict[str, Any] = {"mass": mass, "damping": 0.0 if chance(0.1) else mass / T * decades(-8, 2)}
    found |= {"sample_time": T, "hold": "lag" if chance(1 / 3) else "zoh"}
    if chance(0.5):
        found["delay"] = T * min(decades(-8, 2.2), MOST_DELAY)
    document: dict[str, Any] = {"device": found, "stability": {"criterion": "passive"}}
    tau = T / 2 + found.get("delay", 0.0)
    impedance = mass / tau + found["damping"]
    gains: dict[str, Any] = {}
    for name, unit in (("velocity", impedance), ("position", impedance / tau)):
        if chance(0.3):
            low = 0.0 if name == "position" and chance(0.5) else unit * decades(-8, 0)
            gains[name] = {"min": low, "max": max(low, 1e-8 * unit) * decades(0.05, 9)}
    if gains:
        document["gains"] = gains
    if chance(0.4):
        low = min(0.5 / T, 1 / tau) * decades(-9, -1)
        high = min(low * decades(0.05, 9), 0.3 / T)
        document["transparency"] = {"band_hz": [low, high]}
        document["stability"]["band_hz"] = [low * decades(-1, 0), min(high * decades(0, 1), 0.5 / T)]
    if chance(0.2):
        document.setdefault("transparency", {})["norm"] = "peak"
    if chance(0.2):
        document["stability"]["max_sensitivity"] = 1 + decades(-1, 1)
    if chance(0.1):
        document["coupling"] = {"drag": {"min": 0.0, "max": impedance * decades(-4, 2)}}
    return document
