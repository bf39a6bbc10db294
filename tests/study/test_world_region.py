"""What may be rendered: cells of environments against spectral radii of the whole loop."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise, product
from math import exp, pi
from pathlib import Path
from time import process_time

import numpy as np
import pytest
from command import run
from numpy.typing import NDArray
from rendered_oracle import Loops, impedance_display, velocity_loop

from vctune.design.rendered import rendered
from vctune.document.reading import read_problem
from vctune.exit_codes import ExitCode
from vctune.model.gains import AnyCoupling, Coupling, Gains, SpringDamper
from vctune.model.problem import Problem
from vctune.study.region import Kind, Region
from vctune.study.world_region import judged, world_plane, world_region

AXES = "environment.stiffness", "environment.mass"
WHEEL = Gains(167.34044, 1e5), Coupling(86.541505, 0.038490164, 0.78317472)
"""Gains of the friction wheel for springs to 2 kN/m and tools of 20 g to 5 kg."""
BEYOND = 1e-9
Radii = Callable[[Loops, float, float], NDArray[np.float64]]


def of_wheel(loops: Loops, m: float, k: float) -> NDArray[np.float64]:
    """Return spectral radii of the friction wheel with these gains."""
    gains, coupling = WHEEL
    law = coupling.damping, coupling.mass, coupling.drag
    return velocity_loop((0.4, 2.0, 1e-3), (gains.velocity, gains.position), law, loops, m, k)


def wheel() -> Problem:
    """Return the friction wheel, with hands of half a kilogram, 30 N s/m and 3 kN/m."""
    return read_problem(Path("tests/reference/worlds/world-tools.toml")).problem


def arm(uncertain: bool = True) -> Problem:
    """Return the desktop arm."""
    problem = read_problem(Path("problems/desktop-arm.toml")).problem
    return problem if uncertain else replace(problem, uncertainty=None)


def loops_of(hands: NDArray[np.float64], factor: float, dampings: tuple[float, ...]) -> Loops:
    """Return each hand, of shape (3, n), with every share of the coupling and every damping."""
    every = [(*hand, share, damping) for hand, share, damping in product(hands.T, {1.0, 1 / factor}, dampings)]
    return Loops(*np.array(every).T)


def corners_and_some(problem: Problem, rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    """Return the corners of a box of hands and random hands, many of them near its edges."""
    high = np.array([problem.hands.high.mass, problem.hands.high.damping, problem.hands.high.stiffness])
    shares = np.array(list(product((0.0, 1.0), repeat=3))).T
    return np.concatenate((shares, rng.uniform(0, 1, (3, count)) ** 4), axis=1) * high[:, None]


def points_of(region: Region, kind: Kind, rng: np.random.Generator, count: int) -> list[tuple[float, float]]:
    """Return masses and stiffnesses in random cells of a kind."""
    squares = region.squares[:, region.kinds == kind]
    found = []
    for cell in rng.integers(squares.shape[1], size=count):
        k, m = (
            rng.uniform(*edges[squares[2 * place : 2 * place + 2, cell]])
            for place, edges in enumerate(region.plane.edges)
        )
        found.append((m, k))
    return found


def map_of(problem: Problem, gains: Gains, coupling: AnyCoupling, levels: int) -> Region:
    """Return the map of a design."""
    return world_region(problem, gains, coupling, world_plane(problem, *AXES, levels))


def agrees(region: Region, radii: Radii, problem: Problem, count: int) -> None:
    """Assert that what is proved of random environments is so."""
    rng, factor = np.random.default_rng(2), problem.stability.safety_factor
    loops = loops_of(corners_and_some(problem, rng, 60), factor, (0.0, 0.3, 3.0))
    for m, k in points_of(region, Kind.FEASIBLE, rng, count):
        assert radii(loops, m, k).max() <= 1 + BEYOND, (m, k)
    for m, k in points_of(region, Kind.INFEASIBLE, rng, count):
        assert radii(loops, m, k).max() > 1, (m, k)


def test_cells_of_environments_are_as_their_loops_are() -> None:
    problem = wheel()
    region = map_of(problem, *WHEEL, 3)
    assert region.area(Kind.FEASIBLE) > 0.2 and region.area(Kind.INFEASIBLE) > 0.2
    agrees(region, of_wheel, problem, 40)


def boundary(
    radii: Radii, problem: Problem, stable: float, unstable: float, m: float, rng: np.random.Generator
) -> float:
    """Return the stiffness between two at which the whole loop loses its stability in some hand, by bisection to 0.2 %.

    In each step the hands are those of a grid and others next to the worst so far.
    """
    high = np.array([problem.hands.high.mass, problem.hands.high.damping, problem.hands.high.stiffness])
    hands, worst = corners_and_some(problem, rng, 20), np.zeros(3)
    while abs(unstable / stable - 1) > 2e-3:
        k = (stable * unstable) ** 0.5
        grows = False
        for width in (0.3, 0.1, 0.03):
            near = np.clip(worst + rng.normal(0, width, (30, 3)) * (worst + 0.01 * high), 0, high).T
            loops = loops_of(
                np.concatenate((hands, near, worst[:, None]), axis=1), problem.stability.safety_factor, (0.0, 0.3)
            )
            found = radii(loops, m, k)
            at = int(found.argmax())
            worst = np.array([loops.mass[at], loops.damping[at], loops.stiffness[at]])
            if found[at] > 1 + BEYOND:
                grows = True
                break
        stable, unstable = (stable, k) if grows else (k, unstable)
    return (stable * unstable) ** 0.5


def kind_at(region: Region, m: float, k: float) -> Kind:
    """Return what is proved of an environment."""
    (x, y), squares = region.plane.edges, region.squares
    i, j = np.searchsorted(x, k, side="right") - 1, np.searchsorted(y, m, side="right") - 1
    inside = (squares[0] <= i) & (i < squares[1]) & (squares[2] <= j) & (j < squares[3])
    return Kind(region.kinds[np.flatnonzero(inside)[0]])


@pytest.mark.slow
def test_the_map_of_the_friction_wheel_is_bounded_where_its_loops_grow() -> None:
    problem, rng = wheel(), np.random.default_rng(3)
    began = process_time()
    region = map_of(problem, *WHEEL, 8)
    seconds = process_time() - began
    assert region.area(Kind.UNDECIDED) < 0.02 and seconds < 30
    edges, wrong, done = region.plane.edges, [], 0
    while done < 500:
        m = float(np.exp(rng.uniform(np.log(edges[1][1]), np.log(edges[1][-1]))))
        kinds = np.array([kind_at(region, m, k) for k in edges[0][1:-1] * 1.0001])
        decided = np.flatnonzero(kinds != Kind.UNDECIDED)
        changes = [(a, b) for a, b in pairwise(decided) if kinds[a] != kinds[b]]
        for a, b in changes:
            good, bad = (a, b) if kinds[a] == Kind.FEASIBLE else (b, a)
            at = edges[0][1:-1] * 1.0001
            k = boundary(of_wheel, problem, at[good], at[bad], m, rng)
            inside, outside = (k * 0.99, k * 1.01) if at[good] < at[bad] else (k * 1.01, k * 0.99)
            done += 1
            if kind_at(region, m, inside) == Kind.INFEASIBLE or kind_at(region, m, outside) == Kind.FEASIBLE:
                wrong.append((m, k, kind_at(region, m, inside), kind_at(region, m, outside)))
    assert not wrong


def of_arm(coupling: SpringDamper) -> Radii:
    """Return spectral radii of the desktop arm with a coupling."""
    a = 1 - exp(-2 * pi * 100.0 * 1e-3)
    device = (0.045, 0.25, 1e-3, 0.5e-3, a)
    return lambda loops, m, k: impedance_display(device, (coupling.damping, coupling.stiffness), loops, m, k)


def test_the_desktop_arm_may_render_everything() -> None:
    found = rendered(arm(), Gains(0.0, 0.0), SpringDamper(0.047937331, 158.91247))
    assert found.every
    plane = world_plane(arm(), *AXES, 8)
    kinds, _ = judged(found, plane, plane.coarsest_squares())
    assert (kinds == Kind.FEASIBLE).all()


@pytest.mark.slow
def test_environments_of_an_impedance_display_are_as_their_loops_are() -> None:
    problem, coupling = arm(uncertain=False), SpringDamper(2.0, 2300.0)
    problem = replace(problem, hands=replace(problem.hands, low=replace(problem.hands.low, damping=1.0)))
    found, rng = rendered(problem, Gains(0.0, 0.0), coupling), np.random.default_rng(5)
    hands = corners_and_some(problem, rng, 100)
    hands[1] = np.maximum(hands[1], 1.0)
    loops = loops_of(hands, problem.stability.safety_factor, (0.0, 0.1, 1.0))
    radii = of_arm(coupling)
    plane = world_plane(problem, *AXES, 3)
    squares = plane.coarsest_squares()
    kinds, _ = judged(found, plane, squares)
    assert np.bincount(kinds, minlength=3)[1:].min() > 3
    region = Region(plane, squares, kinds, np.full(kinds.size, np.nan))
    for m, k in points_of(region, Kind.FEASIBLE, rng, 30):
        assert radii(loops, m, k).max() <= 1 + BEYOND, (m, k)
    for m, k in points_of(region, Kind.INFEASIBLE, rng, 30):
        assert radii(loops, m, k).max() > 1, (m, k)


def test_the_command_writes_a_map_that_check_proves_again(tmp_path: Path) -> None:
    """With other hands less of it is proved."""
    path, gains = tmp_path / "wheel.toml", tmp_path / "gains.toml"
    path.write_text(Path("tests/reference/worlds/world-tools.toml").read_text())
    of_gains, coupling = WHEEL
    text = f"[gains]\nvelocity = {of_gains.velocity}\nposition = {of_gains.position}\n[coupling]\n"
    gains.write_text(f"{text}damping = {coupling.damping}\nmass = {coupling.mass}\ndrag = {coupling.drag}\n")
    made = run("region", str(path), str(gains), "--x", AXES[0], "--resolution", "0.125", "--out", ".", cwd=tmp_path)
    assert made.returncode == ExitCode.OK, made.stderr
    assert "of the plane environment.stiffness by environment.mass" in made.stdout
    found = tmp_path / "world-tools" / "z-width.json"
    record = json.loads(found.read_text())
    assert record["axes"] == {"x": AXES[0], "y": AXES[1]} and len(record["designs"]) == 1
    assert (found.parent / "z-width.svg").exists()
    again = run("check", str(path), "--region", str(found), cwd=tmp_path)
    assert again.returncode == ExitCode.OK, again.stdout
    path.write_text(path.read_text().replace("max = 3000.0", "max = 9000.0"))
    stiffer = run("check", str(path), "--region", str(found), cwd=tmp_path)
    assert stiffer.returncode == ExitCode.FAILED and "lost their proof" in stiffer.stdout
    refused = run("region", str(path), "--x", AXES[0], "--y", "gains.velocity", cwd=tmp_path)
    assert "[no-plane]" in refused.stderr
