"""The scan: local minima, the limits of the gains, basins; and the grids that extrema are looked for on."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from vctune.analysis.demands import ratio_minima, sensitivity_maxima, slowest_resonance
from vctune.bench.evaluator import case_of, sensitivity
from vctune.bench.solvers import reference_problems
from vctune.bench.stress import device
from vctune.design.solve import solve
from vctune.model.gains import Coupling, Gains

PROBLEMS = reference_problems()
ANY = Coupling(1.0, 1.0, 0.0)


def test_slow_resonances_are_seen():
    """|S| of an undamped loop peaks at sqrt(K_p/m), however far below the bands that is."""
    problem = PROBLEMS["friction-wheel"]
    slow = replace(problem, device=replace(problem.device, damping=0.0))
    gains = Gains(1e-3, 1.0)
    ring = (gains.position / slow.device.mass) ** 0.5
    assert slowest_resonance(slow, gains.velocity) < ring < slow.transparency.band.min
    peaks = sensitivity_maxima(slow, gains)
    assert peaks.omega[0] == pytest.approx(ring, rel=0.02)
    omega = np.geomspace(ring / 2, ring * 2, 200_001)
    S = sensitivity(case_of(slow.device, gains, ANY), omega)
    assert -peaks.value[0] == pytest.approx(S.max(), rel=1e-6)


def up_to_a_tenth_of_the_sampling_rate(number):
    """A random device with a stability band that its delay has not narrowed."""
    document, problem = device(0, number)
    if "band_hz" in document.get("stability", {}):
        return problem
    band = replace(problem.stability.band, max=2 * pi * 0.1 / problem.device.sample_time)
    return replace(problem, stability=replace(problem.stability, band=band))


@pytest.mark.parametrize(
    ("number", "status"),
    [
        (177, "certified"),  # a ripple between the points of a logarithmic grid
        (1366, "certified"),  # a drag that is 2e-11 of its bound and matters
        (1432, "certified"),
        (1799, "certified"),
        (1509, "infeasible"),  # a resonance a thousand times below Nyquist
        (1785, "infeasible"),
    ],
)
def test_devices_that_a_search_gave_up_on(number, status):
    problem = up_to_a_tenth_of_the_sampling_rate(number)
    solved = solve(problem)
    assert solved.status.value == status
    if solved.judgement is not None:
        factor = problem.stability.safety_factor
        assert ratio_minima(problem, solved.judgement.gains, solved.judgement.coupling).value[0] >= factor * (1 - 1e-9)


@pytest.mark.slow
def test_a_design_below_a_gain_limit_that_no_coupling_can_have():
    """The greatest feasible K_v needs more than any coupling gives, a lower one does not."""
    problem = up_to_a_tenth_of_the_sampling_rate(148)
    least = 1e-5 * (problem.device.mass / problem.device.loop_lag + problem.device.damping)
    velocity = replace(problem.bounds.velocity, min=least)
    solved = solve(replace(problem, bounds=replace(problem.bounds, velocity=velocity)), gap=0.01)
    assert solved.judgement.transparency.error == pytest.approx(140.0219, rel=1e-4)
    assert solved.optimality.proved
