"""Devices with parts between passive hands and environments: what refuted and what certified designs do there.

A refuted one has a lossless pair that makes it grow: the worst environment turns the handle's resistance negative, and
a resonator in the hand takes its reactance away. A certified one has none in its band: there the handle's resistance is
positive before every passive environment, and a mode of the loop in exact time that grows lies outside it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from device_arithmetic import DIGITS, DOUBLES, Arithmetic
from device_oracle import Real, coupling_impedance, low_pass, operator_impedance, response_at
from device_pairs import real_of
from in_time import Loop, cancelling, random_environment, random_hand
from random_loops import Drawn, drawn
from sampled_device_oracle import Hand
from test_witness import passive, value

from vctune.design.solve import solve
from vctune.design.verdict.judge import Status
from vctune.document.reading import read_problem
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.problem import Demands
from vctune.proof.certificate import certify
from vctune.proof.engine.interval import Verdict

REFUTED, CERTIFIED = 40, 40
PAIRS = 50
GROWS = 1 + 1e-9
GROWTH = 1e-3
"""Of the loop with the lossless pair, relative to its frequency, in the limit of a heavy resonator in the hand."""


@dataclass(frozen=True)
class Handle:
    """A device with its gains and coupling in its least operator's hand, in the frequency model."""

    real: Real
    gains: Gains
    coupling: Coupling
    num: Arithmetic = DIGITS

    def port(self, s: Any) -> tuple[Any, Any, Any]:
        """Return G_hh, q and Z_c of the two-port that has absorbed the operator, at s."""
        found, Z_h = response_at(self.real, self.gains, s, self.num), operator_impedance(self.real, s, self.num)
        A_h = 1 + Z_h * found.G_hh
        met = low_pass(self.real.force_sensor, s, self.num) * Z_h * found.G_he / A_h
        return found.G_hh / A_h, found.q, coupling_impedance(self.coupling, s, self.num) + met

    def admittance(self, s: Any, Z_e: Any) -> Any:
        """Return v_h over the force of what else is in the hand, before an environment, at s."""
        G_hh, q, Z_c = self.port(s)
        return G_hh + q / (Z_c + Z_e)


@dataclass(frozen=True)
class Lossless:
    """A mass and a spring: M s + K/s."""

    mass: Any
    stiffness: Any

    def at(self, s: Any) -> Any:
        return self.mass * s + self.stiffness / s


def reactance(X: Any, omega: Any) -> Lossless:
    """Return a mass or a spring with a reactance."""
    return Lossless(X / omega, 0) if X >= 0 else Lossless(0, -X * omega)


def worst_environment(handle: Handle, omega: float) -> Lossless:
    """Return the lossless environment before which the handle's resistance is least at a frequency, rad/s."""
    w = DIGITS.number(omega)
    _, q, Z_c = handle.port(DIGITS.i * w)
    context = DIGITS.context
    return reactance(-Z_c.real * context.tan((context.pi - context.arg(q)) / 2) - Z_c.imag, w)


def resonant_hand(handle: Handle, environment: Lossless, omega: float) -> Lossless:
    """Return a lossless hand that takes the handle's reactance away, and is heavy enough for its growth to be slow."""
    w = DIGITS.number(omega)
    seen = 1 / handle.admittance(DIGITS.i * w, environment.at(DIGITS.i * w))
    heavy = max(-seen.real / (GROWTH * w), 2 * abs(seen.imag) / w, 100 * abs(slope(handle, environment, w)))
    return Lossless((heavy - seen.imag / w) / 2, w**2 * (heavy + seen.imag / w) / 2)


def slope(handle: Handle, environment: Lossless, w: Any) -> Any:
    """Return d(1/Y)/ds at a frequency."""
    ends = [DIGITS.i * w * (1 + sign * DIGITS.number("1e-20")) for sign in (-1, 1)]
    below, above = (1 / handle.admittance(s, environment.at(s)) for s in ends)
    return (above - below) / (ends[1] - ends[0])


def growing_pole(handle: Handle, hand: Lossless, environment: Lossless, omega: float) -> Any:
    """Return the pole of the closed loop that is nearest to a frequency, by Newton's method with 50 digits."""
    s = DIGITS.i * DIGITS.number(omega)

    def unbalance(s: Any) -> Any:
        return hand.at(s) + 1 / handle.admittance(s, environment.at(s))

    for _ in range(30):
        step = s * DIGITS.number("1e-20")
        change = unbalance(s) / ((unbalance(s + step) - unbalance(s - step)) / (2 * step))
        s = s - change
        if abs(change) < 1e-25 * abs(s):
            return s
    raise AssertionError("no pole found")


def design_of(number: int, share: float) -> Drawn:
    return drawn(np.random.default_rng((43, number)), share, inside=False)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.999, 0.7, 0.1])
def test_refuted_means_a_lossless_pair_that_makes_the_loop_grow(share):
    for number in range(REFUTED):
        found = design_of(number, share)
        design, band = found.design, found.band
        outcome = certify(design, Demands(design.device, band, 1.0, 100.0)).outcomes["passive"]
        assert outcome.verdict is Verdict.REFUTED, (number, design)
        handle, omega = Handle(real_of(design.device), design.gains, design.coupling), outcome.witness
        s = DIGITS.i * DIGITS.number(omega)
        assert handle.port(s)[2].real > 0, (number, design)
        environment = worst_environment(handle, omega)
        assert handle.admittance(s, environment.at(s)).real < 0, (number, design)
        hand = resonant_hand(handle, environment, omega)
        assert min(hand.mass, hand.stiffness, environment.mass, environment.stiffness) >= 0
        pole = growing_pole(handle, hand, environment, omega)
        assert pole.real > 0 and abs(pole - s) < 10 * GROWTH * abs(s), (number, design)


@pytest.mark.slow
def test_certified_means_no_environment_turns_the_handle_s_resistance_negative():
    """Random passive environments, and at some frequencies the worst of all."""
    for number in range(CERTIFIED):
        found = design_of(number, 1.05)
        design, band = found.design, found.band
        certificate = certify(design, Demands(design.device, band, 1.0, 100.0))
        assert certificate.outcomes["passive"].verdict is Verdict.PROVED, (number, design)
        rng = np.random.default_rng(number)
        real = real_of(design.device)
        handle, exactly = (Handle(real, design.gains, design.coupling, num) for num in (DOUBLES, DIGITS))
        s = 1j * band[0] * (band[1] / band[0]) ** rng.uniform(size=20)
        for _ in range(PAIRS):
            environment = passive(rng, design.gains.velocity, float(np.sqrt(band[0] * band[1])))
            seen = handle.admittance(s, value(environment, s))
            assert np.all(seen.real > -1e-12 * np.abs(seen)), (number, design)
        for omega in (found.worst, *np.abs(s[:3]).tolist()):
            at = DIGITS.i * DIGITS.number(omega)
            if exactly.port(at)[2].real > 0:
                assert exactly.admittance(at, worst_environment(exactly, omega).at(at)).real > 0, (number, design)


@dataclass(frozen=True)
class Found:
    """A certified design, and the band on which it is proved, Hz."""

    device: Device
    gains: Gains
    coupling: Coupling
    proved_hz: tuple[float, float]


def solved(name: str) -> Found:
    problem = read_problem(ROOT / f"tests/reference/real/{name}.toml").problem
    judgement = solve(problem).judgement
    assert judgement.status is Status.CERTIFIED
    return Found(problem.device, judgement.gains, judgement.coupling, judgement.certificate.proved_band_hz)


def growing(loops: list[Loop]) -> list[float]:
    """Return the frequencies of the modes that grow fastest, of the loops in which one grows, Hz."""
    places = []
    for loop in loops:
        values = np.linalg.eigvals(loop.matrix())
        fastest = values[np.argmax(np.abs(values))]
        if abs(fastest) > GROWS:
            places.append(abs(np.angle(fastest)) / (2 * pi * loop.real.sample_time))
    return places


NAMES = ["real-actuator", "real-difference", "real-force-sensor", "real-flexible", "real-everything"]


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_growing_modes_lie_outside_the_proved_band(name):
    """In exact time, with discrete-passive environments; fewer loops grow than without the coupling."""
    design, rng = solved(name), np.random.default_rng(5)
    real = real_of(design.device)
    loops = []
    for _ in range(PAIRS):
        hand = random_hand(rng)
        hand = replace(hand, mass=hand.mass + real.operator_mass, damping=hand.damping + real.operator_damping)
        loops.append(Loop(real, design.gains, design.coupling, hand, random_environment(rng)))
    bare = [replace(loop, coupling=replace(design.coupling, damping=1e-9, drag=0.0)) for loop in loops]
    low, high = design.proved_hz
    assert all(not low <= hz <= high for hz in growing(loops))
    assert len(growing(loops)) < len(growing(bare))


@pytest.mark.parametrize("count", [10, pytest.param(REFUTED, marks=pytest.mark.slow)])
def test_most_of_these_pairs_make_the_loop_grow_in_exact_time_too(count):
    """At half the ratio that is needed; where not, the loop that runs differs from the frequency model by as much."""
    grows = 0
    for number in range(count):
        found = design_of(number, 0.5)
        design, omega = found.design, found.worst
        handle = Handle(real_of(design.device), design.gains, design.coupling)
        environment = worst_environment(handle, omega)
        lossless = resonant_hand(handle, environment, omega)
        real, s = handle.real, DIGITS.i * DIGITS.number(omega)
        hand = Hand(float(lossless.mass) + real.operator_mass, real.operator_damping, float(lossless.stiffness))
        discrete = cancelling(real, -float(environment.at(s).imag), omega / (2 * pi))
        loop = Loop(real, design.gains, design.coupling, hand, discrete)
        grows += loop.spectral_radius() > GROWS
    assert grows >= 0.9 * count
