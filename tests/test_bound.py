"""The lower bound against closed forms, other units and designs judged by independent code."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

import design_oracle as oracle
import numpy as np
import pytest
from conftest import DEVICE

from vctune.design.bound import Optimality, bound
from vctune.design.judge import Judgement, Status
from vctune.design.solve import improved, solve
from vctune.document.errors import InputError
from vctune.document.problem import Problem
from vctune.document.reading import parse_problem, read_problem
from vctune.proof.least import floors, least_coupling
from vctune.proof.relaxation import Boxes, relaxation

GAP = 0.03
RANDOM = 2
"""Seed of the random problems; another one makes others."""


def problem_of(text: str) -> Problem:
    return parse_problem(text, "problem.toml", "problem")


def random_problems(count: int, seed: int = RANDOM) -> list[Problem]:
    """Return valid problems that leave something free."""

    def valid():
        for text in oracle.random_texts(seed):
            try:
                problem = problem_of(text)
            except InputError:
                continue
            if not problem.bounds.fixed:
                yield problem

    return list(islice(valid(), count))


def searched(problem: Problem, best: Judgement | None, gap: float = GAP, **options) -> Optimality:
    return bound(problem, best, lambda gains, limit: improved(problem, gains, limit), gap=gap, **options)


def hopeless(gains, limit) -> None:
    """Never find a better design."""


def numbers(judgement: Judgement) -> np.ndarray:
    gains, coupling = judgement.gains, judgement.coupling
    return np.array([gains.velocity, gains.position, coupling.damping, coupling.mass, coupling.drag])


def attacked(problem: Problem, count: int, seed: int = 0) -> None:
    """Let random designs, half of them around the best one, try to be below the bound."""
    best = solve(problem).judgement
    if best is None or best.status is not Status.CERTIFIED:
        return
    found = searched(problem, best, time_limit=20)
    assert 0 < found.bound <= found.incumbent
    rng, near = np.random.default_rng(seed), numbers(found.improved or best)
    for around in (None, near):
        below = oracle.below(problem, found.bound, oracle.random_designs(problem, count // 2, rng, around))
        assert below.shape[1] == 0, below[:, :3]
    assert oracle.errors(problem, near[:, None], 4000)[0] == pytest.approx(found.incumbent, rel=1e-3)


@pytest.mark.parametrize("name", ["friction-wheel", "cobot-wrist", "extremes/peak", "extremes/whole-axis"])
def test_no_random_design_is_below_the_bound(name, problems):
    attacked(read_problem(problems / f"{name}.toml").problem, 20_000)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(20))
def test_a_million_random_designs_are_not_below_the_bound(number):
    attacked(random_problems(20)[number], 1_000_000)


@pytest.mark.parametrize("problem", random_problems(40), ids=lambda problem: str(id(problem))[:0] or "random")
def test_boxes_cost_no_more_than_the_designs_in_them(problem):
    rng, count = np.random.default_rng(1), 300
    designs = oracle.random_designs(problem, count, rng)
    omega, upto = np.geomspace(*oracle.band(problem), 30), np.geomspace(problem.nyquist * 1e-3, problem.nyquist, 20)
    relaxed = relaxation(problem, omega, upto, 24)
    K_v, K_p, b_c, m_c, b_0 = designs
    inner = np.array([K_v, K_p, m_c / b_c, b_0])
    size = 10.0 ** rng.uniform(-4, 1, (2, 4, count)) * (rng.random((2, 4, count)) < 0.8)
    boxes = Boxes(inner / (1 + size[0]), inner * (1 + size[1]))
    with np.errstate(all="ignore"):
        floor, least = floors(relaxed, boxes), least_coupling(relaxed, boxes)
        needed = oracle.least_damping(problem, designs, omega)
    meets = oracle.within_bounds(problem, designs) & (b_c >= needed) & np.isfinite(needed)
    Z_d, C = oracle.loops(problem, designs, upto)
    quiet = (np.abs(Z_d / (Z_d + C)) <= problem.stability.max_sensitivity).all(axis=1)
    rounding = 1 + 1e-9
    assert not (least.none & np.isfinite(needed)).any()
    assert (least.damping[meets] <= b_c[meets] * rounding).all()
    assert (least.mass[meets] <= m_c[meets] * rounding).all()
    at = meets & quiet
    if problem.stability.band.min == 0:  # where the limit of R at omega = 0 counts, which no grid has
        at &= K_p == 0
    assert (floor.strain[at] <= rounding).all()
    errors = oracle.errors(problem, designs, 24 if problem.transparency.norm == "peak" else 2000)
    assert (floor.error[at] <= errors[at] * (1 + 1e-6)).all()


LOOP = DEVICE + "[gains]\nvelocity = 150.0\nposition = 6000.0\n"
ELEMENTS = {
    "damping": "[coupling]\nmass = 0.5\n",
    "mass": "[coupling]\ndamping = 160.0\n",
    "drag": "[coupling]\ndamping = 1.0\nmass = 1e-3\ndrag = { min = 0.0, max = 1e3 }\n",
}


def least_element(problem: Problem, element: str) -> float:
    """Return the least b_c, m_c or b_0 that a fixed loop and the other elements leave, on a dense grid."""
    omega, fixed = np.geomspace(*oracle.band(problem), 200_001), problem.bounds
    design = np.array([[fixed.velocity.min], [fixed.position.min], [1.0], [1.0], [0.0]])
    r = problem.stability.safety_factor * oracle.resistances(problem, design, omega)[0]
    if element == "damping":  # b M^2/(b^2 + M^2) >= r
        M = omega * fixed.mass.min
        return float((2 * r * M / (M + np.sqrt(M**2 - 4 * r**2))).max())
    if element == "mass":  # b x^2/(1 + x^2) >= r with x = omega m/b
        b = fixed.damping.min
        return float((b / omega * np.sqrt(r / (b - r))).max())
    x2 = (omega * fixed.mass.min / fixed.damping.min) ** 2
    return float((r - fixed.damping.min * x2 / (1 + x2)).max())


@pytest.mark.parametrize("norm", ["rms", "peak"])
@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize("gap", [1e-2, 1e-4])
def test_one_free_coupling_element_meets_its_closed_form(element, norm, gap):
    problem = problem_of(LOOP + ELEMENTS[element] + f'[transparency]\nnorm = "{norm}"\n')
    bounds = problem.bounds
    design = np.array([[getattr(bounds, name).min] for name in ("velocity", "position", "damping", "mass", "drag")])
    design[2 + ["damping", "mass", "drag"].index(element)] = least_element(problem, element)
    optimum = oracle.errors(problem, design, 20_000)[0]
    best = solve(problem).judgement
    assert best is not None
    found = searched(problem, best, gap)
    assert found.proved
    assert optimum / (1 + gap) * (1 - 1e-4) <= found.bound <= optimum * (1 + 1e-6)


@pytest.mark.parametrize("impedance, time", [(1e-3, 1.0), (7.3, 1e-3), (1e6, 3600.0), (0.11, 1e4)])
@pytest.mark.parametrize("name", ["friction-wheel", "extremes/peak", "friction-wheel-paper"])
def test_units_change_neither_bound_nor_boxes(name, impedance, time, problems):
    problem = read_problem(problems / f"{name}.toml").problem
    best = solve(problem).judgement
    assert best is not None

    def run(posed: Problem) -> Optimality:
        gains = replace(
            best.gains, velocity=best.gains.velocity / impedance, position=best.gains.position * time / impedance
        )
        coupling = replace(
            best.coupling, damping=best.coupling.damping / impedance, mass=best.coupling.mass / impedance / time
        )
        known = best if posed is problem else replace(best, gains=gains, coupling=coupling)
        return bound(posed, known, hopeless, gap=0.02)

    here, there = run(problem), run(problem.in_units(impedance, time))
    assert there.bound == pytest.approx(here.bound, rel=1e-6)
    assert there.rest.boxes == pytest.approx(here.rest.boxes, rel=0.02)
