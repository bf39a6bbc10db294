"""Walls in problems: what is stated and refused, given gains, and a search (model/README.md, section 19)."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from math import inf, pi
from pathlib import Path

import pytest
from command import run
from test_solved_worlds import EXPECTED, REFERENCE, WHEEL, fixed, reference

from vctune import Coupling, Gains, solve
from vctune.analysis.in_worlds import corner_of
from vctune.design.advice.parameter_changes import parameter_changes
from vctune.design.advice.repair import find_repairs
from vctune.design.judging.judge import judge
from vctune.document.building import problem
from vctune.document.schema.statement import statement
from vctune.document.text.json import problem_digest
from vctune.exit_codes import ExitCode
from vctune.model.problem import Problem
from vctune.model.worlds import World, Worlds
from vctune.proof.outcome import Verdict

BOX = {"mass": {"min": 0.02, "max": 5.0}, "stiffness": {"max": 2000.0}}
STIFF = Gains(167.34044, 1e5), Coupling(97.0, 0.0417, 0.99)
"""Gains that bear the walls of `walled`."""


def walled(name: str = "world-tools", corner: float | None = None) -> Problem:
    """Return a reference problem with walls."""
    posed = reference(name)
    assert posed.worlds is not None
    return replace(posed, worlds=replace(posed.worlds, walls=True, corner=corner))


def test_a_problem_states_its_walls() -> None:
    """The statement reads back as the same problem; the digest knows walls and a stated corner, and nothing else."""
    first = problem({**WHEEL, "environment": {**BOX, "walls": True, "corner_hz": 100.0}}).problem
    assert first.worlds == Worlds(World(0.02, 0.0, 0.0), World(5.0, inf, 2000.0), True, 2 * pi * 100.0)
    again = problem(statement(first)).problem
    assert again.worlds == first.worlds
    assert first.in_units(10.0, 1e-3).worlds.corner == pytest.approx(2 * pi * 0.1)
    digests = [
        problem_digest(problem({**WHEEL, "environment": {**BOX, **walls}}).problem)
        for walls in ({}, {"walls": False}, {"walls": True}, {"walls": True, "corner_hz": 100.0})
    ]
    assert digests[0] == digests[1]
    assert len(set(digests)) == 3


def test_given_gains_have_the_corner_with_most_room() -> None:
    """Below it the condition fails, as with less of the coupling; the linear box is proved all the same."""
    best = judge(walled(), *STIFF)
    assert best.certificate.verdict is Verdict.PROVED
    assert best.corner == corner_of(walled(), *STIFF)
    assert best.in_walls.ratio > 1.05
    low = judge(walled(corner=2 * pi * 30.0), *STIFF)
    assert low.certificate.outcomes["worlds"].verdict is Verdict.PROVED
    assert low.certificate.outcomes["walls"].verdict is Verdict.REFUTED
    assert low.in_walls.ratio < 1.05


def test_nothing_is_claimed_of_walls_where_the_linear_box_is_not_proved() -> None:
    """The condition says nothing of a loop that is unstable without a wall."""
    K_v, K_p, b_c, m_c, b_0 = EXPECTED["world-tools"]["x"]
    outcomes = judge(walled(), Gains(K_v, min(K_p, 1e5)), Coupling(b_c, m_c, b_0)).certificate.outcomes
    assert outcomes["worlds"].verdict is Verdict.REFUTED
    assert outcomes["walls"].verdict is Verdict.UNDECIDED


@pytest.mark.advice
@pytest.mark.slow
def test_a_design_that_bears_springs_alone_may_do_without_walls() -> None:
    """The repair turns the walls off, and its line can be written into the file as it is."""
    tables = tomllib.loads((REFERENCE / "world-heavy-tools.toml").read_text())
    tables["environment"]["walls"] = True
    tables["gains"] = {"velocity": 167.34044, "position": 1e5}
    tables["coupling"] = {"damping": 0.73047156, "mass": 0.0023011791, "drag": 0.68781965}
    (change,) = (each for each in parameter_changes(tables, problem(tables).problem) if each.key == "environment.walls")
    (repair,) = find_repairs(tables, [change]).repairs
    assert tomllib.loads(repair.needs) == {"environment": {"walls": False}}
    assert str(repair) == "environment.walls = false instead of true"
    assert change.applied(tables, repair.new)["environment"]["walls"] is False


@pytest.mark.slow
def test_a_gains_file_states_the_corner(tmp_path: Path) -> None:
    """And a check is about that one: a low one fails where the best passes."""
    text = fixed("world-tools", 1.2, tmp_path).read_text().replace("max = 2000.0 }", "max = 2000.0 }\nwalls = true")
    wheel, gains = tmp_path / "wheel.toml", tmp_path / "gains.toml"
    wheel.write_text(text)
    stated = text[text.index("[gains]") : text.index("[transparency]")]
    gains.write_text(stated)
    passed = run("check", str(wheel), str(gains), cwd=tmp_path)
    assert passed.returncode == ExitCode.OK
    assert "walls among them" in passed.stdout
    gains.write_text(f"{stated}[design]\ncorner_hz = 20.0\n")
    failed = run("check", str(wheel), str(gains), "--time-limit", "5", cwd=tmp_path)
    assert failed.returncode == ExitCode.FAILED
    assert "one-sided or piecewise linear" in failed.stdout


@pytest.mark.slow
@pytest.mark.parametrize(("name", "most"), [("world-tools", 1.05), ("world-heavy-tools", 1.2)])
def test_a_search_meets_walls(name: str, most: float) -> None:
    """At little more error than the linear box: 5 % for tools from 20 g."""
    found = solve(walled(name)).judgement
    assert found.certificate.verdict is Verdict.PROVED
    assert list(found.certificate.outcomes) == ["sensitivity", "stable", "worlds", "walls"]
    assert found.error < most * solve(reference(name)).judgement.error


def test_the_schema_of_a_record_has_walls(tmp_path: Path) -> None:
    """A solved problem of fixed numbers says what is proved of walls, and with which corner."""
    text = fixed("world-tools", 1.2, tmp_path).read_text().replace("max = 2000.0 }", "max = 2000.0 }\nwalls = true")
    (tmp_path / "wheel.toml").write_text(text)
    shown = run("solve", "wheel.toml", "--no-report", "--out", "here", cwd=tmp_path)
    assert "every wall" in shown.stdout
    assert "corner_hz = " in next((tmp_path / "here").rglob("gains.toml")).read_text()
    assert REFERENCE.is_dir()
