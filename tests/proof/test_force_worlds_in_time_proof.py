"""Late environments and walls of impedance displays: verdicts against eigenvalues, and against motions at walls
(model/README.md, sections 19 and 20)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import astuple, replace
from itertools import product
from math import inf, pi

import numpy as np
import pytest
from force_loops import ForceLoop
from force_worlds import radius, speeds_at_walls, stepped_with
from late_loops import InTime, balancing
from test_force_worlds_proof import ON_CIRCLE, STABLE, Case, posed
from wall_loops import grow, random_wall

from vctune.model.hands import Hand
from vctune.model.problem import Demands
from vctune.model.worlds import WORLD_RULES, World, Worlds
from vctune.proof.claims.every_hand import prove_hands
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.engine.interval import Outcome, Verdict

MOST = 1e5
"""Damping in place of an infinite one, in units of what the environment meets."""


def timed(rng: np.random.Generator) -> Case:
    """Return a random loop with late environments that it bears about as often as not."""
    case = posed(rng)
    rule, late = str(rng.choice(WORLD_RULES)), int(rng.choice([0, 1, 1, 2, 3]))
    if rule == "trapezoid" and late == 0:
        late = 1
    T, size = case.loop.sample_time, abs(case.held(case.hands.middle).met(np.array([2.5]))[0])
    mass = float(rng.choice([0.0, size * T * 10 ** rng.uniform(-1.5, 0)]))
    light = mass * float(rng.choice([0.0, 0.3, 1.0]))
    if rule == "explicit" and late == 0:
        mass = float(size * T * 10 ** rng.uniform(-0.3, 2) * rng.choice([0.0, 1.0]))
        light = mass * rng.uniform(0.3, 1.0)
    damping, stiff = size * 10 ** rng.uniform(-2.5, -0.3), size / T * 10 ** rng.uniform(-4, -1)
    low = World(light, damping * float(rng.choice([0.0, 0.3])), stiff * float(rng.choice([0.0, 0.3])))
    most = inf if rule == "implicit" and late == 0 else damping
    return replace(case, worlds=Worlds(low, World(mass, most, stiff), rule=rule, late=late))


def box_of(case: Case) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Return the ends of the environments, with a great damping in place of an infinite one."""
    low, high = case.worlds.low, case.worlds.high
    most = min(high.damping, MOST * abs(case.loop.met(np.array([2.5]))[0]))
    return (low.mass, low.damping, low.stiffness), (high.mass, most, high.stiffness)


def members(case: Case, hand: Hand, share: float, rng: np.random.Generator) -> Iterator[tuple[float, float, float]]:
    """Yield corners of the box, random members, and those that cancel the loop at some angle, and beside them."""
    box, world = box_of(case), InTime(case.worlds.rule, case.worlds.late)
    low, high = (np.array(end) for end in box)
    yield from product(*zip(*box, strict=True))
    for _ in range(4):
        yield tuple(low + rng.uniform(0, 1, 3) ** 2 * (high - low))
    theta = np.geomspace(2e-3, 3.1, 60)
    for at, Y in zip(theta, case.held(hand).met(theta, share), strict=True):
        found = balancing(Y, case.loop.sample_time, world, box, float(at))
        if found is not None:
            yield found
            for corner in product(*zip(*box, strict=True)):
                yield tuple(np.array(found) + 0.02 * (np.array(corner) - found))


def with_world(case: Case, hand: Hand, share: float, world: tuple[float, float, float]) -> ForceLoop:
    """Return the loop in a hand with a member of the box."""
    return replace(case.held(hand).with_share(share), world=world)


def grows_late(case: Case, rng: np.random.Generator) -> bool:
    """Return whether some hand and environment of the boxes make the loop grow, with some share of the coupling."""
    world, ends = InTime(case.worlds.rule, case.worlds.late), (astuple(case.hands.low), astuple(case.hands.high))
    corners = [Hand(*(ends[bit][k] for k, bit in enumerate(bits))) for bits in product((0, 1), repeat=3)]
    return any(
        radius(with_world(case, corners[k], share, member), world) > STABLE
        for k in rng.permutation(8)[:3]
        for share in {1.0, 1 / case.factor}
        for member in members(case, corners[k], share, rng)
    )


def is_refuted(case: Case, outcome: Outcome) -> bool:
    """Return whether a member holds a pole at the witness or, without one, the loop in the hand grows."""
    assert outcome.hand is not None
    world, box, T = InTime(case.worlds.rule, case.worlds.late), box_of(case), case.loop.sample_time
    if outcome.witness is None:
        middle = tuple((a + b) / 2 for a, b in zip(*box, strict=True))
        return radius(with_world(case, outcome.hand, 1.0, middle), world) > STABLE
    theta = min(max(outcome.witness * T, 1e-7), pi * (1 - 1e-7))
    for share in np.linspace(1 / case.factor, 1.0, 101):
        Y = case.held(outcome.hand).met(np.array([theta]), share)[0]
        found = balancing(Y, T, world, box, theta)
        if found is not None:
            poles = np.linalg.eigvals(stepped_with(with_world(case, outcome.hand, share, found), world))
            if np.abs(poles - np.exp(1j * theta)).min() < ON_CIRCLE * (10 if theta > pi * (1 - 1e-4) else 1):
                return True
    return False


def judged(seed: int, count: int) -> dict[str, int]:
    """Judge random loops; return how many were proved, refuted, undecided and wrong."""
    rng, found = np.random.default_rng(seed), dict.fromkeys(("proved", "refuted", "undecided", "wrong"), 0)
    while sum(found.values()) < count:
        case = timed(rng)
        outcome = case.outcome()
        if outcome.verdict is Verdict.PROVED:
            found["wrong" if grows_late(case, rng) else "proved"] += 1
        elif outcome.verdict is Verdict.REFUTED:
            found["refuted" if is_refuted(case, outcome) else "wrong"] += 1
        else:
            found["undecided"] += 1
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "count"), [(7, 40)])
def test_verdicts_on_late_environments_agree_with_eigenvalues(seed: int, count: int) -> None:
    """None is wrong, both kinds of verdict occur, and few are undecided."""
    found = judged(seed, count)
    assert found["wrong"] == 0
    assert found["proved"] > count / 4
    assert found["refuted"] > count / 10
    assert found["undecided"] <= count / 15


def walled(rng: np.random.Generator) -> Case:
    """Return a random loop with walls."""
    while True:
        case = posed(rng)
        high = case.worlds.high
        stiff, mass = (x if x < inf else y for x, y in ((high.stiffness, case.loop.coupling[1]), (high.mass, inf)))
        worlds = Worlds(replace(case.worlds.low, stiffness=0.0), World(mass, inf, stiff), walls=True)
        return replace(case, worlds=worlds)


def proved_with_walls(case: Case) -> bool:
    """Return whether walls and linear springs of the box are proved, with one of three corners."""
    gains, coupling = case.law
    demands = Demands(
        case.device, (0.0, 1.0), case.factor, inf, passive=False, hands=case.hands, worlds=case.worlds.linear
    )
    design = Design(case.device, gains, coupling)
    if prove_hands(design, demands).verdict is not Verdict.PROVED:
        return False
    corners = (share * 2 / case.loop.sample_time for share in (0.95, 0.3, 0.03))
    boxes = (replace(demands, worlds=replace(case.worlds, corner=corner)) for corner in corners)
    return any(prove_hands(design, with_corner).verdict is Verdict.PROVED for with_corner in boxes)


def in_motion(case: Case, rng: np.random.Generator) -> ForceLoop:
    """Return the loop in a random hand with a random tool of the box, which the walls are yet to meet."""
    low, high = (np.array(astuple(end)) for end in (case.hands.low, case.hands.high))
    hand = Hand(*(low + rng.choice([0.0, 1.0, rng.random()], 3) * (high - low)))
    light, heavy = case.worlds.low.mass, min(case.worlds.high.mass, 10 * case.loop.mass + 10 * case.worlds.low.mass)
    mass = light + float(rng.choice([0.0, 0.0, 1.0, rng.random() ** 2])) * (heavy - light)
    share = float(rng.choice([1.0, 1 / case.factor]))
    return with_world(case, hand, share, (mass, case.worlds.low.damping, 0.0))


@pytest.mark.parametrize(
    ("seed", "count", "samples"), [(4, 3, 2000), pytest.param(41, 100, 10_000, marks=pytest.mark.slow)]
)
def test_no_motion_grows_at_walls(seed: int, count: int, samples: int) -> None:
    """Certified couplings at one-sided and piecewise walls, in random hands with random tools."""
    rng, loops, walls = np.random.default_rng(seed), [], []
    while len(loops) < 2 * count:
        case = walled(rng)
        if proved_with_walls(case):
            for _ in range(2):
                loops.append(in_motion(case, rng))
                walls.append(random_wall(0.0, case.worlds.high.stiffness, 1e-2, rng))
    assert not grow(speeds_at_walls(loops, walls, samples, rng)).any()


def test_walls_make_softer_couplings_grow() -> None:
    """The motions are no empty test: without proof, couplings that are too stiff grow at walls."""
    rng, loops, walls = np.random.default_rng(9), [], []
    while len(loops) < 40:
        case = walled(rng)
        b_c, k_c = case.loop.coupling
        stiffer = replace(case.loop, coupling=(b_c, 8 * k_c))
        loops.append(in_motion(replace(case, loop=stiffer), rng))
        walls.append(random_wall(0.0, case.worlds.high.stiffness, 1e-2, rng))
    assert grow(speeds_at_walls(loops, walls, 2000, rng)).sum() > 5
