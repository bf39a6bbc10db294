"""Lower bounds on the error with a box of environments: feasible designs never have less, and the gap is small."""

from __future__ import annotations

from dataclasses import astuple, replace
from pathlib import Path

import numpy as np
import pytest

from vctune.analysis.demands import sensitivity_maxima, transparency_error
from vctune.analysis.in_hands import least_ratios
from vctune.api.bounding import bound
from vctune.design.bound.relaxation import ImposedPlaces, lower_bounds, objective_of, relaxation
from vctune.document.reading import read_problem
from vctune.model.gains import AnyCoupling, Coupling, Gains
from vctune.model.hands import Hand, PlacesInHands
from vctune.model.problem import Problem
from vctune.proof.boxes import Cells

WORLDS = Path("tests/reference/worlds")
NAMES = "world-tools", "world-heavy-tools"


def problem_of(name: str) -> Problem:
    """Return a problem with a box of environments."""
    return read_problem(WORLDS / f"{name}.toml").problem


def feasible(problem: Problem, gains: Gains, coupling: AnyCoupling) -> bool:
    """Return whether a design meets the constraints in double precision."""
    if -sensitivity_maxima(problem, gains).value[0] > problem.stability.max_sensitivity:
        return False
    return min(each.ratio for each in least_ratios(problem, gains, coupling)) >= problem.stability.safety_factor


def feasible_designs(problem: Problem, rng: np.random.Generator, count: int) -> list[tuple[Gains, Coupling, float]]:
    """Return random feasible designs with about the least scale of their couplings, with their errors."""
    found = list[tuple[Gains, Coupling, float]]()
    while len(found) < count:
        gains = Gains(rng.uniform(20.0, 168.0), 10 ** rng.uniform(3.5, 5.0))
        coupling = Coupling(*(10 ** rng.uniform((-0.5, -3.0, -0.5), (2.5, 0.0, 1.0))))
        if feasible(problem, gains, coupling):
            low, high = 0.0, 1.0
            for _ in range(5):
                middle = (low + high) / 2
                low, high = (low, middle) if feasible(problem, gains, coupling.times(middle)) else (middle, high)
            coupling = coupling.times(high)
            found.append((gains, coupling, transparency_error(problem, gains, coupling).error))
    return found


def random_places(problem: Problem, rng: np.random.Generator, count: int) -> ImposedPlaces:
    """Return frequencies and hands at random, many of them at the ends of their ranges."""
    nyquist, low, high = problem.nyquist, astuple(problem.hands.low), astuple(problem.hands.high)
    omega = np.concatenate(([0.0, nyquist], nyquist * 10 ** rng.uniform(-3, 0, count - 2)))
    shares = np.round(rng.uniform(-0.5, 1.5, (3, count)).clip(0.0, 1.0), 2)
    hand = [a + (b - a) * share for a, b, share in zip(low, high, shares, strict=True)]
    return ImposedPlaces(np.zeros(0), np.geomspace(1.0, nyquist, 20), PlacesInHands(omega, Hand(*hand)))


def check_bounds(name: str, designs: int, places: int, damping: float = 0.0) -> float:
    """Assert that no design is below the bound of a box around it; return the greatest quotient of bound and error."""
    problem, rng = problem_of(name), np.random.default_rng(4)
    problem = replace(problem, worlds=replace(problem.worlds, low=replace(problem.worlds.low, damping=damping)))
    relaxed = relaxation(
        problem, [problem.device], random_places(problem, rng, places), objective_of(problem, [problem.device], 48)
    )
    found = feasible_designs(problem, rng, designs)
    numbers = np.array([[g.velocity, g.position, c.mass / c.damping, c.drag] for g, c, _ in found]).T
    errors, tight = np.array([error for *_, error in found]), 0.0
    for width in (0.0, 1e-3, 0.03, 0.5):
        low, high = numbers / (1 + width * rng.uniform(0, 1, numbers.shape)), numbers * (1 + width)
        bounds = lower_bounds(relaxed, Cells(low, high))[0]
        assert (bounds <= errors * (1 + 1e-9)).all()
        tight = max(tight, float((bounds / errors).max()))
    return tight


@pytest.mark.slow
@pytest.mark.parametrize("damping", [0.0, 3.0])
def test_no_feasible_design_is_below_the_bound_of_its_box(damping: float) -> None:
    assert check_bounds("world-tools", 5, 100, damping) > (0.6 if damping == 0 else 0.2)


@pytest.mark.night
@pytest.mark.parametrize("name", NAMES)
def test_none_of_many_designs_is_below_the_bound_of_its_box(name: str) -> None:
    assert check_bounds(name, 150, 2000) > 0.9


@pytest.mark.slow
@pytest.mark.parametrize(("name", "gap"), [("world-tools", 0.04), ("world-heavy-tools", 0.1)])
def test_the_best_designs_are_proved_to_be_nearly_so(name: str, gap: float) -> None:
    found = bound(WORLDS / f"{name}.toml", gap=gap)
    assert found.proved and found.judgement is not None and found.optimality is not None
    assert found.optimality.bound <= found.judgement.error <= (1 + gap) * found.optimality.bound
