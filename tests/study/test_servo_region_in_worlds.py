"""Regions of couplings of servos with a box of environments: random points of decided cells against whole loops."""

from __future__ import annotations

from dataclasses import astuple, replace
from itertools import product
from math import pi

import numpy as np
import pytest
from numpy.typing import NDArray
from world_loops import BEYOND, Plant, Whole, in_world, offered, seen, spectral_radius

from vctune.document.building import problem as problem_of
from vctune.model.problem import Problem, Range
from vctune.running import time_limit
from vctune.study.plane import plane
from vctune.study.region import Kind, Region, region

Floats = NDArray[np.float64]
ARM = {
    "device": {"sample_time": 2e-3, "servo": {"delay": 0.032, "bandwidth_hz": 20.0, "order": 2}},
    "operator": {
        "mass": {"min": 0.0, "max": 2.0},
        "damping": {"min": 0.0, "max": 30.0},
        "stiffness": {"min": 0.0, "max": 1000.0},
    },
    "environment": {"mass": {"min": 0.5, "max": 20.0}, "stiffness": {"max": 2000.0}},
}
PLANT = Plant(2e-3, 0.032, servo=2, bandwidth=2 * pi * 20.0)
THETA = np.concatenate((np.geomspace(1e-3, 0.6, 6000), np.linspace(0.6, 3.1, 300)))
PLANES = {
    "coupling": (("damping", (20.0, 2000.0)), ("mass", (0.1, 10.0)), {"drag": 55.0}),
    "drag": (("mass", (0.1, 10.0)), ("drag", (5.0, 100.0)), {"damping": 400.0}),
}


def divided(name: str, levels: int) -> tuple[Problem, Region]:
    """Return a problem with its region in a plane."""
    (x, across), (y, up), fixed = PLANES[name]
    problem = problem_of(ARM).problem
    ranges = {x: Range(*across), y: Range(*up)} | {key: Range(number, number) for key, number in fixed.items()}
    problem = replace(problem, bounds=replace(problem.bounds, **ranges))
    in_plane = plane(problem, f"coupling.{x}", f"coupling.{y}", levels)
    return problem, region(problem, in_plane, in_plane.coarsest_squares())


class Oracle:
    """The environments that put a pole on the unit circle, at many angles in many hands."""

    def __init__(self, problem: Problem, rng: np.random.Generator) -> None:
        assert problem.worlds is not None
        self.low, self.high = problem.worlds.low, problem.worlds.high
        self.shares = np.linspace(1 / problem.stability.safety_factor, 1.0, 3)
        corners = np.array(list(product((0.0, 1.0), repeat=3)))
        inside = np.concatenate((corners, rng.uniform(0, 1, (30, 3)), np.round(rng.uniform(0, 1, (30, 3)))))
        inside[38:, 0] = rng.uniform(0, 1, 30)
        self.hands = inside * astuple(problem.hands.high)
        self.seen = np.array(
            [seen(Whole(PLANT, tuple(hand), (0.0, 0.0), (1.0, 1.0, 1.0)), THETA) for hand in self.hands]
        )
        self.u = 2 / PLANT.sample_time * np.tan(THETA / 2)

    def growing(self, design: Floats) -> float | None:
        """Return the spectral radius of a loop with an environment of the box on the circle; None if there is none."""
        loop = Whole(PLANT, (0.0, 0.0, 0.0), (0.0, 0.0), tuple(design[2:]))
        Y = self.shares[:, None, None] * offered(loop, THETA) + self.seen
        least = self.low.mass * self.u - self.high.stiffness / self.u
        most = self.high.mass * self.u - self.low.stiffness / self.u
        meets = (Y.real + self.low.damping <= 0) & (least <= -Y.imag) & (-Y.imag <= most)
        if not meets.any():
            return None
        share, hand, at = np.unravel_index(np.argmin(np.where(meets, Y.real, np.inf)), Y.shape)
        along = (-Y[share, hand, at].imag - least[at]) / (most[at] - least[at])
        mass = self.low.mass + along * (self.high.mass - self.low.mass)
        stiffness = self.high.stiffness + along * (self.low.stiffness - self.high.stiffness)
        world = mass, float(-Y[share, hand, at].real), stiffness
        whole = replace(loop, hand=tuple(self.hands[hand]))
        return spectral_radius(in_world(whole, world, float(self.shares[share])))

    def greatest_radius(self, design: Floats, rng: np.random.Generator, count: int) -> float:
        """Return the greatest spectral radius with random members of all boxes."""
        found = 0.0
        for _ in range(count):
            hand = tuple(self.hands[rng.integers(len(self.hands))])
            mass = self.low.mass * (self.high.mass / self.low.mass) ** rng.uniform()
            world = mass, self.low.damping, self.high.stiffness * rng.choice([0.0, 1.0, rng.uniform()])
            loop = Whole(PLANT, hand, (0.0, 0.0), tuple(design[2:]))
            found = max(found, spectral_radius(in_world(loop, world, rng.choice(self.shares))))
        return found


def wrong_points(problem: Problem, found: Region, count: int) -> list[tuple[Kind, Floats]]:
    """Return random points of decided cells that whole loops contradict."""
    rng, wrong = np.random.default_rng(1), []
    oracle = Oracle(problem, rng)
    for kind in (Kind.FEASIBLE, Kind.INFEASIBLE):
        squares = found.squares[:, found.kinds == kind]
        cells = found.plane.cells(squares[:, rng.integers(squares.shape[1], size=count)])
        for design in (cells.low + (cells.high - cells.low) * rng.uniform(0, 1, cells.low.shape)).T:
            radius = oracle.growing(design)
            if kind == Kind.INFEASIBLE:
                holds = radius is not None and radius > 1 - 1e-6
            else:
                holds = radius is None and oracle.greatest_radius(design, rng, 10) <= 1 + BEYOND
            if not holds:
                wrong.append((kind, design))
    return wrong


def test_cells_of_couplings_are_as_their_loops_are() -> None:
    problem, found = divided("drag", 4)
    assert found.area(Kind.FEASIBLE) > 0.05 and found.area(Kind.INFEASIBLE) > 0.3
    assert not wrong_points(problem, found, 10)


def test_a_wide_plane_is_decided_at_once() -> None:
    """With free drag, every cell permits some coupling; the hands of a servo need not be divided to prove it."""
    problem = problem_of(ARM).problem
    in_plane = plane(problem, "coupling.damping", "coupling.mass", 3)
    with time_limit(15):
        found = region(problem, in_plane, in_plane.coarsest_squares())
    assert found.area(Kind.UNDECIDED) < 0.1 and found.area(Kind.FEASIBLE) > 0.5


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANES)
def test_none_of_many_points_of_a_servo_is_wrong(name: str) -> None:
    problem, found = divided(name, 8)
    assert found.area(Kind.UNDECIDED) < 0.03
    assert not wrong_points(problem, found, 100)
