"""The lower bound against closed forms, other units and designs judged by independent code."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import exp, inf, log
from typing import Any

import numpy as np
import pytest
from arithmetic import DOUBLES
from conftest import DEVICE, drawn, for_passive_hands, mostly_slow
from draws import Rng, Tables, built, gains_for
from frequency import demanded, offered, unstable_poles
from loop import Loop, radius, sensitivity
from posed import yardstick
from scipy.integrate import simpson

import vctune
from vctune.design.bound.relaxation import ImposedPlaces, least_coupling, lower_bounds, objective_of, relaxation
from vctune.design.bound.search import Optimality, bound
from vctune.design.judging.judge import Judgement, Status
from vctune.design.prepared import pose, prepare
from vctune.design.search.optimum import improved
from vctune.design.solve import solve
from vctune.document.reading import parse_problem, read_problem
from vctune.document.schema.statement import device_table
from vctune.model.problem import Problem, Range
from vctune.proof.boxes import Cells
from vctune.running import OutOfTimeError, time_limit

GAP = 0.03
NAMES = ("velocity", "position", "damping", "mass", "drag")


@cache
def drawn_tables(number: int) -> Tables:
    """Return the number-th problem of a rigid device, of any norm, weights and bands, that leaves its gains free."""
    rng = np.random.default_rng((2, number))
    device = built(rng, *[(), ("delay",), ("part of a sample",)][int(rng.integers(3))])
    device |= {"hold": "lag" if rng.random() < 0.3 else "zoh"}
    more = yardstick(rng, device, gains_for(rng, device)[0])
    low, high = 0.5 / device["sample_time"] * 10 ** rng.uniform([-3.5, -1.3], [-2, -0.1])
    stability = {"criterion": "passive", "band_hz": [float(low), float(high)]}
    stability |= {"safety_factor": float(rng.choice([1.0, 1.05, 1.3])), "max_sensitivity": float(rng.uniform(1.3, 4))}
    coupling = {"drag": {"min": 0.0, "max": gains_for(rng, device)[0]}} if rng.random() < 0.3 else {}
    return {"device": device, "coupling": coupling, "stability": stability, **more}


@cache
def drawn_problem(number: int) -> Problem:
    return vctune.problem(drawn_tables(number)).problem


def ranges(problem: Problem) -> list[Range]:
    return [getattr(problem.bounds, name) for name in NAMES]


def error_of(problem: Problem, design: Any, points: int = 2001) -> float:
    """Return the transparency error (paper eq. 21), as the oracle has it on a grid."""
    objective, weights = problem.transparency, problem.transparency.weights
    Z_0, s = objective.reference_impedance, 1j * np.geomspace(objective.band.min, objective.band.max, points)
    at = demanded({"device": device_table(problem.device)}, tuple(design[:2]), s, DOUBLES)
    square = (weights.admittance * Z_0 * np.abs(at.G_hh)) ** 2 + (weights.tracking * np.abs(at.tracking)) ** 2
    square += (weights.coupling * np.abs(offered(tuple(design[2:]), s, DOUBLES)) / Z_0) ** 2
    return float(np.sqrt(square.max() if objective.norm == "peak" else simpson(square, dx=1 / (points - 1))))


def required_at(problem: Problem, design: Any, omega: np.ndarray) -> np.ndarray:
    """Return the safety factor times R, inf where no coupling will do."""
    with np.errstate(all="ignore"):
        at = demanded({"device": device_table(problem.device)}, tuple(design[:2]), 1j * omega, DOUBLES)
    return np.where(at.resistance > 0, problem.stability.safety_factor * at.required, inf)


def admissible(problem: Problem, design: Any) -> bool:
    """Return whether a design clearly meets every demand: conditions, |S|, and poles of both models."""
    table = device_table(problem.device)
    omega = np.geomspace(problem.stability.band.min, problem.stability.band.max, 2000)
    given = offered(tuple(design[2:]), 1j * omega, DOUBLES).real
    loop = Loop(table, (design[0], design[1]))
    if (given < required_at(problem, design, omega) * (1 + 1e-9)).any() or radius(loop, at_rest=True) >= 1:
        return False
    z = np.exp(1j * np.pi * np.union1d(np.geomspace(1e-5, 1, 400), np.linspace(1e-3, 1, 400))[:-1])
    loud = np.abs(sensitivity(loop, z)).max() > problem.stability.max_sensitivity * (1 - 1e-6)
    return not loud and abs(unstable_poles({"device": table}, (design[0], design[1]))) < 0.1


def random_designs(problem: Problem, count: int, rng: Rng, near: np.ndarray | None = None) -> np.ndarray:
    """Return designs in their bounds or around one; most with about the least b_c that they can have."""
    omega, found = np.geomspace(problem.stability.band.min, problem.stability.band.max, 60), []
    for _ in range(count):
        if near is None:
            shares = rng.random(5)
            design = [
                low.min * (low.max / low.min) ** share if low.min > 0 else low.max * 10 ** (-6 * share)
                for low, share in zip(ranges(problem), shares, strict=True)
            ]
        else:
            design = list(near * np.exp(10 ** rng.uniform(-3, 0) * rng.normal(size=5)))
        if rng.random() < 0.2:
            design[1] = 0.0
        tau = design[3] / design[2]
        if rng.random() < 0.8:
            least = least_damping(problem, design, omega)
            design[2] = least * (1 + 10 ** rng.uniform(-6, 0)) if 0 < least < inf else design[2]
            design[3] = tau * design[2]
        found.append([np.clip(x, r.min, r.max) for x, r in zip(design, ranges(problem), strict=True)])
    return np.array(found).T


def least_damping(problem: Problem, design: Any, omega: np.ndarray) -> float:
    """Return the least b_c that meets the conditions at some frequencies for its m_c/b_c; inf where none does."""
    needed = np.maximum(required_at(problem, design, omega) - design[4], 0)
    return float((needed * (1 + (design[2] / (omega * design[3])) ** 2)).max())


def problem_of(text: str) -> Problem:
    return parse_problem(for_passive_hands(text), "problem.toml", "problem")


def searched(problem: Problem, best: Judgement | None, gap: float = GAP, **options) -> Optimality:
    prepared = prepare(problem)
    return bound(prepared.given, best, lambda gains, limit: improved(prepared, gains, limit), gap=gap, **options)


def hopeless(gains, limit) -> None:
    """Never find a better design."""


def numbers(judgement: Judgement) -> np.ndarray:
    gains, coupling = judgement.gains, judgement.coupling
    return np.array([gains.velocity, gains.position, coupling.damping, coupling.mass, coupling.drag])


@pytest.mark.slow
@pytest.mark.parametrize("number", range(20))
def test_no_random_design_is_admissible_and_below_the_bound(number):
    """Half of them around the best one."""
    problem = drawn_problem(number)
    best = solve(problem).judgement
    if best is None or best.status is not Status.CERTIFIED:
        pytest.skip("without a design")
    with time_limit(20):
        found = searched(problem, best)
    assert 0 < found.bound <= found.incumbent
    rng, near, below = np.random.default_rng(number), numbers(found.improved or best), 0
    assert error_of(problem, near) == pytest.approx(found.incumbent, rel=1e-3)
    for around in (None, near):
        for design in random_designs(problem, drawn(10_000), rng, around).T:
            if error_of(problem, design, 33) < 1.01 * found.bound and error_of(problem, design) < found.bound:
                below += 1
                assert not admissible(problem, design), design
    assert below >= 10


@pytest.mark.parametrize("number", mostly_slow(range(40), range(2)))
def test_boxes_cost_no_more_than_the_designs_in_them(number):
    problem, rng, count = drawn_problem(number), np.random.default_rng(1), 200
    designs = random_designs(problem, count, rng)
    band = problem.stability.band
    omega, upto = np.geomspace(band.min, band.max, 30), np.geomspace(problem.nyquist * 1e-3, problem.nyquist, 20)
    given = pose(problem)
    devices, objective = ([case.device for case in cases] for cases in (given.cases, given.objective))
    relaxed = relaxation(problem, devices, ImposedPlaces(omega, upto), objective_of(problem, objective, 24))
    K_v, K_p, b_c, m_c, b_0 = designs
    inner = np.array([K_v, K_p, m_c / b_c, b_0])
    size = 10.0 ** rng.uniform(-4, 1, (2, 4, count)) * (rng.random((2, 4, count)) < 0.8)
    boxes = Cells(inner / (1 + size[0]), inner * (1 + size[1]))
    with np.errstate(all="ignore"):
        lower, (first, second, none) = lower_bounds(relaxed, boxes)[0], least_coupling(relaxed, boxes)
    needed = np.array([least_damping(problem, design, omega) for design in designs.T])
    table, z = device_table(problem.device), np.exp(1j * upto * problem.device.sample_time * (1 - 1e-12))
    loud = [np.abs(sensitivity(Loop(table, (v, p)), z)).max() for v, p in zip(K_v, K_p, strict=True)]
    meets = (b_c >= needed) & np.isfinite(needed)
    quiet = meets & (np.array(loud) <= problem.stability.max_sensitivity)
    rounding = 1 + 1e-9
    assert not (none & np.isfinite(needed)).any()
    assert (first[meets] <= b_c[meets] * rounding).all()
    assert (second[meets] <= m_c[meets] * rounding).all()
    points = 24 if problem.transparency.norm == "peak" else 2001
    errors = np.array([error_of(problem, design, points) for design in designs.T[quiet]])
    assert (lower[quiet] <= errors * (1 + 1e-6)).all()
    assert meets.sum() >= 20 and quiet.sum() >= 10 and (lower[quiet] > 0).sum() >= 5, (meets.sum(), quiet.sum())


LOOP = DEVICE + "[gains]\nvelocity = 150.0\nposition = 6000.0\n"
ELEMENTS = {
    "damping": "[coupling]\nmass = 0.5\n",
    "mass": "[coupling]\ndamping = 160.0\n",
    "drag": "[coupling]\ndamping = 1.0\nmass = 1e-3\ndrag = { min = 0.0, max = 1e3 }\n",
}


def least_element(problem: Problem, element: str) -> float:
    """Return the least b_c, m_c or b_0 that a fixed loop and the other elements leave, on a dense grid."""
    omega, fixed = np.geomspace(problem.stability.band.min, problem.stability.band.max, 200_001), problem.bounds
    r = required_at(problem, (fixed.velocity.min, fixed.position.min), omega)
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
@pytest.mark.parametrize("gap", [1e-2, pytest.param(1e-4, marks=pytest.mark.slow)])
def test_one_free_coupling_element_meets_its_closed_form(element, norm, gap):
    problem = problem_of(LOOP + ELEMENTS[element] + f'[transparency]\nnorm = "{norm}"\n')
    bounds = problem.bounds
    design = np.array([getattr(bounds, name).min for name in NAMES])
    design[2 + ["damping", "mass", "drag"].index(element)] = least_element(problem, element)
    optimum = error_of(problem, design, 20_001)
    best = solve(problem).judgement
    assert best is not None
    found = searched(problem, best, gap)
    assert found.proved
    assert optimum / (1 + gap) * (1 - 1e-4) <= found.bound <= optimum * (1 + 1e-6)


def infeasible_texts(count: int = 20, seed: int = 7) -> list[tuple[str, str]]:
    """Return problems without a design, each with what makes it impossible."""
    rng = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return exp(rng.uniform(log(low), log(high)))

    found = []
    while len(found) < count:
        m, T, hold = between(1e-2, 10), between(1e-4, 1e-2), ("zoh", "lag")[len(found) // 10 % 2]
        b, late = m / T * between(1e-4, 1e-1), T * between(5, 50)
        Z = 2 * m / T + b
        device = f'[device]\nmass = {m}\nsample_time = {T}\nhold = "{hold}"\ndamping = {b}\n'
        undamped = f'[device]\nmass = {m}\nsample_time = {T}\nhold = "lag"\ndamping = 0.0\n'
        lag = f'[device]\nmass = {m}\nsample_time = {T}\nhold = "lag"\ndamping = {b}\n'
        slack = f"[device]\nmass = {m}\nsample_time = {T}\ndamping = {b / 100}\ndelay = {T / 2}\n"
        some = f"[gains]\nvelocity = {{ min = {0.1 * Z}, max = {Z} }}\n"
        strong = f"[gains]\nvelocity = {{ min = {0.3 * Z}, max = {Z} }}\nposition = {{ min = 0.0, max = {Z / T} }}\n"
        found += [
            ("K_v too high", device + f"[gains]\nvelocity = {{ min = {3 * Z}, max = {5 * Z} }}\n"),
            ("K_p too high", device + f"[gains]\nposition = {{ min = {3 * Z / T}, max = {6 * Z / T} }}\n"),
            ("b_c too small", device + some + f"[coupling]\ndamping = {{ min = {b * 1e-6}, max = {b * 1e-2} }}\n"),
            ("m_c too small", device + some + f"[coupling]\nmass = {{ min = {m * 1e-9}, max = {m * 1e-6} }}\n"),
            (
                "max_sensitivity",
                device + strong + f"[stability]\nmax_sensitivity = {1 + between(1e-3, 3e-2)}\n",
            ),
            ("delay", device + f"delay = {late}\n" + strong),
            ("no damping, whole axis", undamped + "[stability]\nband_hz = [0.0, inf]\n"),
            (
                "K_p > 0 from 0",
                lag + f"[gains]\nposition = {{ min = {Z / T / 500}, max = {2 * Z / T} }}\n"
                f"[stability]\nband_hz = [0.0, {0.1 / T}]\n",
            ),
            (
                "band too wide",
                slack + some + f"[stability]\nband_hz = [{5e-4 / T}, {0.49 / T}]\n",
            ),
            (
                "narrow bounds",
                device + f"[gains]\nvelocity = {{ min = {0.3 * Z}, max = {0.31 * Z} }}\nposition = 0.0\n"
                f"[coupling]\ndamping = {{ min = {Z * 1e-9}, max = {0.3 * Z} }}\n"
                f"mass = {{ min = {m * 1e-9}, max = {m * 1e-2} }}\n",
            ),
        ]
    return found[:count]


LONG = "b_c too small", "delay", "K_p too high"
"""Causes whose proof takes longest."""


@pytest.mark.parametrize(
    ("cause", "text"),
    [
        pytest.param(cause, text, id=cause, marks=pytest.mark.slow if number >= 10 or cause in LONG else ())
        for number, (cause, text) in enumerate(infeasible_texts())
    ],
)
def test_infeasible_problems_are_proved_so(cause, text):
    solved = solve(problem_of(text))
    assert solved.status is Status.INFEASIBLE
    assert solved.infeasibility is not None and solved.infeasibility.proved


def barely_feasible(problem: Problem, best: Judgement, slack: float) -> Problem:
    """Return a problem that leaves a known design, and others only within a factor 1 + slack of it."""

    def around(x: float, given: Range) -> Range:
        if given.fixed:
            return given
        return Range(x / (1 + slack), x * (1 + slack)) if x > 0 else Range(0.0, slack * given.max)

    near = {name: around(x, given) for name, x, given in zip(NAMES, numbers(best), ranges(problem), strict=True)}
    demands = replace(
        problem.stability,
        safety_factor=max(1.0, best.min_ratio / (1 + slack / 10)),
        max_sensitivity=min(problem.stability.max_sensitivity, best.peak_sensitivity * (1 + slack / 10)),
    )
    return replace(problem, bounds=replace(problem.bounds, **near), stability=demands)


def never_empty(problem: Problem, slack: float) -> bool:
    """Search a barely feasible problem without looking for designs: the one that it has must stay in an open box."""
    best = solve(problem).judgement
    if best is None or best.status is not Status.CERTIFIED or best.min_ratio == inf:
        return False
    posed = barely_feasible(problem, best, slack)
    if posed.bounds.fixed:
        return False
    found = bound(pose(posed), None, hopeless, gap=GAP, most_boxes=20_000)
    assert not found.proved
    K_v, K_p, b_c, m_c, b_0 = numbers(best)
    inner, boxes = np.array([[K_v], [K_p], [m_c / b_c], [b_0]]), found.open.boxes
    assert ((boxes.low * (1 - 1e-15) <= inner) & (inner <= boxes.high * (1 + 1e-15))).all(axis=0).any()
    return True


@pytest.mark.slow
@pytest.mark.parametrize("slack", [1e-1, 1e-6])
def test_barely_feasible_problems_are_never_emptied(slack):
    many = drawn(90)
    assert sum(never_empty(drawn_problem(100 + number), slack) for number in range(many)) >= 0.5 * many


@pytest.fixture(scope="module")
def wheel(problems):
    """The friction wheel and its design."""
    problem = read_problem(problems / "friction-wheel.toml").problem
    best = solve(problem).judgement
    assert best is not None
    return problem, best


def test_without_time_there_is_no_bound(wheel):
    problem, best = wheel
    with time_limit(0.0), pytest.raises(OutOfTimeError):
        bound(pose(problem), best, hopeless, gap=0.02)
    stopped = bound(pose(problem), best, hopeless, gap=0.02, stopped=lambda: True)
    assert (stopped.boxes, stopped.bound, len(stopped.open)) == (0, 0.0, 1)


def test_a_basin_that_was_missed_is_found(wheel):
    problem, best = wheel
    poor = replace(best, error=1.5 * best.error)
    found = searched(problem, poor)
    assert found.proved and found.improved is not None
    assert found.improved.status is Status.CERTIFIED
    assert found.incumbent == found.improved.transparency.error
    assert found.incumbent <= best.transparency.error * 1.03


def test_scan_sees_the_basin_of_fast_integral_action(problems):
    """Differential evolution over the formulas of `oracles` on dense grids finds 31.7313, and 73.167 with K_p = 0."""
    problem = read_problem(problems / "extremes/seven-decades.toml").problem
    velocity = replace(problem.bounds.velocity, min=1.0)  # of a loop that is used
    solved = solve(replace(problem, bounds=replace(problem.bounds, velocity=velocity)))
    assert solved.judgement is not None
    assert solved.judgement.transparency.error == pytest.approx(31.7313, rel=1e-4)
