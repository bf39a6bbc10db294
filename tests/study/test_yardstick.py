"""One question has one yardstick: errors that are compared are over one band and with one Z_0."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command import run

from vctune.api.comparing import compare
from vctune.api.sweeping import sweep
from vctune.design.solve import solve
from vctune.document.reading import parse_problem
from vctune.document.study_file import read_study
from vctune.model.problem import Problem

DEVICE = "[device]\nmass = {mass!r}\ndamping = {damping!r}\nsample_time = 1e-3\ndelay = {delay!r}\n"
PASSIVE = "[stability]\ncriterion = 'passive'\n"
BASE = {"mass": 0.4, "damping": 2.0, "delay": 0.0}
POINTS = [BASE, {"mass": 0.62, "damping": 0.74, "delay": 6e-5}, {"mass": 0.125, "damping": 0.21, "delay": 8e-4}]
POINTS += [{"mass": 2.0, "damping": 0.18, "delay": 9e-4}]
KEYS = ("mass", "damping", "delay")
AXES = {f"device.{key}": [point[key] for point in POINTS] for key in KEYS}


def text_of(point, more=PASSIVE):
    return DEVICE.format(**point) + more


def problem_of(point, more=PASSIVE) -> Problem:
    return parse_problem(text_of(point, more), "x", "x")


def stated(problem: Problem) -> str:
    """Return what states a problem's stability band, within that table, and its transparency band and Z_0."""
    on, held = problem.transparency, f"band_hz = {list(problem.stability.band.hz)}\n"
    return f"{held}[transparency]\nband_hz = {list(on.band.hz)}\nreference_impedance = {on.reference_impedance!r}\n"


@pytest.fixture(scope="module")
def three_keys(tmp_path_factory):
    """Return a sweep over mass, damping and delay, each point's problem and what solve makes of its default one."""
    path = tmp_path_factory.mktemp("three") / "wheel.toml"
    path.write_text(text_of(BASE))
    swept = sweep(path, AXES, sample={"kind": "list"})
    problems = [swept.study.at([point[key] for key in KEYS])[0] for point in POINTS]
    own = [solve(problem_of(point)).judgement.error for point in POINTS]
    return swept, problems, own


def test_the_best_point_is_the_best_on_the_yardstick_of_the_problem(three_keys):
    """Each point's default yardstick would name another one: that with the easiest."""
    swept, _, own = three_keys
    errors, best = swept.table.numbers["error"], swept.summary.best
    assert [best[f"device.{key}"] for key in KEYS] == [POINTS[int(np.argmin(errors))][key] for key in KEYS]
    assert np.argmin(errors) != np.argmin(own)


def test_every_point_has_what_a_file_gives_that_states_the_yardstick(three_keys):
    swept, _, own = three_keys
    table = stated(problem_of(BASE))
    for point, error, mine in zip(POINTS, swept.table.numbers["error"], own, strict=True):
        there = solve(problem_of(point, PASSIVE + table)).judgement.error
        assert error == pytest.approx(there, rel=1e-9)
        assert point is BASE or error != pytest.approx(mine, rel=0.05)


def test_each_points_stability_band_is_that_of_the_problem(three_keys):
    swept, problems, _ = three_keys
    for point, problem in zip(POINTS, problems, strict=True):
        own = problem_of(point)
        assert problem.stability == problem_of(BASE).stability
        assert point is BASE or own.stability.band.max < problem.stability.band.max
    assert set(swept.table.numbers["stability_high_hz"]) == {100.0}


def test_a_loop_that_hardly_works_is_idle_in_rows_table_and_summary(three_keys, tmp_path):
    swept, _, _ = three_keys
    tracking = swept.table.numbers["tracking_term"]
    assert swept.table.idle.tolist() == (tracking > 0.5).tolist() and swept.table.idle.tolist()[3]
    assert set(swept.table.status) == {"certified"} and swept.summary.idle == 1
    (tmp_path / "wheel.toml").write_text(text_of(BASE))
    axes = "".join(f'"device.{key}" = [{POINTS[3][key]}]\n' for key in KEYS)
    (tmp_path / "study.toml").write_text(f'problem = "wheel.toml"\n[axes]\n{axes}')
    said = run("sweep", "study.toml", "--executor", "serial", cwd=tmp_path).stdout
    assert "1 certified (1 idle)" in said and ", idle\n" in said and "0.5 to 30 Hz with Z_0 = 9.7339 N s/m" in said
    row = json.loads((tmp_path / "results/study/rows.jsonl").read_text().splitlines()[1])
    assert row["idle"] is True and row["status"] == "certified"
    assert "certified,true," in (tmp_path / "results/study/table.csv").read_text()


def test_an_axis_may_state_the_yardstick(tmp_path):
    (tmp_path / "wheel.toml").write_text(text_of(BASE))
    path = tmp_path / "study.toml"
    keys = '"transparency.reference_impedance" = [3.0]\n"transparency.band_hz[1]" = [20.0]\n"device.delay" = [1e-3]\n'
    path.write_text(f'problem = "wheel.toml"\n[axes]\n{keys}')
    here = read_study(path).at((3.0, 20.0, 1e-3))[0].transparency
    assert here.reference_impedance == 3.0 and here.band.hz == pytest.approx((0.5, 20.0))
    said = run("sweep", "study.toml", "--executor", "serial", cwd=tmp_path).stdout
    assert "except transparency.reference_impedance, transparency.band_hz[1]: errors" in said


def test_what_an_axis_alone_gives_completes_the_problem_for_the_yardstick(tmp_path):
    path = tmp_path / "study.toml"
    (tmp_path / "wheel.toml").write_text(text_of(BASE).replace("mass = 0.4\n", ""))
    path.write_text('problem = "wheel.toml"\n[axes]\n"device.mass" = [0.4, 0.8]')
    assert read_study(path).at((0.8,))[0].transparency == problem_of(BASE).transparency


@pytest.mark.parametrize(("criterion", "reached"), [("passive", False), ("both", False), ("hands", True)])
def test_a_band_that_a_point_does_not_reach_is_the_reason_why_there_is_none(criterion, reached, tmp_path):
    """100 Hz, at a sample time of 7 ms; in hands the demand is up to each point's Nyquist frequency."""
    (tmp_path / "wheel.toml").write_text(text_of(BASE, f"[stability]\ncriterion = '{criterion}'\n"))
    (tmp_path / "study.toml").write_text('problem = "wheel.toml"\n[axes]\n"device.sample_time" = [7e-3, 0.05]\n')
    study = read_study(tmp_path / "study.toml")
    problem, faults = study.at((7e-3,))
    assert (problem is not None) is reached
    assert reached or ("100 Hz" in faults[0].message and "71.4286 Hz" in faults[0].message)
    problem, faults = study.at((0.05,))
    told = next(fault for fault in faults if fault.path == ("transparency", "band_hz"))
    assert problem is None and "30 Hz" in told.message and "10 Hz" in told.message


def test_b_is_measured_as_a_unless_it_states_its_own(tmp_path):
    own = stated(problem_of(POINTS[2]))
    for name, point, more in (("a", BASE, ""), ("b", POINTS[2], ""), ("own", POINTS[2], own)):
        (tmp_path / f"{name}.toml").write_text(text_of(point, PASSIVE + more))
    there = solve(problem_of(POINTS[2], PASSIVE + stated(problem_of(BASE)))).judgement.error
    together = compare(tmp_path / "a.toml", tmp_path / "b.toml")
    assert {each["key"]: each["b"] for each in together.design}["transparency.error"] == pytest.approx(there, rel=1e-6)
    assert not any(each["key"].startswith("transparency") for each in together.problem)
    apart = compare(tmp_path / "a.toml", tmp_path / "own.toml")
    assert {"transparency.band_hz", "stability.band_hz"} < {each["key"] for each in apart.problem}
    values = {each["key"]: each for each in apart.design}
    assert values["transparency.error"]["b"] == pytest.approx(solve(problem_of(POINTS[2])).judgement.error, rel=1e-6)
