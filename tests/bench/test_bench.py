"""Benchmarks: their judges against closed forms, their rows and their seeds."""

from __future__ import annotations

import csv
from dataclasses import dataclass, replace
from math import log, nan, sqrt

import pytest
from click.testing import CliRunner
from conftest import ROOT, for_passive_hands

from vctune.bench import evaluator, peers, solvers, stress
from vctune.bench import solvers as judging
from vctune.bench.benchmark import Measured, csv_of, record_of
from vctune.bench.evaluator import case_of
from vctune.bench.problems import reference_problems
from vctune.cli.commands.bench import bench
from vctune.design.solve import solve
from vctune.design.verdict.judge import Status
from vctune.document.reading import parse_problem, read_problem
from vctune.document.text.errors import InputError
from vctune.model.gains import Coupling, Gains
from vctune.model.transparency import Terms


@pytest.fixture(scope="module")
def wheel():
    return reference_problems()["friction-wheel"]


# The independent evaluator


def test_error_of_the_bare_device(wheel):
    """With Z_0 |G_hh| alone and no loop the mean square is an elementary integral."""
    band, b, m = wheel.transparency.band, wheel.device.damping, wheel.device.mass
    alone = replace(wheel, transparency=replace(wheel.transparency, weights=Terms(1.0, 0.0, 0.0)))
    grown = [log(w * w / (b * b + (m * w) ** 2)) / (2 * b * b) for w in (band.min, band.max)]
    expected = wheel.transparency.reference_impedance * sqrt((grown[1] - grown[0]) / log(band.max / band.min))
    still = case_of(wheel.device, Gains(0.0, 0.0), Coupling(1.0, 1.0, 0.0))
    assert evaluator.error(alone, still) == pytest.approx(expected, rel=1e-9)


def test_violation_is_the_logarithm_of_what_is_missing(wheel):
    """Where Llewellyn's demand binds, asking for a tenth more misses it by log 1.1."""
    found = solve(wheel).judgement
    case = case_of(wheel.device, found.gains, found.coupling)
    assert evaluator.violation(wheel, case) == 0
    more = replace(wheel, stability=replace(wheel.stability, safety_factor=1.1 * found.min_ratio))
    assert evaluator.violation(more, case) == pytest.approx(log(1.1), rel=1e-6)


# Judges


def test_worth_of_designs_good_and_bad(wheel):
    found = solve(wheel).judgement
    good = judging.judge_answer(wheel, found.gains, found.coupling)
    assert (good.verdict, good.violation, good.stable, good.consistent) == (Status.CERTIFIED, 0.0, True, True)
    lighter = replace(found.coupling, mass=0.9 * found.coupling.mass)
    bad = judging.judge_answer(wheel, found.gains, lighter)
    assert bad.verdict is Status.VIOLATED and bad.violation > 0.01 and bad.consistent
    wild = judging.judge_answer(wheel, Gains(5000.0, 3000.0), found.coupling)
    assert not wild.stable and wild.verdict is Status.VIOLATED


def test_stress_notices_a_wrong_certificate(wheel):
    found = solve(wheel).judgement
    assert stress.contradiction(wheel, found)[0] == ""
    lighter = replace(found, coupling=replace(found.coupling, mass=0.9 * found.coupling.mass))
    assert "Re Z_c/R" in stress.contradiction(wheel, lighter)[0]
    loud = replace(found, gains=Gains(5000.0, 3000.0))
    assert "pole" in stress.contradiction(wheel, loud)[0]
    strict = replace(wheel, stability=replace(wheel.stability, max_sensitivity=1.5))
    assert "|S| is" in stress.contradiction(strict, found)[0]


def test_the_scan_finds_a_design_where_there_is_one(wheel):
    assert stress.feasible_design(wheel) is not None
    assert stress.feasible_design(read_problem(ROOT / "problems/infeasible.toml").problem) is None


# What the peers get


def test_problems_are_those_of_the_files():
    for name, problem in reference_problems().items():
        places = [ROOT / f"problems/{name}.toml", ROOT / f"tests/reference/{name}.toml"]
        (path,) = [place for place in places if place.exists()]
        theirs = parse_problem(for_passive_hands(path.read_text()), name, name)
        assert replace(theirs, name="", description="", experiments=()) == replace(problem, name="", description="")


def test_missing_peers_are_an_input_error(monkeypatch):
    monkeypatch.setattr(peers, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"needs mpmath, .*pip install mpmath"):
        peers.need("mpmath")


# Rows


@dataclass(frozen=True)
class Cell:
    name: str
    good: bool
    value: float


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


@pytest.mark.slow
def test_quick_solvers(tmp_path, monkeypatch):
    """With the coarsest grid and a multi-start on a quarter of its frequencies: the dense ones take long to compile."""
    multistart, *_ = solvers.PEERS
    fewer = [replace(multistart, count=solvers.GRID // 4, reserve=16 * solvers.CONSTRAINT_RESERVE)]
    coarsest = [peer for peer in solvers.PEERS if peer.count == min(solvers.COARSE_GRIDS)]
    monkeypatch.setattr(solvers, "PEERS", fewer + coarsest)
    rows = run("solvers", tmp_path)
    assert {peer.name for peer in solvers.PEERS} | {solvers.OURS} == {row["solver"] for row in rows}
    assert all(row["consistent"] == "yes" for row in rows)
    proved = [float(row["gap"]) for row in rows if row["verdict"] == "certified"]
    assert min(proved) == 0
    by_name = {row["solver"]: row for row in rows}
    assert by_name[solvers.OURS]["verdict"] == by_name[solvers.MULTISTART]["verdict"] == "certified"
    assert float(by_name[solvers.OURS]["gap"]) < 1e-4
    assert float(by_name[solvers.OURS]["violation"]) == 0
    coarse = by_name[f"{solvers.IPOPT}{min(solvers.COARSE_GRIDS)} frequencies"]
    assert coarse["succeeded"] == "yes" and coarse["verdict"] == "violated" and float(coarse["violation"]) > 0.01


@pytest.mark.slow
def test_quick_stress(tmp_path, monkeypatch):
    monkeypatch.setattr(stress, "QUICK", 12)
    rows = run("stress", tmp_path)
    assert [row["number"] for row in rows] == [str(number) for number in range(12)]
    assert not any(row["wrong"] for row in rows)
    assert stress.FAILED not in {row["status"] for row in rows}
    assert max(float(row["float_error"] or 0) for row in rows) < 1e-12


def test_a_bad_folder_is_said(tmp_path):
    (tmp_path / "file").write_text("")
    done = CliRunner().invoke(bench, ["stress", "--out", str(tmp_path / "file" / "folder")], standalone_mode=False)
    assert isinstance(done.exception, InputError)
