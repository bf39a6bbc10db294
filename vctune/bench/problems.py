"""List the reference problems."""

from __future__ import annotations

from typing import Any

from vctune.document.reading import pose
from vctune.model.problem import Criterion, Problem

WHEEL = {"mass": 0.4, "damping": 2.0, "sample_time": 1e-3}
LIMITS = {"velocity": {"min": 0.1, "max": 1000.0}, "position": {"min": 0.0, "max": 1e5}}
PAPER = {"velocity": {"min": 1.0, "max": 1000.0}, "position": {"min": 3000.0, "max": 1e5}}
COUPLING = {"damping": {"min": 1e-3, "max": 1e5}, "mass": {"min": 1e-4, "max": 1e4}}
FELT = {"band_hz": [0.5, 30.0], "reference_impedance": 10.0}


def _wheel(gains: dict[str, Any], edge: float, **device: Any) -> dict[str, Any]:
    return {
        "device": {**WHEEL, **device},
        "gains": gains,
        "coupling": COUPLING,
        "transparency": FELT,
        "stability": {"criterion": "passive", "band_hz": [0.5, edge]},
    }


# The problems by name, in the form of files
DOCUMENTS: dict[str, dict[str, Any]] = {
    "two-basins": {
        **_wheel(LIMITS, 30.0, mass=0.8, damping=1.5, delay=1e-3),
        "transparency": {**FELT, "band_hz": [0.5, 20.0]},
        "stability": {"criterion": "passive", "band_hz": [0.2, 30.0]},
    },
    "friction-wheel": _wheel(PAPER, 100.0),
    "fast-sampling": _wheel(LIMITS, 120.0, mass=0.3, damping=0.4, sample_time=5e-4, delay=1e-4),
    "desktop": {
        "device": {"mass": 0.05, "damping": 0.2, "sample_time": 2.5e-4},
        "stability": {"criterion": "passive"},
    },
    "friction-wheel-paper": _wheel(PAPER, 100.0, hold="lag"),
    "lag-damped": _wheel(
        {"velocity": {"min": 1.0, "max": 200.0}, "position": {"min": 0.0, "max": 2e4}}, 100.0, hold="lag"
    ),
    "cobot-wrist": {
        "device": {"mass": 10.0, "damping": 20.0, "sample_time": 2e-3, "delay": 4e-3},
        "transparency": {"band_hz": [0.2, 5.0], "reference_impedance": 50.0},
        "stability": {"criterion": "passive", "band_hz": [0.2, 15.0]},
    },
    "at-bound": _wheel(LIMITS, 250.0, mass=1.0, delay=5e-4),
    "fixed-loop": _wheel({"velocity": 150.0, "position": 6000.0}, 100.0),
}


def posed(name: str, document: dict[str, Any]) -> Problem:
    """Return the problem of a valid document."""
    problem, faults = pose(document, name)
    assert problem is not None, faults
    return problem


def reference_problems(criterion: Criterion = "passive", count: int | None = None) -> dict[str, Problem]:
    """Return the first `count` reference problems, or all of them, under a criterion, by name."""
    some = list(DOCUMENTS.items())[:count]
    return {name: posed(name, x | {"stability": x["stability"] | {"criterion": criterion}}) for name, x in some}
