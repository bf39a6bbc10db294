"""Norm "peak": no design errs less than those of a global search with formulas of its own."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import ROOT, mostly_slow
from global_search import Judge, global_search, random_text

from vctune.analysis.demands import transparency_error
from vctune.design.solve import solve
from vctune.document.reading import parse_problem, read_problem

WORSE = 1e-3
VALLEY = ROOT / "tests/basins/valley.toml"


@pytest.mark.slow
def test_a_peak_that_moves_with_the_gains():
    """The design next to it at K_v = 17.1 errs by 1.5667."""
    problem = read_problem(VALLEY).problem
    error, design = global_search(problem, 1, runs=1)
    assert error == pytest.approx(1.54951, rel=1e-4)
    assert design[1] == 0
    judgement = solve(problem).judgement
    assert judgement.error <= error * (1 + WORSE)
    assert judgement.gains.velocity == pytest.approx(design[0], rel=0.1)


def test_an_answer_in_another_basin_than_its_start_is_sent_back():
    """An interior-point method leaves the corner of both gains' upper bounds for K_p = 0, 3 % above."""
    problem = read_problem(ROOT / "tests/basins/corner.toml").problem
    judgement = solve(problem).judgement
    assert judgement.gains.position == pytest.approx(problem.bounds.position.max, rel=1e-3)
    assert judgement.error <= global_search(problem, 1, runs=1)[0] * (1 + WORSE)


@pytest.mark.parametrize("seed", mostly_slow(range(500), []))
def test_nothing_better_is_found(seed):
    problem = parse_problem(random_text(seed), "random.toml", "random")
    error, _ = global_search(problem, seed, runs=2)
    judgement = solve(problem).judgement
    assert judgement is not None or error == np.inf
    assert judgement is None or judgement.error <= error * (1 + WORSE)


def test_the_global_search_judges_as_vctune_does():
    problem = read_problem(VALLEY).problem
    judgement = solve(problem).judgement
    gains, coupling = judgement.gains, judgement.coupling
    at = np.array([gains.velocity]), np.array([gains.position]), np.array([coupling.mass / coupling.damping])
    violation, error, b_c = Judge(problem, 20.0)(*at)
    assert violation == 0
    assert b_c == pytest.approx(coupling.damping, rel=1e-4)
    assert error == pytest.approx(transparency_error(problem, gains, coupling).error, rel=1e-4)
