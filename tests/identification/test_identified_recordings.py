"""Two real devices with published numbers, from recordings that nobody of this project made."""

from __future__ import annotations

import os
from functools import cache
from math import erf, sqrt
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from vctune import identify
from vctune.document.recording import Channel, Recording
from vctune.identification.box import joint_factor
from vctune.identification.spectra import response
from vctune.identification.study import distances

DATA = Path(os.environ.get("VCTUNE_DATA", ""))
pytestmark = pytest.mark.skipif(
    "VCTUNE_DATA" not in os.environ, reason="VCTUNE_DATA does not name the folder of the recordings"
)
EMPS = """
[columns]
command = { column = "voltage_V", scale = 35.15065 }
"""
BENCH = """
rotary = true
[columns]
time = { column = "time_s", unit = "us" }
position = "motor_rad"
handle = { column = "load_rad", scale = -1.0 }
command = { column = "current_reference_A", scale = 1.0 }
force = { column = "current_A", scale = 1.0 }
"""


def identified(folder, text, *names):
    config = folder / "log.toml"
    config.write_text(text)
    return identify([DATA / f"{name}.csv.gz" for name in names], config)


@pytest.fixture(scope="module")
def emps(tmp_path_factory):
    return identified(tmp_path_factory.mktemp("emps"), EMPS, "emps", "emps-pulses")


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """Return what is identified from a recording, when it is first asked for."""
    return cache(lambda name: identified(tmp_path_factory.mktemp("bench"), BENCH, f"bench-{name}"))


def numbers(recording):
    return {each.name: each for each in (*recording.numbers, *recording.derived)}


@pytest.mark.slow
def test_the_positioning_system_comes_out_as_published(emps):
    """Damping and Coulomb friction as published within twice the deviations found, each way as recomputed elsewhere."""
    first = numbers(emps.record.recordings[0])
    assert first["mass"].value == pytest.approx(95.1, rel=5e-3)
    assert 0.15 < first["mass"].sigma < 0.5
    for name, published in (("damping", 203.5034), ("coulomb", 20.3935), ("offset", -3.1648)):
        found = first[f"{name}, both ways alike"]
        assert found.value == pytest.approx(published, abs=2 * found.sigma)
    assert 3 < first["damping, both ways alike"].sigma < 10
    assert first["damping_forwards"].value == pytest.approx(159, rel=0.05)
    assert first["damping_backwards"].value == pytest.approx(233, rel=0.05)
    assert first["coulomb, both ways alike"].sigma < 0.6


@pytest.mark.slow
def test_the_box_holds_what_both_recordings_say(emps):
    mass, damping = emps.found.bounded("mass"), emps.found.bounded("damping")
    assert all(mass.low < value < mass.high for value in (95.1087, 94.05))
    assert all(damping.low < value < damping.high for value in (159, 203.5, 210.1, 233))
    assert mass.high / mass.low < 1.025


@pytest.mark.parametrize(
    ("name", "motor", "load", "low", "high", "delay", "lag", "late"),
    [
        ("a", 0.004832, 0.004800, 54.00, 76.24, 115e-6, 335e-6, 173e-6),
        pytest.param("b", 0.004796, 0.004801, 53.98, 76.35, 111e-6, 330e-6, 176e-6, marks=pytest.mark.slow),
    ],
)
def test_the_bench_comes_out_as_published(bench, name, motor, load, low, high, delay, lag, late):
    found = numbers(bench(name).record.recordings[0])
    assert found["motor mass"].value == pytest.approx(motor, rel=0.01)
    assert found["handle mass"].value == pytest.approx(load, rel=0.01)
    assert found["antiresonance, Hz"].value == pytest.approx(low, abs=0.2)
    assert found["resonance, Hz"].value == pytest.approx(high, abs=0.2)
    assert found["delay"].value == pytest.approx(delay, abs=10e-6)
    assert found["command to force, lag"].value == pytest.approx(lag, abs=10e-6)
    assert found["command to force, delay"].value == pytest.approx(late, abs=10e-6)


@pytest.mark.slow
def test_the_bench_is_two_masses(bench):
    for each in map(bench, "ab"):
        chosen = next(one for one in each.record.recordings[0].candidates if one.chosen)
        rigid = next(one for one in each.record.recordings[0].candidates if one.structure == "one mass")
        assert chosen.structure.startswith("two masses")
        assert rigid.chi2 > 100 * chosen.chi2


@pytest.mark.slow
def test_the_box_of_one_recording_holds_the_other_s_numbers(bench):
    box, other = bench("a").found, bench("b").found
    for each in other.record.numbers:
        mine = box.bounded(each.key)
        assert mine.low <= each.value <= mine.high, each.key
        for estimate in each.estimates:
            assert mine.low <= estimate.value <= mine.high, each.key


@pytest.mark.slow
def test_every_measured_line_is_that_of_a_device_of_the_file(bench):
    for each in map(bench, "ab"):
        problem, study = each.file.problem, each.found.studies[0]
        (lines,) = study.lines
        needed = distances(lines, each.found.device, each.record.numbers)
        x, y = np.log(np.array(problem.uncertainty.unmodelled)).T
        stated = np.exp(np.interp(np.log(lines.hertz), x, y))
        assert np.all(needed <= stated) and not np.all(needed + 1.0 <= stated)


def test_what_is_late_is_in_the_box(bench):
    """A late motor is in no disc, which is of what motor and hand alike are answered with."""
    posed = bench("a").file.problem
    late = [key for key in ("delay", "actuator.bandwidth_hz") if bench("a").found.bounded(key)]
    assert {"delay"} <= set(late) <= {key for key, _ in posed.uncertainty.half_widths}
    assert max(radius for _, radius in posed.uncertainty.unmodelled) < 1


def test_the_time_column_of_the_bench_is_not_believed(tmp_path):
    from vctune.document.text.errors import InputError

    with pytest.raises(InputError, match='unit = "us"'):
        identified(tmp_path, BENCH.replace('unit = "us"', 'unit = "s"'), "bench-a")


def test_nothing_of_the_recordings_is_in_the_project():
    assert not list(ROOT.rglob("emps*.csv*")) and not list(ROOT.rglob("bench*.csv*"))


@np.errstate(all="ignore")
def test_what_rounding_does_to_every_line_is_its_spread() -> None:
    """Each period repeats the error of the last, which no average shows: its size is quantum sqrt(period/12)."""
    rng, period, lines, quantum = np.random.default_rng(0), 2000, np.arange(3, 120), 1e-3
    force = np.zeros(period // 2 + 1, complex)
    force[lines] = period * np.exp(2j * np.pi * rng.uniform(size=lines.size))
    pushed, place = np.tile(np.fft.irfft([force, 0.01 * force], period), 6)
    channels = {
        "force": Channel("force", pushed, 1.0, None, None),
        "position": Channel("position", quantum * np.round(place / quantum), 1.0, quantum, None),
    }
    found = response(Recording("log.csv", "", 2, channels, (), False), 1e-3)
    off = np.abs(found.ratio[0] / 0.01 - 1) / found.spread[0]
    assert found.omega.size == lines.size and 0.8 < np.sqrt(np.mean(off**2)) < 1.25


@pytest.mark.parametrize("count", [1, 2, 5, 12, 40])
def test_all_intervals_of_a_box_hold_together_with_95_per_cent(count: int) -> None:
    """Each alone with the root of it; two deviations are the least."""
    together = erf(joint_factor(count) / sqrt(2)) ** count
    assert together >= 0.95 if count == 1 else together == pytest.approx(0.95, rel=1e-9)
