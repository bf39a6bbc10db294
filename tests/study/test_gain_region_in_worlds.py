"""Regions of gains with a box of environments: random points of decided cells against roots of whole loops."""

from __future__ import annotations

from dataclasses import astuple, replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from rendered_oracle import Loops, velocity_loop

from vctune.document.reading import read_problem
from vctune.model.problem import Problem, Range
from vctune.study.plane import Squares, plane, plane_errors
from vctune.study.region import Kind, Region, region

TOOLS = Path("tests/reference/worlds/world-tools.toml")
DEVICE = 0.4, 2.0, 1e-3
BEYOND = 1e-9
HELD = 1e9
"""Damping of an environment that stands still, N s/m."""
Floats = NDArray[np.float64]


def wheel(**bounds: float | tuple[float, float]) -> Problem:
    """Return the friction wheel with some of its numbers fixed or in other ranges, and any |S|."""
    problem = read_problem(TOOLS).problem
    ranges = {key: Range(*(value if isinstance(value, tuple) else (value, value))) for key, value in bounds.items()}
    return replace(
        problem,
        bounds=replace(problem.bounds, **ranges),
        stability=replace(problem.stability, max_sensitivity=100.0),
    )


PLANES = {
    "gains": (
        wheel(velocity=(50.0, 1000.0), damping=120.0, mass=0.052, drag=1.17),
        ("gains.velocity", "gains.position"),
    ),
    "coupling": (
        wheel(velocity=165.0, position=1e5, damping=(20.0, 1000.0), mass=(0.005, 1.0), drag=0.8),
        ("coupling.damping", "coupling.mass"),
    ),
    "drag": (
        wheel(velocity=(50.0, 400.0), position=5e4, damping=120.0, mass=0.052, drag=(0.01, 50.0)),
        ("gains.velocity", "coupling.drag"),
    ),
}


def divided(name: str, levels: int) -> Region:
    """Return the region of a problem in its plane."""
    problem, (x, y) = PLANES[name]
    across = plane(problem, x, y, levels)
    return region(problem, across, across.coarsest_squares())


def greatest_radius(problem: Problem, design: Floats, rng: np.random.Generator, count: int) -> float:
    """Return the greatest spectral radius that a search among hands, environments and shares of the coupling finds.

    The corners come first, then random members, then members near the best ones.
    """
    hands, worlds = problem.hands.high, problem.worlds
    assert worlds is not None
    low = np.array([0.0, 0.0, 0.0, 1 / problem.stability.safety_factor, worlds.low.mass, worlds.low.stiffness])
    high = np.array([*astuple(hands), 1.0, worlds.high.mass, worlds.high.stiffness])
    shares = np.concatenate((list(product((0.0, 1.0), repeat=6)), rng.uniform(0, 1, (count, 6)) ** 4))
    dampings = np.array([0.0, 0.3, 3.0, HELD])
    greatest, damping = 0.0, np.resize(dampings, len(shares))
    for width in (0.3, 0.1, 0.03, 0.01):
        *hand, share, m, k = (low + (high - low) * shares).T
        loops = Loops(*hand, share=share, environment_damping=damping)
        radii = velocity_loop(DEVICE, tuple(design[:2]), tuple(design[2:]), loops, m, k)
        greatest = max(greatest, float(radii.max()))
        if greatest > 1 + BEYOND:
            break
        best = np.argsort(radii)[-8:].repeat(count // 4)
        near = shares[best] + rng.normal(0, width, (best.size, 6)) * (shares[best] + 0.01)
        shares, damping = np.clip(near, 0.0, 1.0), damping[best] * rng.uniform(0.5, 1.2, best.size)
    return greatest


def designs_of(found: Region, squares: Squares, rng: np.random.Generator) -> Floats:
    """Return a random design of each cell."""
    cells = found.plane.cells(squares)
    return (cells.low + (cells.high - cells.low) * rng.uniform(0, 1, cells.low.shape)).T


def wrong_points(name: str, found: Region, count: int, dense: int) -> list[tuple[Kind, Floats, float]]:
    """Return random points of decided cells that whole loops contradict."""
    rng, wrong, problem = np.random.default_rng(1), [], PLANES[name][0]
    for kind in (Kind.FEASIBLE, Kind.INFEASIBLE):
        squares = found.squares[:, found.kinds == kind]
        for design in designs_of(found, squares[:, rng.integers(squares.shape[1], size=count)], rng):
            radius = greatest_radius(problem, design, rng, dense)
            if (radius > 1 + BEYOND) != (kind == Kind.INFEASIBLE):
                wrong.append((kind, design, radius))
    return wrong


def test_cells_of_gains_are_as_their_loops_are() -> None:
    found = divided("drag", 3)
    assert found.area(Kind.FEASIBLE) > 0.05 and found.area(Kind.INFEASIBLE) > 0.5
    assert not wrong_points("drag", found, 20, 60)


def test_walls_and_late_environments_have_no_region_of_gains() -> None:
    problem = wheel()
    assert problem.worlds is not None and not plane_errors(problem, *PLANES["gains"][1])
    for changed in ({"walls": True}, {"late": 1}):
        other = replace(problem, worlds=replace(problem.worlds, **changed))
        (mistake,) = plane_errors(other, *PLANES["gains"][1])
        assert mistake.key == "environment"


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANES)
def test_none_of_many_points_of_cells_is_wrong(name: str) -> None:
    found = divided(name, 5)
    assert found.area(Kind.UNDECIDED) < 0.12
    assert not wrong_points(name, found, 100, 400)
