"""Random devices with random parts over ten decades: solved, or proved to have no design, in any units."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from conftest import drawn, mostly_slow
from draws import of_any_size

import vctune
from vctune.design.judging.judge import Status
from vctune.design.solve import solve

MANY = drawn(60)
MOST_UNDECIDED = 0.05
"""Of random devices; of the first 80 one is neither solved nor proved infeasible."""
UNITS = 2.0**7, 2.0**-5
"""Of impedance and of time."""


def posed(seed):
    """Bands and bounds by default, some drag."""
    rng = np.random.default_rng(seed)
    device = of_any_size(rng, (-2, 1.5), 0.5)
    tables = {"device": device, "coupling": {"drag": {"min": 0.0, "max": device["mass"] / device["sample_time"]}}}
    if device["damping"] > 0 and rng.random() < 0.3:
        tables["operator"] = {"damping": float(device["damping"] * rng.uniform(0.1, 3))}
    return vctune.problem(tables | {"stability": {"criterion": "passive"}}).problem


@pytest.mark.slow
def test_most_are_solved_or_proved_to_have_no_design():
    """What is certified is so by the claims of `test_claims`."""
    found = Counter(solve(posed(seed)).status for seed in range(MANY))
    assert MANY - found[Status.CERTIFIED] - found[Status.INFEASIBLE] <= MOST_UNDECIDED * MANY, found
    assert found[Status.CERTIFIED] >= MANY / 4, found


@pytest.mark.parametrize("seed", mostly_slow(range(6), range(3)))
def test_units_do_not_matter(seed):
    problem = posed(seed)
    here, there = solve(problem), solve(problem.in_units(*UNITS))
    assert here.status is there.status is Status.CERTIFIED
    assert there.judgement.error == pytest.approx(here.judgement.error, rel=1e-6)
    verdicts, same = (
        {claim: outcome.verdict for claim, outcome in each.judgement.certificate.outcomes.items()}
        for each in (here, there)
    )
    assert verdicts == same
