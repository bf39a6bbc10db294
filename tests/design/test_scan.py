"""The scan: local minima, the limits of the gains, basins; and the grids that extrema are looked for on."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from math import pi

import numpy as np
import pytest

from vctune.analysis.demands import demand_grid, ratio_minima, sensitivity_maxima, slowest_resonance
from vctune.analysis.extrema import frequency_grid, local_minima
from vctune.bench.devices import device
from vctune.bench.evaluator import case_of, impedances, sensitivity, spectral_radius
from vctune.bench.problems import reference_problems
from vctune.design.prepared import prepare
from vctune.design.search.gain_limit import gain_limits
from vctune.design.search.grid import axes, evaluated, position_gain
from vctune.design.search.refine import between_neighbours, minima_of, refined
from vctune.design.search.refine import local_minima as grid_minima
from vctune.design.search.samples import samples_of
from vctune.design.search.scan import better_start_near, in_same_basin, scan
from vctune.design.solve import solve
from vctune.design.variables import design_of
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.problem import Range
from vctune.model.transparency import Terms, log_quadrature

PROBLEMS = reference_problems()
ANY = Coupling(1.0, 1.0, 0.0)


@pytest.mark.parametrize("shape", [(5, 6, 1, 1), (7, 5, 4, 3), (1, 9, 4, 1), (0, 1, 3, 2), (3, 1, 30, 13)])
def test_local_minima_are_not_above_any_neighbour(shape):
    rng = np.random.default_rng(7)
    for values in (3, 10_000):
        score = rng.integers(0, values, shape).astype(float)
        padded = np.pad(score, 1, constant_values=np.inf)
        expected = {
            at for at in product(*map(range, shape)) if score[at] <= padded[tuple(slice(i, i + 3) for i in at)].min()
        }
        found = grid_minima(score)
        assert set(found) == expected
        assert [score[at] for at in found] == sorted(score[at] for at in found)


@pytest.mark.parametrize("name", ["friction-wheel", "two-basins", "friction-wheel-paper", "at-bound"])
def test_at_the_gain_limit_loops_are_feasible_and_soon_beyond_it_not(name):
    """By plain complex numbers and eigenvalues, where |S| or stability ends it."""
    posed = prepare(PROBLEMS[name]).scaled
    problem, samples, grid = posed.problem, samples_of(posed, integrator=True), axes(posed, integral=True)
    limits = gain_limits(problem, samples, grid, evaluated(problem, samples, grid)[1])
    assert limits.corner.size > 0
    below, band = np.geomspace(1e-4, 1, 4000) * problem.nyquist, problem.stability.band
    within = np.geomspace(band.min, band.max, 1000)

    def feasible(K_v, corner):
        gains = Gains(float(K_v), float(position_gain(problem, np.array(K_v), np.array(corner))))
        case = case_of(problem.device, gains, ANY)
        if sensitivity(case, below).max() > problem.stability.max_sensitivity:
            return False
        return sum(impedances(case, 1j * within)).real.min() > 0 and spectral_radius(case) < 1

    inside = [feasible(0.97 * v, grid.corner[j]) for v, j in zip(limits.velocity, limits.corner, strict=True)]
    beyond = [feasible(1.03 * v, grid.corner[j]) for v, j in zip(limits.velocity, limits.corner, strict=True)]
    assert all(inside)
    assert not any(beyond)


def test_refining_only_improves():
    posed = prepare(PROBLEMS["two-basins"]).scaled
    problem, samples, grid = posed.problem, samples_of(posed, integrator=True), axes(posed, integral=True)
    scores, _ = evaluated(problem, samples, grid)
    minima = minima_of(problem, scores)[:8]
    for at, start in zip(minima, refined(problem, samples, between_neighbours(grid, minima)), strict=True):
        assert start.rank <= scores.rank(at)


def test_starts_on_the_way_down_to_an_optimum_are_dropped_and_those_beyond_a_rise_are_not():
    """Of the two basins of this device the one at lower K_p lies behind a rise."""
    problem = PROBLEMS["two-basins"]
    scaled = prepare(problem).scaled
    seen = scan(scaled)
    best = solve(problem).polished
    gains, coupling = design_of(best.values)
    near = replace(seen.starts[0], gains=Gains(gains.velocity * 0.9, gains.position * 0.9))
    assert in_same_basin(scaled, [near], gains) == [near]
    low = [start for start in seen.starts if 0 < start.gains.position < gains.position / 10]
    assert low
    assert in_same_basin(scaled, low, gains) == []
    assert better_start_near(scaled, gains, coupling) is None


def test_a_better_coupling_than_a_polished_one_is_seen():
    scaled = prepare(PROBLEMS["friction-wheel"]).scaled
    gains, coupling = design_of(solve(PROBLEMS["friction-wheel"]).polished.values)
    heavy = Coupling(coupling.damping * 30, coupling.mass * 30, coupling.drag)
    start = better_start_near(scaled, gains, Coupling(heavy.damping, heavy.mass * 1e-3, heavy.drag))
    assert start is not None
    assert start.coupling.damping == pytest.approx(coupling.damping, rel=0.3)


def test_nodes_are_those_of_gauss_and_legendre():
    omega, weights = log_quadrature(1.0, np.e, 1)
    nodes, expected = np.polynomial.legendre.leggauss(8)
    assert np.log(omega) == pytest.approx((nodes + 1) / 2, abs=1e-15)
    assert weights == pytest.approx(expected / 2, rel=1e-14)


@pytest.mark.parametrize("place", [0.3, 1.0, 17.2, 399.0])
def test_minima_of_a_smooth_function_are_found_to_seven_digits(place):
    found = local_minima(lambda omega: np.cosh(np.log(omega / place)) + 0.1 * np.log(omega / place) ** 3, GRID)
    assert found.omega[0] == pytest.approx(place, rel=1e-7)
    assert found.value[0] == pytest.approx(1.0, rel=1e-14)


GRID = frequency_grid(0.1, 1000.0)


def test_a_grid_with_a_widest_step():
    grid = frequency_grid(0.1, 1000.0, widest=2.0)
    assert (grid[0], grid[-1]) == (0.1, 1000.0)
    assert np.diff(grid).min() > 0
    assert np.diff(grid).max() <= 2.0 * (1 + 1e-12)
    assert np.diff(np.log(grid)).max() <= np.diff(np.log(GRID)).max() * (1 + 1e-9)
    assert np.array_equal(frequency_grid(0.1, 1000.0, widest=1e3), GRID)


@pytest.mark.parametrize("samples", [3.2, 43.4, 149.7])
def test_every_ripple_of_a_delay_is_on_the_grid(samples):
    """cos(2 omega tau) has a minimum at every odd multiple of pi/(2 tau)."""
    delayed = Device(1.0, 0.0, 1e-3, samples * 1e-3, "zoh")
    grid = demand_grid(delayed, 1.0, pi / delayed.sample_time)
    found = local_minima(lambda omega: np.cos(2 * omega * delayed.loop_lag), grid)
    inside = found.value[(found.omega > grid[0]) & (found.omega < grid[-1])]
    assert len(inside) == int(delayed.loop_lag / delayed.sample_time + 0.5)
    assert inside == pytest.approx(np.full(len(inside), -1.0), abs=1e-9)


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


def test_a_design_below_a_gain_limit_that_no_coupling_can_have():
    """The greatest feasible K_v needs more than any coupling gives, a lower one does not."""
    problem = up_to_a_tenth_of_the_sampling_rate(148)
    least = 1e-5 * (problem.device.mass / problem.device.loop_lag + problem.device.damping)
    velocity = replace(problem.bounds.velocity, min=least)
    solved = solve(replace(problem, bounds=replace(problem.bounds, velocity=velocity)), gap=0.01)
    assert solved.judgement.transparency.error == pytest.approx(140.0219, rel=1e-4)
    assert solved.optimality.proved


def test_a_fixed_velocity_gain_has_no_limit():
    problem = PROBLEMS["friction-wheel"]
    posed = prepare(replace(problem, bounds=replace(problem.bounds, velocity=Range(100.0, 100.0)))).scaled
    fixed, samples, grid = posed.problem, samples_of(posed, integrator=True), axes(posed, integral=True)
    assert gain_limits(fixed, samples, grid, evaluated(fixed, samples, grid)[1]).corner.size == 0
    assert scan(posed).starts[0].gains.velocity == pytest.approx(fixed.bounds.velocity.min, rel=1e-12)


@pytest.mark.parametrize("name", ["friction-wheel", "two-basins", "lag-damped"])
@pytest.mark.parametrize("factor", [1e-20, 1e20])
def test_starts_and_designs_scale_with_impedances(name, factor):
    """Of a problem in which every impedance is greater by one factor."""
    problem = PROBLEMS[name]
    scaled = problem.in_units(1 / factor, 1.0)
    assert scaled.transparency.reference_impedance == pytest.approx(
        factor * problem.transparency.reference_impedance, rel=1e-12
    )
    starts, expected = scan(prepare(scaled).scaled).starts, scan(prepare(problem).scaled).starts
    assert [start.error for start in starts] == pytest.approx([start.error for start in expected], rel=1e-9)
    here, there = solve(problem).judgement, solve(scaled).judgement
    assert there.gains.velocity == pytest.approx(factor * here.gains.velocity, rel=1e-6)
    assert there.coupling.mass == pytest.approx(factor * here.coupling.mass, rel=1e-5)
    assert there.error == pytest.approx(here.error, rel=1e-8)


@pytest.mark.parametrize("exponent", [-20, -8, 8, 20])
def test_an_extreme_reference_impedance_leaves_the_best_start_admissible(exponent):
    """Only one term of the error is left, whose size no longer says anything about the demands.

    The best design is then that for the term alone.
    """
    problem = PROBLEMS["friction-wheel"]
    transparency = replace(problem.transparency, reference_impedance=10.0**exponent)
    extreme = replace(problem, transparency=transparency)
    assert all(start.admissible for start in scan(prepare(extreme).scaled).starts)
    weights = Terms(0.0, 0.0, 1.0) if exponent < 0 else Terms(1.0, 0.0, 0.0)
    alone = replace(problem, transparency=replace(problem.transparency, weights=weights))
    unit = (10.0**exponent / problem.transparency.reference_impedance) ** (-1 if exponent < 0 else 1)
    assert solve(extreme).judgement.error == pytest.approx(solve(alone).judgement.error * unit, rel=1e-3)
