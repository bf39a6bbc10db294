"""The sampled loop in a known hand: against an oracle that shares nothing with it, closed forms, every arithmetic."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import astuple, replace
from math import inf, pi
from typing import Any, NamedTuple

import numpy as np
import pytest
from agreement import all_to_all_digits, contains, to_all_digits
from arithmetic import DIGITS, Digits
from conftest import DRAWS, WHOLE
from devices import device_of
from draws import COMBINATIONS, Tables, combined, coupling_for, gains_for
from draws import hand_for as drawn_hand
from loop import Loop, offered, sensitivity
from loop import port as port_of

from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains, sampled_resistance
from vctune.model.hands import HAND, Hand
from vctune.model.numbers.arithmetic import FLOATS, Arithmetic, Number
from vctune.model.sampled.hand_loop import (
    LoopInHand,
    NextToRest,
    loop_in_hand,
    required_in_hand,
    required_in_limp_hand,
    seen_in_hand,
    seen_in_limp_hand,
)
from vctune.model.sampled.loop_in_worlds import disjuncts, limp_disjuncts, offered_at, sum_of
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand, plants_in_spring
from vctune.model.worlds import World, Worlds
from vctune.proof.claims.cases import case_at
from vctune.proof.claims.hands import hand_margin, margin_in_spring
from vctune.proof.enclosures.intervals import ENCLOSURES, between, decimal

WHEEL = device_of({"mass": 0.4, "damping": 2.0, "sample_time": 1e-3})
WHEEL_GAINS = Gains(714.08906, 19575.807)
WITH_PARTS = device_of(
    {
        "mass": 0.4,
        "damping": 2.0,
        "sample_time": 1e-3,
        "delay": 3e-4,
        "velocity": {"from": "difference", "filter_hz": 200.0},
        "actuator": {"bandwidth_hz": 500.0},
        "force_sensor": {"bandwidth_hz": 500.0, "delay": 4e-4},
    }
)
GAINS = Gains(150.0, 3000.0)
HERTZ = (1, 10, 100, 400, 499.999999)
SHARES = (1e-6, 1e-3, 0.03, 0.2, 0.4999)
"""Of the sampling rate."""
QUICK = Digits(80)
"""For balls of 128 bits."""
KEYS = (*HAND, "theta")


def loop(
    device: Device, hand: Hand, theta: Number, ops: Arithmetic = FLOATS, plain: Device | None = None
) -> LoopInHand:
    """Return the loop in the hand; the plain device is the one of which device is an enclosure."""
    return loop_in_hand(plant_in_hand(device, hand, delays_of(plain or device), ops), theta, ops)


def required(device: Device, gains: Gains, hand: Hand, theta: Any) -> Any:
    """Return R in doubles, N s/m."""
    found = required_in_hand(loop(device, hand, np.asarray(theta)), gains)
    return found.lost / found.size


def number(part: Any, theta: Any) -> Any:
    """Return even + j s odd."""
    return part.even + 1j * np.sin(theta / 2) * part.odd


def seen(device: Device, gains: Gains, hand: Hand, theta: Any) -> Any:
    """Return Z_seen in doubles, N s/m."""
    found = loop(device, hand, theta)
    return number(found.numerator(gains), theta) / (2j * np.sin(theta / 2)) / number(found.closed(gains), theta)


def oracles(device: Tables, gains: Gains, hand: Hand, angles: Iterable[Any], num: Any = DIGITS) -> list[Any]:
    """Return what the oracle says of Z_seen, N s/m."""
    port = port_of(Loop(device, astuple(gains), hand=astuple(hand), num=num))
    return [-port(num.exp(num.i * num.number(theta))) for theta in angles]


def oracle(device: Tables, gains: Gains, hand: Hand, theta: Any, num: Any = DIGITS) -> Any:
    return oracles(device, gains, hand, [theta], num)[0]


class Held(NamedTuple):
    """A device as its tables and as vctune has it, with gains, in a hand."""

    tables: Tables
    device: Device
    gains: Gains
    hand: Hand
    rng: np.random.Generator


def cases(numbers: Iterable[int], seed: int) -> Iterator[Held]:
    """Yield random devices, with the combinations of parts one after the other, with gains and a hand."""
    for k in numbers:
        rng = np.random.default_rng((seed, k))
        tables = combined(rng, k)
        gains, hand = Gains(*gains_for(rng, tables)), Hand(*drawn_hand(rng, tables))
        yield Held(tables, device_of(tables), gains, hand, rng)


SOME = range(0, len(COMBINATIONS), 11)
"""Of all combinations: 11 has no factor in common with their number."""
EVERY = 1 if DRAWS >= WHOLE else 5
"""Every which combination a slow run takes; 5 has no factor in common with their number either, 192."""
FEW = range(0, len(COMBINATIONS), 41)
"""Fewer of them, for what takes long."""


def radius(device: Device, gains: Gains, hand: Hand) -> float:
    """Return the spectral radius: F e^(-j n theta/2) is a polynomial in e^(-j theta), with its DFT as coefficients."""
    plant = plant_in_hand(device, hand, delays_of(device), FLOATS)
    theta = 2 * pi * np.arange(64) / 64
    turned = np.exp(-0.5j * (len(plant.push) + plant.filter_poles) * theta)
    coefficients = np.fft.ifft(number(loop_in_hand(plant, theta, FLOATS).closed(gains), theta) * turned).real
    degree = int(np.flatnonzero(np.abs(coefficients) > 1e-14 * np.abs(coefficients).max())[-1])
    return float(np.abs(np.roots(coefficients[: degree + 1])).max())


@pytest.mark.parametrize(
    ("device", "law", "hand", "printed", "printed_radius"),
    [
        (
            WHEEL,
            WHEEL_GAINS,
            Hand(0, 2, 1000),
            "-3.30189871, -1.79708223, -1.43203308, .75885157, 16.66506962",
            ".971311321227",
        ),
        (WHEEL, WHEEL_GAINS, Hand(0, 5, 1000), "41.65673015", ".971431542196"),
        (
            WHEEL,
            WHEEL_GAINS,
            Hand(0.1, 5, 500),
            "-5.073865, -5.1123491, -48.7445991, 107.034006, 508.637387",
            ".972009890218",
        ),
        (
            WITH_PARTS,
            GAINS,
            Hand(0.1, 5, 500),
            "-5.92496224, -4.67687430, -23.4782379, -1.42762575, -10.4771066",
            ".976809123701",
        ),
    ],
    ids=["damper and spring", "heavier damper", "with mass", "a and a late sensor"],
)
def test_check_numbers(device: Device, law: Gains, hand: Hand, printed: str, printed_radius: str) -> None:
    """R and the spectral radius, as model/README.md, section 14, has them."""
    hertz = np.array(HERTZ[-1:] if "," not in printed else HERTZ)
    assert all_to_all_digits(printed, list(required(device, law, hand, 2 * pi * hertz * device.sample_time)))
    assert to_all_digits(printed_radius, radius(device, law, hand))


@pytest.mark.parametrize(
    "numbers", [FEW, pytest.param(range(0, len(COMBINATIONS), EVERY), marks=pytest.mark.slow)], ids=["some", "every"]
)
def test_what_the_environment_meets_is_what_the_oracle_says(numbers):
    """Z_seen and R, and the return difference over its open part, of every combination of parts."""
    theta = 2 * pi * np.array(SHARES)
    for tables, device, gains, hand, rng in cases(numbers, 61):
        found, R = seen(device, gains, hand, theta), required(device, gains, hand, theta)
        held = loop(device, hand, theta)
        delta = number(held.closed(gains), theta) / number(held.open, theta)
        for k, (at, true) in enumerate(zip(theta, oracles(tables, gains, hand, theta), strict=True)):
            assert abs(DIGITS.context.mpc(found[k]) - true) <= 1e-10 * abs(true), (device, hand, at)
            assert abs(float(R[k]) + true.real) <= 1e-10 * abs(true), (device, hand, at)
        k = int(rng.integers(1, len(theta)))
        z = DIGITS.exp(DIGITS.i * DIGITS.number(theta[k]))
        S = sensitivity(Loop(tables, astuple(gains), hand=astuple(hand), num=DIGITS), z)
        assert delta[k] == pytest.approx(complex(1 / S), rel=1e-9, abs=1e-9 * (1 + abs(complex(1 - 1 / S)))), device


@pytest.mark.parametrize(
    "numbers", [SOME, pytest.param(range(0, len(COMBINATIONS), EVERY), marks=pytest.mark.slow)], ids=["some", "every"]
)
@pytest.mark.parametrize("integrating, summed", [(0.0, False), (1.0, False), (1.0, True)])
def test_next_to_rest_both_forms_differ_by_rho(numbers, integrating, summed):
    """Without an integrator and with little of it, and as exactly anywhere else, of every combination of parts."""
    for _, drawn, gains, hand, rng in cases(numbers, 62):
        device = replace(drawn, summed=summed)
        held = replace(hand, stiffness=float(10 ** rng.uniform(-6, 4)))
        theta, K_v = float(10 ** rng.uniform(-4, 0.49)), gains.velocity
        K_p = integrating * float(10 ** rng.uniform(-6, 4))
        plant = plant_in_hand(device, held, delays_of(device), FLOATS)
        known = seen_in_hand(loop_in_hand(plant, theta, FLOATS), Gains(K_v, K_p))
        parts = np.array(
            [2 * np.sin(theta / 2), *(np.array([held.stiffness, K_p]) * device.sample_time**2 / device.mass)]
        )
        rho = parts.sum()
        rest = NextToRest(rho, *parts / rho)
        found = required_in_limp_hand(plant, K_v, theta, rest, FLOATS)
        size = abs(found.size) + abs(found.lost) / K_v
        assert abs(found.size - known.size / rho**2) < 1e-6 * size, (device, held, theta)
        assert abs(found.lost - known.lost / rho**2) < 1e-6 * size * K_v, (device, held, theta)
        if not integrating:
            swing = known.swing / (rho**2 * np.sin(theta / 2))
            found_swing = seen_in_limp_hand(plant, K_v, theta, rest, FLOATS).swing
            assert abs(found_swing - swing) < 1e-6 * size * K_v, (device, held, theta)


@pytest.mark.parametrize("softest", [0.0, 40.0])
def test_next_to_rest_both_forms_of_the_margins_in_environments_differ_by_rho(softest: float) -> None:
    """Margins in a box of environments, with a softest spring and without one, which leaves another factor s."""
    worlds, coupling = Worlds(World(0.1, 0.5, softest), World(2.0, 9.0, 900.0)), Coupling(30.0, 0.2, 0.5)
    for _, device, gains, hand, rng in cases(FEW, 162):
        theta, K_v, T = float(10 ** rng.uniform(-3, 0.4)), gains.velocity, device.sample_time
        plant = plant_in_hand(device, hand, delays_of(device), FLOATS)
        pulled, s = hand.stiffness * T**2 / device.mass, np.sin(theta / 2)
        rho = 2 * s + pulled
        seen = seen_in_hand(loop_in_hand(plant, theta, FLOATS), Gains(K_v, 0.0))
        near = seen_in_limp_hand(plant, K_v, theta, NextToRest(rho, 2 * s / rho, pulled / rho, 0.0), FLOATS)
        at = offered_at(coupling, T, "trapezoid", theta, FLOATS)
        whole, limp = (
            disjuncts(at, worlds, T, seen, 1.1, theta, FLOATS),
            limp_disjuncts(at, worlds, T, near, 1.1, theta, FLOATS),
        )
        assert whole.above is not None and limp.above is not None
        size = rho**2 * (1.0 if softest else s)
        for terms, factor, others in ((limp.resistive, rho**2, whole.resistive), (limp.above, size, whole.above)):
            away = abs(sum_of(terms) * factor - sum_of(others))
            assert away < 1e-6 * sum(map(abs, others)), (device, hand, theta)


def test_at_0_hz_the_worst_hand_is_a_spring_with_its_mass():
    """R is (b + sigma K_p)^2/(4 (b + K_v - tau K_p)) at most, sigma = M/(m + M) T/2, and a little damping is enough."""
    T = 1e-4
    for b, K_v, K_p in ((2.0, 150.0, 3000.0), (0.5, 40.0, 9000.0), (8.0, 20.0, 200.0)):
        for M in (0.0, 0.1, 0.5):
            device, gains, K = Device(0.4, b, T), Gains(K_v, K_p), K_p * 10 ** np.linspace(-5, 2, 4001)
            k, lost = K_v - T / 2 * K_p, b + M / (0.4 + M) * T / 2 * K_p
            enough = lost**2 / (4 * (k - lost + b))
            worst = [
                required(device, gains, Hand(M, B, K), np.zeros(K.shape)).max()
                for B in (0.0, 0.99 * enough, 1.01 * enough)
            ]
            assert worst[0] == pytest.approx(lost**2 / (4 * (b + k)), rel=1e-3)
            assert worst[1] > 0 > worst[2]


@pytest.mark.parametrize(
    "numbers", [FEW, pytest.param(range(1, len(COMBINATIONS), EVERY), marks=pytest.mark.slow)], ids=["some", "every"]
)
def test_next_to_0_with_every_part(numbers):
    """What vctune says at 0 is the oracle's limit; without an integrator or a spring, next to it."""
    for tables, device, gains, hand, _ in cases(numbers, 66):
        at = 0.0 if gains.position and hand.stiffness else 1e-7
        true = oracle(tables, gains, hand, at or 1e-12)
        away = abs(float(required(device, gains, hand, at)) + true.real)
        assert away <= 1e-10 * (abs(true.real) + gains.velocity), (device, hand)


def test_the_coupling_as_the_firmware_runs_it():
    """Re Z_c by the trapezoidal rule, from 0 to the Nyquist frequency, where it is b_0 + b_c."""
    for k in range(50):
        rng = np.random.default_rng((67, k))
        T = float(10 ** rng.uniform(-4, -2))
        b_c, m_c, b_0 = 10 ** rng.uniform(0, 4), 10 ** rng.uniform(-3, 1), float(rng.integers(2)) * 0.3
        theta = pi * 10 ** rng.uniform(-5, 0, 5)
        found = sampled_resistance(Coupling(b_c, m_c, b_0), T, "trapezoid", theta, FLOATS)
        for x, at in zip(found, theta, strict=True):
            z = DIGITS.exp(DIGITS.i * DIGITS.number(at))
            true = offered(Loop({"sample_time": T}, coupling=(b_c, m_c, b_0), num=DIGITS), z).real
            assert float(x) == pytest.approx(float(true), rel=1e-12)
        ends = sampled_resistance(Coupling(b_c, m_c, b_0), T, "trapezoid", np.array([0.0, pi]), FLOATS)
        assert ends == pytest.approx([b_0, b_0 + b_c], rel=1e-12)


def demands_of(device):
    return Demands(device, (0.0, inf), 1.05, inf)


def around(x: float, width: float, rng: np.random.Generator) -> tuple[float, float]:
    """Return an interval that contains a number, of a width relative to it, somewhere within it."""
    low, high = rng.uniform(0.1, 1.0, 2) * width
    return x * (1 - low), x * (1 + high)


def numbers_of(hand: Hand, theta: float) -> dict[str, float]:
    return dict(zip(KEYS, (*astuple(hand), theta), strict=True))


def quotient(values: dict[str, Any], device: Device, gains: Gains, ops: Arithmetic, plain: Device) -> Any:
    """Return R from what KEYS name."""
    *hand, theta = (values[key] for key in KEYS)
    found = required_in_hand(loop(device, Hand(*hand), theta, ops, plain), gains)
    return found.lost / found.size


WIDTHS = (1e-14, 1e-9, 1e-6, 1e-3, 0.05)


@pytest.mark.parametrize(
    "numbers", [FEW, pytest.param(range(0, len(COMBINATIONS), EVERY), marks=pytest.mark.slow)], ids=["some", "every"]
)
@np.errstate(all="ignore")
def test_boxes_of_hands_and_angles_contain_what_the_oracle_says(numbers):
    finite = dict.fromkeys(WIDTHS, 0)
    for tables, device, gains, hand, rng in cases(numbers, 68):
        theta = float(pi * 10 ** rng.uniform(-3, 0))
        values = numbers_of(hand, theta)
        true = -oracle(tables, gains, hand, theta, QUICK).real
        enclosed, law = device.converted(decimal), Gains(decimal(gains.velocity), decimal(gains.position))
        for width in WIDTHS:
            ends = {key: around(x, width, rng) if x else (0.0, 0.0) for key, x in values.items()}
            boxes = {key: between(*map(np.array, pair)) for key, pair in ends.items()}
            found = quotient(boxes, enclosed, law, ENCLOSURES, device)
            assert contains(found, true), (device, hand, width)
            finite[width] += bool(np.isfinite(found.rad))
    assert finite[1e-9] == len(numbers) and finite[1e-3] > len(numbers) / 2


@np.errstate(all="ignore")
def test_boxes_that_begin_at_no_hand():
    """Mass, damping and stiffness from 0 on, angles from 0 on: any hand and angle within are contained."""
    finite = 0
    for _, device, gains, hand, rng in cases(SOME, 69):
        values = numbers_of(hand, float(pi * 10 ** rng.uniform(-4, -2)))
        law = Gains(decimal(gains.velocity), decimal(gains.position))
        boxes = {key: between(np.array(0.0), np.array(x)) for key, x in values.items()}
        held = loop(device.converted(decimal), Hand(*(boxes[key] for key in HAND)), boxes["theta"], ENCLOSURES, device)
        found = required_in_hand(held, law)
        for share in (0.0, 0.3, 0.99):
            within = loop(device, Hand(*(values[key] * share for key in HAND)), np.array(values["theta"] * share))
            inside = required_in_hand(within, gains)
            for one, other in zip(found, inside, strict=True):
                away = abs(float(other) - float(one.mid))
                finite += bool(np.isfinite(one.rad))
                assert not np.isfinite(one.rad) or away <= float(one.rad) + 1e-12 * abs(float(other)), (device, hand)
    assert finite >= 2 * len(SOME), finite


def test_the_loop_is_affine_in_the_stiffness_that_pulls_at_the_handle():
    """And where both margins are positive in any stiffness, the margin is, at the hand's own and at any other."""
    sure_of = 0
    for tables, device, gains, drawn, rng in cases(range(0, len(COMBINATIONS), 5), 163):
        coupling = Coupling(*coupling_for(rng, tables, gains.velocity))
        stiffness = device.mass / device.sample_time**2 * float(10 ** rng.uniform(-4, 0))
        hand = Hand(drawn.mass, drawn.damping, stiffness)
        theta, x = np.geomspace(1e-3, 3.1, 60), stiffness * device.sample_time**2 / device.mass
        plants = plants_in_spring(device, hand, delays_of(device), FLOATS)
        soft, stiff = (loop_in_hand(each, theta, FLOATS) for each in plants)
        whole = loop_in_hand(plant_in_hand(device, hand, delays_of(device), FLOATS), theta, FLOATS)
        for of in ("closed", "numerator"):
            a, b, own = (getattr(each, of)(gains) for each in (soft, stiff, whole))
            for part in ("even", "odd"):
                first, last = getattr(a, part), getattr(b, part)
                scale = np.abs(first) + np.abs(last) + 1e-30
                assert np.abs(first + x * (last - first) - getattr(own, part)) / scale == pytest.approx(0, abs=1e-9)
        there = case_at(Design(device, gains, coupling), demands_of(device), hand)
        sure, bent = margin_in_spring(there, theta)
        both = (sure > 0) & (bent > 0)
        sure_of += bool(both.any())
        assert (np.broadcast_to(hand_margin(there, theta), theta.shape)[both] > 0).all()
    assert sure_of >= 5, sure_of
