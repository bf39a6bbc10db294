"""`vctune check`: the gate for continuous integration."""

from __future__ import annotations

import json
import re
import subprocess
import sys

import command
import numpy as np
import pytest
from command import check_files, strict
from conftest import DEVICE, FIXED, ROOT, drawn, for_passive_hands

from vctune.design.check import CheckVerdict
from vctune.design.judging.judge import Status, judge
from vctune.design.solve import solve
from vctune.document.gains_file import gains_text
from vctune.document.reading import parse_problem
from vctune.exit_codes import ExitCode


def run(*arguments, cwd):
    return command.run("check", *arguments, cwd=cwd)


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


@pytest.mark.advice
def test_refusal_names_frequency_ratio_and_a_change_that_passes(folder):
    text = run("poor.toml", cwd=folder).stdout
    found = re.search(
        r"refuted at ([\d.]+) Hz.*least Re Z_c / R ([\d.]+).*; (\S+) = ([\d.]+) instead of ([\d.]+) would pass", text
    )
    key, new, old = found[3], float(found[4]), float(found[5])
    assert float(found[2]) < 1
    name, document = key.split(".")[1], (folder / "poor.toml").read_text()
    assert f"{name} = {old}" in document
    mended = parse_problem(document.replace(f"{name} = {old}", f"{name} = {new!r}"), "mended.toml", "mended")
    assert judge(mended, *mended.fixed_design).status is Status.CERTIFIED


def test_json_is_the_object_of_solve(folder):
    (one,) = json.loads(run("good.toml", "--format", "json", cwd=folder).stdout)
    assert (one["schema"], one["status"], one["certificate"]["verdict"]) == ("vctune/design/1", "certified", "proved")
    several = json.loads(run("good.toml", "bad.toml", "--format", "json", cwd=folder).stdout)
    assert [item["status"] for item in several] == ["certified", None]


def test_gains_files_are_checked_against_one_problem(tmp_path):
    problem = parse_problem(for_passive_hands(DEVICE), "x", "x")
    judgement = solve(problem).judgement
    (tmp_path / "problem.toml").write_text(for_passive_hands(DEVICE))
    (tmp_path / "gains").mkdir()
    for share in (1.0, 0.5):
        coupling = type(judgement.coupling)(judgement.coupling.damping * share, judgement.coupling.mass, 0.0)
        (tmp_path / f"gains/{share}.toml").write_text(
            gains_text(judgement.kind, judgement.gains, coupling, {"sha256": "of another"})
        )
    done = run("problem.toml", "gains", cwd=tmp_path)
    assert done.returncode == ExitCode.FAILED
    assert done.stdout.count("sha256 differs") == 2
    assert done.stdout.splitlines()[-1] == "1 passed, 1 FAILED"
    assert run("problem.toml", "problem.toml", "gains/1.0.toml", cwd=tmp_path).returncode == ExitCode.BAD_INPUT


@pytest.mark.parametrize("count", [5, pytest.param(drawn(1000), marks=pytest.mark.slow)])
def test_rounding_attack(tmp_path, count):
    """The numbers as printed in gains.toml pass, whatever the device."""
    rng = np.random.default_rng(3)
    for k in range(count):
        mass, T = 10.0 ** rng.uniform(-3, 3), 10.0 ** rng.uniform(-4, -2)
        text = f"[device]\nmass = {mass!r}\ndamping = {mass / T * 10 ** rng.uniform(-5, -1)!r}\nsample_time = {T!r}\n"
        text += f'hold = "{rng.choice(["zoh", "lag"])}"\ndelay = {T * float(rng.choice([0.0, 0.5]))!r}\n'
        judgement = solve(parse_problem(for_passive_hands(text), "x", "x")).judgement
        problem, gains = tmp_path / f"p{k}.toml", tmp_path / f"g{k}.toml"
        problem.write_text(for_passive_hands(text))
        gains.write_text(gains_text(judgement.kind, judgement.gains, judgement.coupling, {}))
        assert check_files([problem, gains])[0].result is CheckVerdict.PASSED


def test_a_check_imports_no_optimiser():
    code = (
        "import sys\nfrom vctune.cli.main import main\n"
        f"assert main(['check', {str(ROOT / 'problems/fixed-gains.toml')!r}], standalone_mode=False) == 0\n"
        "sys.exit('casadi' in sys.modules or 'matplotlib' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.advice
@pytest.mark.parametrize("spoil", [lambda text: "\ufeff" + text, lambda text: text.replace("\n", "\r\n")])
def test_files_of_windows_are_read(tmp_path, spoil):
    (tmp_path / "device.toml").write_text(spoil(for_passive_hands(DEVICE)), newline="")
    (tmp_path / "gains.toml").write_text(spoil(FIXED.format(80.0)), newline="")
    done = run("gains.toml", "device.toml", "--format", "github", cwd=tmp_path)
    assert done.returncode == ExitCode.FAILED
    assert done.stdout.startswith("::error file=gains.toml,line=2,")


def test_a_broken_file_among_gains_is_named(folder):
    (folder / "gains.toml").write_text(FIXED.format(160.0))
    (folder / "broken.toml").write_text("[gains\n")
    done = run("free.toml", "gains.toml", "broken.toml", cwd=folder)
    assert done.returncode == ExitCode.BAD_INPUT
    assert "broken.toml:1: not valid TOML" in done.stdout
    assert "passed     gains.toml" in done.stdout
    assert "broken.toml:1: not valid TOML" in run("broken.toml", "gains.toml", cwd=folder).stdout


LATE = """[device]
sample_time = 1e-3
servo = {{ delay = {}, bandwidth_hz = 1e6 }}
force_sensor = {{ delay = {} }}
[operator]
mass = {{ min = 0, max = 2 }}
damping = {{ min = 0, max = 30 }}
stiffness = {{ min = 0, max = 1000 }}
[coupling]
damping = inf
mass = 8.0
drag = 50.0
"""
WIDE = """[device]
mass = {}
damping = {}
sample_time = 1e-3
[gains]
velocity = 399.0
position = 1e5
[coupling]
damping = 100.0
mass = 0.3
[stability]
criterion = "passive"
"""


@pytest.mark.parametrize(
    ("text", "stated", "uncertain", "keys", "claim"),
    [
        (LATE, (0.01203, 0.0), "", ("servo.delay", None), "hands"),
        pytest.param(LATE, (0.002, 0.00203), "", ("servo.delay", None), "hands", marks=pytest.mark.slow),
        pytest.param(
            LATE,
            (0.01, 0.0),
            '[uncertainty]\n"servo.delay" = 0.21\n',
            ("servo.delay", None),
            "hands",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            WIDE,
            (0.4, 2.0),
            "[uncertainty]\nmass = 0.13\ndamping = 0.57\n",
            ("mass", "damping"),
            "sensitivity",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_the_device_of_a_refutation_is_told_to_the_last_digit(tmp_path, text, stated, uncertain, keys, claim):
    """At a delay beside a whole sample and inside a box: the same numbers in text and JSON, with which a file fails."""
    (tmp_path / "near.toml").write_text(text.format(*stated) + uncertain)
    done = run("near.toml", cwd=tmp_path)
    found = told(tmp_path, "near.toml", claim)
    assert (done.returncode, found["verdict"]) == (ExitCode.FAILED, "refuted")
    device = found["witness_device"] | found["witness_device"].get("parts", {})
    there = tuple(number if key is None else device[key] for key, number in zip(keys, stated, strict=True))
    assert there != stated
    for key, number in zip(keys, there, strict=True):
        assert key is None or f"{key} {number!r}".removesuffix(".0") in done.stdout
    (tmp_path / "there.toml").write_text(text.format(*map(repr, there)))
    assert told(tmp_path, "there.toml", claim)["verdict"] == "refuted"


def told(folder, name, claim):
    """Return what JSON says of a claim."""
    (record,) = strict(run(name, "--json", cwd=folder).stdout)
    return next(each for each in record["certificate"]["claims"] if each["id"] == claim)


@pytest.mark.slow
def test_the_division_of_a_latency_that_fails_is_told_with_its_bandwidth(tmp_path):
    text = LATE.format(0.01, 0.0).replace(", bandwidth_hz = 1e6", "")
    (tmp_path / "late.toml").write_text(text)
    found = told(tmp_path, "late.toml", "hands")
    parts = found["witness_device"]["parts"]
    assert found["verdict"] == "refuted" and parts["servo.delay"] != 0.01
    exact = text.replace(
        "delay = 0.01", f"delay = {parts['servo.delay']!r}, bandwidth_hz = {parts['servo.bandwidth_hz']!r}"
    )
    (tmp_path / "there.toml").write_text(exact)
    assert told(tmp_path, "there.toml", "hands")["verdict"] == "refuted"
