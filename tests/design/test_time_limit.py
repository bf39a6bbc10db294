"""What a time limit leaves: what was known by then, written, undecided where it is, and exit code 3.

The clock counts how often it is asked, so that a limit of n ends the same work at the same place on every machine.
"""

from __future__ import annotations

import json
import subprocess
import sys
from contextvars import ContextVar
from itertools import count
from math import inf
from pathlib import Path

import click
import numpy as np
import pytest
from command import run, strict

import vctune
from vctune import running
from vctune.design.judging.judge import Status, judge
from vctune.document.reading import parse_problem
from vctune.exit_codes import ExitCode
from vctune.proof.certificate import certify
from vctune.proof.enclosures.intervals import Enclosure
from vctune.proof.enclosures.taylor import variables

DEVICE = "[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 1e-3\n"
PASSIVE = DEVICE + '[stability]\ncriterion = "passive"\n'
GAINS = "[gains]\nvelocity = 150.0\nposition = 6000.0\n[coupling]\ndamping = 160.0\nmass = 0.37\n"
LONG = "[device]\nmass = 0.1824\ndamping = 0.1256\nsample_time = 1.685e-3\ndelay = 7.397e-3\n"
LONG_UNCERTAINTY = "[uncertainty]\nmass = 0.2568\ndamping = 0.5906\ndelay = 0.1481\n"
LONG_GAINS = (
    "[gains]\nvelocity = 4.7586404e-4\nposition = 0.0\n"
    "[coupling]\ndamping = 0.34848667\nmass = 4.2347732e-3\ndrag = 7.4223667e-3\n"
)
"""A device whose three uncertain numbers keep the proof in every hand busy for about a minute, and its design."""
EVERYTHING = """
[device]
mass = 0.6
damping = 3.0
sample_time = 1e-3
delay = 0.05
structure = { handle_mass = 0.2, frequency_hz = 150.0, damping_ratio = 0.05 }
actuator = { bandwidth_hz = 300.0 }
velocity = { filter_hz = 200.0 }
force_sensor = { bandwidth_hz = 300.0, delay = 2e-4 }
[uncertainty]
mass = 0.1
damping = 0.5
delay = 0.2
"structure.handle_mass" = 0.1
"structure.frequency_hz" = 0.1
"structure.damping_ratio" = 0.3
"actuator.bandwidth_hz" = 0.1
"velocity.filter_hz" = 0.1
"""
"""A device with 8 uncertain numbers, and so many delays that 1217 devices meet every hand."""
EVERYTHING_GAINS = "[gains]\nvelocity = 5.0\nposition = 6.0\n[coupling]\ndamping = 160.0\nmass = 0.37\ndrag = 3.0\n"
BOX = "[environment]\nmass.min = 0.05\nstiffness.max = 1000.0\n"
SERVO = """
[device]
sample_time = 2e-3
servo = { delay = 0.15, bandwidth_hz = 10.0, order = 2 }
force_sensor = { delay = 3e-3, bandwidth_hz = 80.0 }
[uncertainty]
"servo.delay" = 0.3
"servo.bandwidth_hz" = 0.2
"force_sensor.delay" = 0.5
"force_sensor.bandwidth_hz" = 0.2
"""
NOTHING_BEHIND = "[environment]\nmass.max = 0.0\nstiffness.max = 0.0\n"
SERVO_GAINS = "[coupling]\ndamping = inf\nmass = 20.0\ndrag = 2000.0\n"
STUDY = 'problem = "device.toml"\n[axes]\n"device.damping" = [1.0, 2.0, 4.0]\n'
ENOUGH = 10**9
IN_PROCESSOR_SECONDS = """
import sys, time
from vctune import running
running.perf_counter = time.process_time
running.process_began()
from vctune.cli.main import execute
code = execute()
print(time.process_time(), file=sys.stderr)
sys.exit(code)
"""
"""Runs a command whose limit is in seconds of the processor, and says how many it took."""


@pytest.fixture
def ticks(monkeypatch):
    """A clock that a limit of n seconds ends when it is asked for the n-th time."""

    def restart():
        tick = count()
        monkeypatch.setattr(running, "perf_counter", lambda: float(next(tick)))

    restart()
    return restart


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "device.toml").write_text(PASSIVE)
    (tmp_path / "fixed.toml").write_text(PASSIVE + GAINS)
    return tmp_path


def solved(folder, name="device"):
    return json.loads((folder / "results" / name / "design.json").read_text())


def asked(folder, *command):
    """Return how often the clock is asked in all by a command that ends, when it is run again."""
    for _ in range(2):  # the first run fills what this process keeps for the others
        asks = count()
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(running, "perf_counter", lambda asks=asks: float(next(asks)))
            run(*command, "--time-limit", ENOUGH, cwd=folder)
    return next(asks)


@pytest.mark.advice
def test_without_enough_time_for_a_design_solve_says_so(folder, ticks):
    done = run("solve", "device.toml", "--time-limit", 5, cwd=folder)
    record = solved(folder)
    assert done.returncode == ExitCode.UNDECIDED
    assert record["status"] == "undecided" and record["gains"] is None
    assert "the time limit ended the search before it had found a design" in record["reason"]
    assert any(said.endswith("[time-limit]") for said in record["warnings"])
    assert record["repairs"] is None, "that there are none was not found out"


def test_what_solve_knows_grows_with_its_time_and_nothing_cut_is_proved(folder, ticks):
    whole = asked(folder, "solve", "device.toml")
    best, stages = solved(folder), set()
    for share in (0.02, 0.2, 0.6, 0.8, 0.95):
        ticks()
        done = run("solve", "device.toml", "--time-limit", int(share * whole), cwd=folder)
        record = solved(folder)
        claims = [claim["verdict"] for claim in (record["certificate"] or {"claims": []})["claims"]]
        stages.add((record["status"], bool(claims), "proved" in claims))
        assert done.returncode == ExitCode.UNDECIDED
        assert record["status"] == "undecided" or set(claims) == {"proved"}
        assert any(said.endswith("[time-limit]") for said in record["warnings"]) or "[time-limit]" in done.stderr
        if record["status"] == "certified":
            assert record["transparency"]["error"] >= best["transparency"]["error"] * (1 - 1e-6)
    assert ("undecided", False, False) in stages and len(stages) > 1, stages


def test_a_limit_that_is_not_reached_changes_nothing(folder):
    run("solve", "device.toml", cwd=folder)
    without = solved(folder)
    run("solve", "device.toml", "--time-limit", 1000, cwd=folder)
    assert {**solved(folder), "date": None} == {**without, "date": None}


def test_check_names_the_claims_that_it_had_no_time_for(folder, ticks):
    whole = asked(folder, "check", "fixed.toml")
    cut = set()
    for limit in (1, whole // 4, whole // 2):
        ticks()
        done = run("check", "fixed.toml", "--time-limit", limit, cwd=folder)
        cut.add(done.stdout.count("(the time limit cut its proof)"))
        assert done.returncode == ExitCode.UNDECIDED and "[time-limit]" in done.stdout
    assert 4 in cut and 0 not in cut


@pytest.mark.slow
def test_what_is_refuted_in_time_stays_refuted(folder, ticks):
    (folder / "poor.toml").write_text(PASSIVE + GAINS.replace("damping = 160.0", "damping = 80.0"))
    whole = asked(folder, "check", "poor.toml")
    ticks()
    done = run("check", "poor.toml", "--time-limit", whole // 2, cwd=folder)
    assert done.returncode == ExitCode.FAILED and "refuted" in done.stdout
    assert "each changed alone" not in done.stdout


@pytest.mark.slow
def test_a_region_holds_the_cells_that_were_decided(folder, ticks):
    whole = asked(folder, "region", "device.toml", "--resolution", 0.125)
    complete = json.loads((folder / "results/device/region.json").read_text())
    ticks()
    done = run("region", "device.toml", "--resolution", 0.125, "--time-limit", int(0.2 * whole), cwd=folder)
    part = json.loads((folder / "results/device/region.json").read_text())
    assert done.returncode == ExitCode.UNDECIDED and "[time-limit]" in done.stderr and "out of time" in done.stdout
    assert part["interrupted"] is True
    assert part["areas"]["feasible"] <= complete["areas"]["feasible"]
    assert part["areas"]["infeasible"] <= complete["areas"]["infeasible"]
    ticks()
    done = run("region", "device.toml", "--resolution", 0.125, "--time-limit", 3, cwd=folder)
    assert done.returncode == ExitCode.UNDECIDED and "holds what was decided before the time limit" in done.stderr
    assert "some undecided cells were not examined" in (folder / "results/device/region.svg").read_text()


def test_a_region_that_had_no_time_to_be_proved_again_is_not_lost(folder, ticks):
    ticks()
    run("region", "device.toml", "--resolution", 0.125, "--time-limit", ENOUGH, cwd=folder)
    ticks()
    baseline = "results/device/region.json"
    done = run("check", "device.toml", "--region", baseline, "--time-limit", 10, cwd=folder)
    assert done.returncode == ExitCode.UNDECIDED and "not proved again in time" in done.stdout
    assert not (folder / "results/device/lost.json").exists()


@pytest.mark.slow
def test_a_bound_ends_in_time(folder, ticks):
    run("solve", "device.toml", cwd=folder)
    command = ("bound", "device.toml", "results/device/design.json", "--gap", 0.02)
    verdicts = []
    whole = asked(folder, *command)
    run("solve", "device.toml", cwd=folder)
    for limit in (2, 10, whole - 20):
        ticks()
        done = run(*command, "--time-limit", limit, cwd=folder)
        assert done.returncode == ExitCode.UNDECIDED
        found = solved(folder)["optimality"]
        verdicts.append(found and found["verdict"])
        assert ("the search had no time" in done.stderr) == (found is None)
    assert verdicts == [None, None, "open"], "neither the proof of the design nor the relaxation was complete, then was"


def test_a_point_of_a_sweep_that_takes_too_long_is_undecided_and_tried_again_with_more_time(folder, ticks):
    (folder / "study.toml").write_text(STUDY)
    command = ("sweep", "study.toml", "--executor", "serial")
    done = run(*command, "--time-limit", 5, cwd=folder)
    rows = [json.loads(line) for line in (folder / "results/study/rows.jsonl").read_text().splitlines()][1:]
    assert done.returncode == ExitCode.UNDECIDED and len(rows) == 3
    for row in rows:
        assert row["status"] == "undecided" and row["reason"].endswith("[time-limit]") and row["time_limit"] == 5
    before = (folder / "results/study/rows.jsonl").read_text()
    run(*command, "--time-limit", 5, cwd=folder)
    assert (folder / "results/study/rows.jsonl").read_text() == before, "with no more time nothing is tried again"
    assert run(*command, cwd=folder).returncode == ExitCode.OK
    last = [json.loads(line) for line in (folder / "results/study/rows.jsonl").read_text().splitlines()][-3:]
    assert {row["status"] for row in last} == {"certified"}


def test_the_limit_of_a_command_counts_from_the_start_of_its_process(monkeypatch):
    """Ten seconds of the interpreter and the imports leave two of twelve."""
    monkeypatch.setattr(running, "perf_counter", lambda: 100.0)
    monkeypatch.setattr(running, "process_time", lambda: 10.0)
    monkeypatch.setattr(running, "_BEGAN", ContextVar("began", default=None))
    with running.time_limit_of_command(12.0):
        assert running.seconds_left() == 12.0, "where nobody knows when the process began"
    running.process_began()
    with running.time_limit_of_command(12.0):
        assert running.seconds_left() == 2.0
    with running.time_limit_of_command(5.0):
        assert running.out_of_time()


@pytest.mark.slow
@pytest.mark.parametrize("command", ["solve", "check", "bound", "region"])
def test_a_short_limit_is_kept(tmp_path, command):
    """In seconds of the processor, of which other work takes none; start, imports, estimates and picture without any
    time for the search are measured beside it."""
    parts = (LONG, LONG_UNCERTAINTY * (command != "region"), LONG_GAINS * (command == "check"))
    (tmp_path / "unc.toml").write_text("".join(parts))
    taken = []
    for seconds in (0.0, 3.0):
        line = [sys.executable, "-c", IN_PROCESSOR_SECONDS, command, "unc.toml", "--time-limit", str(seconds)]
        done = subprocess.run(line, check=False, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode in (ExitCode.UNDECIDED, ExitCode.FAILED), done.stderr
        taken.append(float(done.stderr.split()[-1]))
    assert taken[1] < 3.0 + taken[0]


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.0, 2.0])
@pytest.mark.parametrize(
    "text, command",
    [
        (EVERYTHING + EVERYTHING_GAINS, ("check", "--json")),
        (EVERYTHING + EVERYTHING_GAINS + BOX + "walls = true\n", ("check",)),
        (EVERYTHING, ("solve",)),
        (EVERYTHING + BOX, ("solve",)),
        (SERVO + NOTHING_BEHIND, ("solve",)),
        (SERVO + SERVO_GAINS, ("check", "--json")),
    ],
)
def test_many_uncertain_numbers_keep_the_limit(tmp_path, text, command, seconds):
    (tmp_path / "many.toml").write_text(text)
    line = [sys.executable, "-c", IN_PROCESSOR_SECONDS, command[0], "many.toml", *command[1:]]
    done = subprocess.run(
        [*line, "--time-limit", str(seconds)], check=False, cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode in (ExitCode.UNDECIDED, ExitCode.FAILED), done.stderr
    assert float(done.stderr.split()[-1]) < max(seconds, 1.0) + 1.0, "a process takes up to a second to begin"


def test_without_time_a_judgement_holds_the_nominal_device_and_is_cut():
    problem = parse_problem(EVERYTHING + EVERYTHING_GAINS, "many.toml", "many")
    with running.time_limit(0.0):
        found = judge(problem, *problem.fixed_design)
    assert found.status is Status.UNDECIDED and found.cut
    assert {margin.device for margin in found.margins} == {problem.device}
    assert 0 < found.min_ratio < inf and found.peak_sensitivity > 0


def test_a_contact_that_there_was_no_time_for_is_said_to_be_missing(tmp_path):
    (tmp_path / "servo.toml").write_text(SERVO + SERVO_GAINS)
    done = run("check", "servo.toml", "--json", "--time-limit", 0, cwd=tmp_path)
    (record,) = json.loads(done.stdout)
    assert "contact" not in record and any(
        "cut the stiffest contact and whether it shakes short" in said for said in record["warnings"]
    )


def test_a_proof_looks_at_the_limit_within_a_batch_of_boxes():
    number = variables([Enclosure(np.zeros(1), np.ones(1))], [True])[0]
    with running.time_limit(0.0), pytest.raises(running.OutOfTimeError):
        number * number


def test_functions_take_the_limit_too():
    found = vctune.solve({"device": {"mass": 0.4, "damping": 2.0, "sample_time": 1e-3}}, time_limit=1e-9)
    assert found.status == "undecided" and found.cut and found.judgement is None


@pytest.mark.parametrize(
    "text, code",
    [
        (DEVICE.replace("1e-3", "0.5"), "warn-sample-time"),
        (DEVICE.replace("1e-3", "2000.0"), "warn-sample-time"),
        (DEVICE.replace("0.4", "11.0") + "[operator]\nstiffness = { min = 0.0, max = 6e11 }\n", "warn-stiffness"),
    ],
)
def test_a_mistake_of_units_is_named_before_the_work(folder, monkeypatch, text, code):
    """By every command, before anything is proved or solved."""
    (folder / "doubtful.toml").write_text(text)
    (folder / "given.toml").write_text(text + GAINS)
    (folder / "of-doubtful.toml").write_text(STUDY.replace("device.toml", "doubtful.toml"))
    for place, work in (("design.check", "judge_all"), ("api.solving", "find"), ("api.sweeping", "run")):
        monkeypatch.setattr(f"vctune.{place}.{work}", _too_early)
    for command in (("solve", "doubtful.toml"), ("check", "given.toml"), ("sweep", "of-doubtful.toml")):
        done = run(*command, cwd=folder)
        assert done.returncode == ExitCode.INTERNAL, "the work was begun"
        assert f"[{code}]" in done.stderr.splitlines()[0], command


def test_a_sweep_into_a_mistake_of_units_is_named(folder):
    """The problem is sound; one of its points is doubtful, which is said once."""
    (folder / "study.toml").write_text(STUDY.replace('"device.damping" = [1.0, 2.0, 4.0]', HANDS_AXES))
    (folder / "device.toml").write_text(DEVICE)
    done = run("sweep", "study.toml", "--time-limit", 1e-9, "--executor", "serial", cwd=folder)
    assert done.stderr.count("[warn-stiffness]") == 1 and "2e+06" in done.stderr.splitlines()[0]


HANDS_AXES = '"operator.stiffness.max" = [3e3, 2e6]\n"device.damping" = [1.0, 2.0]'


def _too_early(*args, **kwargs):
    raise AssertionError("the work is not to begin")


@pytest.mark.night
@pytest.mark.parametrize(
    "change", ["sample_time = 0.5", "sample_time = 2000.0", *(f"{k:g}" for k in (1e6, 1e8, 6e11, 1e10))]
)
def test_a_mistake_of_units_has_an_answer(change, monkeypatch):
    """Its proofs need at most 1.25 million boxes, which take about a minute of processor time."""
    device = {"mass": 0.4, "damping": 2.0, "sample_time": 1e-3}
    operator, boxes = {}, []

    def counted(*args, **kwargs):
        certificate = certify(*args, **kwargs)
        boxes.append(certificate.boxes)
        return certificate

    monkeypatch.setattr("vctune.design.judging.judge.certify", counted)
    if "=" in change:
        device["sample_time"] = float(change.split()[-1])
    else:
        device["mass"], operator = 110.0, {"operator": {"stiffness": {"min": 0.0, "max": float(change)}}}
    found = vctune.solve({"name": "doubtful", "device": device, **operator})
    assert boxes and sum(boxes) <= 1_250_000
    assert found.status in ("certified", "undecided", "infeasible") and not found.cut


POOR = GAINS.replace("damping = 160.0", "damping = 80.0")


@pytest.mark.advice
@pytest.mark.slow
def test_repairs_that_a_limit_cut_are_not_called_complete(folder, ticks, monkeypatch) -> None:
    """None that was found, or some of all, with a warning; never that there are none."""
    (folder / "poor.toml").write_text(PASSIVE + POOR.replace("0.37", "1e-4"))
    limited, asks = ("check", "poor.toml", "--json", "--time-limit"), count()
    monkeypatch.setattr(running, "perf_counter", lambda: float(next(asks)))
    (full,) = strict(run(*limited, ENOUGH, cwd=folder).stdout)
    whole, known = next(asks), [repair["key"] for repair in full["repairs"]]
    assert known and full["warnings"] == [] and full["status"] == "violated"
    for share, some in ((0.3, False), (0.9, True)):
        ticks()
        (part,) = strict(run(*limited, int(share * whole), cwd=folder).stdout)
        assert part["status"] == "violated" and any(said.endswith("[time-limit]") for said in part["warnings"])
        found = part["repairs"] and [repair["key"] for repair in part["repairs"]]
        assert {*found} <= {*known} if some else found is None
    ticks()
    said = run("check", "poor.toml", "--time-limit", int(0.3 * whole), cwd=folder).stdout
    assert "each changed alone" not in said and "would pass" not in said, "nobody knows yet"


def saves(monkeypatch, *texts: tuple[Path, str]) -> None:
    """Save a file each time the command waits for one; then end it, by an error that leaves its output."""
    left = list(texts)

    def sleep(_seconds: float) -> None:
        if not left:
            raise click.UsageError("saved for the last time")
        path, text = left.pop(0)
        path.write_text(text)

    monkeypatch.setattr("vctune.cli.runner.time.sleep", sleep)


def test_watch_ends_each_search_at_its_limit(folder, ticks, monkeypatch) -> None:
    saves(monkeypatch)
    done = run("solve", "device.toml", "--watch", "--time-limit", 5, cwd=folder)
    assert "for the last time" in done.stderr and "[time-limit]" in done.stdout
    assert solved(folder)["status"] == "undecided" and solved(folder)["gains"] is None


def test_the_limit_of_watch_is_that_of_one_save(folder, ticks, monkeypatch) -> None:
    """Two searches take longer than the limit, and each of them less."""
    limit = int(1.5 * asked(folder, "solve", "device.toml"))
    saves(monkeypatch, (folder / "device.toml", PASSIVE.replace("2.0", "2.01")))
    ticks()
    done = run("solve", "device.toml", "--watch", "--time-limit", limit, cwd=folder)
    assert "for the last time" in done.stderr and "[time-limit]" not in done.stdout + done.stderr
    assert solved(folder)["status"] == "certified" and "2.01" in solved(folder)["problem"]["text"]
    assert done.stdout.count("device: certified") == 2


@pytest.mark.parametrize(
    ("names", "code"),
    [
        pytest.param(("poor", "fixed"), ExitCode.FAILED, marks=pytest.mark.slow),
        (("fixed", "fixed"), ExitCode.UNDECIDED),
        (("bad", "fixed", "fixed"), ExitCode.BAD_INPUT),
        pytest.param(("bad", "poor", "fixed"), ExitCode.BAD_INPUT, marks=pytest.mark.slow),
    ],
)
def test_the_code_of_files_of_which_the_last_has_no_time(folder, ticks, names: tuple[str, ...], code: ExitCode) -> None:
    """Undecided is worse than passed, failed than undecided, and what cannot be read than all of them."""
    (folder / "poor.toml").write_text(PASSIVE + POOR.replace("0.37", "1e-4"))
    (folder / "bad.toml").write_text("[device]\n")
    whole, last = (asked(folder, "check", *(f"{name}.toml" for name in some)) for some in (names, names[-1:]))
    limit = whole - last // 2
    ticks()
    done = run("check", *(f"{name}.toml" for name in names), "--time-limit", limit, cwd=folder)
    assert "1 undecided" in done.stdout and done.returncode == code


def test_the_code_of_an_infeasible_and_an_undecided_problem(folder, ticks) -> None:
    (folder / "vague.toml").write_text(PASSIVE + "[uncertainty]\nunmodelled = [[1.0, 2.0]]\n")
    limit = asked(folder, "solve", "vague.toml") + 2
    ticks()
    done = run("solve", "vague.toml", "device.toml", "--time-limit", limit, cwd=folder)
    assert [solved(folder, name)["status"] for name in ("vague", "device")] == ["infeasible", "undecided"]
    assert done.returncode == ExitCode.FAILED
