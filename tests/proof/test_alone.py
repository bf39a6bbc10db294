"""A handle with nothing behind in any passive hand (Keemink's question), against the definitions in continuous time."""

from __future__ import annotations

from math import inf
from typing import Any

import numpy as np
import pytest
from arithmetic import DOUBLES
from conftest import DRAWS
from draws import admittance, gains_for
from frequency import demanded, low_pass

import vctune
from vctune.model.gains import Coupling, Gains
from vctune.proof.outcome import Verdict

PLAIN = {"mass": 0.6, "damping": 3.0, "sample_time": 1e-3, "delay": 1.4e-3}
NOTHING = {"mass": {"max": 0.0}, "stiffness": {"max": 0.0}}


def stated(device: dict[str, Any], velocity: float, position: float = 0.0, **others: Any) -> dict[str, Any]:
    """Return the tables of a device with its own loop and nothing behind it."""
    demands = {"criterion": "passive", "safety_factor": 1.0, "max_sensitivity": 1e6}
    gains = {"velocity": velocity, "position": position}
    return {"device": device, "gains": gains, "environment": NOTHING, "stability": demands} | others


def scale_needed(tables: dict[str, Any], mass: float, drag: float) -> float:
    """Return by how much a mass and a drag must be multiplied before no hand meets a negative resistance."""
    band = vctune.problem(tables).problem.stability.band
    s = 1j * np.geomspace(band.min, band.max, 40_001)
    loop = demanded(tables, tuple(tables["gains"].values()), s, DOUBLES)
    sensed = low_pass(tables["device"].get("force_sensor", {}), s, DOUBLES)
    driven = -(sensed * loop.G_he / (mass * s + drag)).real
    return float(np.max(np.where(loop.G_hh.real > 0, driven / loop.G_hh.real, inf)))


def verdict(tables: dict[str, Any], mass: float, drag: float) -> Verdict:
    gains = Gains(tables["gains"]["velocity"], tables["gains"]["position"])
    judged = vctune.judge(vctune.problem(tables).problem, gains, Coupling(inf, mass, drag))
    return judged.certificate.outcomes["alone"].verdict


def test_a_thousandth_beside_the_limit_decides() -> None:
    """Devices with all their parts, with and without an integrator and a drag."""
    proved = refuted = limits = 0
    for number in range(3 * DRAWS):
        rng = np.random.default_rng((91, number))
        device = admittance(rng) | {"hold": str(rng.choice(["zoh", "zoh", "lag"]))}
        mass = device["mass"] * 10 ** rng.uniform(-2, 1)
        drag = device["damping"] * 10 ** rng.uniform(-1, 1) * rng.integers(2)
        tables = stated(device, *gains_for(rng, device))
        scale = scale_needed(tables, mass, drag)
        if 0 < scale < inf:
            assert verdict(tables, 0.999 * scale * mass, 0.999 * scale * drag) is Verdict.REFUTED, number
            scale, limits = 1.001 * scale, limits + 1
        found = (
            verdict(tables, max(scale, 1) * mass, max(scale, 1) * drag) if scale < inf else verdict(tables, mass, drag)
        )
        assert found is (Verdict.PROVED if scale < inf else Verdict.REFUTED), number
        proved, refuted = proved + (scale < inf), refuted + (scale == inf)
    assert limits >= DRAWS and proved >= DRAWS, (limits, proved, refuted)


def test_the_least_mass_of_a_proportional_loop_is_that_of_keemink() -> None:
    tables = stated({"mass": 10.0, "damping": 5.0, "sample_time": 1e-5}, 100.0, coupling={"drag": 0.0})
    tables |= {"transparency": {"band_hz": [0.1, 10.0]}}
    found = vctune.solve(tables)
    assert found.status == "certified"
    assert found.judgement.coupling.mass == pytest.approx(100 / 105 * 10, rel=1e-3)


@pytest.mark.parametrize("criterion", ["passive", "both"])
def test_some_drag_may_take_the_place_of_mass(criterion: str) -> None:
    tables = stated(PLAIN, 80.0)
    tables["stability"] = {"criterion": criterion}
    found = vctune.solve(tables)
    coupling = found.judgement.coupling
    assert found.status == "certified"
    assert scale_needed(tables, coupling.mass, coupling.drag) < 1 / 1.05
    assert set(found.judgement.certificate.outcomes) >= ({"alone", "worlds"} if criterion == "both" else {"alone"})


def test_uncertain_devices_are_covered() -> None:
    tables = stated(PLAIN, 80.0, uncertainty={"mass": 0.1, "damping": 0.1})
    ends = [{"mass": 0.6 * m, "damping": 3.0 * b} for m in (0.9, 1.1) for b in (0.9, 1.1)]
    least = max(scale_needed(tables | {"device": PLAIN | end}, 1.0, 0.0) for end in ends)
    assert verdict(tables, 0.97 * least, 0.0) is Verdict.REFUTED
    assert verdict(tables, 1.03 * least, 0.0) is Verdict.PROVED


@pytest.mark.parametrize("mass", [0.0, {"max": 0.0}])
@pytest.mark.parametrize("stiffness", [0.0, {"max": 0.0}])
def test_nothing_may_be_stated_by_numbers_or_by_ends(mass: Any, stiffness: Any) -> None:
    tables = stated(PLAIN, 40.0, environment={"mass": mass, "stiffness": stiffness})
    assert vctune.problem(tables).problem.alone
