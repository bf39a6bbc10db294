"""Walls that come and go: verdicts against the condition by brute force, and against loops in time (section 19)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import astuple, dataclass, replace
from functools import cache
from itertools import islice, product
from math import inf, pi

import numpy as np
import pytest
from test_worlds_proof import STABLE, Case, draw, of_hand
from wall_loops import Wall, grow, least_of_condition, random_wall, speeds
from world_loops import Whole, in_world, spectral_radius

from vctune.analysis.in_hands import least_ratios_in_hands
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hand
from vctune.model.problem import Demands
from vctune.model.worlds import World, Worlds, WorldsMet
from vctune.proof.claims.every_hand import prove_hands
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.engine.interval import Outcome, Verdict


@dataclass(frozen=True)
class Walled:
    """A random loop with its boxes, and a corner of the multiplier."""

    case: Case
    worlds: Worlds

    @property
    def design(self) -> Design:
        """Return what vctune is told of it."""
        return Design(self.case.device, Gains(*self.case.whole.gains), Coupling(*self.case.whole.coupling))

    @property
    def ratio(self) -> float:
        """Return the least ratio in double precision."""
        design, met = self.design, WorldsMet(self.worlds, self.case.factor)
        return least_ratios_in_hands(design.device, self.case.hands, design.gains, design.coupling, met)[0].ratio

    def outcome(self, *, walls: bool = True) -> Outcome:
        """Return what is proved of walls, or of the linear environments."""
        design, worlds = self.design, self.worlds if walls else self.worlds.linear
        return prove_hands(
            design,
            Demands(
                design.device, (0.0, 1.0), self.case.factor, inf, passive=False, hands=self.case.hands, worlds=worlds
            ),
        )

    def scaled(self, by: float) -> Walled:
        """Return it with a multiple of the coupling."""
        b_c, m_c, b_0 = self.case.whole.coupling
        return replace(
            self, case=replace(self.case, whole=replace(self.case.whole, coupling=(b_c * by, m_c * by, b_0 * by)))
        )


def draw_walled(rng: np.random.Generator) -> Walled | None:
    """Return a random loop with about the coupling that its walls need; None where none of some would do."""
    case = draw(rng)
    if spectral_radius(replace(case.whole, world=(0.0, 1e9, 0.0))) > STABLE:
        return None
    low, high = case.worlds.low, case.worlds.high
    high = World(min(high.mass, 1e3 * (low.mass + 1)), inf, min(high.stiffness, 100 / case.whole.plant.sample_time))
    if high.stiffness <= low.stiffness or (case.whole.gains[1] == 0 and not case.whole.plant.servo):
        return None
    corner = 2 / case.whole.plant.sample_time * rng.choice([0.03, 0.3, 0.7, 0.999, 0.999])
    found = Walled(case, Worlds(low, high, True, corner))
    return next((more for by in (1.0, 4.0) if (more := found.scaled(by)).ratio > 0.7 * case.factor), None)


def drawn(seed: int) -> Iterator[Walled]:
    """Yield random loops."""
    rng = np.random.default_rng(seed)
    while True:
        if (found := draw_walled(rng)) is not None:
            yield found


def least_anywhere(walled: Walled, rng: np.random.Generator) -> float:
    """Return the least of the condition over many angles, some hands and shares of the coupling, by brute force."""
    case, theta, least = walled.case, np.concatenate((np.geomspace(1e-3, 3.14, 200), rng.uniform(0, 3.14, 100))), inf
    ends = (case.hands.low, case.hands.high)
    corners = [Hand(*(getattr(ends[k], name) for k, name in zip(bits, ("mass", "damping", "stiffness"), strict=True)))
               for bits in product((0, 1), repeat=3)]  # fmt: skip
    inside = [Hand(*(rng.uniform(getattr(ends[0], name), getattr(ends[1], name))
                     for name in ("mass", "damping", "stiffness"))) for _ in range(4)]  # fmt: skip
    for hand in corners + inside:
        for share in {1.0, 1 / case.factor, 1 / rng.uniform(1, case.factor)}:
            loop = in_world(of_hand(case, hand), (0.0, 0.0, 0.0), share)
            least = min(least, float(least_of_condition(loop, theta, walled.worlds, walled.worlds.corner).min()))
    return least


def holds_at(walled: Walled, outcome: Outcome) -> bool:
    """Return whether the condition holds by brute force at a witness, with every share of the coupling."""
    assert outcome.hand is not None
    assert outcome.witness is not None
    theta = np.array([min(outcome.witness * walled.case.whole.plant.sample_time, pi * (1 - 1e-7))])
    shares = np.unique(np.append(np.linspace(1 / walled.case.factor, 1.0, 51), 1.0))
    loops = [in_world(of_hand(walled.case, outcome.hand), (0.0, 0.0, 0.0), share) for share in shares]
    return all(least_of_condition(loop, theta, walled.worlds, walled.worlds.corner)[0] > 0 for loop in loops)


def judged(seed: int, count: int) -> dict[str, int]:
    """Judge random loops; return how many were proved, refuted and undecided, and which were wrong."""
    rng, found = np.random.default_rng(seed + 1), dict.fromkeys(("proved", "refuted", "undecided", "wrong"), 0)
    for walled, _ in zip(drawn(seed), range(count), strict=False):
        outcome = walled.outcome()
        if outcome.verdict is Verdict.PROVED:
            found["proved" if least_anywhere(walled, rng) > 0 else "wrong"] += 1
        elif outcome.verdict is Verdict.REFUTED:
            found["wrong" if holds_at(walled, outcome) else "refuted"] += 1
        else:
            found["undecided"] += 1
    return found


@cache
def certified(seed: int, count: int) -> tuple[Walled, ...]:
    """Return random loops of which walls and linear environments are proved."""
    found = (walled for walled in drawn(seed) if walled.ratio > walled.case.factor)
    proved = (each for each in found if all(each.outcome(walls=w).verdict is Verdict.PROVED for w in (False, True)))
    return tuple(islice(proved, count))


def grown(designs: tuple[Walled, ...], samples: int, runs: int, share: float = 1.0) -> int:
    """Return of how many designs some motion at a wall grows, in random hands, masses and dampings of the boxes.

    Parameters
    ----------
    samples, runs : of each design
    share : of the coupling that is certified
    """
    rng, loops, walls = np.random.default_rng(2), list[Whole](), list[Wall]()
    for walled in designs * runs:
        low, high, hands = walled.worlds.low, walled.worlds.high, walled.case.hands
        ends = zip(astuple(hands.low), astuple(hands.high), strict=True)
        hand = Hand(*(a + rng.choice([0.0, 1.0, rng.random()]) * (b - a) for a, b in ends))
        mass = low.mass + rng.choice([0.0, rng.random() ** 3, 1.0]) * (high.mass - low.mass)
        damping = low.damping + rng.choice([0.0, rng.random()])
        part = share / rng.choice([1.0, walled.case.factor])
        loops.append(in_world(of_hand(walled.case, hand), (mass, damping, 0.0), part))
        walls.append(random_wall(low.stiffness, high.stiffness, 1e-3, rng))
    found = grow(speeds(loops, walls, samples, rng))
    return int(found.reshape(runs, len(designs)).any(axis=0).sum())


def test_verdicts_of_some_loops_agree_with_brute_force() -> None:
    """A proof holds at hands, masses and dampings that are tried, a refutation names a place where it fails."""
    found = judged(19, 4)
    assert found["wrong"] == 0
    assert found["proved"] and found["refuted"]


@pytest.mark.slow
def test_verdicts_of_many_loops_agree_with_brute_force() -> None:
    """The same of many."""
    found = judged(11, 150)
    assert found["wrong"] == 0
    assert found["undecided"] <= 0.02 * 150


def test_nothing_certified_grows_at_walls() -> None:
    """And something does with a thirtieth of the coupling."""
    designs = certified(5, 2)
    assert grown(designs, 1200, 8) == 0
    assert grown(designs, 1200, 8, share=0.03) > 0


@pytest.mark.slow
def test_nothing_certified_grows_at_walls_in_long_runs() -> None:
    """Many designs, 10,000 samples each."""
    assert grown(certified(17, 60), 10_000, 6) == 0
