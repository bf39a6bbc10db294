"""Boxes of environments of impedance displays: verdicts against eigenvalues of the whole loop (model/README.md,
section 18)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import astuple, dataclass, replace
from itertools import product
from math import inf, log, pi, sqrt

import numpy as np
import pytest
from force_loops import ForceLoop, corner
from test_worlds_proof import balanced, damping_asked, limit_of
from vctune.analysis.destabilising import growing_in_worlds

from vctune.model.device import Device
from vctune.model.experiment import Environment, Experiment, Operator, Sensors
from vctune.model.gains import Gains, SpringDamper
from vctune.model.hands import Hand, Hands
from vctune.model.parts import Actuator, Structure, VelocityEstimate
from vctune.model.problem import Demands
from vctune.model.worlds import World, Worlds
from vctune.proof.claims.every_hand import prove_hands
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.engine.interval import Outcome, Verdict
from vctune.simulation.mechanics.scene_stability import fastest_mode
from vctune.simulation.scene import designed_scene

STABLE = 1 + 1e-9
"""Spectral radius up to which a loop counts as stable: the eigenvalues are right to much less."""
ON_CIRCLE = 1e-5
"""Distance to the unit circle's point at a witness at which a pole counts as there."""
THETA = np.append(np.geomspace(1e-3, 0.1, 100), np.linspace(0.1, 3.1, 300)[1:])


@dataclass(frozen=True)
class Case:
    """A random loop with its boxes."""

    loop: ForceLoop
    hands: Hands
    worlds: Worlds
    factor: float

    @property
    def device(self) -> Device:
        """The same device for vctune."""
        one = self.loop
        hz = corner(one.smoothing, one.sample_time) if one.filters else None
        structure, (m2, k, c) = None, one.handle
        if m2:
            reduced = m2 * (one.mass - m2) / one.mass
            structure = Structure(m2, sqrt(k / reduced) / (2 * pi), c / (2 * sqrt(k * reduced)))
        return Device(
            one.mass,
            one.damping,
            one.sample_time,
            one.delay,
            velocity=VelocityEstimate("difference", hz, max(one.filters, 1)),
            actuator=Actuator(one.actuator / (2 * pi), one.order) if one.order else None,
            structure=structure,
            display="impedance",
        )

    @property
    def law(self) -> tuple[Gains, SpringDamper]:
        """Gains and coupling."""
        return Gains(self.loop.velocity, 0.0), SpringDamper(*self.loop.coupling)

    def outcome(self) -> Outcome:
        """Return what is proved."""
        demands = Demands(
            self.device, (0.0, 1.0), self.factor, inf, passive=False, hands=self.hands, worlds=self.worlds
        )
        return prove_hands(Design(self.device, *self.law), demands)

    def held(self, hand: Hand) -> ForceLoop:
        """Return the loop in a hand."""
        return replace(self.loop, hand=(hand.mass, hand.damping, hand.stiffness))


def decades(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a random number whose logarithm has a uniform density."""
    return float(10 ** rng.uniform(low, high))


def draw(rng: np.random.Generator) -> Case:
    """Return a random loop whose coupling is about as stiff as its environments and hands permit."""
    T, m = decades(rng, -3.3, -2.3), decades(rng, -1.5, 0.5)
    b = m / T * decades(rng, -3, -1)
    delay = float(T * rng.choice([0.0, 0.0, 0.5 * rng.random(), 1.0, 1.8 * rng.random()]))
    K_v = float(m / T * rng.choice([0.0, decades(rng, -2.5, -1.3)]))
    filters = int(rng.integers(0, 3))
    handle, order = (0.0, 0.0, 0.0), int(rng.choice([0, 0, 1, 2]))
    if rng.random() < 0.25:
        m2 = m * rng.uniform(0.1, 0.4)
        reduced, w = m2 * (m - m2) / m, rng.uniform(0.3, 1.5) / T
        handle = (m2, reduced * w * w, 2 * rng.uniform(0.02, 0.2) * reduced * w)
    lags = 1 + delay / T + filters * 0.5 + order * 0.5
    k_c = 2 * (b + K_v) / (T * lags**2) * decades(rng, -0.3, 1.5)
    b_c = (b + K_v) * decades(rng, -1.5, 0.3)
    high = Hand(m * decades(rng, -1, 0.7), b * decades(rng, -1, 1), k_c * decades(rng, -1.5, 1))
    share = rng.choice([0.0, rng.uniform(0, 1)], 3)
    low = Hand(high.mass * share[0], high.damping * share[1], high.stiffness * share[2])
    mass, stiff = m * decades(rng, -1, 1), k_c * decades(rng, -1, 1)
    worlds = Worlds(
        World(
            mass * float(rng.choice([0.0, decades(rng, -2.5, 0)])),
            float(rng.choice([0.0, 0.1 * b])),
            stiff * float(rng.choice([0.0, 0.3])),
        ),
        World(float(rng.choice([mass, mass, inf])), inf, float(rng.choice([stiff, stiff, inf]))),
    )
    loop = ForceLoop(
        T,
        m,
        b,
        delay,
        K_v,
        (b_c, k_c),
        handle=handle,
        actuator=rng.uniform(0.3, 2.0) / T if order else 0.0,
        order=order,
        smoothing=rng.uniform(0.3, 0.95) if filters else 1.0,
        filters=filters,
    )
    return Case(loop, Hands(low, high), worlds, float(rng.choice([1.0, 1.05, 1.3])))


def posed(rng: np.random.Generator) -> Case:
    """Return a random loop that is stable with the tool held still in the middle of its hands."""
    while True:
        case = draw(rng)
        if replace(case.held(case.hands.middle), world=(0.0, 1e9, 0.0)).radius() <= STABLE:
            return case


def environments(
    case: Case, hand: Hand, share: float, rng: np.random.Generator
) -> Iterator[tuple[float, float, float]]:
    """Yield corners of the box, random members, and at some angles those of it that cancel the loop's reactance."""
    low, high, T = case.worlds.low, case.worlds.high, case.loop.sample_time
    most = min(high.mass, 1e3 * (low.mass + 1)), min(high.stiffness, 1e7)
    yield from product((low.mass, most[0]), (low.damping,), (low.stiffness, most[1]))
    for _ in range(4):
        u, v = rng.uniform(0, 1, 2) ** 3
        yield low.mass + u * (most[0] - low.mass), low.damping, low.stiffness + v * (most[1] - low.stiffness)
    met, at = case.held(hand).met(THETA, share), 2 / T * np.tan(THETA / 2)
    for k in np.argsort(met.real)[:: len(met) // 200][:3]:
        for mass, stiffness in balanced(case.worlds, -met[k].imag, at[k]):
            yield mass, low.damping, stiffness


def grows(case: Case, rng: np.random.Generator) -> bool:
    """Return whether some hand and environment of the boxes make the loop grow, with some share of the coupling."""
    ends = astuple(case.hands.low), astuple(case.hands.high)
    corners = [Hand(*(ends[bit][k] for k, bit in enumerate(bits))) for bits in product((0, 1), repeat=3)]
    for hand in (corners[k] for k in rng.permutation(8)[:4]):
        for share in {1.0, 1 / case.factor, 1 / rng.uniform(1, case.factor)}:
            alone = case.held(hand).with_share(share)
            if any(replace(alone, world=world).radius() > STABLE for world in environments(case, hand, share, rng)):
                return True
    return False


def holds_a_pole(case: Case, outcome: Outcome) -> bool:
    """Return whether at the witness an environment of the box holds a pole on the unit circle."""
    assert outcome.hand is not None
    assert outcome.witness is not None
    T, alone = case.loop.sample_time, case.held(outcome.hand)
    theta = min(max(outcome.witness * T, 1e-7), pi * (1 - 1e-7))
    u = 2 / T * np.tan(theta / 2)
    for share in np.linspace(1 / case.factor, 1.0, 401):
        met = alone.met(np.array([theta]), share)[0]
        for m, k in balanced(case.worlds, -met.imag, u):
            if -met.real >= case.worlds.low.damping - 1e-9 * abs(met):
                whole = replace(alone.with_share(share), world=(m, max(-met.real, 0.0), k))
                if np.abs(np.linalg.eigvals(whole.stepped()) - np.exp(1j * theta)).min() < ON_CIRCLE:
                    return True
    return False


def judged(seed: int, count: int) -> dict[str, int]:
    """Judge random loops; return how many were proved, refuted, undecided, and which were wrong."""
    rng, found = np.random.default_rng(seed), dict.fromkeys(("proved", "refuted", "undecided", "wrong"), 0)
    while sum(found.values()) < count:
        case = posed(rng)
        outcome = case.outcome()
        if outcome.verdict is Verdict.PROVED:
            found["wrong" if grows(case, rng) else "proved"] += 1
        elif outcome.verdict is Verdict.REFUTED:
            found["refuted" if holds_a_pole(case, outcome) else "wrong"] += 1
        else:
            found["undecided"] += 1
    return found


@pytest.mark.parametrize(("seed", "count"), [(5, 8), pytest.param(35, 150, marks=pytest.mark.slow)])
def test_verdicts_agree_with_eigenvalues(seed: int, count: int) -> None:
    """None is wrong, both kinds of verdict occur, and few are undecided."""
    found = judged(seed, count)
    assert found["wrong"] == 0
    assert found["proved"] > count / 3
    assert found["refuted"] > count / 10
    assert found["undecided"] <= count / 50


def at_the_limit(seed: int, count: int, off: float) -> dict[str, int]:
    """Judge loops whose environments have the damping that they must have, a share more or less."""
    rng, found = np.random.default_rng(seed), dict.fromkeys(("right", "undecided", "wrong"), 0)
    while sum(found.values()) < count:
        case = posed(rng)
        name = str(rng.choice(["mass", "damping", "stiffness"]))
        one = replace(case.hands.middle, **{name: getattr(case.hands.low, name)})
        hands = Hands(one, replace(one, **{name: getattr(case.hands.high, name)}))
        case = replace(case, hands=hands, factor=1.0)
        T = case.loop.sample_time

        def asked(hand: Hand, case: Case = case, T: float = T) -> float:
            return damping_asked(case.worlds, T, case.held(hand).met)

        ends = (hands.low, hands.middle, hands.high)
        held = (replace(case.held(hand), world=(0.0, 1e9, 0.0)).radius() for hand in ends)
        if max(held) > STABLE or asked(hands.middle) < 0:
            continue  # with the tool held no damping suffices, or none is needed
        limit = limit_of(hands, asked)
        if not 1e-3 < limit / abs(case.loop.met(np.array([0.5]))[0]) < 1e3:
            continue
        for sign in (1, -1):
            low = replace(case.worlds.low, damping=limit * (1 + sign * off))
            verdict = replace(case, worlds=replace(case.worlds, low=low)).outcome().verdict
            right = Verdict.PROVED if sign > 0 else Verdict.REFUTED
            found["undecided" if verdict is Verdict.UNDECIDED else "right" if verdict is right else "wrong"] += 1
    return found


@pytest.mark.parametrize(
    ("count", "off"), [(1, 1e-3), *(pytest.param(60, off, marks=pytest.mark.slow) for off in (1e-3, 1e-5))]
)
def test_verdicts_next_to_the_limit(count: int, off: float) -> None:
    """No verdict is wrong, and fewer than 2 % are undecided."""
    found = at_the_limit(3, count, off)
    assert found["wrong"] == 0
    assert found["undecided"] < max(1, 0.02 * count)


def test_a_passive_box_is_every_passive_environment() -> None:
    """Without limits of mass and stiffness the verdict is that of every passive environment."""
    rng = np.random.default_rng(2)
    for _ in range(4):
        case = posed(rng)
        every = replace(case, worlds=Worlds(World(0.0, 0.0, 0.0), World(inf, inf, inf)))
        demands = Demands(case.device, (0.0, 1.0), case.factor, inf, passive=False, hands=case.hands)
        assert every.outcome().verdict is prove_hands(Design(case.device, *case.law), demands).verdict


def test_the_oracle_is_the_loop() -> None:
    """A pole lies where the oracle's response says that the environment cancels it."""
    rng, off = np.random.default_rng(1), []
    for _ in range(10):
        loop, theta = posed(rng).loop, rng.uniform(0.05, 2.5)
        met, u = loop.met(np.array([theta]))[0], 2 / loop.sample_time * np.tan(theta / 2)
        whole = replace(loop, world=(max(-met.imag, 0) / u, -met.real, max(met.imag, 0) * u))
        off.append(np.abs(np.linalg.eigvals(whole.stepped()) - np.exp(1j * theta)).min())
    assert max(off) < 1e-6


def refuted_cases(seed: int, count: int) -> Iterator[tuple[Case, Hand, float]]:
    """Yield random loops that are refuted with the factor 1, each with the hand and the frequency where."""
    rng, found = np.random.default_rng(seed), 0
    while found < count:
        case = replace(posed(rng), factor=1.0)
        outcome = case.outcome()
        if outcome.verdict is Verdict.REFUTED and outcome.hand is not None and outcome.witness is not None:
            found += 1
            yield case, outcome.hand, outcome.witness


@pytest.mark.parametrize(("seed", "count"), [(7, 3), pytest.param(8, 30, marks=pytest.mark.slow)])
def test_a_refused_world_grows(seed: int, count: int) -> None:
    """Each refuted loop has an environment of the box with which it grows, in exact time and in `simulate`."""
    for case, hand, omega in refuted_cases(seed, count):
        made = growing_in_worlds(case.device, *case.law, hand, omega, case.worlds)
        assert made is not None
        mass, stiffness = (made.value, made.stiffness) if made.kind == "mass" else (0.0, made.value)
        low, high, edge = case.worlds.low, case.worlds.high, 1 + 1e-9
        assert low.mass <= mass * edge <= high.mass * edge**2
        assert low.stiffness <= stiffness * edge <= high.stiffness * edge**2
        assert made.damping >= low.damping
        rate = log(replace(case.held(hand), world=(mass, made.damping, stiffness)).radius()) / case.loop.sample_time
        assert rate >= made.growth * (1 - 1e-6)  # another mode may grow faster
        experiment = Experiment(
            name="refused",
            environment=Environment(mass, made.damping, stiffness, 0.0, wall=False, rule="trapezoid"),
            operator=Operator("sine", 0.0, 0.01, 0.1, 3, hand.mass, hand.damping, hand.stiffness),
            friction=None,
            sensors=Sensors(0.0, 0.0, 0),
            limit=None,
            baseline=None,
        )
        mode = fastest_mode(designed_scene(case.device, *case.law, experiment))
        assert log(mode.radius) / case.loop.sample_time == pytest.approx(rate, rel=1e-6)
