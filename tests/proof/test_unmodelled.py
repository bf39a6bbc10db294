"""What is not modelled: the proof holds for every response of the disc, as an oracle that shares no code has it."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from functools import cache
from math import pi

import numpy as np
import pytest
from arithmetic import DOUBLES
from conftest import mostly_slow
from frequency import mechanism
from loop import Loop, sensitivity

from vctune.design.judging.judge import Status, judge
from vctune.design.records.claims import claim_records, device_record
from vctune.design.search.theorems import impossible
from vctune.design.solve import solve
from vctune.document.reading import parse_problem
from vctune.model.gains import Coupling, Gains
from vctune.model.parts import Unmodelled
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
    "ideal": "[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 1e-3\n",
    "parts": (
        "[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 2.5e-4\ndelay = 1e-4\n[device.actuator]\n"
        'bandwidth_hz = 800.0\n[device.velocity]\nfrom = "difference"\nfilter_hz = 300.0\n'
        "[device.force_sensor]\nbandwidth_hz = 500.0\norder = 2\n"
        "[device.structure]\nhandle_mass = 0.1\nfrequency_hz = 300.0\ndamping_ratio = 0.05\n"
    ),
}


def radius(hz):
    at, value = np.log(TABLE).T
    return np.exp(np.interp(np.log(hz), at, value))


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
    text = f"{DEVICES['ideal']}{DEMANDS}[uncertainty]\nunmodelled = [{radii}]\n"
    found = impossible(parse_problem(text, "x", "x"))
    assert found.proved
    assert f"at {hz}, where uncertainty.unmodelled {greatest}" in found.cause


def test_a_radius_of_1_within_the_band_is_not_searched_for_a_design():
    text = f"{DEVICES['ideal']}{DEMANDS}[uncertainty]\nunmodelled = [[1.0, 0.1], [50.0, 1.0], [80.0, 0.2]]\n"
    solved = solve(parse_problem(text, "x", "x"))
    assert solved.status is Status.INFEASIBLE
    assert solved.infeasibility.proved and "at 50 Hz" in solved.infeasibility.reason


@pytest.mark.parametrize("radii", ["[1.0, 0.1], [101.0, 1.0]", "[0.4, 2.0], [0.6, 0.1]", "[1.0, 0.999]"])
def test_a_radius_below_1_within_the_band_is_no_theorems_business(radii):
    text = f"{DEVICES['ideal']}{DEMANDS}[uncertainty]\nunmodelled = [{radii}]\n"
    assert impossible(parse_problem(text, "x", "x")) is None


SPRUNG = "[device]\nmass = 0.4\ndamping = 0.2\nsample_time = 1e-3\n"
"""A device whose loop has a peak of |1 - S| that is a quarter above that of |S|."""
ANGLES = tuple(
    np.concatenate([np.geomspace(1e-4, 3e-3, 200), np.geomspace(3e-3, 0.3, 2600), np.linspace(0.3, pi, 200)])
)


@cache
def sprung(gains: tuple[float, float], angles: tuple[float, ...] = ANGLES) -> tuple[np.ndarray, np.ndarray]:
    """Return angles, and |1 - S| of the sampled loop there, as the oracle has it."""
    loop, theta = Loop(tomllib.loads(SPRUNG)["device"], gains), np.array(angles)
    return theta, np.abs(1 - sensitivity(loop, np.exp(1j * theta)))


@pytest.mark.parametrize(
    ("gains", "limit", "radii"),
    [
        *(((10.0, 200.0), 1.1, f"[1.0, {r}]") for r in (0.47, 0.48, 0.73)),
        *(pytest.param((10.0, 200.0), 1.1, f"[1.0, {r}]", marks=pytest.mark.slow) for r in (0.72, 0.9)),
        ((10.0, 200.0), 1.1, "[0.1, 0.01], [3.0, 0.9], [100.0, 0.1]"),
        ((10.0, 200.0), 1.1, "[0.1, 0.9], [3.0, 0.4], [100.0, 0.9]"),
        ((10.0, 200.0), 1.1, "[0.5, 0.01], [1.5, 0.47], [3.0, 0.9]"),
        # |S| of 9.4 exceeds its limit, which then says nothing of |1 - S|
        *(((5.0, 3000.0), 2.0, f"[1.0, {r}]") for r in (0.1, 0.3333)),
        *(pytest.param((5.0, 3000.0), 2.0, f"[1.0, {r}]", marks=pytest.mark.slow) for r in (0.11, 0.3334, 0.6)),
        pytest.param((5.0, 3000.0), 9.5, "[1.0, 0.0952]", marks=pytest.mark.slow),
        pytest.param((5.0, 3000.0), 9.5, "[1.0, 0.105]", marks=pytest.mark.slow),
        ((5.0, 3000.0), 9.5, "[1.0, 0.1063]"),
    ],
)
def test_the_quick_answer_about_a_disc_is_that_of_the_whole_circle(
    gains: tuple[float, float], limit: float, radii: str
) -> None:
    """Proved where r |1 - S| < 1 on 3000 frequencies, refuted elsewhere, on both sides of r = 1/(1 + limit)."""
    asked = f"max_sensitivity = {limit}\n[uncertainty]\nunmodelled = [{radii}]\n"
    given, table = parse_problem(SPRUNG + DEMANDS + asked, "x", "x"), np.log(tomllib.loads(f"r = [{radii}]")["r"])
    theta, around = sprung(gains)
    most = (np.exp(np.interp(np.log(theta / (2 * pi * 1e-3)), *table.T)) * around).max()
    assert abs(most - 1) > 2e-3, "too near to tell"
    found = judge(given, Gains(*gains), Coupling(10.0, 1.0, 0.0)).certificate.outcomes["unmodelled"]
    assert found.verdict is (Verdict.PROVED if most < 1 else Verdict.REFUTED)
    if found.witness is not None:
        _, (there,) = sprung(gains, (found.witness * 1e-3,))
        assert np.exp(np.interp(np.log(found.witness / (2 * pi)), *table.T)) * there > 1


@pytest.mark.parametrize("name", mostly_slow(DEVICES, ["ideal"]))
def test_the_direction_of_a_refuting_response_is_in_degrees(name: str) -> None:
    """The response that design.json names gives energy, as the oracle has it; the text names the same angle."""
    given, tables = parse_problem(DEVICES[name] + DEMANDS + DISC, "x", "x"), tomllib.loads(DEVICES[name])
    records = claim_records(given, judge(given, Gains(0.0, 0.0), Coupling(10.0, 1.0, 0.0)))
    (claim,) = (each for each in records if each.id == "passive")
    assert claim.witness_device is not None and claim.witness_device.unmodelled is not None
    found, hz = claim.witness_device.unmodelled, claim.witness_hz
    delta = found.share * radius(hz) * np.exp(1j * np.radians(found.phase_deg))
    P_hh = mechanism(tables["device"], 2j * pi * hz, DOUBLES)[0]
    assert (P_hh * (1 + delta)).real <= 1e-12 * abs(P_hh) < P_hh.real
    assert any(f"at {found.phase_deg:.4g} deg" in str(row) for row in claim.rows(given.units))


@pytest.mark.parametrize("degrees", [0.0, 45.0, 90.0, 225.0, 359.0])
def test_a_response_in_the_disc_is_recorded_in_degrees(degrees: float) -> None:
    problem = parse_problem(DEVICES["ideal"] + DEMANDS + DISC, "x", "x")
    off = Unmodelled(((1.0, 0.1),), 0.5, degrees * pi / 180)
    found = device_record(replace(problem.device, unmodelled=off), problem).unmodelled
    assert found is not None and (found.share, found.phase_deg) == (0.5, pytest.approx(degrees, abs=1e-9))
    assert str(found) == str(off) == f"response off by 0.5 r at {degrees:g} deg"
