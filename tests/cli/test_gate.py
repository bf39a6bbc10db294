"""The gate: `vctune check` of several problems, each with its gains and regions, in CI over a year of edits."""

from __future__ import annotations

import json
import re
import shlex

import pytest
from command import run, started
from conftest import DEVICE, FIXED, for_passive_hands
from test_formats import workflow_commands

import vctune
from vctune.exit_codes import ExitCode

ARM = (
    "[device]\nsample_time = 2e-3\n[device.servo]\ndelay = 0.01\nbandwidth_hz = 8.0\n[operator]\nstiffness = 500.0\n"
    "[coupling]\ndamping = inf\nmass = 5.0\ndrag = 90.0\n"
)
SLOWER = DEVICE.replace("1e-3", "2e-3")


@pytest.fixture
def axes(tmp_path):
    """Two problems, gains that pass with the first, and gains that fail."""
    for name, text in {
        "a": for_passive_hands(DEVICE), "b": for_passive_hands(SLOWER),
        "good": FIXED.format(160.0), "poor": FIXED.format(80.0), "cut": "[gains]\nveloc",
    }.items():  # fmt: skip
        (tmp_path / f"{name}.toml").write_text(text)
    return tmp_path


@pytest.mark.parametrize("jobs", [1, 2])
def test_several_problems_each_with_their_own_gains(axes, jobs):
    done = run("check", "a.toml", "good.toml", "b.toml", "good.toml", "--jobs", jobs, cwd=axes)
    first, second, summary = done.stdout.splitlines()
    assert first.startswith("passed     good.toml: with a.toml: proved") and summary == "1 passed, 1 FAILED"
    assert second.startswith("FAILED     good.toml: with b.toml: ") and done.returncode == ExitCode.FAILED


def test_a_check_that_fails_for_its_warnings_counts_as_failed(axes):
    (axes / "doubted.toml").write_text('name = "aux"\n' + for_passive_hands(DEVICE))
    done = run("check", "doubted.toml", "good.toml", "a.toml", "good.toml", "--strict", cwd=axes)
    line, *_, summary = done.stdout.splitlines()
    assert line.startswith("FAILED     good.toml: with doubted.toml: proved")
    assert (
        line.endswith("; fails for its warnings")
        and summary == "1 passed, 1 FAILED"
        and done.returncode == ExitCode.FAILED
    )


def test_one_error_for_one_mistake_and_the_others_are_checked(axes):
    """What cannot be read is an annotation; the gains and problems beside it have their verdicts."""
    (axes / "region.json").write_text("{")
    names = ("a.toml", "cut.toml", "good.toml", "region.json", "none.toml", "none.yaml")
    commands = workflow_commands(run("check", *names, "--format", "github", cwd=axes).stdout)
    found = [(kind, place["file"]) for kind, place, _ in commands]
    refused = ["none.toml", "none.yaml", "region.json"]
    assert found == [("error", "cut.toml"), ("notice", "good.toml"), *(("error", name) for name in refused)]
    done = run("check", *names, "--format", "json", cwd=axes)
    assert [item["status"] for item in json.loads(done.stdout)] == [None, "certified", None, None, None]


@pytest.mark.parametrize("jobs", [1, 2])
def test_each_verdict_is_printed_when_it_is_known(axes, jobs):
    """A job that is ended shows what it had."""
    ended = started("check", "a.toml", *["good.toml"] * 300, "--jobs", str(jobs), cwd=axes)
    for _ in range(2):
        assert ended.stdout.readline().startswith("passed     good.toml: proved") and ended.poll() is None
    ended.terminate()
    out, _ = ended.communicate()
    assert ended.returncode == ExitCode.INTERRUPTED and re.fullmatch(r"\d+ passed", out.splitlines()[-1])


@pytest.mark.advice
def test_annotations_are_one_line_of_200_characters(axes):
    (axes / "bad.toml").write_text(DEVICE + "dampin = 1\nmas = 2\n")
    out = run("check", "a.toml", "poor.toml", "bad.toml", "--format", "github", cwd=axes).stdout
    commands = workflow_commands(out)
    assert [len(commands), all(len(data) <= 200 and "\n" not in data for *_, data in commands)] == [2, True]
    assert "would pass" in out and "device.mas:" in out  # in the log


def test_only_the_safety_factor_is_missed(tmp_path):
    """An arm that is stable in every hand, and misses an absurd factor."""
    (tmp_path / "arm.toml").write_text(ARM + "[stability]\nsafety_factor = 50\n")
    done = run("check", "arm.toml", cwd=tmp_path)
    assert done.returncode == ExitCode.FAILED
    assert re.match(r"FAILED     arm.toml: stable; misses safety_factor 50: least Re Z_c / R [\d.]+ at ", done.stdout)
    assert "unstable" not in done.stdout


def test_the_command_in_an_exported_ros_file_runs_there(tmp_path):
    (tmp_path / "my arm.toml").write_text(ARM)
    assert run("export", "my arm.toml", "--to", "ros2", cwd=tmp_path).returncode == ExitCode.OK
    (file,) = tmp_path.rglob("admittance_controller.yaml")
    command = re.search(r"^# (vctune check .*)$", file.read_text(), re.MULTILINE)[1]
    assert run(*shlex.split(command)[1:], cwd=file.parent).returncode == ExitCode.OK


def test_an_impedance_display_without_a_velocity_loop_shows_none(tmp_path):
    text = "[device]\ndisplay = 'impedance'\nmass = 0.1\ndamping = 0.8\nsample_time = 1e-3\n"
    (tmp_path / "knob.toml").write_text(text)
    assert "velocity loop" not in run("solve", "knob.toml", cwd=tmp_path).stdout
    (tmp_path / "knob.toml").write_text(text + "[gains]\nvelocity = 0.1\n")
    assert "velocity loop" in (out := run("solve", "knob.toml", cwd=tmp_path).stdout) and "none" not in out


@pytest.mark.parametrize("criterion", ["hands", "passive"])
def test_gains_of_a_loop_beside_a_wall_are_refused_for_programs_too(tmp_path, criterion):
    """With them the wall has a damping that no proof of its multiples has seen."""
    wall = DEVICE + 'display = "impedance"\n[environment]\nstiffness = inf\n'
    (tmp_path / "wall.toml").write_text(wall + f'[stability]\ncriterion = "{criterion}"\n')
    (tmp_path / "fast.toml").write_text("[gains]\nvelocity = 700.0\n[coupling]\nstiffness = 500.0\ndamping = 0.2\n")
    done = run("check", "wall.toml", "fast.toml", "--json", cwd=tmp_path)
    assert done.returncode == ExitCode.BAD_INPUT
    assert "fast.toml" in done.stdout and "adds to coupling.damping, which is the damping of the wall" in done.stdout
    problem = vctune.problem(tmp_path / "wall.toml").problem
    with pytest.raises(vctune.InputError, match=r"gains\.velocity"):
        vctune.judge(problem, vctune.Gains(700.0, 0.0), vctune.SpringDamper(0.2, 500.0))
