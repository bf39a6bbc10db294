"""Benchmarks: their judges against closed forms, their rows and their seeds."""

from __future__ import annotations

import csv
from dataclasses import make_dataclass, replace
from math import exp, log, nan

import numpy as np
import pytest
from click.testing import CliRunner
from conftest import ROOT, for_passive_hands

from vctune.bench import evaluator, peers, solvers, stress
from vctune.bench.benchmark import Measured, csv_of, record_of
from vctune.bench.evaluator import case_of
from vctune.bench.solvers import reference_problems
from vctune.cli.commands.bench import bench
from vctune.design.judging.judge import Status, judge
from vctune.design.prepared import prepare
from vctune.design.search.scan import scan
from vctune.design.solve import solve
from vctune.design.variables import point, ranges
from vctune.document.reading import parse_problem, read_problem
from vctune.document.text.errors import InputError
from vctune.model.gains import Gains


@pytest.fixture(scope="module")
def wheel():
    return reference_problems()["friction-wheel"]


def test_violation_is_the_logarithm_of_what_is_missing(wheel):
    """Where Llewellyn's demand binds, asking for a tenth more misses it by log 1.1."""
    found = solve(wheel).judgement
    case = case_of(wheel.device, found.gains, found.coupling)
    assert evaluator.violation(wheel, case) == 0
    more = replace(wheel, stability=replace(wheel.stability, safety_factor=1.1 * found.min_ratio))
    assert evaluator.violation(more, case) == pytest.approx(log(1.1), rel=1e-6)


def test_worth_of_designs_good_and_bad(wheel):
    found = solve(wheel).judgement
    assert solvers.judged(wheel, found.gains, found.coupling) == (found.error, 0.0, Status.CERTIFIED, True)
    _, missed, verdict, consistent = solvers.judged(wheel, *lighter(found))
    assert verdict is Status.VIOLATED and missed > 0.01 and consistent
    assert solvers.judged(wheel, Gains(5000.0, 3000.0), found.coupling)[2] is Status.VIOLATED


def test_a_violation_in_hands_counts():
    problem = reference_problems("both", 2)["friction-wheel"]
    found = solve(problem).judgement
    assert solvers.judged(problem, found.gains, found.coupling)[1:] == (0.0, Status.CERTIFIED, True)
    _, missed, verdict, _ = solvers.judged(problem, *lighter(found))
    assert missed >= log(problem.stability.safety_factor / judge(problem, *lighter(found)).in_hand.ratio)
    assert missed > 0.01 and verdict is Status.VIOLATED


def lighter(found):
    """Return a design with less mass of its coupling."""
    return found.gains, replace(found.coupling, mass=0.9 * found.coupling.mass)


def test_stress_notices_a_wrong_certificate(wheel):
    found = solve(wheel).judgement
    assert stress.contradiction(wheel, found) == ""
    assert "violated" in stress.contradiction(wheel, replace(found, coupling=lighter(found)[1]))
    assert "pole" in stress.contradiction(wheel, replace(found, gains=Gains(5000.0, 3000.0)))
    strict = replace(wheel, stability=replace(wheel.stability, max_sensitivity=1.5))
    assert "violated" in stress.contradiction(strict, found)


def test_the_scan_finds_a_design_where_there_is_one(wheel):
    assert stress.feasible_design(wheel) is not None
    assert stress.feasible_design(read_problem(ROOT / "problems/infeasible.toml").problem) is None


def test_problems_are_those_of_the_files():
    for name, problem in reference_problems().items():
        places = [ROOT / f"problems/{name}.toml", ROOT / f"tests/reference/{name}.toml"]
        (path,) = [place for place in places if place.exists()]
        theirs = parse_problem(for_passive_hands(path.read_text()), name, name)
        assert replace(theirs, name="", description="", experiments=()) == replace(problem, name="", description="")


@pytest.mark.parametrize("criterion", solvers.CRITERIA)
def test_peers_get_the_problem(criterion):
    """On a grid the constraints hold at vctune's design, one binds, and the derivatives are those of the values."""
    problem = reference_problems(criterion, 1)["two-basins"]
    found, prepared = solve(problem).judgement, prepare(problem)
    grid = peers.on_grid(prepared, scan(prepared.scaled).starts[0], 300)
    x = prepared.units.to_dimensionless(point(found.gains, found.coupling))
    z = np.array([each.to_z(x[each.index]) for each in grid.free])
    assert grid.design(z) == (found.gains, found.coupling)
    log_error, slack = grid.values(z)
    assert prepared.units.error * exp(log_error) == pytest.approx(found.transparency.error, rel=1e-6)
    assert -1e-3 < slack.min() < 1e-3
    assert grid.judged(z) == (log_error, max(0.0, -slack.min()))
    slopes = grid.slopes(z)[1]
    for k, step in enumerate(1e-6 * np.eye(len(z))):
        difference = (grid.values(z + step)[1] - grid.values(z - step)[1]) / 2e-6
        np.testing.assert_allclose(slopes[:, k], difference, rtol=1e-4, atol=1e-5)


Cell = make_dataclass("Cell", ["name", "good", "value"], frozen=True)
CELLS = [Cell("a, b", True, 0.1), Cell("c", False, nan), Cell("d", True, float("inf"))]


def test_json_has_no_nan():
    made = record_of("cells", Measured("Cells", "", CELLS, ["three"], []), "here")
    assert [row["value"] for row in made["table"]] == [0.1, None, None]


def test_csv_has_no_nan(tmp_path):
    path = tmp_path / "cells.csv"
    path.write_text(csv_of(CELLS))
    assert rows_of(path) == [
        {"name": "a, b", "good": "yes", "value": "0.1"},
        {"name": "c", "good": "no", "value": ""},
        {"name": "d", "good": "yes", "value": "inf"},
    ]


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def run(name, folder):
    """Run a benchmark's command and return the rows of its table."""
    done = CliRunner().invoke(bench, [name, "--quick", "--out", str(folder)], standalone_mode=False)
    assert done.exception is None and done.return_value == 0
    assert (folder / f"{name}.svg").stat().st_size > 1000
    assert f"`vctune bench {name} --quick --seed 0`" in (folder / f"{name}.md").read_text()
    return rows_of(folder / f"{name}.csv")


@pytest.mark.night
def test_quick_solvers(tmp_path, monkeypatch):
    """Without evolution, which takes long."""
    monkeypatch.setattr(solvers, "PEERS", dict(list(solvers.PEERS.items())[:3]))
    rows = run("solvers", tmp_path)
    assert {*solvers.PEERS, solvers.OURS} == {row["solver"] for row in rows}
    assert all(row["consistent"] == row["succeeded"] == "yes" and row["late"] == "no" for row in rows)
    for criterion in solvers.CRITERIA:
        own = {row["solver"]: row for row in rows if row["criterion"] == criterion}
        assert min(float(row["gap"]) for row in own.values() if row["verdict"] == "certified") == 0
        ours, coarse, fine = own[solvers.OURS], own["IPOPT, 200 frequencies"], own["IPOPT, 2000 frequencies"]
        assert ours["verdict"] == "certified" and float(ours["gap"]) < 1e-4 and float(ours["violation"]) == 0
        assert coarse["verdict"] == "violated" and float(coarse["violation"]) > 1e-4 and float(coarse["gap"]) < 0
        assert fine["verdict"] == "certified" and float(fine["gap"]) < 1e-4


def test_evolution_stops_in_time(monkeypatch):
    monkeypatch.setattr(peers, "PATIENCE", 0.1)
    prepared = prepare(reference_problems("passive", 1)["two-basins"])
    grid = peers.on_grid(prepared, scan(prepared.scaled).starts[0], 30)
    answer, late = peers.best_answer([grid], peers.evolution)
    assert late and not answer.succeeded


@pytest.mark.slow
def test_quick_stress(tmp_path, monkeypatch):
    monkeypatch.setattr(stress, "QUICK", 12)
    rows = run("stress", tmp_path)
    assert [row["number"] for row in rows] == [str(number) for number in range(12)]
    assert not any(row["wrong"] for row in rows)
    assert stress.FAILED not in {row["status"] for row in rows}


def test_a_bad_folder_is_said(tmp_path):
    (tmp_path / "file").write_text("")
    done = CliRunner().invoke(bench, ["stress", "--out", str(tmp_path / "file" / "folder")], standalone_mode=False)
    assert isinstance(done.exception, InputError)


def test_random_starts_are_designs_of_the_problem():
    """Each is within the bounds, and from ten of them IPOPT reaches the design that vctune proves."""
    problem = reference_problems("passive", 1)["two-basins"]
    prepared, found = prepare(problem), solve(problem).judgement
    starts = peers.random_starts(prepared.scaled.problem, solvers.RANDOM_STARTS, seed=0)
    for start in starts:
        values = prepared.units.to_si(point(start.gains, start.coupling))
        for value, bounds in zip(values, ranges(problem), strict=True):
            assert bounds.min * (1 - 1e-9) <= value <= bounds.max * (1 + 1e-9)
    assert len({start.gains for start in starts}) == solvers.RANDOM_STARTS
    answer, _ = peers.best_answer([peers.on_grid(prepared, start, 300) for start in starts], peers.ipopt)
    assert judge(problem, *answer.design).error == pytest.approx(found.error, rel=1e-3)
