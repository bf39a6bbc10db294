"""The bound of what hands ask for: no hand asks for more, by oracles of its own; what it proves of couplings holds."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from conftest import ROOT, mostly_slow
from device_arithmetic import DOUBLES
from device_pairs import real_of
from in_time import seen_at
from random_hands import in_hands
from sampled_device_oracle import Hand as Held
from test_impedance_display import ROUNDING, T, display, mechanics_of, pulse, random_display, random_hand, worst_of

import vctune
from vctune.design.prepared import pose
from vctune.design.verdict.judge import Status, judge
from vctune.document.reading import parse_problem, read_problem
from vctune.model.gains import Gains, SpringDamper
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.problem import HUMAN_HANDS
from vctune.model.sampled.hand_loop import loop_in_hand, required_in_hand
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.proof.certificate import certify
from vctune.proof.claims.envelope import Envelope, envelope
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.engine.interval import Verdict
from vctune.study.plane import plane
from vctune.study.region import Kind, region

FEW, HANDS = 2, 40
NEAR = {False: 0.01, True: 0.1}
"""By how much more than some hand asks for half of the pieces are at most, relative, without and with a flexible
handle, whose pieces are left higher where they are hard to prove."""


def random_box(random) -> Hands:
    low = random.choice([0, 1]) * 10 ** random.uniform([-3, -2, 0], [-1, 0, 2])
    width = 10 ** random.uniform([-2, -1, 1], [0.5, 1.5, 3.5])
    return Hands(Hand(*map(float, low)), Hand(*map(float, low + width)))


def bound_at(found: Envelope, theta: np.ndarray) -> np.ndarray:
    piece = np.clip(np.searchsorted(found.low, theta, "right") - 1, 0, len(found.low) - 1)
    return found.offset[piece] + found.slope[piece] * theta


def angles(random) -> np.ndarray:
    return np.concatenate((pi * 10 ** random.uniform(-3.5, 0, 30), random.uniform(0, pi, 10)))


def lies_above(found: Envelope, theta: np.ndarray, asked: list[np.ndarray]) -> bool:
    assert np.isfinite(found.offset).all()
    most = np.max(asked, axis=0)
    return bool((bound_at(found, theta) >= most - 1e-9 * np.abs(most)).all())


@pytest.mark.parametrize("number", mostly_slow(range(12), [1, 10]))
def test_no_hand_asks_an_impedance_display_for_more(number):
    """By matrix exponentials."""
    random = np.random.default_rng((3, number))
    device, gains, _ = random_display(random)
    hands = HUMAN_HANDS if number % 2 else random_box(random)
    theta, asked = angles(random), []
    for _ in range(HANDS):
        held, _ = random_hand(random, hands)
        G = pulse(mechanics_of(device, held), device.delay, theta)
        if device.velocity is None or device.velocity.filter_hz is None:
            filtered = 1.0
        else:
            pole = np.exp(-2 * pi * device.velocity.filter_hz * T)
            filtered = (1 - pole) / (1 - pole * np.exp(-1j * theta))
        asked.append(-(G / (1 + gains.velocity * filtered * G)).real / np.sin(theta / 2) ** 2)
    assert lies_above(envelope(device, hands, gains), theta, asked)


@pytest.mark.parametrize("number", mostly_slow([*range(12), 18], [2]))
def test_no_hand_asks_an_admittance_display_for_more(number):
    case, random = in_hands(np.random.default_rng((51, number)), inside=number % 3 == 0), np.random.default_rng(number)
    device, gains, theta, asked = case.design.device, case.design.gains, angles(random), []
    for _ in range(HANDS):
        held, _ = random_hand(random, case.hands)
        seen = [
            seen_at(real_of(device), gains, Held(held.mass, held.damping, held.stiffness), z, DOUBLES)
            for z in np.exp(1j * theta)
        ]
        asked.append(-np.array(seen).real)
    assert lies_above(envelope(device, case.hands, gains), theta, asked)


@pytest.mark.parametrize("number", mostly_slow(range(12), [1]))
def test_the_bound_is_near_what_some_hand_asks_for(number):
    """Next to the most that 1,331 hands ask for."""
    device, gains, _ = random_display(np.random.default_rng((3, number)))
    found = envelope(device, HUMAN_HANDS, gains)
    theta = (found.low + found.high) / 2
    shares = np.linspace(0, 1, 11) ** 3
    high = HUMAN_HANDS.high
    some = np.meshgrid(high.mass * shares, high.damping * shares, high.stiffness * shares, indexing="ij")
    plant = plant_in_hand(device, Hand(*(number.reshape(-1, 1) for number in some)), delays_of(device), FLOATS)
    required = required_in_hand(loop_in_hand(plant, theta, FLOATS), gains)
    most = np.maximum(np.nanmax(required.lost / required.size, axis=0), 0.0)
    excess = (bound_at(found, theta) - most) / np.maximum(np.abs(most), 1e-3 * np.abs(most).max())
    assert np.median(excess) < NEAR[device.structure is not None]


@pytest.mark.slow
def test_where_a_hand_makes_the_loop_unstable_there_is_no_bound():
    """K_v of so much that the loop in a light hand oscillates: F turns around 0 on the way from a heavy one."""
    device = display(mass=0.05, delay=1.5 * T)
    light, heavy = Hand(0.0, 0.0, 0.0), Hand(5.0, 30.0, 100.0)
    found = envelope(device, Hands(light, heavy), Gains(60.0, 0.0))
    assert np.isinf(found.offset).any()


def test_a_loop_that_a_hand_makes_unstable_has_no_admissible_coupling():
    tables = {"device": {"display": "impedance", "mass": 0.1, "damping": 0.3, "sample_time": T}}
    tables |= {"gains": {"velocity": 500.0}, "stability": {"criterion": "hands"}}
    tables["operator"] = {"mass": 0.2, "damping": 3.0, "stiffness": 200.0}
    assert vctune.region(tables, resolution=1 / 8).areas["infeasible"] == 1


@pytest.mark.parametrize("resolution", [1 / 32, pytest.param(1 / 256, marks=pytest.mark.slow)])
def test_the_region_of_a_paddle(resolution):
    """What is proved of its cells holds: of feasible ones in exact time, of infeasible ones by a certificate."""
    path = ROOT / "problems/paddle.toml"
    found, problem = vctune.region(path, resolution=resolution).region, read_problem(path).problem
    assert found.area(Kind.UNDECIDED) < 2.5 * resolution
    random, cells = np.random.default_rng(8), found.plane.cells(found.squares)
    for kind in (Kind.FEASIBLE, Kind.INFEASIBLE):
        for cell in random.choice(np.flatnonzero(found.kinds == kind), 12):
            low, high = cells.low[2:, cell], cells.high[2:, cell]
            coupling = SpringDamper(*map(float, low + (high - low) * random.choice([0.0, 1.0, random.uniform()], 2)))
            if kind is Kind.FEASIBLE:
                assert worst_of(random, problem.device, Gains(0.0, 0.0), coupling, problem.hands, 40) < 1 + ROUNDING
            else:
                demands = pose(problem).demands
                verdict = certify(Design(problem.device, Gains(0.0, 0.0), coupling), demands).verdict
                assert verdict is Verdict.REFUTED


@pytest.mark.parametrize("criterion", ["passive", pytest.param("hands", marks=pytest.mark.slow)])
def test_the_region_of_an_uncertain_arm_is_that_of_all_its_devices(criterion):
    """Of couplings of its cells the certificate is for every device of the box."""
    text = (ROOT / "problems/desktop-arm.toml").read_text() + f'\n[stability]\ncriterion = "{criterion}"\n'
    problem = parse_problem(text, "arm", "arm")
    assert problem.uncertainty is not None
    across = plane(problem, "coupling.damping", "coupling.stiffness", 6)
    found, random = region(problem, across, across.coarsest_squares()), np.random.default_rng(4)
    cells, expected = across.cells(found.squares), {Kind.FEASIBLE: Status.CERTIFIED, Kind.INFEASIBLE: Status.VIOLATED}
    for kind, status in expected.items():
        for cell in random.choice(np.flatnonzero(found.kinds == kind), 6):
            low, high = cells.low[2:, cell], cells.high[2:, cell]
            coupling = SpringDamper(*map(float, low + (high - low) * random.choice([0.0, 1.0, random.uniform()], 2)))
            assert judge(problem, Gains(0.0, 0.0), coupling).status is status
    assert found.area(Kind.UNDECIDED) < 0.04
