"""The coupling of an impedance display as a wall: Colgate and Schenkel's limits, and loops stepped in time."""

from __future__ import annotations

from math import inf
from typing import Any

import numpy as np
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


def radius(
    device: dict[str, float], wall: tuple[float, float], hand: tuple[float, float, float], share: float
) -> float:
    """Return the spectral radius of a rigid mass in a hand before a share of a wall, stepped exactly; no delay."""
    from scipy.linalg import expm

    (b_c, k_c), (mass, damping, stiffness), T = wall, hand, device["sample_time"]
    m, b = device["mass"] + mass, device["damping"] + damping
    steps = expm(np.array([[0, 1, 0], [-stiffness / m, -b / m, 1 / m], [0, 0, 0]]) * T)[:2]
    force = -share * np.array([k_c + b_c / T, 0.0, -b_c / T])  # of x, v and the x before
    after = steps[:, :2] @ np.eye(2, 3) + np.outer(steps[:, 2], force)
    return float(np.abs(np.linalg.eigvals(np.vstack((after, [1.0, 0.0, 0.0])))).max())


def test_the_stiffest_wall_of_a_device_without_damping_is_stable_in_hands_and_next_to_its_limit():
    device = {"display": "impedance", "mass": 0.025, "damping": 0.0, "sample_time": 1e-3}
    hands = {"mass": {"max": 0.5}, "damping": {"max": 2.0}, "stiffness": {"max": 100.0}}
    found = vctune.solve(
        {"device": device, "environment": RIGID, "operator": hands, "stability": {"criterion": "hands"}}
    )
    assert found.status == "certified"
    coupling, rng = found.judgement.coupling, np.random.default_rng(7)
    wall = coupling.damping, coupling.stiffness
    tried = [(0.0, 0.0, 0.0), *(tuple(rng.uniform(0, 1, 3) ** 3 * (0.5, 2.0, 100.0)) for _ in range(300))]
    assert all(radius(device, wall, hand, share) < 1 for hand in tried for share in (1.0, 1.05))
    assert any(radius(device, wall, hand, 1.06) > 1 for hand in tried)


def test_gains_of_a_device_without_damping_are_answered():
    tables = {
        "device": DEVICE | {"damping": 0.0},
        "environment": RIGID,
        "coupling": {"damping": 1.0, "stiffness": 100.0},
    }
    with pytest.raises(InputError, match="damping is 0: any passive hand"):
        vctune.check(tables)
    assert vctune.solve(tables).status == "infeasible"


def test_the_least_multiple_in_any_passive_hand_is_not_missed():
    """A passive hand of .436 g and 5740 N/m is unstable at 1.15 times this wall, which fails in few angles."""
    device = {
        "display": "impedance", "mass": 0.042, "damping": 5.932, "sample_time": 1.911e-3,
        "velocity": {"from": "difference", "filter_hz": 46.01, "filter_order": 2},
        "structure": {"handle_mass": 0.0185, "frequency_hz": 14.8, "damping_ratio": 0.0845},
    }  # fmt: skip
    wall = 2.29, 5949.1
    problem = vctune.problem(
        {
            "device": device,
            "environment": RIGID,
            "stability": {"criterion": "passive"},
            "coupling": dict(zip(("damping", "stiffness"), wall, strict=True)),
        }
    ).problem
    said = vctune.judge(problem, *problem.fixed_design).before_wall.ratio
    assert verdict(device, wall, 0.99 * said) == "proved" and verdict(device, wall, 1.01 * said) == "refuted"


def test_the_peak_of_the_sensitivity_is_that_of_the_loop_that_the_wall_closes():
    """With a rigid mass, no delay and no hand, L is known in closed form."""
    problem = vctune.problem({"device": DEVICE, "environment": RIGID, "coupling": {"damping": 0.1, "stiffness": 400.0}})
    judgement = vctune.judge(problem.problem, *problem.problem.fixed_design)
    m, b, T = DEVICE["mass"], DEVICE["damping"], DEVICE["sample_time"]
    z, p = np.exp(1j * np.geomspace(1e-4, np.pi, 200_001)), np.exp(-b * T / m)
    gain = T / (b * (z - 1)) - m * (1 - p) / (b * b * (z - p))  # position per held force
    L = (400.0 + 0.1 * (1 - 1 / z) / T) * gain
    assert judgement.closed_loop.peak == pytest.approx(1 / np.abs(1 + L).min(), rel=1e-6)
    crossing = np.flatnonzero(np.diff(np.sign(np.abs(L) - 1)))
    assert judgement.closed_loop.phase == pytest.approx((np.pi - np.abs(np.angle(L[crossing]))).min(), rel=1e-3)
