"""Seek the hands and environments in which every design of a cell seems to fail, in double precision: a proof begins
there, and no verdict depends on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass
from functools import lru_cache
from itertools import product
from math import nan
from typing import NamedTuple

import numpy as np

from vctune.analysis.damped import ServoOnCurve, WallOnCurve
from vctune.analysis.extrema import Floats
from vctune.analysis.in_worlds import binding_world
from vctune.analysis.multiples import LoopsInWorlds
from vctune.design.variables import design_of
from vctune.model.gains import AnyCoupling, Coupling, Gains, SpringDamper
from vctune.model.hands import Hand, PlacesInHands
from vctune.model.problem import Problem
from vctune.model.worlds import PlacesInWorlds, World
from vctune.proof.boxes import Cells
from vctune.proof.enclosures.intervals import Flags

TRIED = 4  # Number of hands in which a cell may fail throughout
# Shares of the ranges of hands that are tried: beside the heaviest hand other poles are at the limit
MASSES, SPRINGS = (0.0, 0.05, 0.3, 0.9, 1.0), (0.0, 0.01, 0.03, 0.1, 0.2, 0.4, 0.7, 1.0)
NOTHING = World(0.0, 0.0, 0.0)
UNBOUNDED = 3.0  # Multiple of a coupling above which the greatest failing one says little of the coupling


class Hard(NamedTuple):
    """The greatest multiple of a coupling that fails in a hand, and where."""

    multiple: float  # 0 if none fails
    theta: float  # rad
    hand: Hand


@dataclass(frozen=True, slots=True)
class Limits:
    """The limits of a claim."""

    of: Callable[[Gains, AnyCoupling], list[Hard]]  # of a design, in some hands with some environments
    world: Callable[[Gains, AnyCoupling, int, Hard], World]  # the environment of one of these limits, by its number


@dataclass(frozen=True, slots=True)
class HardPlaces:
    """What some hands and environments ask of n cells."""

    multiple: Floats  # greatest multiple of the coupling at the centre that fails, shape (n,)
    meets: Flags  # whether the claim seems to hold at the centre and at the corners
    places: PlacesInWorlds  # where all corners seem to fail; angles are nan for places where one does not


def hard_places(limits: Limits, cells: Cells, allowed: float) -> HardPlaces:
    """Return the places of cells where a claim is hardest to meet, which allows multiples up to a number to fail."""
    places, met, multiple, meets = list[tuple[float, Hand]](), list[World](), [], []
    for low, high, middle in zip(cells.low.T, cells.high.T, cells.centres().low.T, strict=True):
        corners = product(*({a, b} for a, b in zip(low.tolist(), high.tolist(), strict=True)))
        designs = [design_of(tuple(values)) for values in (middle.tolist(), *corners)]
        found = [limits.of(*design) for design in designs]
        multiples = np.array([[each.multiple for each in of_design] for of_design in found])
        multiple.append(multiples[0].max())
        meets.append(multiples.max() <= allowed)
        least = multiples.min(axis=0)
        hardest = np.argsort(-least, kind="stable").tolist()
        of_mass = {found[0][k].hand.mass: k for k in reversed(hardest)}  # the worst hand of each mass comes first
        for k in sorted(hardest, key=lambda k: k != of_mass[found[0][k].hand.mass])[:TRIED]:
            fails, hard = least[k] > allowed, found[0][k]
            places.append((hard.theta if fails else nan, hard.hand))
            met.append(limits.world(*designs[0], k, hard) if fails else NOTHING)
    shape = len(cells), -1
    in_hands = PlacesInHands.of(places).mapped(lambda numbers: numbers.reshape(shape))
    worlds = World(*(x.reshape(shape) for x in np.array([astuple(each) for each in met]).T))
    return HardPlaces(np.array(multiple), np.array(meets), PlacesInWorlds(in_hands, worlds))


@lru_cache(maxsize=4)
def limits_in_worlds(problem: Problem) -> Limits:
    """Return the limits of the claim about every hand with every environment of a box."""
    hands, worlds, T = _tried(problem), problem.worlds, problem.device.sample_time
    assert worlds is not None
    loops = lru_cache(maxsize=512)(lambda gains: LoopsInWorlds.of(problem.device, gains, hands, worlds))

    def world(gains: Gains, coupling: AnyCoupling, _: int, hard: Hard) -> World:
        factor = (
            1 / hard.multiple if hard.multiple < UNBOUNDED else 1.0
        )  # what fails if all greater ones do fails itself
        found = binding_world(problem.device, gains, coupling, hard.hand, hard.theta / T, factor, worlds)
        return found or NOTHING

    def limits(gains: Gains, coupling: AnyCoupling) -> list[Hard]:
        return [Hard(*found) for found in loops(gains).limits(coupling)]

    return Limits(lru_cache(maxsize=4096)(limits), world)  # cells share their corners


@lru_cache(maxsize=4)
def limits_on_curve(problem: Problem) -> Limits:
    """Return the limits of the claim about the damping ratio; of a wall, 2 in a hand in which it fails, and else 0."""
    ratio, hands = problem.stability.damping_ratio, _tried(problem)
    assert ratio is not None
    none = np.empty(0)
    if problem.rigid:
        loops = [WallOnCurve.of(problem.device, [hand], ratio, none) for hand in hands]

        def of_wall(_: Gains, wall: AnyCoupling) -> list[Hard]:
            assert isinstance(wall, SpringDamper)
            bears = [loop.bears(wall) for loop in loops]
            return [Hard(0.0 if b else 2.0, 0.0, hand) for b, hand in zip(bears, hands, strict=True)]

        return Limits(lru_cache(maxsize=4096)(of_wall), lambda *_: NOTHING)
    assert problem.worlds is not None
    ends = problem.worlds.least_damped
    cases, servo = list(product(ends, hands)), ServoOnCurve.of(problem.device, hands, ends, ratio, none)

    def of_servo(_: Gains, coupling: AnyCoupling) -> list[Hard]:
        assert isinstance(coupling, Coupling)
        each = zip(servo.limits(coupling), cases, strict=True)
        return [Hard(multiple, 0.0, hand) for multiple, (_, hand) in each]

    return Limits(lru_cache(maxsize=4096)(of_servo), lambda _gains, _coupling, number, _hard: cases[number][0])


def _tried(problem: Problem) -> list[Hand]:
    """Return hands of a box that damp least."""
    hands = problem.hands_met
    assert hands is not None
    low, high = hands.low, hands.high
    masses, springs = (
        [a + share * (b - a) for share in shares]
        for shares, a, b in ((MASSES, low.mass, high.mass), (SPRINGS, low.stiffness, high.stiffness))
    )
    return list(dict.fromkeys(Hand(mass, low.damping, spring) for mass, spring in product(masses, springs)))
