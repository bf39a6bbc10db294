"""Proofs in every hand of a box, next to the demand, against oracles and in exact time, which share nothing with them.

What is refuted grows with a lossless spring or mass; what is proved grows in no hand of the box before no passive
environment.
"""

from __future__ import annotations

import sys
import time
from dataclasses import astuple, dataclass
from functools import cache, partial
from math import pi
from statistics import median

import numpy as np
import pytest
from conftest import drawn, mostly_slow
from device_arithmetic import DIGITS, DOUBLES, Arithmetic
from device_oracle import Real
from device_pairs import real_of
from firmware import Device as Sampled
from in_time import Environment, Loop, cancelling, coupling_at, random_environment, seen_at
from random_hands import InHands, box_of, exact_need, in_hands
from sampled_device_oracle import Hand as Held

from vctune.model.hands import Hands
from vctune.model.problem import Demands
from vctune.proof.claims.every_hand import prove_hands
from vctune.proof.engine.box_tests import positive
from vctune.proof.engine.boxes import band_of, over_band
from vctune.proof.engine.branching import prove
from vctune.proof.engine.interval import Outcome, Verdict

FACTOR = 1.05
SIDES = (1e-3, -1e-3, 1e-5, -1e-5)
"""By how much the least ratio is above or below the factor."""
FEW, MANY, MANY_LIMP = (1, 2), drawn(200), drawn(60)
LEFT_OPEN = 0.03
"""Share of the proofs that may be given up: of flexible devices whose resonance with the hand crosses a wide box."""
SECONDS = 5.0
"""Of a proof at the median, on a slow machine too; what it takes on a quick one is printed."""
LEAST = 1e-5
"""Least angle of a witness at which the growth is asked for in doubles: below it takes years, and they round it."""
HANDS, AT_REST = 200, 1 + 1e-9
WALLS, SAMPLES = 3, 4000


@dataclass(frozen=True)
class Judged:
    """A case, what is said of it and how long that took, s."""

    side: float
    case: InHands
    outcome: Outcome
    seconds: float

    @property
    def expected(self) -> Verdict:
        return Verdict.PROVED if self.side > 0 else Verdict.REFUTED

    @property
    def real(self) -> Real:
        return real_of(self.case.design.device)


@cache
def drawn(number: int, *, integrator: bool = True) -> InHands:
    """Return the number-th design, of a least ratio of 1; of a third of them the worst hand is inside the box."""
    return in_hands(np.random.default_rng((51, number)), inside=number % 3 == 0, integrator=integrator)


@cache
def judged(number: int, factor: float = FACTOR, *, integrator: bool = True) -> Judged:
    """Return the number-th design, next to a factor, and what is proved of it."""
    side = SIDES[number % 4]
    case = drawn(number, integrator=integrator).scaled(factor * (1 + side))
    demands = Demands(case.design.device, (1.0, 10.0), factor, 100.0, passive=False, hands=case.hands)
    begin = time.process_time()
    outcome = prove_hands(case.design, demands)
    return Judged(side, case, outcome, time.process_time() - begin)


def check(number: int, found: Judged) -> None:
    """Assert that a proof is not against the oracles' search, and that where it is a refusal, 50 digits say so.

    A refusal may be right where the search has missed the worst hand.
    """
    design, outcome = found.case.design, found.outcome
    assert outcome.verdict is not Verdict.PROVED or found.expected is Verdict.PROVED, (number, found)
    if outcome.verdict is Verdict.REFUTED:
        assert inside(found.case.hands, outcome.hand)
        assert 0 <= outcome.witness <= pi / design.device.sample_time * (1 + 1e-15)
        need = exact_need(found.real, design.gains, design.coupling, outcome.hand, outcome.witness)
        assert need * FACTOR > 1, (number, found)


def inside(hands: Hands, hand: Held) -> bool:
    box, numbers = box_of(hands), np.array(astuple(hand))
    return bool(np.all((numbers >= box[:, 0]) & (numbers <= box[:, 1])))


@pytest.mark.parametrize("integrator", [True, False], ids=["", "without an integrator"])
@pytest.mark.parametrize("number", mostly_slow(FEW, [2]))
def test_no_verdict_is_wrong(number, integrator):
    """Without an integrator F vanishes with the angle and the stiffness together."""
    found = judged(number, integrator=integrator)
    check(number, found)
    assert found.outcome.verdict is found.expected


@pytest.mark.slow
@pytest.mark.parametrize(("integrator", "many"), [(True, MANY), (False, MANY_LIMP)], ids=["", "without an integrator"])
def test_no_verdict_of_many_is_wrong(integrator, many, capsys):
    every = [judged(number, integrator=integrator) for number in range(many)]
    for number, found in enumerate(every):
        check(number, found)
    open_ = [number for number, found in enumerate(every) if found.outcome.verdict is Verdict.UNDECIDED]
    missed = [
        number for number, found in enumerate(every) if found.outcome.verdict not in (found.expected, Verdict.UNDECIDED)
    ]
    seconds, insides = [found.seconds for found in every], [found.case.inside for found in every]
    with capsys.disabled():
        sys.stdout.write(
            f"\n{many} loops in boxes of hands: undecided {open_}, refused where the search has missed the worst hand "
            f"{missed}; processor time median {median(seconds):.2f} s, mean {np.mean(seconds):.2f} s, greatest "
            f"{max(seconds):.1f} s; worst hand inside a range in {sum(inside > 0 for inside in insides)}, inside two "
            f"in {sum(inside > 1 for inside in insides)}\n"
        )
    assert len(open_) < LEFT_OPEN * many
    assert len(missed) < LEFT_OPEN * many
    assert median(seconds) < SECONDS
    assert sum(inside > 0 for inside in insides) > many / 4


@pytest.mark.slow
@pytest.mark.parametrize("few", [0, 64])
def test_faces_prove_what_whole_boxes_do(few):
    """Quadratic margins that are least inside, on a face or at a corner, 1e-4 above and below 0."""
    names, grid = ("x", "y"), np.linspace(0.0, 1.0, 401)
    ends = np.zeros((2, 1)), np.ones((2, 1))
    places = 1 + grid[:, None, None], grid[None, :, None], grid[None, None, :]
    for number in range(6):
        rng = np.random.default_rng((53, number))
        centre, shape = rng.uniform([0.5, -0.7, -0.7], [2.5, 1.7, 1.7]), rng.uniform(0.1, 2, 3) * [1, 1, -1]
        tilt = rng.uniform(-1, 1)

        def margin(omega, v, centre=centre, shape=shape, tilt=tilt, offset=0.0):
            a, b, c = omega - centre[0], v["x"] - centre[1], v["y"] - centre[2]
            return shape[0] * (a * a) + shape[1] * (b * b) + shape[2] * (c * c) + tilt * (a * b) - offset

        least = float(np.min(margin(places[0], {"x": places[1], "y": places[2]})))
        for side in (1e-4, -1e-4):
            test = positive(partial(margin, offset=least - side), {})
            boxes = over_band(names, *ends, band_of(1.0, 2.0, 1.4))
            halved = {"halved": [True] * 3, "max_halvings": 60, "max_boxes": 100_000}
            found = prove(test, boxes, 1, **halved, at_ends=True, few=few)
            assert bool(found.proved[0]) == (side > 0), (number, side)
            if side < 0:
                omega, x, y = found.failing[:, 0]
                assert margin(omega, {"x": x, "y": y}, offset=least - side) < 0


def test_a_face_where_another_margin_is_least_is_not_enough():
    """A margin that fails at x = 1 and omega > 1/2, beside one that proves as much next to 0 and is least at x = 0."""

    def margin(omega, v):
        return 1 - 2 * v["x"] * omega

    def sufficient(omega, v):
        return 0.1 + v["x"] - 100 * omega * (omega - 0.25)

    boxes = over_band(("x",), np.zeros((1, 1)), np.ones((1, 1)), (np.zeros(1), np.ones(1)))
    test = positive(margin, {}, sufficient)
    found = prove(test, boxes, 1, halved=[True] * 2, max_halvings=60, max_boxes=1000, at_ends=True)
    omega, x = found.failing[:, 0]
    assert not found.proved[0] and margin(omega, {"x": x}) < 0


def loop_of(found: Judged, hand: Held, environment: Environment, num: Arithmetic = DOUBLES) -> Loop:
    design = found.case.design
    return Loop(found.real, design.gains, design.coupling, hand, environment, num)


def missing(found: Judged, hand: Held, omega: float, num: Arithmetic = DOUBLES) -> tuple[Environment, float]:
    """Return the spring or mass that cancels Im(Z_c + Z_seen) at a frequency, and the real part, N s/m."""
    real, design = found.real, found.case.design
    z = num.exp(num.i * num.number(omega) * num.number(real.sample_time))
    met = coupling_at(real, design.coupling, z, num) + seen_at(real, design.gains, hand, z, num)
    return cancelling(real, float(met.imag), omega / (2 * pi)), float(met.real)


def check_growth(number: int, found: Judged) -> bool:
    """Assert that a refuted design grows in exact time with the environment made for it; return whether it was."""
    outcome = found.outcome
    if outcome.verdict is not Verdict.REFUTED:
        return False
    hand = Held(*astuple(outcome.hand))
    lossless, resistance = missing(found, hand, outcome.witness, DIGITS)
    assert resistance < 0, (number, found)
    assert loop_of(found, hand, lossless, DIGITS).spectral_radius() > 1, (number, found)
    return True


@pytest.mark.slow
@pytest.mark.parametrize("number", [3, 5])
def test_what_is_refuted_grows(number):
    assert check_growth(number, judged(number, 1.0))


@pytest.mark.slow
def test_everything_refuted_grows(capsys):
    """With a factor of 1: what misses a greater one may be passive."""
    grown = [check_growth(number, judged(number, 1.0)) for number in range(1, MANY, 2)]
    with capsys.disabled():
        sys.stdout.write(f"\n{sum(grown)} of {len(grown)} refuted designs grow with what is made for them\n")
    assert sum(grown) >= (1 - LEFT_OPEN) * len(grown)


def hands_of(rng: np.random.Generator, found: Judged, count: int) -> list[Held]:
    """Return hands of a box, its corners more often than not, and first the worst one."""
    low, width = box_of(found.case.hands)[:, 0], np.ptp(box_of(found.case.hands), axis=1)
    shares = np.clip(rng.uniform(-0.5, 1.5, (count - 1, 3)), 0, 1)
    return [Held(*astuple(found.case.worst)), *(Held(*map(float, low + width * share)) for share in shares)]


def worst_environments(rng: np.random.Generator, found: Judged, hand: Held) -> list[Environment]:
    """Return the worst environment of a hand at some frequency, and the same with a mass and its spring beside it."""
    T = found.real.sample_time
    omega = found.case.omega or 1e-3 / T
    if rng.random() < 0.5:
        omega = min(omega * 10 ** rng.uniform(-1, 1), 0.999 * pi / T)
    lossless, _ = missing(found, hand, min(omega, 0.999 * pi / T))
    bend, mass = 2 / T * np.tan(omega * T / 2), 10 ** rng.uniform(-3, 1)
    return [lossless, Environment(lossless.mass + mass, 0.0, lossless.stiffness + mass * bend**2)]


def check_rest(number: int, found: Judged, count: int) -> None:
    """Assert that a proved design grows in no hand of its box: before no linear environment, and at no wall."""
    rng = np.random.default_rng((52, number))
    for index, hand in enumerate(hands_of(rng, found, count)):
        for environment in (random_environment(rng), *worst_environments(rng, found, hand)):
            radius = float(loop_of(found, hand, environment).spectral_radius())
            if radius > AT_REST:  # a double eigenvalue at 1 is rounded to the root of a unit
                radius = float(loop_of(found, hand, environment, DIGITS).spectral_radius())
            assert radius < AT_REST, (number, hand, environment, found)
        if index < WALLS:
            settles_at_a_wall(rng, found, hand)


def settles_at_a_wall(rng: np.random.Generator, found: Judged, hand: Held) -> None:
    """Assert that hand and device do not gain from bouncing at a one-sided wall, which runs by backward Euler."""
    design, T = found.case.design, found.real.sample_time
    device = Sampled(found.real, hand, DOUBLES)
    stiffness = design.device.mass / T**2 * 10 ** rng.uniform(-4, 1)
    b_c, m_c, b_0 = astuple(design.coupling)
    soft = b_c / (1 + b_c * T / (2 * m_c))
    memory = np.zeros(device.size)
    memory[0], memory[1] = rng.uniform(-1, 1) * 1e-3, rng.uniform(-1, 1) * 0.1
    x_p, p_c, size = float(memory[0]), 0.0, []
    step = device_matrix(device)
    for _ in range(SAMPLES):
        force = float(device.force(memory))
        free = (force + soft * p_c) / (b_0 + soft)
        pressed = (force + soft * p_c - stiffness * x_p) / (b_0 + soft + stiffness * T)
        v_e = pressed if x_p + T * pressed > 0 else free
        x_e = x_p + T / 2 * v_e
        command = design.gains.velocity * (v_e - float(device.velocity(memory)))
        command += design.gains.position * (x_e - float(device.position(memory)))
        memory = step @ np.append(memory, command)
        x_p, p_c = x_p + T * v_e, p_c + T / m_c * soft * (v_e - p_c)
        size.append(abs(force) + abs(command))
    early, late = max(size[: SAMPLES // 4]), max(size[-SAMPLES // 4 :])
    assert late < 2 * early, (hand, stiffness, found)


def device_matrix(device: Sampled) -> np.ndarray:
    """Return the matrix of a sample's wait, over memory and command."""
    ahead = [device.wait(unit[:-1], unit[-1]) for unit in np.eye(device.size + 1)]
    return np.array(ahead).T


@pytest.mark.slow
@pytest.mark.parametrize("number", [0, 2])
def test_what_is_proved_stays_at_rest(number):
    check_rest(number, judged(number, 1.0), 5)


@pytest.mark.slow
def test_everything_proved_stays_at_rest():
    """With a factor of 1: next to what grows."""
    proved = [number for number in range(0, MANY, 2) if judged(number, 1.0).outcome.verdict is Verdict.PROVED]
    assert len(proved) >= (1 - 2 * LEFT_OPEN) * MANY / 2
    for number in proved:
        check_rest(number, judged(number, 1.0), HANDS)
