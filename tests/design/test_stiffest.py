"""The stiffest coupling of an impedance display with a box of environments: scales, reserve, and random displays."""

from __future__ import annotations

from dataclasses import replace
from math import log10

import numpy as np
import pytest

from vctune.analysis.hardest_hands import needs_in_worlds
from vctune.api.solving import solve
from vctune.design.prepared import prepare
from vctune.design.search.in_worlds.force_scale import forbidden_scale
from vctune.design.search.in_worlds.known_places import least_scale
from vctune.design.search.in_worlds.stiffest import stiffest
from vctune.design.search.scan import scan
from vctune.design.verdict.judge import Status, judge
from vctune.document.reading import parse_problem
from vctune.model.gains import Gains, SpringDamper
from vctune.model.hands import Hand
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.problem import Problem
from vctune.model.sampled.hand_loop import loop_in_hand, seen_in_hand
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.model.worlds import WorldsMet

ARM = """
[device]
display = "impedance"
mass = 0.045
damping = 0.25
sample_time = 1e-3
delay = 0.5e-3
velocity.filter_hz = 100.0
[operator]
mass = 0.05
damping = 1.0
stiffness = { min = 0.0, max = 1500.0 }
[stability]
criterion = "hands"
[transparency.weights]
admittance = 0.0
tracking = 0.0
[environment]
mass = { min = 0.1, max = 5.0 }
stiffness = { max = 2000.0 }
"""
HANDLE = """
[device]
mass = 0.1
damping = 1.0
sample_time = 1e-3
display = "impedance"
[stability]
criterion = "hands"
[environment]
mass = { min = 0.05, max = 5.0 }
stiffness = { max = 2000.0 }
"""


def number(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a random number of four digits whose logarithm has a uniform density."""
    return float(f"{10 ** rng.uniform(log10(low), log10(high)):.4g}")


def random_display(seed: int) -> Problem:
    """Return a random impedance display with a random box of tools."""
    rng = np.random.default_rng(3500 + seed)
    T, m = number(rng, 3e-4, 2e-3), number(rng, 0.02, 1.0)
    damping = m / T * 10 ** rng.uniform(-3, -1.5)
    delay = T * rng.choice([0.0, 0.5 * rng.random(), rng.random()])
    text = f'[device]\ndisplay = "impedance"\nmass = {m}\ndamping = {damping:.4g}\n'
    text += f"sample_time = {T}\ndelay = {delay:.4g}\n"
    if rng.random() < 0.5:
        text += f"velocity.filter_hz = {number(rng, 50, 0.3 / T)}\n"
    if rng.random() < 0.6:
        text += f"[operator]\nmass = {{ min = {number(rng, 0.01, 0.1)}, max = {number(rng, 0.2, 1.0)} }}\n"
        text += f"damping = {{ min = {number(rng, 0.3, 2)}, max = 30.0 }}\n"
        text += f"stiffness = {{ min = 0.0, max = {number(rng, 300, 3000)} }}\n"
    text += f'[stability]\ncriterion = "hands"\nsafety_factor = {rng.choice([1.0, 1.05, 1.05, 1.2])}\n'
    least, most = number(rng, 0.01, 0.3), rng.choice([number(rng, 1, 10), 0.0])
    text += f"[environment]\nmass = {{ min = {least}" + (f", max = {most}" if most else "") + " }\n"
    stiff = rng.choice([number(rng, 300, 6000), number(rng, 300, 6000), 0.0])
    text += f"stiffness = {{ max = {stiff} }}\n" if stiff else ""
    return parse_problem(text, "random.toml", "random")


def test_the_forbidden_scales_are_those_at_which_every_margin_is_negative() -> None:
    """Just below the greatest of them every margin is negative, and at none of 2,000 scales beyond."""
    rng, compared = np.random.default_rng(1), 0
    for seed in range(4):
        problem = random_display(seed)
        device, worlds, hands = problem.device, problem.worlds, problem.hands_met
        assert worlds is not None and hands is not None
        gains, tau = Gains(0.0, 0.0), 10 ** rng.uniform(0, 1.5) * device.sample_time
        hand = hands.middle if seed % 2 else hands.low
        theta = np.geomspace(0.02, 3.0, 60)
        loop = loop_in_hand(plant_in_hand(device, hand, delays_of(device), FLOATS), theta, FLOATS)
        found = forbidden_scale(worlds, device, theta, seen_in_hand(loop, gains), tau)

        def fails(x: np.ndarray, at: tuple = (device, loop, theta, tau, worlds, gains)) -> np.ndarray:
            device, loop, theta, tau, worlds, gains = at
            coupling = SpringDamper(tau / x, 1 / x)
            needs = needs_in_worlds(loop, device, gains, coupling, theta, WorldsMet(worlds, 1.0))
            return np.asarray(np.minimum.reduce(np.broadcast_arrays(*needs.values())) > 1)

        forbids = found > 0
        below = np.where(forbids, found * (1 - 1e-7), 1.0)
        assert fails(below)[forbids].all()
        beyond = np.where(forbids, found, 1e-12) * np.geomspace(1 + 1e-6, 1e4, 2000)[:, None]
        assert not fails(beyond).any()
        compared += int(forbids.sum())
    assert compared > 40


@pytest.mark.parametrize("seed", [16, *(pytest.param(k, marks=pytest.mark.slow) for k in range(20) if k != 16)])
def test_random_displays_are_certified(seed: int) -> None:
    """At the first attempt or with the proof's witness; three hundredths more of the coupling are refuted."""
    problem = random_display(seed)
    found = solve(problem)
    assert found.status is Status.CERTIFIED
    assert found.judgement is not None
    coupling, bounds = found.judgement.coupling, problem.bounds
    stiffer = SpringDamper(*(1.03 * x for x in (coupling.damping, coupling.stiffness)))
    if stiffer.stiffness < bounds.stiffness.max and stiffer.damping < bounds.damping.max:
        assert judge(problem, found.judgement.gains, stiffer).status is not Status.CERTIFIED


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "factor", "error"), [(ARM, 1.05, 0.000256), (ARM, 1.0, 0.000244), (HANDLE, 1.05, None)]
)
def test_heavy_tools_are_certified(text: str, factor: float, error: float | None) -> None:
    """The arm is as transparent as the exchange at single frequencies promised, and less reserve costs nothing."""
    problem = parse_problem(text, "arm.toml", "arm")
    found = solve(replace(problem, stability=replace(problem.stability, safety_factor=factor)))
    assert found.status is Status.CERTIFIED
    assert found.judgement is not None
    assert found.judgement.certificate.boxes < 40_000
    assert error is None or found.judgement.error < error


def test_a_hand_of_a_witness_joins_the_search() -> None:
    """With it the coupling is not stiffer, and its place is in the box of hands."""
    prepared = prepare(random_display(16))
    start = scan(prepared.scaled).starts[0]
    alone = stiffest(prepared.scaled, start, np.inf, 0.0, [])
    assert alone is not None
    tighter = stiffest(prepared.scaled, start, np.inf, 0.01, alone.places)
    assert tighter is not None
    assert alone.error < tighter.error < 1.05 * alone.error
    assert stiffest(prepared.scaled, start, 0.5 * alone.error, 0.0, []) is None
    hands = prepared.scaled.problem.hands_met
    assert hands is not None
    for place in alone.places:
        assert isinstance(place.hand, Hand)
        for x, low, high in zip(
            place.hand.numbers.values(), hands.low.numbers.values(), hands.high.numbers.values(), strict=True
        ):
            assert low - 1e-12 <= x <= high + 1e-12


@pytest.mark.slow
def test_walls_of_the_arm_cost_little() -> None:
    """The coupling for walls is softer than that for springs by less than 2 %."""
    softer, stiffer = (solve(parse_problem(text, "arm.toml", "arm")) for text in (f"{ARM}walls = true\n", ARM))
    couplings = []
    for found in (softer, stiffer):
        assert found.status is Status.CERTIFIED
        assert found.judgement is not None
        assert isinstance(found.judgement.coupling, SpringDamper)
        couplings.append(found.judgement.coupling.stiffness)
    assert softer.judgement is not None
    assert softer.judgement.in_walls is not None
    assert 0.98 < couplings[0] / couplings[1] < 1


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(16))
def test_random_displays_render_walls(seed: int) -> None:
    """The design is certified, and a stiffer coupling of the same shape is not certified or is beyond a bound."""
    problem = random_display(seed)
    assert problem.worlds is not None
    if problem.worlds.high.stiffness == np.inf:
        return
    walled, linear = (solve(replace(problem, worlds=replace(problem.worlds, walls=walls))) for walls in (True, False))
    assert walled.status is Status.CERTIFIED
    assert walled.judgement is not None
    assert linear.judgement is not None
    assert linear.judgement.error <= walled.judgement.error * (1 + 1e-3) < 1.3 * linear.judgement.error


def test_the_least_scale_is_found_above_a_gap() -> None:
    """Softer couplings may fail, too: the first range that suffices counts."""
    assert least_scale(lambda x: 3.0 < x < 8.0, 1.0, 1e6) == pytest.approx(3.0, rel=1e-3)
    assert least_scale(lambda x: True, 2.0, 1e6) == 2.0
    assert least_scale(lambda x: False, 2.0, 1e6) == np.inf
    assert least_scale(lambda x: x > 1.5, 2.0, 2.0) == 2.0
