"""Hands next to resonance with the device are proved by boxes that lie along it: none is lost, no verdict changes."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pytest
from conftest import mostly_slow
from device_pairs import real_of
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from random_hands import exact_need

from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains, SpringDamper
from vctune.model.hands import HAND, Hand, Hands
from vctune.model.problem import Demands
from vctune.proof.claims import every_hand as in_hands
from vctune.proof.claims.every_hand import prove_hands
from vctune.proof.claims.in_hands.resonant_hands import AROUND, DEVICE_MASS, ROWS, Resonance, resonance
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.engine.boxes import FREQUENCY, Boxes
from vctune.proof.engine.branching import Decided
from vctune.proof.engine.interval import Verdict

HELD = Hands(Hand(0.0, 0.0, 0.0), Hand(0.5, 30.0, 3000.0))
SHARE = st.floats(0.0, 1.0)


@pytest.fixture(autouse=True)
def at_once(monkeypatch):
    """Resonance is looked at apart wherever it is sharp, also where the other boxes would do."""
    monkeypatch.setattr(in_hands, "EASY_BOXES", 0)


def nothing_known(boxes: Boxes) -> Decided:
    none, zero = np.zeros(len(boxes), bool), np.zeros_like(boxes.low)
    middle, least = (boxes.low + boxes.high) / 2, np.full(len(boxes), -np.inf)
    return Decided(none, none.copy(), middle, zero, none.copy(), zero.copy(), least)


def one_box(names, low, high):
    edges = (np.array(edge, float)[:, None] for edge in (low, high))
    return Boxes((FREQUENCY, *names), *edges, np.zeros(1, np.intp), np.zeros(1, np.intp))


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.floats(1e-3, 3.14), st.lists(SHARE, min_size=4, max_size=4), st.floats(1e-6, 0.5), st.booleans())
def test_a_box_that_is_left_to_the_others_is_among_them(theta, shares, width, uncertain):
    """Each of its points has the same angle, mass and stiffness there, within what is looked at."""
    near = Resonance(0.1, 1e-3, 10.0, 3000.0, 2e-3)
    mass, damping, stiffness, own = (share * most for share, most in zip(shares, (0.5, 30.0, 3000.0, 0.2), strict=True))
    names, low = (*HAND, DEVICE_MASS), [theta, mass, damping, 10.0 + stiffness, 0.05 + own]
    high = [edge * (1 + width) for edge in low]
    names, low, high = (names, low, high) if uncertain else (names[:-1], low[:-1], high[:-1])
    box = one_box(names, low, high)
    if not near.left_to_it(nothing_known, names)(box).proved[0]:
        return
    rng = np.random.default_rng(1)
    there = (*ROWS, *names[len(HAND) :])
    for _ in range(20):
        at = rng.uniform(low, high)
        m = at[4] if uncertain else near.mass
        ratio = at[3] / ((m + at[1]) * (at[0] / near.sample_time) ** 2)
        assert AROUND[0] <= ratio <= AROUND[1] and at[0] >= near.first
        point = [*at[:3], ratio, *at[4:]]
        outside = near.in_range(nothing_known, there)(one_box(there, point, point)).proved[0]
        assert not outside or at[3] > near.greatest
        hand = near.hand(at[0], dict(zip(there, point[1:], strict=True)))
        assert astuple(hand) == pytest.approx((at[1], at[2], min(at[3], near.greatest)))


def drawn(number: int) -> tuple[Design, Hands]:
    """Return a lightly damped device and a design of it, and hands."""
    rng = np.random.default_rng((97, number))
    impedance = number % 2 == 0
    mass, K, T = 10 ** rng.uniform(-1.5, 0), 10 ** rng.uniform(2.5, 3.5), 10 ** rng.uniform(-3.3, -2.8)
    held = Hands(Hand(0.0, 0.0, rng.choice([0.0, 50.0])), Hand(rng.uniform(0, 0.5), 30.0, K))
    damping = rng.uniform(0.008, 0.025) * 2 * np.sqrt(K * (mass + held.high.mass))
    device = Device(
        mass, damping, T, display="impedance" if impedance else "admittance", delay=rng.choice([0.0, 0.3 * T])
    )
    if impedance:
        return Design(device, Gains(0.0, 0.0), SpringDamper(0.4 * damping, 0.4 * damping / T)), held
    gains = Gains(0.2 * damping, 0.0)
    return Design(device, gains, Coupling(50 * damping, 0.5 * mass, 0.5 * damping)), held


def scaled(design: Design, factor: float) -> Design:
    """Return the design with as much more of what it is to offer."""
    parts = astuple(design.coupling)
    if isinstance(design.coupling, SpringDamper):
        return Design(design.device, design.gains, SpringDamper(*(part / factor for part in parts)))
    return Design(design.device, design.gains, Coupling(*(part * factor for part in parts)))


def greatest_need(design: Design, held: Hands) -> float:
    """Return the greatest R/Re Z_c, in 50 digits, of hands at resonance and next to it."""
    rng, real, T = np.random.default_rng(5), real_of(design.device), design.device.sample_time
    needs = []
    for _ in range(200):
        mass, damping = rng.uniform(0, held.high.mass), rng.choice([0.0, 0.01]) * design.device.damping
        stiffness = held.high.stiffness * rng.choice([1.0, rng.uniform(0, 1)])
        omega = np.sqrt(stiffness / (design.device.mass + mass)) * (1 + rng.normal() * rng.choice([0.0, 0.02, 0.2]))
        if 0 < omega < np.pi / T:
            hand = Hand(mass, max(damping, held.low.damping), stiffness)
            needs.append(exact_need(real, design.gains, design.coupling, hand, omega))
    return max(needs)


@pytest.mark.parametrize("number", mostly_slow(range(10), [0]))
def test_no_verdict_is_another_than_without(number, monkeypatch):
    """Next to the demand, where it is found by bisection; what is refused names a hand that fails."""
    design, held = drawn(number)
    demands = Demands(design.device, (1.0, 10.0), 1.05, 100.0, passive=False, hands=held)
    assert resonance(design, held) is not None
    low, high = 2.0**-8, 2.0**8
    while high > 1.04 * low:
        middle = np.sqrt(low * high)
        proved = prove_hands(scaled(design, middle), demands).verdict is Verdict.PROVED
        low, high = (low, middle) if proved else (middle, high)
    assert 2.0**-7 < low < 2.0**7
    for factor, expected in ((high * 1.02, Verdict.PROVED), (low / 1.02, Verdict.REFUTED)):
        found = prove_hands(scaled(design, factor), demands)
        with monkeypatch.context() as without:
            without.setattr(in_hands, "resonance", lambda design, hands, box: None)
            assert prove_hands(scaled(design, factor), demands).verdict in (expected, Verdict.UNDECIDED)
        assert found.verdict is expected
        if found.verdict is Verdict.PROVED and design.device.kind.senses_force:
            assert greatest_need(scaled(design, factor), held) * demands.factor <= 1
        if found.hand is not None:
            assert all(a <= x <= b for a, x, b in zip(*map(astuple, (held.low, found.hand, held.high)), strict=True))


@pytest.mark.slow
def test_a_device_of_hardly_any_damping_is_proved():
    """A damping ratio of 1e-5; by boxes across the resonance it was undecided after half a million of them."""
    device = Device(0.045, 0.001, 1e-3, display="impedance")
    demands = Demands(device, (1.0, 10.0), 1.05, 100.0, passive=False, hands=HELD)
    found = prove_hands(Design(device, Gains(0.0, 0.0), SpringDamper(0.02703, 7.474)), demands)
    assert found.verdict is Verdict.PROVED and found.boxes < 100_000
    refused = prove_hands(Design(device, Gains(0.0, 0.0), SpringDamper(0.0272, 7.55)), demands)
    assert refused.verdict is Verdict.REFUTED
