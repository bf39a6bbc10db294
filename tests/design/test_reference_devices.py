"""Devices with parts whose optima were found elsewhere: those optima by the oracles alone, and what vctune finds."""

from __future__ import annotations

import json

import numpy as np
import pytest
from arithmetic import DOUBLES
from conftest import ROOT, mostly_slow
from device_oracle import Coupling, Gains, Real, coupling_impedance, laplace, read_device, response
from firmware import spectral_radius
from sampled_device_oracle import sensitivity

from vctune.design.solve import solve
from vctune.design.verdict.judge import Status
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


def posed(name: str) -> tuple[Real, Problem]:
    path = FOLDER / f"{name}.toml"
    return read_device(path), read_problem(path).problem


def error(device: Real, problem: Problem, gains: Gains, coupling: Coupling) -> float:
    """Return the root mean square over log f of Z_0 |G_hh|, |1 - G_he| and |Z_c|/Z_0 together."""
    Z_0 = problem.transparency.reference_impedance
    low, high = np.log(problem.transparency.band.hz)
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    square = 0.0
    for node, weight in zip(nodes, weights, strict=True):
        hertz = float(np.exp((low + high) / 2 + node * (high - low) / 2))
        found = response(device, gains, hertz, DOUBLES)
        Z_c = coupling_impedance(coupling, laplace(hertz, DOUBLES), DOUBLES)
        square += weight / 2 * ((Z_0 * abs(found.G_hh)) ** 2 + abs(found.tracking) ** 2 + (abs(Z_c) / Z_0) ** 2)
    return float(square**0.5)


def least_ratio(device: Real, problem: Problem, gains: Gains, coupling: Coupling) -> float:
    """Return the least Re Z_c/R on a grid of the stability band, of the frequencies at which R is positive."""
    ratios = []
    for hertz in np.geomspace(*problem.stability.band.hz, GRID):
        found = response(device, gains, float(hertz), DOUBLES)
        assert found.G_hh.real > 0
        if found.required > 0:
            Z_c = coupling_impedance(coupling, laplace(float(hertz), DOUBLES), DOUBLES)
            ratios.append(Z_c.real / found.required)
    return min(ratios)


def greatest_sensitivity(device: Real, gains: Gains) -> float:
    hertz = np.linspace(0.01, 0.5 / device.sample_time, GRID)
    return max(abs(sensitivity(device, gains, float(f), DOUBLES)) for f in hertz)


@pytest.mark.parametrize("name", mostly_slow(EXPECTED, FEW))
def test_what_was_expected_is_admissible_and_touches_the_demand(name: str) -> None:
    device, problem = posed(name)
    optimum = EXPECTED[name]
    gains = Gains(optimum["velocity"], optimum["position"])
    coupling = Coupling(optimum["damping"], optimum["mass"], optimum["drag"])
    assert error(device, problem, gains, coupling) == pytest.approx(optimum["error"], rel=1e-6)
    assert spectral_radius(device, gains, num=DOUBLES) < 1
    assert greatest_sensitivity(device, gains) < problem.stability.max_sensitivity * (1 + BETWEEN)
    touched = problem.stability.safety_factor
    assert least_ratio(device, problem, gains, coupling) == pytest.approx(touched, rel=BETWEEN)


@pytest.mark.parametrize("name", mostly_slow(EXPECTED, FEW))
def test_vctune_finds_it(name: str) -> None:
    device, problem = posed(name)
    solved = solve(problem)
    assert solved.status is Status.CERTIFIED
    judgement = solved.judgement
    gains = Gains(judgement.gains.velocity, judgement.gains.position)
    coupling = Coupling(judgement.coupling.damping, judgement.coupling.mass, judgement.coupling.drag)
    found = judgement.transparency.error
    assert found == pytest.approx(EXPECTED[name]["error"], rel=3e-3)
    assert found == pytest.approx(error(device, problem, gains, coupling), rel=1e-6)
    assert spectral_radius(device, gains, num=DOUBLES) < 1
    assert judgement.peak_sensitivity == pytest.approx(greatest_sensitivity(device, gains), rel=BETWEEN)
    assert judgement.min_ratio == pytest.approx(least_ratio(device, problem, gains, coupling), rel=BETWEEN)
    assert judgement.min_ratio >= problem.stability.safety_factor
