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
from vctune.identification.box import joint_factor
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


@pytest.mark.night
def test_the_positioning_system_comes_out_as_published(emps):
    """The mass as published; the damping as a regression of each direction has it, 159 and 233 N s/m."""
    first = numbers(emps.record.recordings[0])
    assert first["mass"].value == pytest.approx(95.1, rel=5e-3)
    assert 0.1 < first["mass"].sigma < 0.5
    for name, published in (("damping", 159.0), ("damping_back", 233.0), ("coulomb", 20.3935)):
        assert first[name].value == pytest.approx(published, rel=0.08)


@pytest.mark.night
def test_the_box_holds_what_both_recordings_say(emps):
    mass, damping = emps.found.bounded("mass"), emps.found.bounded("damping")
    assert all(mass.low < value < mass.high for value in (95.1087, 94.05))
    assert all(damping.low < value < damping.high for value in (159.0, 203.5, 210.1, 233.0))
    assert mass.high / mass.low < 1.025


@pytest.mark.night
@pytest.mark.parametrize(
    ("name", "motor", "load", "resonance", "delay", "lag", "late"),
    [
        ("a", 0.004832, 0.004800, 76.24, 115e-6, 335e-6, 173e-6),
        ("b", 0.004796, 0.004801, 76.35, 111e-6, 330e-6, 176e-6),
    ],
)
def test_the_box_of_the_bench_holds_what_is_published(bench, name, motor, load, resonance, delay, lag, late):
    """The delay without that of the hold, and the lag of the current, are together both delays and the lag."""
    known = {"mass": motor + load, "structure.handle_mass": load, "structure.frequency_hz": resonance}
    for key, published in known.items():
        found = bench(name).found.bounded(key)
        assert found.low <= published <= found.high, key
        assert found.high / found.low < 1.07
    ends, corner = (bench(name).found.bounded(key) for key in ("delay", "actuator.bandwidth_hz"))
    least, most = (ends.low + 1 / (2 * np.pi * corner.high), ends.high + 1 / (2 * np.pi * corner.low))
    assert least <= delay + lag + late - bench(name).record.sample_time / 2 <= most
    assert most / least < 1.4


@pytest.mark.night
def test_the_box_of_one_recording_holds_the_other_s_numbers(bench):
    """Friction aside, which no two recordings share: their dampings differ by more than either tells."""
    box, other = bench("a").found, bench("b").found
    for each in other.record.numbers:
        mine = box.bounded(each.key)
        assert mine.low <= each.value <= mine.high or "damping" in each.key, each.key


@pytest.mark.slow
def test_every_measured_line_is_that_of_a_device_of_the_file(bench):
    for each in map(bench, "ab"):
        problem, study = each.file.problem, each.found.studies[0]
        (lines,) = study.lines
        needed = distances(lines, each.found.device, each.record.numbers)
        x, y = np.log(np.array(problem.uncertainty.unmodelled)).T
        stated = np.exp(np.interp(np.log(lines.hertz), x, y))
        assert np.all(needed <= stated) and not np.all(needed + 1.0 <= stated)


@pytest.mark.slow
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


@pytest.mark.parametrize("count", [1, 2, 5, 12, 40])
def test_all_intervals_of_a_box_hold_together_with_95_per_cent(count: int) -> None:
    """Each alone with the root of it; two deviations are the least."""
    together = erf(joint_factor(count) / sqrt(2)) ** count
    assert together >= 0.95 if count == 1 else together == pytest.approx(0.95, rel=1e-9)
