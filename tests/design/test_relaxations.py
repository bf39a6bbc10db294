"""A certified design of little use says what it costs, and errors are told with their yardstick."""

from __future__ import annotations

import json
import re

import pytest
from command import run
from conftest import DEVICE, for_passive_hands

import vctune
from vctune.document.text.toml import toml_text

pytestmark = pytest.mark.advice

FIRST = """
[device]
mass = 0.35
damping = 1.5
sample_time = 5e-4
delay = 4e-4
force_sensor = { bandwidth_hz = 200.0 }
"""


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    folder = tmp_path_factory.mktemp("first")
    (folder / "first.toml").write_text(FIRST)
    done = run("solve", "first.toml", cwd=folder, report=True)
    return folder, done


def test_the_criterion_that_makes_a_design_useless_is_named_with_the_error_without_it(first):
    """Solved with the line that is named, the error on the same yardstick is the one that was told."""
    folder, done = first
    assert done.returncode == 0 and "[warn-limp]" in done.stdout
    record = json.loads((folder / "results/first/design.json").read_text())
    best = record["relaxations"][0]
    assert best["needs"] == 'stability.criterion = "hands"' and best["needs"] in done.stdout
    assert best["instead_of"] == record["transparency"]["error"] > 2 * best["error"]
    relaxed = vctune.solve(vctune.problem(folder / "first.toml").document | {"stability": {"criterion": "hands"}})
    assert relaxed.judgement.transparency.error == pytest.approx(best["error"], rel=1e-6)
    assert not relaxed.judgement.limp and relaxed.relaxations == []


def test_a_warning_fails_it_strictly_and_the_page_says_the_same_in_no_stamp(first):
    folder, _ = first
    assert run("solve", "first.toml", "--strict", "--no-report", "--out", "strict", cwd=folder).returncode == 1
    page = (folder / "results/first/report.html").read_text()
    next_step = re.search(r"Next:<.b>(.*)", page)[1]
    assert "of little use" in page and "0.541 for 1.87" in next_step
    assert 'stability.criterion = "hands"' in next_step
    assert "of little use" not in page.partition("<svg")[2]


def test_a_design_is_written_before_its_page_and_a_limit_that_cuts_the_page_is_no_failure(tmp_path):
    (tmp_path / "device.toml").write_text(DEVICE)
    done = run("solve", "device.toml", "--time-limit", "3", cwd=tmp_path)
    assert done.returncode == (0 if "certified" in done.stdout else 3), done
    if "certified" in done.stdout:
        assert (tmp_path / "results/device/gains.toml").exists()


def test_the_error_of_a_repair_on_another_yardstick_names_it():
    """Z_0 is by default made of mass and loop lag, so that another sample time moves it."""
    problem = vctune.problem(for_passive_hands(DEVICE) and {
        "device": {"mass": 0.4, "damping": 2.0, "sample_time": 1e-3},
        "gains": {"velocity": 150.0, "position": 6000.0},
        "coupling": {"damping": 80.0, "mass": 0.37},
        "stability": {"criterion": "passive"},
    })  # fmt: skip
    repairs = vctune.check(problem).finding.repairs
    own = problem.problem.transparency.reference_impedance
    of_device = [repair for repair in repairs if repair.key in ("device.sample_time", "device.damping")]
    assert of_device or any(repair.chooses for repair in repairs)
    for repair in repairs:
        table, name = repair.key.split(".")[:2]
        tables = problem.document
        changed = tables | {table: tables.get(table, {}) | {name: repair.new}} if "[" not in repair.key else tables
        impedance = vctune.problem(toml_path(changed)).problem.transparency.reference_impedance
        told = repair.reference_impedance
        assert (told is None) == (abs(impedance / own - 1) < 1e-6)
        assert told is None or told == pytest.approx(impedance)


def toml_path(tables):
    """Return tables as they are read from a file."""
    import tomllib

    return tomllib.loads(toml_text(tables))


def test_a_design_that_replaces_one_of_another_file_with_its_name_says_so(tmp_path):
    for folder in ("one", "other"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "same.toml").write_text(DEVICE)
    quick = ("--no-report", "--time-limit", "20")
    assert "replaces" not in run("solve", "one/same.toml", *quick, cwd=tmp_path).stderr
    assert "replaces" not in run("solve", "one/same.toml", *quick, cwd=tmp_path).stderr
    said = run("solve", "other/same.toml", *quick, cwd=tmp_path).stderr
    assert "results/same holds the design of one/same.toml" in said and "[warn-name]" in said
