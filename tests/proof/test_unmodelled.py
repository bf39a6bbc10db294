"""What is not modelled: the proof holds for every response of the disc, as an oracle that shares no code has it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import pi

import numpy as np
import pytest
from arithmetic import DOUBLES
from conftest import mostly_slow
from device_oracle import Coupling as CouplingNumbers
from device_oracle import Gains as LawNumbers
from device_oracle import LowPass, Real, Velocity, coupling_impedance, low_pass, mechanism, response_at
from device_oracle import Structure as Spring
from sampled_device_oracle import sensitivity

from vctune.design.search.theorems import impossible
from vctune.design.solve import solve
from vctune.design.verdict.judge import Status, judge
from vctune.document.reading import parse_problem
from vctune.model.gains import Coupling, Gains
from vctune.proof.outcome import Verdict

FACTOR, BAND = 1.05, (0.5, 100.0)
DEMANDS = (
    "[gains]\nvelocity = { min = 1.0, max = 1000.0 }\nposition = { min = 0.0, max = 1e5 }\n"
    "[coupling]\ndrag = { min = 0.0, max = 50.0 }\n[transparency]\nband_hz = [0.5, 30.0]\nreference_impedance = 10.0\n"
    "[stability]\ncriterion = 'passive'\nband_hz = [0.5, 100.0]\n"
)
DISC = "[uncertainty]\nunmodelled = [[1.0, 0.02], [100.0, 0.1], [400.0, 1.0]]\n"
TABLE = np.array([[1.0, 0.02], [100.0, 0.1], [400.0, 1.0]])
DEVICES = {
    "ideal": ("[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 1e-3\n", Real(0.4, 2.0, 1e-3)),
    "parts": (
        "[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 2.5e-4\ndelay = 1e-4\n[device.actuator]\n"
        'bandwidth_hz = 800.0\n[device.velocity]\nfrom = "difference"\nfilter_hz = 300.0\n'
        "[device.force_sensor]\nbandwidth_hz = 500.0\norder = 2\n"
        "[device.structure]\nhandle_mass = 0.1\nfrequency_hz = 300.0\ndamping_ratio = 0.05\n",
        Real(
            0.4,
            2.0,
            2.5e-4,
            delay=1e-4,
            velocity=Velocity("difference", 300.0, 1),
            actuator=LowPass(800.0),
            force_sensor=LowPass(500.0, 2),
            structure=Spring(0.1, 300.0, 0.05),
        ),
    ),
}
RESPONSES = 200_000


@cache
def designed(name):
    """The problem with its disc, and the design for it."""
    given = parse_problem(DEVICES[name][0] + DEMANDS + DISC, "x", "x")
    return given, solve(given).judgement


def radius(hz):
    at, value = np.log(TABLE).T
    return np.exp(np.interp(np.log(hz), at, value))


def ratio(real, judgement, hz, delta):
    """Re Z_c / R with all of P times 1 + delta, straight from the definitions."""
    s, gains, coupling = 2j * pi * hz, judgement.gains, judgement.coupling
    known = response_at(real, LawNumbers(gains.velocity, gains.position), s, DOUBLES)
    P_hh, P_hu, P_mh, P_mu = (P * (1 + delta) for P in mechanism(real, s, DOUBLES))
    Delta = 1 + P_mu * known.C_f
    G_hh = (P_hh + known.C_f * (P_hh * P_mu - P_hu * P_mh)) / Delta
    q = low_pass(real.force_sensor, s, DOUBLES) * P_hu * known.C_0 / Delta
    Z_c = coupling_impedance(CouplingNumbers(coupling.damping, coupling.mass, coupling.drag), s, DOUBLES)
    return np.where(G_hh.real > 0, Z_c.real * 2 * G_hh.real / (np.abs(q) - q.real), -np.inf)


def random_responses(rng, count):
    """Frequencies of the band and points of the disc there, half of them on its edge."""
    hz = np.exp(rng.uniform(*np.log(BAND), count))
    hz[:100] = BAND[1]
    share = np.where(rng.random(count) < 0.5, 1.0, rng.uniform(0, 1, count))
    return hz, share * radius(hz) * np.exp(1j * rng.uniform(0, 2 * pi, count))


@pytest.mark.parametrize("name", mostly_slow(DEVICES, ["ideal"]))
def test_no_response_of_the_disc_falls_short(name):
    _, judgement = designed(name)
    assert judgement.status is Status.CERTIFIED
    least = ratio(DEVICES[name][1], judgement, *random_responses(np.random.default_rng(1), RESPONSES)).min()
    assert FACTOR <= least < 1.01 * FACTOR  # and one of them nearly does: the disc is what holds the design
    assert judgement.min_ratio == pytest.approx(FACTOR, rel=1e-4)


@pytest.mark.parametrize("name", mostly_slow(DEVICES, ["ideal"]))
def test_no_response_of_the_disc_makes_the_sampled_loop_unstable(name):
    _, judgement = designed(name)
    gains, real = LawNumbers(judgement.gains.velocity, judgement.gains.position), DEVICES[name][1]
    hz = np.linspace(1.0, 0.5 / real.sample_time, 800)
    off = [abs(1 - complex(sensitivity(real, gains, float(at), DOUBLES))) * radius(at) for at in hz]
    assert max(off) < 1


@pytest.mark.parametrize("name", mostly_slow(DEVICES, ["ideal"]))
def test_a_design_for_the_device_alone_is_refuted_by_a_response(name):
    given, _ = designed(name)
    alone = solve(replace(given, uncertainty=None)).judgement
    assert alone.status is Status.CERTIFIED
    found = judge(given, alone.gains, alone.coupling).certificate.outcomes["passive"]
    assert found.verdict is Verdict.REFUTED
    hz, off = found.witness_hz, found.device.unmodelled
    delta = off.share * radius(hz) * np.exp(1j * off.phase)
    assert abs(delta) <= radius(hz) * (1 + 1e-9)
    assert ratio(DEVICES[name][1], alone, np.array([hz]), np.array([delta]))[0] < FACTOR


def test_a_greater_disc_costs_more_and_one_of_nothing_costs_nothing():
    text = DEVICES["ideal"][0] + DEMANDS
    alone = solve(parse_problem(text, "x", "x")).judgement.error
    errors = []
    for size in (1e-9, 0.02, 0.05):
        errors.append(
            solve(parse_problem(f"{text}[uncertainty]\nunmodelled = [[1.0, {size}]]\n", "x", "x")).judgement.error
        )
    assert errors[0] == pytest.approx(alone, rel=1e-5)
    assert errors == sorted(errors) and errors[2] > 1.01 * alone


def test_a_loop_that_a_response_may_make_unstable_is_refuted():
    """|1 - S| is nearly 1 at low frequency: a radius above 1 there admits a response without any loop gain."""
    text = DEVICES["ideal"][0] + DEMANDS + "[uncertainty]\nunmodelled = [[1.0, 0.01], [200.0, 3.0]]\n"
    given, (_, judgement) = parse_problem(text, "x", "x"), designed("ideal")
    outcome = judge(given, judgement.gains, judgement.coupling).certificate.outcomes["unmodelled"]
    assert outcome.verdict is Verdict.REFUTED
    gains = LawNumbers(judgement.gains.velocity, judgement.gains.position)
    S = complex(sensitivity(DEVICES["ideal"][1], gains, outcome.witness_hz, DOUBLES))
    at, value = np.log([[1.0, 0.01], [200.0, 3.0]]).T
    assert abs(1 - S) * np.exp(np.interp(np.log(outcome.witness_hz), at, value)) > 1


@pytest.mark.parametrize("name", DEVICES)
def test_a_design_without_a_loop_is_passive_only_if_its_response_is(name):
    """A mass answers at nearly -90 degrees: the disc holds responses that are behind it, which give energy."""
    given = parse_problem(DEVICES[name][0] + DEMANDS + DISC, "x", "x")
    idle = Gains(0.0, 0.0), Coupling(10.0, 1.0, 0.0)
    alone = judge(replace(given, uncertainty=None), *idle)
    assert alone.status is Status.CERTIFIED
    judgement = judge(given, *idle)
    assert judgement.status in (Status.UNDECIDED, Status.VIOLATED)
    outcomes = judgement.certificate.outcomes
    assert outcomes["unmodelled"].verdict is Verdict.PROVED, "there is no loop to make unstable"
    assert outcomes["passive"].verdict is not Verdict.PROVED
    assert judgement.certificate.proved_band is None
    P_hh = mechanism(DEVICES[name][1], 2j * pi * BAND[1], DOUBLES)[0]
    assert (P_hh * (1 - 1j * radius(BAND[1]))).real < 0 < P_hh.real


@pytest.mark.parametrize(
    ("radii", "hz", "greatest"),
    [
        ("[1.0, 0.1], [50.0, 1.0], [80.0, 0.2]", "50 Hz", "is 1:"),
        ("[1.0, 0.1], [50.0, 1.2], [80.0, 1.5], [400.0, 3.0]", "100 Hz", "is 1.651:"),
        ("[0.1, 6.0], [1.0, 0.5], [100.0, 0.1]", "0.5 Hz", "is 1.056:"),
        ("[200.0, 2.0]", "0.5 Hz", "is 2:"),
    ],
)
def test_a_radius_of_1_within_the_band_is_infeasible_and_the_reason_says_where(radii, hz, greatest):
    text = f"{DEVICES['ideal'][0]}{DEMANDS}[uncertainty]\nunmodelled = [{radii}]\n"
    found = impossible(parse_problem(text, "x", "x"))
    assert found.proved
    assert f"at {hz}, where uncertainty.unmodelled {greatest}" in found.cause


def test_a_radius_of_1_within_the_band_is_not_searched_for_a_design():
    text = f"{DEVICES['ideal'][0]}{DEMANDS}[uncertainty]\nunmodelled = [[1.0, 0.1], [50.0, 1.0], [80.0, 0.2]]\n"
    solved = solve(parse_problem(text, "x", "x"))
    assert solved.status is Status.INFEASIBLE
    assert solved.infeasibility.proved and "at 50 Hz" in solved.infeasibility.reason


@pytest.mark.parametrize("radii", ["[1.0, 0.1], [101.0, 1.0]", "[0.4, 2.0], [0.6, 0.1]", "[1.0, 0.999]"])
def test_a_radius_below_1_within_the_band_is_no_theorems_business(radii):
    text = f"{DEVICES['ideal'][0]}{DEMANDS}[uncertainty]\nunmodelled = [{radii}]\n"
    assert impossible(parse_problem(text, "x", "x")) is None


def random_loop(rng):
    """A two-mass device late by a little, its gains and an operator's damping, none of which need be a good one."""
    T = 1e-3
    real = Real(
        0.4,
        10 ** rng.uniform(-2, 1),
        T,
        delay=T * rng.uniform(0, 1),
        actuator=LowPass(10 ** rng.uniform(2, 3)),
        structure=Spring(rng.uniform(0.05, 0.35), 10 ** rng.uniform(1.3, 2.2), 10 ** rng.uniform(-2, -0.5)),
    )
    return real, LawNumbers(10 ** rng.uniform(0, 2.3), rng.choice([0.0, 10 ** rng.uniform(1, 4)])), rng.choice([0, 1.0])


def demanded(real, gains, b_h, hz, delta):
    """R with all of P times 1 + delta in hands of at least b_h, inf where no coupling will do; N over that at rest."""
    s = 2j * pi * hz
    known = response_at(real, gains, s, DOUBLES)
    P_hh, P_hu, P_mh, P_mu = (P * (1 + delta) for P in mechanism(real, s, DOUBLES))
    N = P_hh + known.C_f * (P_hh * P_mu - P_hu * P_mh)
    D = 1 + P_mu * known.C_f
    G_hh, q = N / D, low_pass(real.force_sensor, s, DOUBLES) * P_hu * known.C_0 / D
    held = G_hh.real + b_h * np.abs(G_hh) ** 2
    need = (np.abs(q) - q.real - 2 * b_h * (q * G_hh.conj()).real) / (2 * held)
    return np.where(held > 0, np.maximum(need, 0), np.inf), N / P_hh


def test_a_disc_is_worst_at_its_edge():
    """R is the greatest of functions that are harmonic where N is not 0, one for each hand."""
    rng, met, edge = np.random.default_rng(3), 0, np.exp(2j * pi * np.linspace(0, 1, 2000))
    inside = np.sqrt(rng.random(20_000)) * np.exp(2j * pi * rng.random(20_000))
    for _ in range(400):
        (real, gains, b_h), r = random_loop(rng), rng.uniform(0.02, 0.7)
        hz = real.structure.frequency_hz * np.exp(rng.uniform(-1, 0.5))
        around, N = demanded(real, gains, b_h, hz, r * edge)
        within, _ = demanded(real, gains, b_h, hz, r * inside)
        turns = np.angle(N / np.roll(N, 1)).sum() / (2 * pi)
        if np.isfinite(around).all() and abs(turns) < 0.5:
            met += 1
            assert within.max() <= around.max() * (1 + 1e-4) + 1e-9
    assert met > 100
