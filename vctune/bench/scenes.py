"""A simulation with everything that a scene can have, and a problem with everything that an NLP can have."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

from vctune.bench.problems import DOCUMENTS, posed
from vctune.model.quantities import Coupling, Gains
from vctune.simulation.scene import Scene, baseline_scene, designed_scene

GAINS, COUPLING = Gains(150.0, 6000.0), Coupling(160.0, 0.4, 0.5)
EXPERIMENT: dict[str, Any] = {
    "name": "everything",
    "environment": {"stiffness": 200.0, "damping": 1.0, "mass": 0.1, "zero": 0.025, "wall": True},
    "operator": {
        "motion": "reciprocate", "from": 0.0, "to": 0.05, "speed": 0.02, "cycles": 1,
        "mass": 0.1, "damping": 2.0, "stiffness": 1000.0,
    },
    "friction": {"coulomb": 0.3, "stiction": 0.4, "stribeck_velocity": 0.005, "stiffness": 1e5},
    "sensors": {"position_resolution": 1e-6, "velocity": "difference", "filter_hz": 100.0, "force_noise": 0.01},
    "actuator": {"limit": 50.0},
    "baseline": {"kp": 2000.0, "ki": 100.0, "kd": 20.0, "mass": 1.0, "damping": 20.0},
}  # fmt: skip
"""Friction, a wall, a hand with mass, an encoder, a filter, noise, saturation."""


def scene_of(experiment: dict[str, Any], *, delay: float = 0.0, designed: bool = True) -> Scene:
    """Return the scene of an experiment table with the friction wheel."""
    document = deepcopy(DOCUMENTS["friction-wheel"])
    document["device"] = {**document["device"], "delay": delay}
    problem = posed("scene", {**document, "experiment": [experiment]})
    (only,) = problem.experiments
    if designed:
        return designed_scene(problem.device, GAINS, COUPLING, only)
    assert only.baseline is not None
    return baseline_scene(problem.device, only, only.baseline)


def loaded_scene() -> Scene:
    """Return the scene with everything in it but delay."""
    return scene_of(EXPERIMENT)
