"""Boxes of environments: verdicts against eigenvalues of the whole loop (model/README.md, section 18)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass, replace
from functools import partial
from itertools import product
from math import inf, pi, sqrt

import numpy as np
import pytest
from world_loops import Plant, Whole, in_world, offered, seen, spectral_radius, stepped

from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hand, Hands
from vctune.model.parts import ForceSensor, Servo
from vctune.model.problem import Demands
from vctune.model.worlds import World, Worlds
from vctune.proof.claims.every_hand import prove_hands
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.engine.interval import Outcome, Verdict

STABLE = 1 + 1e-9
"""Spectral radius up to which a loop counts as stable: the eigenvalues are right to much less."""
ON_CIRCLE = 1e-5
"""Distance to the unit circle's point at a witness at which a pole counts as there."""


@dataclass(frozen=True)
class Case:
    """A random loop with its boxes."""

    whole: Whole
    hands: Hands
    worlds: Worlds
    factor: float

    @property
    def device(self) -> Device:
        """The same device for vctune."""
        p = self.whole.plant
        sensor = ForceSensor(p.sensor / (2 * pi), 1, 0.0) if p.sensor else None
        if not p.servo:
            return Device(p.mass, p.damping, p.sample_time, p.delay, force_sensor=sensor)
        command = "position" if p.interpolated else "velocity"
        servo = Servo(p.delay, p.bandwidth / (2 * pi), p.servo, command)
        return Device(1.0, 0.0, p.sample_time, force_sensor=sensor, display="servo", servo=servo)

    def outcome(self) -> Outcome:
        """Return what is proved."""
        design = Design(self.device, Gains(*self.whole.gains), Coupling(*self.whole.coupling))
        demands = Demands(
            self.device, (0.0, 1.0), self.factor, inf, passive=False, hands=self.hands, worlds=self.worlds
        )
        return prove_hands(design, demands)


def of_hand(case: Case, hand: Hand) -> Whole:
    """Return the loop in a hand."""
    return replace(case.whole, hand=(hand.mass, hand.damping, hand.stiffness))


def draw(rng: np.random.Generator) -> Case:
    """Return a random loop whose coupling is about as great as its environments need it."""
    T = 10 ** rng.uniform(-3.3, -2.3)
    sensor = 2 * pi * rng.uniform(0.05, 0.3) / T if rng.random() < 0.3 else 0.0
    rigid = rng.random() < 0.2
    if rng.random() < 0.5:
        order = int(rng.integers(1, 3))
        plant = Plant(
            T, T * rng.uniform(0, 4), 1.0, 0.0, order, 2 * pi * rng.uniform(0.01, 0.08) / T, rng.random() < 0.3
        )
        gains, scale = (0.0, 0.0), 10 ** rng.uniform(-0.5, 1.5)
    else:
        m = 10 ** rng.uniform(-1, 0.5)
        plant = Plant(T, T * rng.choice([0.0, rng.uniform(0, 1.5)]), m, m / T * 10 ** rng.uniform(-4, -2))
        lag = T / 2 + plant.delay
        gains = (m / lag * rng.uniform(0.1, 0.5), 0.0)
        gains = (gains[0], gains[0] / lag * 10 ** rng.uniform(-2.5, -1)) if rng.random() < 0.8 else gains
        scale = gains[0]
    plant = replace(plant, sensor=sensor)
    k = scale / (T * 10 ** rng.uniform(0.5, 2.5))
    high = Hand(scale * T * 10 ** rng.uniform(-1, 1), scale * 10 ** rng.uniform(-2, 0), k)
    share = rng.choice([0.0, rng.uniform(0, 1)], 3)
    low = Hand(high.mass * share[0], high.damping * share[1], high.stiffness * share[2])
    b_c = inf if rigid else scale * 10 ** rng.uniform(-1.5, 0.5)
    tau = T * 10 ** rng.uniform(-0.5, 1.5)
    coupling = (
        b_c,
        scale * tau * 10 ** rng.uniform(-1.5, 0) if rigid else b_c * tau,
        scale * 10 ** rng.uniform(-3, -1),
    )
    mass, stiff = scale * T * 10 ** rng.uniform(-1, 2), scale / T * 10 ** rng.uniform(-3, 0)
    worlds = Worlds(
        World(
            mass * rng.choice([0.0, 10 ** rng.uniform(-3, 0)]),
            rng.choice([0.0, 0.03 * scale]),
            stiff * rng.choice([0.0, 0.3]),
        ),
        World(rng.choice([mass, mass, inf]), inf, rng.choice([stiff, stiff, inf])),
    )
    middle = Hands(low, high).middle
    whole = Whole(plant, (middle.mass, middle.damping, middle.stiffness), gains, coupling)
    return Case(whole, Hands(low, high), worlds, float(rng.choice([1.0, 1.05, 1.3])))


def environments(case: Case, hand: Hand, rng: np.random.Generator) -> Iterator[tuple[float, float, float]]:
    """Yield corners of the box, random members, and at many angles those of it that cancel the loop's reactance."""
    low, high, T = case.worlds.low, case.worlds.high, case.whole.plant.sample_time
    most = min(high.mass, 1e3 * (low.mass + 1)), min(high.stiffness, 1e7)
    yield from product((low.mass, most[0]), (low.damping,), (low.stiffness, most[1]))
    for _ in range(4):
        u, v = rng.uniform(0, 1, 2) ** 3
        yield low.mass + u * (most[0] - low.mass), low.damping, low.stiffness + v * (most[1] - low.stiffness)
    theta = np.geomspace(1e-3, 3.1, 300)
    alone = of_hand(case, hand)
    Y = seen(alone, theta) + offered(alone, theta)
    at = 2 / T * np.tan(theta / 2)
    for k in np.argsort(Y.real)[:3]:
        for mass, stiffness in balanced(case.worlds, -Y[k].imag, at[k]):
            yield mass, low.damping, stiffness


def balanced(worlds: Worlds, reactance: float, u: float) -> list[tuple[float, float]]:
    """Return masses and stiffnesses of the box with m u - k/u = reactance, on its edges."""
    low, high = worlds.low, worlds.high
    found = [(m, (m * u - reactance) * u) for m in (low.mass, high.mass) if m < inf]
    found += [((reactance + k / u) / u, k) for k in (low.stiffness, high.stiffness) if k < inf]
    edge = 1e-9
    return [
        (min(max(m, low.mass), high.mass), min(max(k, low.stiffness), high.stiffness))
        for m, k in found
        if low.mass - edge <= m <= high.mass * (1 + edge) + edge
        and low.stiffness - edge <= k <= high.stiffness * (1 + edge) + edge
    ]


def grows_in(case: Case, rng: np.random.Generator) -> bool:
    """Return whether some hand and environment of the boxes make the loop grow, with any share of the coupling."""
    ends = [(case.hands.low, case.hands.high)[k] for k in (0, 1)]
    corners = [
        Hand(*(getattr(ends[k], name) for k, name in zip(bits, ("mass", "damping", "stiffness"), strict=True)))
        for bits in product((0, 1), repeat=3)
    ]
    some = [corners[k] for k in rng.permutation(8)[:4]]
    for hand in some:
        alone = of_hand(case, hand)
        for world in environments(case, hand, rng):
            for share in {1.0, 1 / case.factor, 1 / rng.uniform(1, case.factor)}:
                if spectral_radius(in_world(alone, world, share)) > STABLE:
                    return True
    return False


def holds_a_pole(case: Case, outcome: Outcome) -> bool:
    """Return whether at the witness an environment of the box holds a pole on the unit circle."""
    assert outcome.hand is not None
    assert outcome.witness is not None
    T, alone = case.whole.plant.sample_time, of_hand(case, outcome.hand)
    theta = min(outcome.witness * T, pi * (1 - 1e-7))
    theta = max(theta, 1e-7)
    u = 2 / T * np.tan(theta / 2)
    Z, Z_c = seen(alone, np.array([theta]))[0], offered(alone, np.array([theta]))[0]
    for share in np.linspace(1 / case.factor, 1.0, 401):
        Y = share * Z_c + Z
        for m, k in balanced(case.worlds, -Y.imag, u):
            if -Y.real >= case.worlds.low.damping - 1e-9 * abs(Y):
                poles = np.linalg.eigvals(stepped(in_world(alone, (m, max(-Y.real, 0.0), k), share)))
                if np.abs(poles - np.exp(1j * theta)).min() < ON_CIRCLE:
                    return True
    return False


def judged(seed: int, count: int) -> dict[str, int]:
    """Judge random loops; return how many were proved, refuted, undecided, and which were wrong."""
    rng, found = np.random.default_rng(seed), dict.fromkeys(("proved", "refuted", "undecided", "wrong", "unstable"), 0)
    while sum(found.values()) < count:
        case = draw(rng)
        if spectral_radius(replace(case.whole, world=(0.0, 1e9, 0.0))) > STABLE:
            continue  # the velocity loop itself
        outcome = case.outcome()
        if outcome.verdict is Verdict.PROVED:
            found["wrong" if grows_in(case, rng) else "proved"] += 1
        elif outcome.verdict is Verdict.REFUTED:
            found["refuted" if holds_a_pole(case, outcome) else "wrong"] += 1
        else:
            found["undecided"] += 1
    return found


@pytest.mark.slow
def test_verdicts_agree_with_eigenvalues() -> None:
    """Of 400 random loops none is judged wrongly, both kinds of verdict occur, and few are undecided."""
    found = judged(35, 400)
    assert found["wrong"] == 0
    assert min(found["proved"], found["refuted"]) > 60
    assert found["undecided"] <= 8


def test_verdicts_of_some_loops_agree_with_eigenvalues() -> None:
    """The same of a dozen."""
    found = judged(5, 12)
    assert found["wrong"] == 0
    assert found["proved"] + found["refuted"] >= 11


def limit_of(hands: Hands, asked_in: Callable[[Hand], float]) -> float:
    """Return the damping that every environment must have at least, of hands that differ in one number."""
    low, high = astuple(hands.low), astuple(hands.high)

    def asked(share: float) -> float:
        return asked_in(Hand(*(a + share * (b - a) for a, b in zip(low, high, strict=True))))

    shares = np.concatenate((np.linspace(0, 1, 33), [1e-3, 1e-2]))
    found = np.array([asked(share) for share in shares])
    at, best, width = float(shares[np.argmax(found)]), float(found.max()), 1 / 32
    while width > 1e-8:
        near = np.clip(at + width * np.array([-1.0, -0.5, 0.5, 1.0]), 0, 1)
        values = [asked(share) for share in near]
        if max(values) > best:
            at, best = float(near[int(np.argmax(values))]), max(values)
        else:
            width /= 2
    return best


def damping_asked(worlds: Worlds, T: float, met: Callable[[np.ndarray], np.ndarray]) -> float:
    """Return the greatest -Re Y where -Im Y is a reactance of the box, the ends of such angles included."""

    def at(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        Y, u = met(theta), 2 / T * np.tan(theta / 2)
        least, most = (
            worlds.low.mass * u - worlds.high.stiffness / u,
            worlds.high.mass * u - worlds.low.stiffness / u,
        )
        return (-Y.imag <= most) & (-Y.imag >= least), -Y.real

    theta = np.append(np.geomspace(1e-4, 0.1, 300), np.linspace(0.1, pi * (1 - 1e-9), 900)[1:])
    inside, asked = at(theta)
    best = float(np.where(inside, asked, -inf).max())
    edges = np.flatnonzero(inside[1:] != inside[:-1])
    kept, left = (
        np.where(inside[edges], theta[edges], theta[edges + 1]),
        np.where(inside[edges], theta[edges + 1], theta[edges]),
    )
    for _ in range(45 if len(edges) else 0):
        middle = (kept + left) / 2
        within, _ = at(middle)
        kept, left = np.where(within, middle, kept), np.where(within, left, middle)
    if len(edges):
        best = max(best, float(at(kept)[1].max()))
    peaks = np.flatnonzero((asked[1:-1] >= asked[:-2]) & (asked[1:-1] >= asked[2:]) & inside[1:-1]) + 1
    for k in peaks:
        a, b = theta[k - 1], theta[k + 1]
        for _ in range(12):
            grid = np.linspace(a, b, 9)
            ok, value = at(grid)
            value = np.where(ok, value, -inf)
            n = int(np.argmax(value))
            best, a, b = max(best, float(value[n])), grid[max(n - 1, 0)], grid[min(n + 1, 8)]
    return best


def asked_of(case: Case, hand: Hand) -> float:
    """Return the damping that a loop asks of its environments in a hand."""
    alone = of_hand(case, hand)
    return damping_asked(
        case.worlds, case.whole.plant.sample_time, lambda theta: seen(alone, theta) + offered(alone, theta)
    )


def at_the_limit(seed: int, count: int, off: float) -> dict[str, int]:
    """Judge loops whose environments have the damping that they must have, a share more or less."""
    rng, found = np.random.default_rng(seed), dict.fromkeys(("right", "undecided", "wrong"), 0)
    while sum(found.values()) < count:
        case = draw(rng)
        if spectral_radius(replace(case.whole, world=(0.0, 1e9, 0.0))) > STABLE:
            continue
        name = str(rng.choice(["mass", "damping", "stiffness"]))
        one = replace(case.hands.middle, **{name: getattr(case.hands.low, name)})
        hands = Hands(one, replace(one, **{name: getattr(case.hands.high, name)}))
        case = replace(case, hands=hands, factor=1.0)
        limit = limit_of(hands, partial(asked_of, case))
        if not 1e-3 < limit / abs(offered(case.whole, np.array([0.5]))[0]) < 1e3:
            continue
        for sign in (1, -1):
            low = replace(case.worlds.low, damping=limit * (1 + sign * off))
            verdict = replace(case, worlds=replace(case.worlds, low=low)).outcome().verdict
            right = Verdict.PROVED if sign > 0 else Verdict.REFUTED
            found["undecided" if verdict is Verdict.UNDECIDED else "right" if verdict is right else "wrong"] += 1
    return found


@pytest.mark.slow
def test_verdicts_next_to_the_limit() -> None:
    """A thousandth beside the limit no verdict is wrong, and fewer than 2 % are undecided."""
    found = at_the_limit(3, 100, 1e-3)
    assert found["wrong"] == 0
    assert found["undecided"] < 2


def test_a_passive_box_is_every_passive_environment() -> None:
    """Without limits of mass and stiffness the margin is that of every passive environment."""
    rng = np.random.default_rng(2)
    for _ in range(4):
        case = draw(rng)
        every = replace(case, worlds=Worlds(World(0.0, 0.0, 0.0), World(inf, inf, inf)))
        design = Design(case.device, Gains(*case.whole.gains), Coupling(*case.whole.coupling))
        demands = Demands(case.device, (0.0, 1.0), case.factor, inf, passive=False, hands=case.hands)
        assert every.outcome().verdict is prove_hands(design, demands).verdict


def test_the_oracle_is_the_loop() -> None:
    """A pole lies where the oracle's response says that the environment cancels it."""
    rng, off = np.random.default_rng(1), []
    for _ in range(10):
        case = draw(rng)
        theta = rng.uniform(0.05, 2.5)
        at = np.array([theta])
        Y = (seen(case.whole, at) + offered(case.whole, at))[0]
        u = 2 / case.whole.plant.sample_time * np.tan(theta / 2)
        world = (max(-Y.imag, 0) / u, -Y.real, max(Y.imag, 0) * u)
        poles = np.linalg.eigvals(stepped(in_world(case.whole, world)))
        off.append(np.abs(poles - np.exp(1j * theta)).min())
    assert max(off) < 1e-6 * sqrt(10)
