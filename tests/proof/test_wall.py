"""The coupling of an impedance display as a wall: Colgate and Schenkel's limits, and loops stepped in time."""

from __future__ import annotations

from math import inf
from typing import Any

import pytest

import vctune
from vctune import InputError

DEVICE = {"display": "impedance", "mass": 0.05, "damping": 0.8, "sample_time": 1e-3}
RIGID = {"stiffness": inf}


def verdict(device: Any, wall: tuple[float, float], factor: float = 1.0) -> str:
    """Return what a certificate says of a wall of damping and stiffness, in any passive hand."""
    stability = {"safety_factor": factor, "criterion": "passive", "max_sensitivity": 1e6}
    tables = {"device": device, "environment": RIGID, "stability": stability}
    tables["coupling"] = dict(zip(("damping", "stiffness"), map(float, wall), strict=True))
    problem = vctune.problem(tables).problem
    return vctune.judge(problem, *problem.fixed_design).certificate.verdict.value


@pytest.mark.parametrize(
    ("more", "damping", "limit"),
    [
        ({}, 0.0, 1600.0),
        ({}, 0.2, 1200.0),  # b > k T/2 + b_c
        ({"delay": 1e-3}, 0.0, 1600 / 3),  # k < 2 b/(T (1 + 2 N))
        ({"delay": 2e-3}, 0.0, 320.0),
    ],
)
def test_walls_of_colgate_and_schenkel(more, damping, limit):
    device = DEVICE | more
    assert verdict(device, (damping, limit * 0.999)) == "proved"
    assert verdict(device, (damping, limit * 1.001)) == "refuted"
    assert verdict(device, (damping / 1.05, limit / 1.05 * 0.999), 1.05) == "proved"
    found = vctune.solve({"device": device, "environment": RIGID, "coupling": {"damping": damping}})
    assert found.status == "certified" and found.judgement is not None
    if damping == 0:
        assert found.judgement.coupling.stiffness * 1.05 == pytest.approx(limit, rel=1e-3)


@pytest.mark.parametrize(
    ("tables", "key"),
    [
        ({"device": DEVICE | {"display": "admittance"}, "environment": RIGID}, "environment.stiffness"),
        ({"device": DEVICE, "environment": RIGID | {"mass": {"max": 1.0}}}, "environment.mass"),
        ({"device": DEVICE, "environment": {"stiffness": {"max": 100.0}}}, "environment"),
        ({"device": DEVICE, "environment": RIGID, "gains": {"velocity": 1.0}}, "gains.velocity"),
    ],
)
def test_what_is_no_wall_is_refused(tables, key):
    with pytest.raises(InputError, match=key):
        vctune.problem(tables)


def test_the_firmware_of_a_wall_promises_no_other_environment():
    coupling = {"damping": 0.0, "stiffness": 1500.0}
    exported = vctune.export({"device": DEVICE, "environment": RIGID, "coupling": coupling})
    files = {name: " ".join(str(text).replace("*", "").split()) for name, text in exported.files.items()}
    assert all("always in contact" in files[f"vctune_controller.{ending}"] for ending in "ch")
    assert not any("passive as" in text for text in files.values())


@pytest.mark.slow
def test_a_wall_of_given_stiffness_keeps_it_though_its_damping_is_rounded() -> None:
    """The most damping that this wall bears, to six digits, is more than it bears."""
    device = {
        "display": "impedance",
        "mass": 0.423534,
        "sample_time": 0.00195,
        "damping": 0.640491,
        "delay": 0.00258439,
    }
    device |= {"velocity": {"filter_hz": 19.6151}, "actuator": {"bandwidth_hz": 465.185, "order": 2}}
    tables: dict[str, Any] = {
        "device": device,
        "coupling": {"stiffness": 111.7316989808293},
        "environment": RIGID,
        "stability": {"criterion": "passive", "safety_factor": 1.0},
    }
    found = vctune.solve(tables)
    assert found.status == "certified" and found.judgement is not None
    wall = found.judgement.coupling
    assert wall.stiffness == pytest.approx(111.7317, rel=1e-6)
    tables["coupling"] = {"damping": 1.001 * wall.damping, "stiffness": wall.stiffness}
    assert vctune.solve(tables).status == "violated"
