"""Environments that run late or are stepped by Euler's rules: verdicts against eigenvalues of the whole loop."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from math import inf, pi

import numpy as np
import pytest
from late_loops import Box, InTime, cancelling, cancelling_at_nyquist, spectral_radius, stepped
from test_worlds_proof import ON_CIRCLE, STABLE, Case, draw, of_hand
from world_loops import Whole, in_world, offered, seen
from world_loops import spectral_radius as lossless_radius

from vctune.model.hands import Hand
from vctune.model.worlds import WORLD_RULES, World, Worlds
from vctune.proof.engine.interval import Outcome, Verdict

STANDS = (0.0, 1e9, 0.0)
"""An environment that hardly moves."""


@dataclass(frozen=True)
class Timed:
    """A random loop with its boxes, and how its environments are stepped."""

    case: Case
    world: InTime

    @property
    def box(self) -> Box:
        """The ends of the environments."""
        low, high = self.case.worlds.low, self.case.worlds.high
        return (low.mass, low.damping, low.stiffness), (high.mass, high.damping, high.stiffness)


def timed(rng: np.random.Generator) -> Timed:
    """Return a random loop with environments that its coupling bears about as often as not."""
    case = draw(rng)
    rule, late = str(rng.choice(WORLD_RULES)), int(rng.choice([0, 1, 1, 2, 3]))
    if rule == "trapezoid" and late == 0:
        late = 1
    T = case.whole.plant.sample_time
    b_c, m_c, b_0 = case.whole.coupling
    size = b_0 + (2 * m_c / T if np.isinf(b_c) else b_c * 2 * m_c / (T * b_c + 2 * m_c))  # of the coupling, at once
    mass = rng.choice([0.0, size * T * 10 ** rng.uniform(-1.5, 0)])
    light = mass * rng.choice([0.3, 1.0])
    if rule == "explicit" and late == 0:
        mass = size * T * 10 ** rng.uniform(-0.3, 2) * rng.choice([0.0, 1.0])
        light = mass * rng.uniform(0.3, 1.0)
    elif rng.random() < 0.5:
        light = 0.0
    damping = size * 10 ** rng.uniform(-2, 0)
    stiff = size / T * 10 ** rng.uniform(-3.5, -0.5)
    low = World(light, damping * rng.choice([0.0, 0.3]), stiff * rng.choice([0.0, 0.3]))
    if rule == "implicit" and late == 0:
        high = World(rng.choice([mass, inf]), inf, rng.choice([stiff, inf]))
    else:
        high = World(mass, damping, stiff)
    return Timed(replace(case, worlds=Worlds(low, high, rule=rule, late=late)), InTime(rule, late))


def radius(one: Timed, hand: Hand, world: tuple[float, float, float], share: float = 1.0) -> float:
    """Return the spectral radius in a hand with an environment."""
    return spectral_radius(in_world(of_hand(one.case, hand), world, share), one.world)


def finite(box: Box, whole: Whole) -> Box:
    """Return a box without infinite ends, far beyond what matters."""
    T = whole.plant.sample_time
    size = abs(offered(whole, np.array([0.5]))[0]) + abs(seen(whole, np.array([0.5]))[0])
    most = (1e4 * size * T, 1e3 * size, 1e3 * size / T)
    return box[0], tuple(min(a, max(b, c)) for a, b, c in zip(box[1], most, box[0], strict=True))  # type: ignore[return-value]


def environments(
    one: Timed, hand: Hand, share: float, rng: np.random.Generator
) -> Iterator[tuple[float, float, float]]:
    """Yield corners of the box, random members, and those that cancel the loop at some angle, and beside them."""
    box = finite(one.box, one.case.whole)
    low, high = (np.array(end) for end in box)
    yield from product(*zip(*box, strict=True))
    for _ in range(4):
        yield tuple(low + rng.uniform(0, 1, 3) ** 2 * (high - low))
    alone = of_hand(one.case, hand)
    for theta in np.geomspace(2e-3, 3.1, 60):
        found = cancelling(alone, one.world, box, theta, share)
        if found is not None:
            yield found
            for corner in product(*zip(*box, strict=True)):
                yield tuple(np.array(found) + 0.02 * (np.array(corner) - found))


def grows_in(one: Timed, rng: np.random.Generator) -> bool:
    """Return whether some hand and environment of the boxes make the loop grow, with any share of the coupling."""
    hands, factor = one.case.hands, one.case.factor
    names = ("mass", "damping", "stiffness")
    corners = [
        Hand(*(getattr((hands.low, hands.high)[k], name) for k, name in zip(bits, names, strict=True)))
        for bits in product((0, 1), repeat=3)
    ]
    for k in rng.permutation(8)[:3]:
        for share in {1.0, 1 / factor}:
            for world in environments(one, corners[k], share, rng):
                if radius(one, corners[k], world, share) > STABLE:
                    return True
    return False


def is_refuted(one: Timed, outcome: Outcome) -> bool:
    """Return whether an environment holds a pole at the witness or, without one, the loop in the hand grows."""
    assert outcome.hand is not None
    if outcome.witness is None:
        box = finite(one.box, one.case.whole)
        middle = tuple((a + b) / 2 for a, b in zip(*box, strict=True))
        return (
            max(
                radius(one, outcome.hand, middle),
                lossless_radius(replace(of_hand(one.case, outcome.hand), world=STANDS)),
            )
            > STABLE
        )
    T, alone, box = one.case.whole.plant.sample_time, of_hand(one.case, outcome.hand), finite(one.box, one.case.whole)
    theta = min(max(outcome.witness * T, 1e-7), pi)
    for share in np.linspace(1 / one.case.factor, 1.0, 101):
        if theta > pi * (1 - 1e-4):
            found = cancelling_at_nyquist(alone, one.world, box, share)
        else:
            found = cancelling(alone, one.world, box, theta, share)
        if found is not None:
            poles = np.linalg.eigvals(stepped(in_world(alone, found, share), one.world))
            if np.abs(poles - np.exp(1j * theta)).min() < ON_CIRCLE * (10 if theta > pi * (1 - 1e-4) else 1):
                return True
    return False


def judged(seed: int, count: int) -> dict[str, int]:
    """Judge random loops; return how many were proved, refuted, undecided and wrong."""
    rng, found = np.random.default_rng(seed), dict.fromkeys(("proved", "refuted", "undecided", "wrong"), 0)
    while sum(found.values()) < count:
        one = timed(rng)
        if lossless_radius(replace(one.case.whole, world=STANDS)) > STABLE:
            continue  # the velocity loop itself
        outcome = one.case.outcome()
        if outcome.verdict is Verdict.PROVED:
            found["wrong" if grows_in(one, rng) else "proved"] += 1
        elif outcome.verdict is Verdict.REFUTED:
            found["refuted" if is_refuted(one, outcome) else "wrong"] += 1
        else:
            found["undecided"] += 1
    return found


@pytest.mark.slow
def test_verdicts_agree_with_eigenvalues() -> None:
    """Of 400 random loops none is judged wrongly, both kinds of verdict occur, and few are undecided."""
    found = judged(353, 400)
    assert found["wrong"] == 0
    assert min(found["proved"], found["refuted"]) > 60
    assert found["undecided"] <= 8


def test_verdicts_of_some_loops_agree_with_eigenvalues() -> None:
    """The same of a dozen."""
    found = judged(4, 12)
    assert found["wrong"] == 0
    assert found["proved"] + found["refuted"] >= 11
