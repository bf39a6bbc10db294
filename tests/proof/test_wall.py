"""The coupling of an impedance display as a wall: Colgate and Schenkel's limits, and loops stepped in time."""

from __future__ import annotations

from math import inf, pi
from typing import Any

import numpy as np
import pytest
from conftest import mostly_slow
from kinds import hands_for, impedance, triple
from loop import Loop, radius

import vctune
from vctune import InputError

DEVICE = {"display": "impedance", "mass": 0.05, "damping": 0.8, "sample_time": 1e-3}
RIGID = {"stiffness": inf}


def verdict(device: Any, wall: tuple[float, float], factor: float = 1.0, box: Any = None, **more: Any) -> str:
    """Return what a certificate says of a wall of damping and stiffness."""
    stability = {
        "safety_factor": factor,
        "criterion": "hands" if box is not None else "passive",
        "max_sensitivity": 1e6,
    }
    tables = {"device": device, "environment": RIGID, "stability": stability}
    tables["coupling"] = dict(zip(("damping", "stiffness"), map(float, wall), strict=True))
    if box is not None:
        ends = zip(("mass", "damping", "stiffness"), *box, strict=True)
        tables["operator"] = {name: {"min": float(low), "max": float(high)} for name, low, high in ends}
    problem = vctune.problem(tables | more).problem
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


def most_in_any_hand(device: Any, damping: float) -> float:
    """Return the greatest stiffness of a wall in any passive hand, by a sum over 4,000 aliases at many angles."""
    T, b, n = device["sample_time"], device["damping"], np.arange(-2000, 2001)
    theta = np.r_[np.geomspace(1e-4, pi, 600), np.linspace(0.3, pi, 600)]
    w, back = (theta[:, None] + 2 * pi * n) / T, 1 - np.exp(-1j * theta)
    answer = back[:, None] / (1j * w) ** 2 / T * np.exp(-1j * w * device.get("delay", 0.0))
    radii = abs(answer).sum(axis=1) + 2 * abs(back) * T / (4 * pi**2 * 2000.5)
    if "actuator" in device:
        answer, radii = (x / (1 + 1j * w / (2 * pi * device["actuator"]["bandwidth_hz"])) for x in (answer, 0 * w))
        radii = abs(answer).sum(axis=1)
    centre, a = answer.sum(axis=1), 1.0
    if "velocity" in device:
        a = 1 - np.exp(-2 * pi * device["velocity"]["filter_hz"] * T)
    rate = damping * back / T * a / (1 - (1 - a) * np.exp(-1j * theta))
    low, high = 1e-6 * b / T, 10 * b / T
    for _ in range(60):
        middle = np.sqrt(low * high)
        H = rate + middle
        stable = (abs(1 + H * centre / (2 * b)) > abs(H) * radii / (2 * b)).all()
        low, high = (middle, high) if stable else (low, middle)
    return float(low)


@pytest.mark.parametrize("number", mostly_slow(range(60), range(3)))
def test_walls_in_any_hand(number):
    rng = np.random.default_rng((161, number))
    T = float(f"{10 ** rng.uniform(-3.7, -2.7):.4g}")
    device: Any = {"display": "impedance", "mass": 0.3, "damping": float(f"{10 ** rng.uniform(-2, 1):.4g}")}
    device |= {"sample_time": T, "delay": float(f"{T * rng.choice([0, 1, rng.uniform(0, 3)]):.6g}")}
    if number % 3:
        device["velocity"] = {"filter_hz": float(f"{10 ** rng.uniform(-1.5, -0.4) / T:.4g}")}
    if number % 2:
        device["actuator"] = {"bandwidth_hz": float(f"{10 ** rng.uniform(-1.5, 0.3) / T:.4g}")}
    damping = float(f"{device['damping'] * rng.uniform(0, 0.4):.4g}")
    limit = most_in_any_hand(device, damping)
    assert verdict(device, (damping, limit * 0.998)) == "proved"
    assert verdict(device, (damping, limit * 1.002)) == "refuted"


@pytest.mark.parametrize("number", mostly_slow(range(60), range(3)))
def test_walls_in_hands(number):
    """Beside the stiffest wall that no hand of a search makes grow."""
    rng = np.random.default_rng((162, number))
    device = impedance(rng)
    T, damping = device["sample_time"], float(f"{device['damping'] * rng.uniform(0, 0.4):.4g}")
    low, high = hands_for(rng, device["mass"], T)

    def grows(hand: Any, stiffness: float) -> bool:
        rigid = (0.0, 0.0, 1e6 * stiffness)
        return radius(Loop(device, (0.0, 0.0), (damping, stiffness), triple(hand), rigid)) > 1 + 1e-9

    def limit(hand: Any) -> float:
        ends = np.log([1e-5 * device["damping"] / T, 30 * (device["damping"] + device["mass"] / T) / T])
        for _ in range(18):
            middle = ends.mean()
            ends[int(grows(hand, float(np.exp(middle))))] = middle
        return float(np.exp(ends[0]))

    hands = [low + (high - low) * np.array(share) for share in np.ndindex(2, 2, 2)]
    hands += [low + (high - low) * rng.random(3) ** 2 for _ in range(6)]
    worst = min(hands, key=limit)
    for width in 0.4 * 0.5 ** np.arange(7):
        steps = width * (high - low) * (np.stack(np.meshgrid(*[[-1, 0, 1]] * 3), -1).reshape(-1, 3))
        worst = min(np.clip(worst + steps, low, high), key=limit)
    stiffest = limit(worst)
    assert verdict(device, (damping, stiffest * 0.99), box=(low, high)) == "proved"
    assert verdict(device, (damping, stiffest * 1.01), box=(low, high)) == "refuted"


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


def test_a_region_of_walls_ends_at_the_classical_line():
    ranges = {"damping": {"min": 0.0, "max": 1.0}, "stiffness": {"min": 1.0, "max": 2500.0}}
    posed = {"device": DEVICE, "environment": RIGID, "coupling": ranges, "stability": {"safety_factor": 1.0}}
    found = vctune.region(posed, resolution=1 / 64)
    record, spare = found.record(), {"feasible": set[bool](), "infeasible": set[bool](), "undecided": set[bool]()}
    x, y = (np.array(record["edges"][axis]) for axis in "xy")
    for left, right, low, high, kind, _ in record["cells"]:
        corners = (x[left], y[low]), (x[right], y[high])
        spare[kind] |= {DEVICE["damping"] > k * DEVICE["sample_time"] / 2 + b for b, k in corners}
    assert spare == {"feasible": {True}, "infeasible": {False}, "undecided": {True, False}}
    assert found.areas["undecided"] < 0.03


def test_the_firmware_of_a_wall_promises_no_other_environment():
    coupling = {"damping": 0.0, "stiffness": 1500.0}
    exported = vctune.export({"device": DEVICE, "environment": RIGID, "coupling": coupling})
    files = {name: " ".join(str(text).replace("*", "").split()) for name, text in exported.files.items()}
    assert all("always in contact" in files[f"vctune_controller.{ending}"] for ending in "ch")
    assert not any("passive as" in text for text in files.values())


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
