"""Random devices with random parts over ten decades, solved, and judged by oracles that share no code."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pytest
from arithmetic import DIGITS
from conftest import drawn, mostly_slow
from frequency import demanded, offered
from loop import Loop, radius, sensitivity
from random_devices import parts

from vctune.design.judging.judge import Status
from vctune.design.solve import solve
from vctune.document.reading import problem_at

FACTOR, LIMIT = 1.05, 2.0
FEW, MANY = 6, drawn(60)
MOST_UNDECIDED = 0.05
"""Of random devices; of the first 80 one is neither solved nor proved infeasible."""
UNITS = 2.0**7, 2.0**-5
"""Of impedance and of time."""


def document(seed):
    """A device over ten decades; each of its parts is there as often as not. Bands and bounds by default, some drag."""
    rng = np.random.default_rng(seed)
    T, mass = 10 ** rng.uniform(-5, -2), 10 ** rng.uniform(-5, 5)
    delay = T * rng.uniform(0, 3) if rng.random() < 0.4 else 0.0
    damping = mass / (T / 2 + delay) * 10 ** rng.uniform(-8, 0) if rng.random() < 0.9 else 0.0
    device = {"mass": mass, "damping": damping, "sample_time": T, "delay": delay}
    device |= parts(rng, device, (-2, 1.5), 0.5)
    operator = {"operator": {"damping": damping * rng.uniform(0.1, 3)}} if damping > 0 and rng.random() < 0.3 else {}
    tables = {"coupling": {"drag": {"min": 0.0, "max": mass / T}}, "stability": {"criterion": "passive"}}
    return {"device": device, **operator, **tables}


def posed(tables):
    problem, faults = problem_at(tables, "random")
    assert problem is not None and not faults, faults
    return problem


def settled(seed):
    """Whether a random device is solved, or proved to have no design; a design is held against the oracles."""
    tables = document(seed)
    problem = posed(tables)
    solved = solve(problem)
    if solved.status is not Status.CERTIFIED:
        return solved.status is Status.INFEASIBLE
    gains, coupling = astuple(solved.judgement.gains), astuple(solved.judgement.coupling)
    for hz in np.geomspace(*problem.stability.band.hz, 40):
        s = DIGITS.i * 2 * DIGITS.pi * DIGITS.number(float(hz))
        needed = demanded(tables, gains, s).required
        assert offered(coupling, s).real >= FACTOR * (1 - 1e-9) * needed, seed
    loop = Loop(tables["device"], gains)
    z = np.exp(1j * np.pi * np.linspace(0.002, 1 - 1e-9, 80))
    assert np.abs(sensitivity(loop, z)).max() <= LIMIT + 1e-6, seed
    assert radius(loop, at_rest=True) < 1, seed
    return True


@pytest.mark.parametrize("seed", mostly_slow(range(FEW), range(3)))
def test_designs_hold(seed):
    assert settled(seed)


@pytest.mark.slow
def test_designs_of_many_hold():
    assert sum(not settled(seed) for seed in range(MANY)) <= MOST_UNDECIDED * MANY


@pytest.mark.parametrize("seed", mostly_slow(range(FEW), range(3)))
def test_units_do_not_matter(seed):
    problem = posed(document(seed))
    here, there = solve(problem), solve(problem.in_units(*UNITS))
    assert here.status is there.status
    assert there.judgement.error == pytest.approx(here.judgement.error, rel=1e-6)
    verdicts, same = (
        {claim: outcome.verdict for claim, outcome in each.judgement.certificate.outcomes.items()}
        for each in (here, there)
    )
    assert verdicts == same
