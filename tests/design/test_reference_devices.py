"""Devices with parts whose optima were found elsewhere: those optima by the oracles alone, and what vctune finds."""

from __future__ import annotations

import json
import tomllib
from dataclasses import astuple

import numpy as np
import pytest
from arithmetic import DOUBLES
from conftest import ROOT, mostly_slow
from frequency import Tables, demanded, offered
from loop import Loop, radius, sensitivity

from vctune.design.judging.judge import Status
from vctune.design.solve import solve
from vctune.document.reading import read_problem
from vctune.model.problem import Problem

FOLDER = ROOT / "tests/reference/real"
EXPECTED = json.loads((FOLDER / "expected.json").read_text())
FEW = ("real-actuator", "real-difference")
"""Those that are looked for each time."""
GRID = 4000
"""Frequencies on which the oracles look for the least ratio and the greatest |S|; what lies between two of them is
within 2e-5 of the smaller one for these optima."""
BETWEEN = 2e-5
NODES = 60
"""Of Gauss and Legendre over two decades: the errors change in the tenth digit with twice as many."""


Triple = tuple[float, float, float]


def posed(name: str) -> tuple[Tables, Problem]:
    path = FOLDER / f"{name}.toml"
    return tomllib.loads(path.read_text()), read_problem(path).problem


def error(tables: Tables, problem: Problem, gains: tuple[float, float], coupling: Triple) -> float:
    """Return the root mean square over log f of Z_0 |G_hh|, |1 - G_he| and |Z_c|/Z_0 together."""
    Z_0 = problem.transparency.reference_impedance
    low, high = np.log(problem.transparency.band.hz)
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    s = 2j * np.pi * np.exp((low + high) / 2 + nodes * (high - low) / 2)
    found, Z_c = demanded(tables, gains, s, DOUBLES), offered(coupling, s, DOUBLES)
    squares = (Z_0 * abs(found.G_hh)) ** 2 + abs(found.tracking) ** 2 + (abs(Z_c) / Z_0) ** 2
    return float((weights / 2 @ squares) ** 0.5)


def least_ratio(tables: Tables, problem: Problem, gains: tuple[float, float], coupling: Triple) -> float:
    """Return the least Re Z_c/R on a grid of the stability band, of the frequencies at which R is positive."""
    s = 2j * np.pi * np.geomspace(*problem.stability.band.hz, GRID)
    found = demanded(tables, gains, s, DOUBLES)
    assert (found.G_hh.real > 0).all()
    asked = found.required > 0
    return float((offered(coupling, s, DOUBLES).real[asked] / found.required[asked]).min())


def held(tables: Tables, problem: Problem, gains: tuple[float, float]) -> float:
    """Return the greatest |S| of a loop, and assert that it is stable."""
    loop, theta = Loop(tables["device"], gains), np.linspace(2e-5, 1, GRID) * np.pi
    assert radius(loop, at_rest=True) < 1
    return float(np.abs(sensitivity(loop, np.exp(1j * theta))).max())


@pytest.mark.parametrize("name", mostly_slow(EXPECTED, FEW))
def test_vctune_finds_the_optimum_which_touches_the_demand(name: str) -> None:
    tables, problem = posed(name)
    known = EXPECTED[name]
    gains, coupling = (known["velocity"], known["position"]), (known["damping"], known["mass"], known["drag"])
    assert error(tables, problem, gains, coupling) == pytest.approx(known["error"], rel=1e-6)
    assert held(tables, problem, gains) < problem.stability.max_sensitivity * (1 + BETWEEN)
    factor = problem.stability.safety_factor
    assert least_ratio(tables, problem, gains, coupling) == pytest.approx(factor, rel=BETWEEN)
    solved = solve(problem)
    assert solved.status is Status.CERTIFIED
    judgement = solved.judgement
    gains, coupling = astuple(judgement.gains), astuple(judgement.coupling)
    found = judgement.transparency.error
    assert found == pytest.approx(known["error"], rel=3e-3)
    assert found == pytest.approx(error(tables, problem, gains, coupling), rel=1e-6)
    assert judgement.peak_sensitivity == pytest.approx(held(tables, problem, gains), rel=BETWEEN)
    assert judgement.min_ratio == pytest.approx(least_ratio(tables, problem, gains, coupling), rel=BETWEEN)
    assert judgement.min_ratio >= factor
