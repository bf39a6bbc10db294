"""Several axes: solved and checked each, equal ones once, in one table and with one exit code."""

from __future__ import annotations

import re

import pytest
from command import run as vctune
from command import strict

from vctune.api import uncoupled_axes as api
from vctune.design.verdict import gains_check
from vctune.exit_codes import ExitCode
from vctune.report.typography import html

ARM = """[device]
sample_time = 2e-3
[device.servo]
delay = 0.01
bandwidth_hz = 20.0
[operator]
mass = { min = 0.0, max = 0.0 }
damping = { min = 0.0, max = 0.0 }
stiffness = { min = 0.0, max = 1000.0 }
[coupling]
damping = 1e4
mass = 1.0
"""
AXES = """[[axis]]
name = "x"
[[axis]]
name = "y"
[[axis]]
name = "z"
operator.stiffness.max = 400.0
"""


@pytest.fixture
def arm(tmp_path):
    (tmp_path / "arm.toml").write_text(ARM + AXES)
    return tmp_path


def test_equal_axes_are_solved_once_and_each_has_its_files(arm, monkeypatch):
    solved, solve = [], api.solve
    monkeypatch.setattr(api, "solve", lambda file, **how: solved.append(file.problem.name) or solve(file, **how))
    done = vctune("solve", "arm.toml", cwd=arm)
    assert done.returncode == ExitCode.OK, done.stderr
    assert solved == ["arm x", "arm z"]
    rows = [line.split() for line in done.stdout.splitlines()]
    assert [row[:2] for row in rows if row[0] in "xyz"] == [[axis, "certified"] for axis in "xyz"]
    drags = [float(row[row.index("kg") + 1]) for row in rows if row[0] in "xyz"]
    assert drags[0] == drags[1] > 2 * drags[2]
    page = (arm / "results/arm/index.html").read_text()
    for axis in "xyz":
        record = strict((arm / f"results/arm/{axis}/design.json").read_text())
        assert record["problem"]["name"] == f"arm {axis}" and record["status"] == "certified"
    promises = [line for line in done.stdout.splitlines() if "stable in every hand" in line]
    assert [promise.partition(": ")[0] for promise in promises] == ["x, y", "z"]
    assert all(f"<li>{html(promise)}.</li>" in page for promise in promises)
    checked = vctune("check", "arm.toml", "results/arm", cwd=arm)
    assert checked.returncode == ExitCode.OK and checked.stdout.endswith("3 passed\n"), checked.stdout
    assert "results/arm/y/gains.toml: y: proved" in checked.stdout
    objects = strict(vctune("check", "arm.toml", "results/arm", "--json", cwd=arm).stdout)
    assert [each["problem"]["name"] for each in objects] == ["arm x", "arm y", "arm z"]


@pytest.mark.parametrize("report", [False, True])
def test_a_page_leads_to_the_reports_that_are_drawn(arm, report):
    (arm / "arm.toml").write_text(f'{ARM}[[axis]]\nname = "x"\n')
    assert vctune("solve", "arm.toml", cwd=arm, report=report).returncode == ExitCode.OK
    links = re.findall('href="(.*?)"', (arm / "results/arm/index.html").read_text())
    assert links == (["x/report.html"] if report else [])
    assert all((arm / "results/arm" / link).is_file() for link in links)


def test_the_worst_axis_decides(arm, monkeypatch):
    monkeypatch.setattr(gains_check, "_repairs", lambda *given: (None, []))  # of what would help other tests speak
    (arm / "arm.toml").write_text(f"{ARM}drag = 20.0\n{AXES}coupling.drag = 7.0\n")
    done = vctune("check", "arm.toml", cwd=arm)
    assert done.returncode == ExitCode.FAILED and done.stdout.endswith("2 passed, 1 FAILED\n"), done.stdout
    (error,) = (
        line
        for line in vctune("check", "arm.toml", "--format", "github", cwd=arm).stdout.splitlines()
        if line.startswith("::error")
    )
    assert "file=arm.toml,line=19," in error and "z: refuted" in error


def test_axes_without_gains_are_told_what_is_missing(arm):
    done = vctune("check", "arm.toml", cwd=arm)
    assert done.returncode == ExitCode.BAD_INPUT
    assert "arm.toml:14: x: coupling.drag: nothing to check: not fixed" in done.stdout and "[not-fixed]" in done.stdout
    folder = vctune("check", "arm.toml", "nowhere.toml", cwd=arm)
    assert folder.returncode == ExitCode.BAD_INPUT and "name the folder of their designs" in folder.stderr


def test_other_commands_design_one_axis(arm):
    done = vctune("region", "arm.toml", cwd=arm)
    assert done.returncode == ExitCode.BAD_INPUT and "axis: makes several problems of one file" in done.stderr
