"""Filters by their coefficients, and walls with a measured velocity."""

from __future__ import annotations

from collections import Counter
from math import inf, pi
from typing import Any

import numpy as np
import pytest
from arithmetic import DOUBLES
from conftest import DRAWS
from draws import sections
from frequency import demanded
from scipy import signal

import vctune
from vctune import InputError
from vctune.design.prepared import pose
from vctune.model.design import Design
from vctune.model.gains import Gains, SpringDamper
from vctune.model.sections import greatest_gain
from vctune.proof.claims.covered import of_design
from vctune.proof.claims.poles import coupling_turns

DUAL = {"display": "impedance", "mass": 0.05, "damping": 0.3, "sample_time": 1e-3, "delay": 5e-4}
NOTCH = signal.tf2sos(*signal.iirnotch(60, 3, fs=1000)).tolist()
WALLS = {"environment": {"stiffness": inf}, "stability": {"criterion": "hands", "safety_factor": 1.05}}


def judged(tables: dict[str, Any]) -> Any:
    problem = vctune.problem(tables).problem
    return vctune.judge(problem, *problem.fixed_design)


def test_a_low_pass_is_the_same_however_it_is_stated():
    """By its corner, by its coefficient, and as a section."""
    a = 1 - np.exp(-2 * np.pi * 60.0 * 1e-3)
    stated = {"filter_hz": 60.0}, {"filter_coefficient": a}, {"sections": [[a, 0.0, 0.0, 1.0, a - 1, 0.0]]}
    law = {"coupling": {"stiffness": 200.0, "damping": 0.2}, "gains": {"velocity": 0.1}}
    law |= {"stability": {"criterion": "both"}}
    ratios = [judged({"device": DUAL | {"velocity": velocity}} | law) for velocity in stated]
    first, *others = [[at.ratio for at in each.margins] for each in ratios]
    assert all(other == pytest.approx(first, rel=1e-9) for other in others)
    assert len({each.status for each in ratios}) == 1


def test_a_measured_velocity_damps_more_than_a_difference():
    """A joint of 100 N m/rad and 20 N m s/rad, a sample late: 2.52 times that wall shakes, differenced 2.08 times."""
    joint = {"display": "impedance", "units": "rotary", "mass": 0.1, "damping": 1.0, "sample_time": 2e-3, "delay": 2e-3}
    hands = {name: {"min": 0.0, "max": most} for name, most in (("mass", 0.005), ("damping", 0.3), ("stiffness", 30.0))}
    for source, limit in (("measured", 2.52), ("difference", 2.08)):
        for share, status in ((0.99, "certified"), (1.01, "violated")):
            tables = {"device": joint | {"velocity": {"from": source}}, "operator": hands, "coupling": {}} | WALLS
            tables["coupling"] = {"stiffness": 100 * share * limit, "damping": 20 * share * limit}
            tables["stability"] = WALLS["stability"] | {"safety_factor": 1.0}
            assert judged(tables).status.value == status, (source, share)


@pytest.mark.parametrize("seed", range(8))
def test_unstable_couplings_are_counted(seed):
    """The zeros of (1 - 1/z) b_c F + k_c T outside the unit circle; some filters turn more than two low-passes."""
    rng = np.random.default_rng(seed)
    rows = signal.butter(6, 80.0, fs=1000.0, output="sos").tolist() if seed < 4 else sections(rng)
    device = vctune.problem({"device": DUAL | {"velocity": {"sections": rows}}}).problem.device
    b, k = 10 ** rng.uniform(-1, 2), 10 ** rng.uniform(0, 3)
    above, below = np.ones(1), np.ones(1)
    for row in rows:
        above, below = np.convolve(above, row[:3]), np.convolve(below, row[3:])
    zeros = np.roots(np.polyadd(b * np.convolve([1.0, -1.0], above), k * 1e-3 * np.append(below, 0.0)))
    demands = pose(vctune.problem({"device": DUAL}).problem).demands
    counted = coupling_turns(of_design(Design(device, Gains(0.0, 0.0), SpringDamper(b, k)), demands))
    assert counted.number[0] == np.count_nonzero(np.abs(zeros) > 1)


@pytest.mark.parametrize("rows", [NOTCH, np.array(NOTCH), tuple(map(tuple, NOTCH))], ids=["lists", "array", "tuples"])
def test_a_program_states_sections_as_scipy_gives_them(rows):
    """In a part of a `Device`, whose loop is that of the file, and in a dict."""
    device = vctune.Device(0.4, 2.0, 1e-3, velocity=vctune.VelocityEstimate(sections=rows))
    z = np.exp(2j * np.pi * 0.05)
    expected = signal.sosfreqz(np.array(NOTCH), [2 * np.pi * 0.05])[1][0]
    plain = vctune.Device(0.4, 2.0, 1e-3).loop(Gains(10.0, 0.0)).L
    omega = np.array([np.angle(z) / 1e-3])
    assert device.loop(Gains(10.0, 0.0)).L.at(omega).values[0] == pytest.approx(
        expected * plain.at(omega).values[0], rel=1e-9
    )
    stated = vctune.problem(
        {"device": {"mass": 0.4, "damping": 2.0, "sample_time": 1e-3, "velocity": {"sections": rows}}}
    )
    assert (
        stated.problem.device.velocity == device.velocity == vctune.problem({"device": device}).problem.device.velocity
    )
    with pytest.raises(InputError, match="section 1 is unstable"):
        vctune.Device(0.4, 2.0, 1e-3, velocity=vctune.VelocityEstimate(sections=[[1.0, 0.0, 0.0, 1.0, -2.1, 1.2]]))


def amplifying(rng: np.random.Generator) -> list[float]:
    """Return a section of any poles and zeros, with the gain 1 at rest."""
    poles, zeros = (
        np.poly(radius * np.exp(1j * angle * np.array([1, -1]))).real
        for radius, angle in ((rng.uniform(0.6, 0.97), rng.uniform(0.8, 2.9)), rng.uniform([0, 0.3], [1.2, 3.0]))
    )
    return [float(x) for x in (*(zeros * poles.sum() / zeros.sum()), *poles)]


@pytest.mark.parametrize("seed", range(6))
def test_the_greatest_gain_of_sections_is_bounded_closely(seed):
    rng = np.random.default_rng(seed)
    rows = [amplifying(rng), [0.5, 0.2, 0.0, 1.0, -0.3, 0.0]]
    z, each = np.exp(-1j * np.linspace(0, pi, 20_001)), []
    for row in rows:
        each.append(np.abs(np.polyval(row[2::-1], z) / np.polyval(row[:2:-1], z)).max())
    found = greatest_gain(tuple(map(tuple, rows)))
    assert np.prod(each) <= found <= 1.05 * np.prod(each)


def stable_model(device: dict[str, Any], K_v: float) -> str:
    """Return the verdict on the poles of the frequency model."""
    tables = {
        "device": device, "gains": {"velocity": K_v, "position": 0.0},
        "coupling": {"damping": 1e3, "mass": 5.0, "drag": 0.0},
        "stability": {"criterion": "passive", "band_hz": [1.0, 20.0], "max_sensitivity": 1e6, "safety_factor": 1.0},
    }  # fmt: skip
    return judged(tables).certificate.outcomes["stable_model"].verdict.value


def test_sections_that_amplify_make_the_model_unstable_far_above_its_corner():
    """A gain of 29 near 455 Hz, where K_v alone is a tenth of the inertia."""
    above = [3.154, -0.0094, 0.0752]
    above[2] += 1 + 1.545 + 0.6748 - sum(above)
    device = {"mass": 0.4, "damping": 1.0, "sample_time": 1e-3, "delay": 3e-4}
    device["velocity"] = {"sections": [[*above, 1.0, 1.545, 0.6748]]}
    root = 46.485 + 2858.548j
    sides = [demanded({"device": device}, (70.0, 0.0), root + off, DOUBLES).D for off in (0.0, 50.0)]
    assert abs(sides[0]) < 1e-4 * abs(sides[1])
    assert stable_model(device, 70.0) == "refuted"


def test_poles_of_the_model_are_counted_behind_sections_that_amplify():
    """D turns on after the motor's inertia alone would outweigh K_v: the gain of the sections counts."""
    counts = Counter()
    for seed in range(4 * DRAWS):
        rng = np.random.default_rng((7, seed))
        T, mass = 1e-3, 0.4
        K_v = float(mass / T * 10 ** rng.uniform(-2.5, 0.3))
        device = {"mass": mass, "damping": 1.0, "sample_time": T, "velocity": {"sections": [amplifying(rng)]}}
        s = 1e-6 / T + 1j * np.concatenate([np.geomspace(1e-8, 1e-2, 2000), np.linspace(1e-2, 400, 200_000)]) / T
        turns = np.unwrap(np.angle(demanded({"device": device}, (K_v, 0.0), s, DOUBLES).D))
        poles = (turns[0] - turns[-1]) / pi
        verdict = stable_model(device, K_v)
        counts[verdict] += 1
        assert verdict == "undecided" or (verdict == "proved") == (abs(poles) < 0.3), (seed, verdict, poles)
    assert counts["proved"] >= DRAWS / 2 and counts["refuted"] >= DRAWS / 2, counts
