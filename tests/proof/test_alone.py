"""A handle with nothing behind in any passive hand (Keemink's question), against plain complex numbers."""

from __future__ import annotations

import os
from math import inf, pi
from typing import Any

import numpy as np
import pytest

import vctune
from vctune.bench.evaluator import case_of, impedances
from vctune.model.gains import Coupling, Gains

DRAWS = int(os.environ.get("VCTUNE_DRAWS", "6"))


def stated(rng: np.random.Generator) -> dict[str, Any]:
    """Return a random device with a proportional velocity loop, and nothing behind it."""
    T, mass = 10 ** rng.uniform(-3.7, -2.7), 10 ** rng.uniform(-1, 1)
    device = {"mass": mass, "damping": mass * 10 ** rng.uniform(-1, 1), "sample_time": T}
    device |= {"delay": T * rng.choice([0.0, 1.0, rng.uniform(0, 2.5)]), "hold": str(rng.choice(["zoh", "lag"]))}
    velocity = mass / (1.5 * T + device["delay"]) * 10 ** rng.uniform(-1.5, -0.5)
    return {
        "device": device,
        "gains": {"velocity": velocity, "position": 0.0},
        "environment": {"mass": {"max": 0.0}, "stiffness": {"max": 0.0}},
        "stability": {"criterion": "passive", "safety_factor": 1.0, "max_sensitivity": 10.0},
    }


def felt(tables: dict[str, Any], mass: float, drag: float = 0.0) -> np.ndarray:
    """Return the admittance of the handle on the stability band: its own, and that of the motion it is told."""
    problem = vctune.problem(tables).problem
    band, gains = problem.stability.band, Gains(tables["gains"]["velocity"], 0.0)
    s = 1j * np.geomspace(band.min, band.max, 20_001)
    Z_d, C = impedances(case_of(problem.device, gains, Coupling(inf, 1.0, 0.0)), s)
    return np.asarray((1 + C / (mass * s + drag)) / (Z_d + C))


def least_mass(tables: dict[str, Any]) -> float:
    low, high = 1e-6, 1e6
    for _ in range(60):
        middle = (low * high) ** 0.5
        low, high = (low, middle) if felt(tables, middle).real.min() > 0 else (middle, high)
    return high


@pytest.mark.parametrize("seed", range(DRAWS))
def test_the_least_mass_is_found_and_proved(seed: int) -> None:
    tables = stated(np.random.default_rng((91, seed)))
    least, device = least_mass(tables), tables["device"]
    K_v, b = tables["gains"]["velocity"], device["damping"]
    assert least > 0.99 * K_v * device["mass"] / (K_v + b) or device["delay"] > 0
    for share, status in ((0.98, "violated"), (1.02, "certified")):
        judged = vctune.judge(vctune.problem(tables).problem, Gains(K_v, 0.0), Coupling(inf, share * least, 0.0))
        assert judged.status == status
        assert judged.min_ratio == pytest.approx(share, rel=1e-3)
    found = vctune.solve(tables | {"coupling": {"drag": 0.0}})
    assert found.status == "certified"
    assert least < found.judgement.coupling.mass < 1.01 * least


@pytest.mark.parametrize("criterion", ["passive", "both"])
def test_some_drag_may_take_the_place_of_mass(criterion: str) -> None:
    tables = stated(np.random.default_rng((91, 77)))
    tables["stability"] |= {"criterion": criterion}
    found = vctune.solve(tables)
    coupling = found.judgement.coupling
    assert found.status == "certified"
    assert felt(tables, coupling.mass, coupling.drag).real.min() > 0
    claims = found.judgement.certificate.outcomes
    assert ("worlds" in claims) == (criterion == "both")
    assert "alone" in claims


def test_uncertain_devices_are_covered() -> None:
    tables = stated(np.random.default_rng((91, 78))) | {"uncertainty": {"mass": 0.1, "damping": 0.1}}
    device = tables["device"]
    others = [
        tables | {"device": device | {"mass": device["mass"] * m, "damping": device["damping"] * b}}
        for m in (0.9, 1.1)
        for b in (0.9, 1.1)
    ]
    least = max(map(least_mass, others))
    for share, status in ((0.97, "violated"), (1.03, "certified")):
        gains, coupling = Gains(tables["gains"]["velocity"], 0.0), Coupling(inf, share * least, 0.0)
        assert vctune.judge(vctune.problem(tables).problem, gains, coupling).status == status


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"environment": {"mass": {"max": 1.0}, "stiffness": {"max": 0.0}}}, "with nothing behind"),
        ({"gains": {"velocity": 3.0}}, "asks for a mass and a drag for stated gains"),
        ({"coupling": {"damping": 5.0}}, "holds nothing"),
    ],
)
def test_what_is_not_proved_is_refused(change: dict[str, Any], said: str) -> None:
    with pytest.raises(vctune.InputError, match=said):
        vctune.problem(stated(np.random.default_rng(1)) | change)


def test_a_band_to_zero_is_refused() -> None:
    tables = stated(np.random.default_rng(1))
    tables["stability"] |= {"band_hz": [0.0, 1 / (2 * pi)]}
    with pytest.raises(vctune.InputError, match="state another edge"):
        vctune.problem(tables)
