"""`vctune check`: the gate for continuous integration, and each of its formats read by a real consumer."""

from __future__ import annotations

import json
import re
import subprocess
import sys

import numpy as np
import pytest
from conftest import ROOT
from junitparser import Error, Failure, JUnitXml
from sarif_pydantic import Sarif

from vctune.design.check import check
from vctune.design.solve import solve
from vctune.document.gains import gains_text
from vctune.document.reading import parse_problem
from vctune.exits import ExitCode

DEVICE = "[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 1e-3\n"
FIXED = "[gains]\nvelocity = 150.0\nposition = 6000.0\n[coupling]\ndamping = {}\nmass = 0.35\n"


def run(*arguments, cwd):
    command = [sys.executable, "-m", "vctune", "check", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False, timeout=120)


@pytest.fixture
def folder(tmp_path):
    """One good, one violated, one unreadable and one free problem."""
    (tmp_path / "good.toml").write_text(DEVICE + FIXED.format(160.0))
    (tmp_path / "poor.toml").write_text(DEVICE + FIXED.format(60.0))
    (tmp_path / "bad.toml").write_text(DEVICE + "dampin = 1.0\n")
    (tmp_path / "free.toml").write_text(DEVICE)
    return tmp_path


@pytest.mark.parametrize(
    ("names", "code"),
    [
        (["good.toml"], ExitCode.OK),
        (["poor.toml"], ExitCode.FAILED),
        (["good.toml", "poor.toml"], ExitCode.FAILED),
        (["poor.toml", "bad.toml"], ExitCode.BAD_INPUT),
        (["free.toml"], ExitCode.BAD_INPUT),
        (["none.toml"], ExitCode.BAD_INPUT),
        (["."], ExitCode.BAD_INPUT),
    ],
)
def test_worst_exit_code_wins(folder, names, code):
    done = run(*names, cwd=folder)
    assert done.returncode == code
    assert done.stderr == "" and "Traceback" not in done.stdout


def test_summary_of_a_folder(folder):
    assert run(".", cwd=folder).stdout.splitlines()[-1] == "1 passed, 1 FAILED, 2 bad input"


def test_refusal_names_frequency_ratio_and_the_least_change(folder):
    text = run("poor.toml", cwd=folder).stdout
    found = re.search(
        r"refuted at ([\d.]+) Hz.*least Re Z_c / R ([\d.]+).*; (\S+) = ([\d.]+) instead of ([\d.]+) would pass", text
    )
    key, new, old = found[3], float(found[4]), float(found[5])
    assert float(found[2]) < 1
    document = (folder / "poor.toml").read_text()
    name = key.split(".")[1]
    assert f"{name} = {old}" in document
    for value, passes in ((new, True), (old + (new - old) * 0.99, False)):
        (folder / "mended.toml").write_text(document.replace(f"{name} = {old}", f"{name} = {value!r}"))
        assert (check(folder / "mended.toml", None).exit_code is ExitCode.OK) == passes


def test_json_is_the_object_of_solve(folder):
    one = json.loads(run("good.toml", "--format", "json", cwd=folder).stdout)
    assert (one["schema"], one["status"], one["certificate"]["verdict"]) == ("vctune/design/1", "certified", "proved")
    several = json.loads(run("good.toml", "bad.toml", "--format", "json", cwd=folder).stdout)
    assert [item["status"] for item in several] == ["certified", None]


def test_github_annotates_the_line_of_the_gain_to_change(folder):
    lines = run(".", "--format", "github", cwd=folder).stdout.splitlines()
    assert re.match(r"::error file=([^,]+),line=(\d+),", lines[0]).groups() == ("bad.toml", "5")
    place = next(line for line in lines if "file=poor.toml" in line)
    number, key = int(re.search(r"line=(\d+)", place)[1]), re.search(r"(\w+) = \S+ instead of", place)[1]
    assert (folder / "poor.toml").read_text().splitlines()[number - 1].startswith(key)
    assert all("\n" not in line and "%0A" not in line.split("::")[1] for line in lines)


def test_junit_is_read_by_a_junit_reader(folder):
    (suite,) = JUnitXml.fromstring(run(".", "--format", "junit", cwd=folder).stdout.encode())
    assert (suite.tests, suite.failures, suite.errors) == (4, 1, 2)
    kinds = {case.name: [type(result) for result in case.result] for case in suite}
    assert kinds == {"good.toml": [], "poor.toml": [Failure], "bad.toml": [Error], "free.toml": [Error]}


def test_sarif_is_valid(folder):
    log = Sarif.model_validate_json(run(".", "--format", "sarif", cwd=folder).stdout)
    results = log.runs[0].results
    assert log.version == "2.1.0"
    assert {result.rule_id for result in results} == {"violated", "bad-input"}
    known = {rule.id for rule in log.runs[0].tool.driver.rules}
    assert {result.rule_id for result in results} <= known
    assert all(result.locations[0].physical_location.region.start_line >= 1 for result in results)


def test_gains_files_are_checked_against_one_problem(tmp_path):
    problem = parse_problem(DEVICE, "x", "x")
    judgement = solve(problem).judgement
    (tmp_path / "problem.toml").write_text(DEVICE)
    (tmp_path / "gains").mkdir()
    for share in (1.0, 0.5):
        coupling = type(judgement.coupling)(judgement.coupling.damping * share, judgement.coupling.mass, 0.0)
        (tmp_path / f"gains/{share}.toml").write_text(gains_text(judgement.gains, coupling, {"sha256": "of another"}))
    done = run("problem.toml", "gains", cwd=tmp_path)
    assert done.returncode == ExitCode.FAILED
    assert done.stdout.count("sha256 differs") == 2
    assert done.stdout.splitlines()[-1] == "1 passed, 1 FAILED"
    assert run("problem.toml", "problem.toml", "gains/1.0.toml", cwd=tmp_path).returncode == ExitCode.BAD_INPUT


def test_bad_gains_files_are_refused_with_their_lines(tmp_path):
    (tmp_path / "problem.toml").write_text(DEVICE)
    (tmp_path / "gains.toml").write_text('[gains]\nvelocity = "x"\n[coupling]\ndamping = 1.0\nmass = -1.0\n')
    done = run("problem.toml", "gains.toml", cwd=tmp_path)
    assert done.returncode == ExitCode.BAD_INPUT
    for part in (
        "gains.toml:1: gains.position: is missing",
        "gains.toml:2: gains.velocity",
        "gains.toml:5: coupling.mass",
    ):
        assert part in done.stdout


@pytest.mark.parametrize("count", [40, pytest.param(1000, marks=pytest.mark.slow)])
def test_rounding_attack(tmp_path, count):
    """The numbers as printed in gains.toml pass, whatever the device."""
    rng = np.random.default_rng(3)
    for k in range(count):
        mass, T = 10.0 ** rng.uniform(-3, 3), 10.0 ** rng.uniform(-4, -2)
        text = f"[device]\nmass = {mass!r}\ndamping = {mass / T * 10 ** rng.uniform(-5, -1)!r}\nsample_time = {T!r}\n"
        text += f'hold = "{rng.choice(["zoh", "lag"])}"\ndelay = {T * float(rng.choice([0.0, 0.5]))!r}\n'
        judgement = solve(parse_problem(text, "x", "x")).judgement
        problem, gains = tmp_path / f"p{k}.toml", tmp_path / f"g{k}.toml"
        problem.write_text(text)
        gains.write_text(gains_text(judgement.gains, judgement.coupling, {}))
        assert check(problem, gains).exit_code is ExitCode.OK


def test_a_check_imports_no_optimiser():
    code = (
        "import sys; from pathlib import Path; from vctune.design.check import check;"
        f"check(Path({str(ROOT / 'problems/fixed-gains.toml')!r}), None);"
        "sys.exit('casadi' in sys.modules or 'matplotlib' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
