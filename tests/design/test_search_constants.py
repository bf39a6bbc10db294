"""The search's constants are not tuned: with each of them halved and doubled the designs are as good."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, for_passive_hands

from vctune.analysis import climb, hardest_hands, in_hands, loops_in_hands, resonance
from vctune.design import solve as solving
from vctune.design.bound import search
from vctune.design.bound import strong_branching as branching
from vctune.design.nlp import ipopt, nlp_structure
from vctune.design.search import (
    exchange,
    gain_limit,
    grid,
    optimum,
    refine,
    samples,
    scan,
    stabilise,
    violations,
    worst,
)
from vctune.design.verdict.judge import Status
from vctune.document.reading import parse_problem, read_problem
from vctune.proof import device_box as devices

PROBLEMS = {
    path.stem: path
    for name in ("reference", "reference/real", "basins")
    for path in sorted((ROOT / "tests" / name).glob("*.toml"))
}
AS_GOOD = 3e-3

Scaled = Callable[[Any, float], Any]
"""A value and the factor that its size is changed by."""


def times(value: float, factor: float) -> float:
    return value * factor


def count(value: int, factor: float) -> int:
    return max(1, round(value * factor))


def beside_one(value: Any, factor: float) -> Any:
    """Scale the distance from 1, of factors on a logarithmic scale."""
    return np.asarray(value) ** factor if isinstance(value, np.ndarray) else value**factor


def below_one(value: float, factor: float) -> float:
    """Scale the distance of a share from 1, down to 0."""
    return max(0.0, 1 - (1 - value) * factor)


def denser(values: Any, factor: float) -> Any:
    """Leave out every second of some places, or put one in the middle between each two."""
    if factor < 1:
        return values[::2]
    between = np.interp(np.arange(2 * len(values) - 1) / 2, np.arange(len(values)), values)
    return between if isinstance(values, np.ndarray) else tuple(between.tolist())


def each(scaled: Scaled, values: Any, factor: float) -> Any:
    if isinstance(values, dict):
        return {key: scaled(value, factor) for key, value in values.items()}
    return tuple(scaled(value, factor) for value in values)


@dataclass(frozen=True)
class Constant:
    """A constant, the modules that have it, and how it is scaled."""

    name: str
    modules: tuple[Any, ...]
    scaled: Scaled

    def __str__(self) -> str:
        return f"{self.modules[0].__name__.rsplit('.', 1)[-1]}.{self.name}"


CONSTANTS = [
    Constant("COUNTS", (grid,), partial(each, count)),
    Constant("PER_DECADE", (grid,), times),
    Constant("FREQUENCIES", (samples,), count),
    Constant("PANELS", (samples,), count),
    Constant("STARTS", (scan,), count),
    Constant("CLOSE", (scan,), times),
    Constant("AROUND", (scan,), partial(each, beside_one)),
    Constant("STEPS", (scan,), count),
    Constant("FLAT", (scan,), beside_one),
    Constant("WORTH_ANOTHER", (scan,), beside_one),
    Constant("PROMISING", (scan,), times),
    Constant("HALVINGS", (refine,), count),
    Constant("ROUNDS", (gain_limit,), count),
    Constant("PARTS", (gain_limit,), count),
    Constant("BELOW", (gain_limit,), beside_one),
    Constant("ABOVE", (gain_limit,), beside_one),
    Constant("WORTH_POLISHING", (optimum,), beside_one),
    Constant("PROOF_ROUNDS", (optimum,), count),
    Constant("NEW_HANDS", (optimum,), count),
    Constant("MORE_DIGITS", (optimum,), count),
    Constant("LONG_SHOTS", (optimum,), count),
    Constant("SHARPENING", (optimum,), times),
    Constant("DECIDABLE", (optimum,), times),
    Constant("TIGHTENING", (exchange, optimum), times),
    Constant("ROUNDS", (exchange,), count),
    Constant("STALLED", (exchange,), count),
    Constant("RADIUS", (exchange,), times),
    Constant("GROWTH", (exchange,), beside_one),
    Constant("LEAST_RADIUS", (exchange,), times),
    Constant("FIRST_FREQUENCIES", (exchange,), count),
    Constant("GAIN_REDUCTIONS", (stabilise,), partial(each, below_one)),
    Constant("STABILITY_MARGIN", (stabilise,), times),
    Constant("MAX_CUTS", (stabilise,), count),
    Constant("PANELS", (exchange,), count),
    Constant("MAX_PANELS", (exchange,), count),
    Constant("OBJECTIVE_TOLERANCE", (exchange,), partial(each, times)),
    Constant("UPHILL", (exchange,), times),
    Constant("NEAR_SIDE", (ipopt, exchange), times),
    Constant("TRACKING_REACH", (ipopt,), times),
    Constant("TRACKED_FROM", (violations,), below_one),
    Constant("CAPACITY_STEPS", (nlp_structure,), partial(each, count)),
    Constant("EARLY_BOXES", (solving,), count),
    Constant("SEARCH_BOXES", (solving,), count),
    Constant("RESONANCE_REACH", (resonance,), beside_one),
    Constant("NARROWEST", (resonance,), times),
]
"""Those that decide which design is found.

Left out are those of speed (`LOOPS_AT_ONCE`) and of a form (digits written), and options of IPOPT. `NEARLY` and the
constants of repairs decide which changes are tried.
"""
OF_UNCERTAIN = [
    Constant("SHARES", (worst,), count),
    Constant("DELAY_SHARES", (worst,), count),
    Constant("MOST_DEVICES", (worst,), count),
    Constant("MOST", (worst,), count),
    Constant("FIRST_STEP", (worst,), partial(each, times)),
    Constant("STEPS", (worst,), count),
    Constant("SHRINK", (worst,), beside_one),
    Constant("PHASES", (devices,), count),
    Constant("MOST_AT_ONCE", (devices,), count),
]
"""Those that decide which devices of a box are looked at."""
OF_MANY = [
    Constant("TOGETHER", (worst,), count),
    Constant("SWEEPS", (worst,), count),
]
"""Those that are about devices with many uncertain numbers."""
OF_HANDS = [
    Constant("SHARES", (loops_in_hands,), denser),
    Constant("PER_DECADE", (loops_in_hands, hardest_hands, in_hands), count),
    Constant("SOFT", (loops_in_hands,), denser),
    Constant("SEARCHED", (in_hands,), count),
    Constant("FIRST_STEP", (hardest_hands,), times),
    Constant("ROUNDS", (climb,), count),
    Constant("LEAST_STEP", (climb,), times),
    Constant("SHRINK", (climb,), times),
    Constant("LEAP", (climb,), times),
    Constant("TRIALS", (climb,), count),
    Constant("CONSIDERED", (climb,), lambda share, factor: min(1.0, share * factor)),
    Constant("FEW", (samples,), denser),
    Constant("FEW_ANGLES", (samples,), count),
    Constant("FEW_SPRINGS", (samples,), count),
    Constant("TIGHTENING_IN_HANDS", (ipopt, violations), times),
]
"""Those that decide which hands are looked at."""
UNCERTAIN = {
    "numbers": "[uncertainty]\nmass = 0.1\ndamping = 0.5\n",
    "parts": '[device.actuator]\nbandwidth_hz = 500.0\n[uncertainty]\n"actuator.bandwidth_hz" = 0.3\nmass = 0.1\n',
    "unmodelled": "[uncertainty]\nunmodelled = [[1.0, 0.02], [100.0, 0.1], [400.0, 0.5]]\n",
}
OF_BOUND = [
    Constant("BETTER_HALF", (branching,), times),
    Constant("LENGTH", (branching,), times),
    Constant("DIGITS", (branching,), count),
    Constant("FREQUENCIES", (search,), count),
    Constant("INTERVALS", (search,), count),
    Constant("MOST_FREQUENCIES", (search,), count),
    Constant("CHUNK", (search,), count),
    Constant("TRY_EVERY", (search,), count),
    Constant("VIOLATED", (search,), times),
    Constant("BETTER", (search,), times),
]
"""Those that decide in which order boxes are searched for a bound."""
GAP = 0.03


@cache
def error(name: str) -> float:
    judgement = solving.solve(read_problem(PROBLEMS[name]).problem).judgement
    assert judgement is not None and judgement.status is Status.CERTIFIED
    return judgement.error


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("constant", CONSTANTS, ids=str)
def test_half_and_twice_a_constant_give_designs_as_good(constant, factor, monkeypatch):
    known = {name: error(name) for name in PROBLEMS}
    changed = constant.scaled(getattr(constant.modules[0], constant.name), factor)
    for module in constant.modules:
        monkeypatch.setattr(module, constant.name, changed)
    if constant.name == "TIGHTENING":
        monkeypatch.setitem(exchange.polish.__kwdefaults__, "tightening", changed)
    worse = {}
    for name, path in PROBLEMS.items():
        judgement = solving.solve(read_problem(path).problem).judgement
        ratio = judgement.error / known[name] if judgement and judgement.status is Status.CERTIFIED else float("inf")
        if abs(ratio - 1) > AS_GOOD:
            worse[name] = round(ratio, 5)
    assert not worse


@cache
def robust_error(name: str) -> float:
    judgement = solving.solve(_uncertain(name)).judgement
    assert judgement is not None and judgement.status is Status.CERTIFIED
    return judgement.error


def _uncertain(name: str) -> Any:
    drag = "[coupling]\ndrag = { min = 0.0, max = 50.0 }\n"
    return parse_problem(
        for_passive_hands("[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 1e-3\n" + UNCERTAIN[name] + drag),
        "x",
        "x",
    )


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("constant", OF_UNCERTAIN, ids=str)
def test_half_and_twice_a_constant_give_robust_designs_as_good(constant, factor, monkeypatch):
    known = {name: robust_error(name) for name in UNCERTAIN}
    changed = constant.scaled(getattr(constant.modules[0], constant.name), factor)
    monkeypatch.setattr(constant.modules[0], constant.name, changed)
    for name in UNCERTAIN:
        judgement = solving.solve(_uncertain(name)).judgement
        assert judgement is not None and judgement.status is Status.CERTIFIED, name
        assert judgement.error == pytest.approx(known[name], rel=AS_GOOD), name


MANY_NUMBERS = """
[device]
mass = 1.67
damping = 2.3
sample_time = 5e-4
delay = 7e-5
velocity = { from = "difference", filter_hz = 480.0 }
actuator = { bandwidth_hz = 390.0 }
structure = { handle_mass = 0.72, frequency_hz = 130.0, damping_ratio = 0.03 }
[stability]
criterion = "passive"
[uncertainty]
mass = 0.01
damping = 0.35
delay = 0.7
"actuator.bandwidth_hz" = 0.01
"structure.handle_mass" = 0.01
"structure.frequency_hz" = 0.005
"structure.damping_ratio" = 0.01
unmodelled = [[10.0, 0.0005], [100.0, 0.002]]
"""


@cache
def error_of_many() -> float:
    judgement = solving.solve(parse_problem(MANY_NUMBERS, "x", "x")).judgement
    assert judgement is not None and judgement.status is Status.CERTIFIED
    return judgement.error


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("constant", OF_MANY, ids=str)
def test_half_and_twice_a_constant_give_designs_as_good_of_many_uncertain_numbers(constant, factor, monkeypatch):
    known = error_of_many()
    changed = constant.scaled(getattr(constant.modules[0], constant.name), factor)
    monkeypatch.setattr(constant.modules[0], constant.name, changed)
    judgement = solving.solve(parse_problem(MANY_NUMBERS, "x", "x")).judgement
    assert judgement is not None and judgement.status is Status.CERTIFIED
    assert judgement.error == pytest.approx(known, rel=AS_GOOD)


HANDS = sorted((ROOT / "tests/reference/hands").glob("*.toml"))


@cache
def error_in_hands(path: Path) -> float:
    judgement = solving.solve(read_problem(path).problem).judgement
    assert judgement is not None and judgement.status is Status.CERTIFIED
    return judgement.error


def forget_loops() -> None:
    loops_in_hands.loops_in_hands.cache_clear()
    loops_in_hands.loops_at_rest.cache_clear()


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("constant", OF_HANDS, ids=str)
def test_half_and_twice_a_constant_give_designs_as_good_in_hands(constant, factor, monkeypatch):
    known = {path: error_in_hands(path) for path in HANDS}
    changed = constant.scaled(getattr(constant.modules[0], constant.name), factor)
    for module in constant.modules:
        monkeypatch.setattr(module, constant.name, changed)
    function = loops_in_hands.loops_in_hands.__wrapped__
    monkeypatch.setattr(function, "__defaults__", (loops_in_hands.SHARES, loops_in_hands.PER_DECADE))
    forget_loops()
    try:
        for path in HANDS:
            judgement = solving.solve(read_problem(path).problem).judgement
            assert judgement is not None and judgement.status is Status.CERTIFIED, path.stem
            assert judgement.error == pytest.approx(known[path], rel=AS_GOOD), path.stem
    finally:
        forget_loops()


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("constant", OF_BOUND, ids=str)
def test_half_and_twice_a_constant_prove_a_bound(constant, factor, monkeypatch):
    changed = constant.scaled(getattr(constant.modules[0], constant.name), factor)
    monkeypatch.setattr(constant.modules[0], constant.name, changed)
    for name in ("two-basins", "real-flexible"):
        solved = solving.solve(read_problem(PROBLEMS[name]).problem, gap=GAP)
        assert solved.optimality is not None and solved.optimality.proved, name
        assert solved.optimality.bound <= error(name) <= (1 + GAP + AS_GOOD) * solved.optimality.bound, name
