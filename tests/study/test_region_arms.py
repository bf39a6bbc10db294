"""Regions over mass and drag of an arm, with nothing or a box of environments behind: every point by its own loop.

A feasible point is stable in a dense set of hands with environments, and one of these makes an infeasible one unstable;
with a damping ratio, "stable" means that every oscillation has it.
"""

from __future__ import annotations

from itertools import product
from math import inf
from typing import Any

import numpy as np
import pytest
from conftest import DRAWS, drawn, mostly_slow
from loop import Loop, matrix, radius

import vctune
from vctune.study.region import Kind

ARM: dict[str, Any] = {
    "device": {"sample_time": 2e-3, "servo": {"delay": 0.024, "bandwidth_hz": 14.0, "order": 2}},
    "tool": {"mass": 1.5},
    "environment": {"mass": {"max": 0.0}, "stiffness": {"max": 0.0}},
    "coupling": {"rule": "euler", "mass": {"min": 0.5, "max": 10.0}, "drag": {"min": 20.0, "max": 300.0}},
}


def short(x: float) -> float:
    return float(f"{x:.3g}")


def drawn_arm(seed: int) -> dict[str, Any]:
    """Return an arm with nothing, a spring, or mass and spring behind, by either rule."""
    rng = np.random.default_rng(seed)
    T = float(rng.choice([1e-3, 2e-3, 4e-3, 8e-3]))
    servo = {"delay": short(rng.uniform(0, 12) * T), "bandwidth_hz": short(10 ** rng.uniform(0.5, 1.5))}
    tables: dict[str, Any] = {"device": {"sample_time": T, "servo": servo | {"order": int(rng.integers(1, 3))}}}
    if rng.random() < 0.6:
        tables["tool"] = {"mass": short(rng.uniform(0.1, 3))}
    if rng.random() < 0.3:
        tables["device"]["force_sensor"] = {"bandwidth_hz": short(10 ** rng.uniform(1, 2))}
    heavy, springy = rng.random() < 0.4, rng.random() < 0.7
    mass, spring = heavy * short(rng.uniform(0, 3)), springy * short(10 ** rng.uniform(1, 3.5))
    tables["environment"] = {"mass": {"max": mass}, "stiffness": {"max": spring}}
    if rng.random() < 0.4:
        soft = float(rng.choice([0.0, 100.0]))
        stiffness = {"min": soft, "max": short(10 ** rng.uniform(2.2, 3.7))}
        tables["operator"] = {
            "mass": {"max": short(rng.uniform(0, 2))},
            "damping": {"max": 20.0},
            "stiffness": stiffness,
        }
    law = {"rule": "euler"} if rng.random() < 0.6 else {"rule": "trapezoid", "damping": inf}
    bounds = {
        "mass": {"min": short(10 ** rng.uniform(-1.5, 0)), "max": short(10 ** rng.uniform(0.5, 1.5))},
        "drag": {"min": short(10 ** rng.uniform(0, 1.5)), "max": short(10 ** rng.uniform(2.3, 3))},
    }
    return tables | {"coupling": law | bounds}


def spread(low: float, high: float, most: int) -> list[float]:
    """Return numbers of a range, closer together at its low end."""
    return sorted({low, high, *(low + (high - low) * 10 ** np.linspace(-3, 0, most))})


def worst_radius(tables: dict[str, Any], problem: Any, mass: float, drag: float, ratio: float | None = None) -> float:
    """Return the greatest radius of the loop in many hands with environments, and with shares of the coupling; with a
    ratio, how many times it is missed."""
    T, hands, worlds = tables["device"]["sample_time"], problem.hands, problem.worlds
    euler = tables["coupling"]["rule"] == "euler"
    if euler and mass <= drag * T:
        return inf  # a step goes beyond rest, which a file may not state
    masses, springs = spread(hands.low.mass, hands.high.mass, 3), spread(hands.low.stiffness, hands.high.stiffness, 14)
    tried = [(m, b, k) for m, b, k in product(masses, {hands.low.damping, hands.high.damping}, springs)]
    behind = product({worlds.low.mass, worlds.high.mass}, {worlds.low.stiffness, worlds.high.stiffness})
    shares = (1.0,) if ratio else (1.0, 1 / problem.stability.safety_factor)
    worst = 0.0
    for (m, k), hand, share in product(behind, tried, shares):
        M, D = mass * share, drag * share
        law = (2 * (M - D * T) / T, M - D * T, D) if euler else (inf, M, D)
        more = {"rule": (M, D, 0.0)} if euler else {}
        z = np.linalg.eigvals(matrix(Loop(tables["device"], (0.0, 0.0), law, hand, (m, worlds.low.damping, k), **more)))
        if ratio:
            s = np.log(z[(np.abs(z) > 1e-3) & (np.abs(z - 1) > 1e-6)].astype(complex))
            oscillates = s[(s.imag > 1e-9) & (s.imag < np.pi - 1e-9)]
            worst = max(
                worst, float((ratio * np.abs(oscillates) / np.maximum(-oscillates.real, 1e-12)).max(initial=0.0))
            )
        else:
            worst = max(worst, float(np.abs(z).max(initial=0.0)))
    return worst


def points(found: Any, kind: Kind, many: int, rng: np.random.Generator) -> list[tuple[float, float]]:
    """Return designs in cells of a kind, many of them at corners."""
    at, edges = np.flatnonzero(found.kinds == kind), found.plane.edges
    some = []
    for cell in rng.choice(at, many) if at.size else []:
        x_low, x_high, y_low, y_high = found.squares[:, cell]
        shares = [rng.choice([0.0, 1.0, rng.random()]) for _ in range(2)]
        ends = ((edges[0][x_low], edges[0][x_high]), (edges[1][y_low], edges[1][y_high]))
        some.append(tuple(float(a + share * (b - a)) for share, (a, b) in zip(shares, ends, strict=True)))
    return some


ARMS = {"field": ARM, **{f"drawn-{seed}": drawn_arm(seed) for seed in range(drawn(30))}}


@pytest.mark.parametrize("name", mostly_slow(ARMS, ["field"]))
def test_points_of_cells_are_what_their_cells_say(name):
    tables, rng = ARMS[name], np.random.default_rng(7)
    fast = name == "field"
    found = vctune.region(tables, resolution=1 / 8 if fast else 1 / 32)
    problem = found.file.problem
    for point in points(found.region, Kind.FEASIBLE, 4 if fast else 4 * DRAWS, rng):
        assert worst_radius(tables, problem, *point) < 1 + 1e-9, point
    missed = [
        point
        for point in points(found.region, Kind.INFEASIBLE, 4 if fast else 4 * DRAWS, rng)
        if worst_radius(tables, problem, *point) < 1 + 1e-9
    ]
    # a hand between those that are tried may be the one that is unstable: the certificate of the design tells
    for mass, drag in missed:
        law = vctune.Coupling(inf, mass, drag)
        assert vctune.judge(problem, vctune.Gains(0.0, 0.0), law).status is vctune.Status.VIOLATED, (mass, drag)
    assert found.areas["undecided"] < (0.25 if fast else 0.15)


def test_a_damping_ratio_has_a_region():
    """Feasible points have the ratio in every hand of the set, and infeasible ones miss it in one."""
    tables = ARM | {"stability": {"damping_ratio": 0.05}}
    found, rng = vctune.region(tables, resolution=1 / 8), np.random.default_rng(3)
    assert found.areas["undecided"] < 0.25
    for kind in (Kind.FEASIBLE, Kind.INFEASIBLE):
        some = points(found.region, kind, 4, rng)
        assert len(some) == 4
        for point in some:
            missed = worst_radius(tables, found.file.problem, *point, ratio=0.05)
            assert missed <= 1 + 1e-6 if kind is Kind.FEASIBLE else missed > 1 - 2e-2, point


def test_a_law_that_goes_beyond_rest_in_a_step_is_infeasible():
    """M <= D T: also without environments, where the region of the continuous law would go on."""
    late = ARM | {"coupling": ARM["coupling"] | {"mass": {"min": 0.05, "max": 10.0}}}
    for tables in (late, {key: late[key] for key in ("device", "tool", "coupling")}):
        found = vctune.region(tables, resolution=1 / 8).region
        x, y = found.plane.edges
        beyond = x[found.squares[1]] <= 2e-3 * y[found.squares[2]]
        assert beyond.any() and (found.kinds[beyond] == Kind.INFEASIBLE).all()
        touched = x[found.squares[0]] <= 2e-3 * y[found.squares[3]]
        assert not (found.kinds[touched] == Kind.FEASIBLE).any()


@pytest.mark.slow
def test_a_velocity_loop_before_a_box_of_environments_has_a_region():
    """Stable with each environment in a dense set of hands in feasible cells, unstable in one in infeasible ones."""
    tables: dict[str, Any] = {
        "device": {"mass": 0.4, "damping": 2.0, "sample_time": 1e-3, "delay": 1e-3},
        "environment": {"mass": {"max": 0.5}, "stiffness": {"max": 500.0}},
        "gains": {"velocity": 100.0, "position": 2000.0},
        "coupling": {"damping": inf, "mass": {"min": 0.05, "max": 5.0}, "drag": {"min": 0.0, "max": 50.0}},
        "stability": {"criterion": "hands"},
    }
    found, rng = vctune.region(tables, "coupling.mass", "coupling.drag", resolution=1 / 16), np.random.default_rng(5)
    hands, factor = found.file.problem.hands, found.file.problem.stability.safety_factor
    tried = list(product(*(spread(*ends, 6) for ends in hands.ranges.values())))

    def worst(mass: float, drag: float) -> float:
        shares, behind = (1.0, 1 / factor), product((0.0, 0.5), (0.0, 500.0))
        loops = (
            Loop(tables["device"], (100.0, 2000.0), (inf, mass * share, drag * share), hand, (m, 0.0, k))
            for share, (m, k), hand in product(shares, behind, tried)
        )
        return max(radius(loop) for loop in loops)

    for kind in (Kind.FEASIBLE, Kind.INFEASIBLE):
        for point in points(found.region, kind, DRAWS, rng):
            assert (worst(*point) < 1 + 1e-9) == (kind is Kind.FEASIBLE), point
