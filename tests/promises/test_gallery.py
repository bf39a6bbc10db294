"""results/ is what the code says today: numbers are compared, not bytes or seconds."""

from __future__ import annotations

import csv
import json
import subprocess
import tomllib
from functools import cache
from math import inf
from pathlib import Path
from xml.etree import ElementTree

import pytest
from conftest import PROBLEM_FILES, ROOT, mostly_slow
from hand_scan import least_ratio_in_hands
from test_solve import assert_admissible_by_the_oracles, recomputed

from vctune.design.solve import solve
from vctune.design.verdict.judge import Status
from vctune.document.reading import read_problem
from vctune.document.records.design_file import read_design
from vctune.document.records.region_json import read_region
from vctune.document.records.simulation_json import simulation_beside
from vctune.document.study_file import read_study
from vctune.simulation.two_runs import simulate
from vctune.study.plane import plane
from vctune.study.points import points
from vctune.study.region import Kind, region
from vctune.study.region_check import recheck

PROBLEMS = sorted((ROOT / "problems").glob("*.toml"))
QUICK = [ROOT / "problems" / f"{name}.toml" for name in ("delta-4khz", "fixed-gains", "friction-wheel")]
"""Problems that are solved each time."""
STUDIES = sorted((ROOT / "problems" / "studies").glob("*.toml"))
PAGES = (
    "cobot-wrist-real", "desktop-arm", "flexible-handle",
    "friction-wheel", "friction-wheel-hands",
)  # fmt: skip
"""Designs whose page is kept, as .gitignore has it: all of them would be more than `MOST_BYTES`."""
MOST_BYTES = 4_000_000
SPARSE = 10
"""Every tenth point of a study is solved again."""


@cache
def solved_problem(path):
    return solve(read_problem(path).problem)


def stem(path):
    return path.stem


@pytest.mark.parametrize("path", mostly_slow(PROBLEM_FILES, QUICK), ids=stem)
def test_every_problem_is_solved_and_admissible_by_the_oracles(path):
    solved = solved_problem(path)
    problem, judgement = solved.problem, solved.judgement
    expected = Status.INFEASIBLE if path.stem in ("infeasible", "unstable-bounds") else Status.CERTIFIED
    assert solved.status is expected
    assert tomllib.loads(path.read_text())["name"] == path.stem
    if judgement is None:
        return
    if problem.hands_met is not None:
        ratio, S = least_ratio_in_hands(path, problem, judgement)
        assert ratio >= 1.05 * (1 - 1e-9) and S <= 2 * (1 + 1e-9)
    if problem.passive and not problem.device.ideal:
        assert_admissible_by_the_oracles(problem, judgement)
    elif problem.passive and problem.stability.band.max < inf:
        ratio, S, error, radius = recomputed(problem, judgement.gains, judgement.coupling)
        assert ratio >= (1.0 if path.stem == "fixed-gains" else 1.05) * (1 - 1e-9)
        assert S <= 2 * (1 + 1e-9)
        assert radius < 1
        assert judgement.transparency.error == pytest.approx(error, rel=1e-5)


@pytest.mark.parametrize("path", PROBLEMS, ids=stem)
def test_gallery_is_of_the_problems(path):
    folder = ROOT / "results" / path.stem
    record = json.loads((folder / "design.json").read_text())
    assert record["problem"]["text"] == path.read_text()
    assert record["problem"]["sha256"] == read_problem(path).sha256
    if path.stem in PAGES:
        assert record["problem"]["sha256"] in (folder / "report.html").read_text()


@pytest.mark.parametrize("path", mostly_slow(PROBLEMS, QUICK), ids=stem)
def test_gallery_is_as_new_as_the_code(path):
    record = json.loads((ROOT / "results" / path.stem / "design.json").read_text())
    solved = solved_problem(path)
    assert record["status"] == solved.status.value
    optimal = solved.status is Status.CERTIFIED and not solved.problem.bounds.fixed
    assert bool(record.get("prices")) == optimal
    if solved.judgement is not None:
        assert record["transparency"]["error"] == pytest.approx(solved.judgement.transparency.error, rel=1e-5)
        assert record["gains"]["velocity"] == pytest.approx(solved.judgement.gains.velocity, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("path", PROBLEMS, ids=stem)
def test_simulations_are_as_new_as_the_code(path):
    file, folder = read_problem(path), ROOT / "results" / path.stem
    assert (folder / "simulation.json").exists() == bool(file.problem.experiments)
    if not file.problem.experiments:
        return
    record = read_design(folder / "design.json")
    stored, (gains, coupling) = simulation_beside(folder, record), record.design
    for here, there in zip(file.problem.experiments, stored.experiments, strict=True):
        made = simulate(file.problem, gains, coupling, here)
        for run, measured in ((made.design, there.design.metrics), (made.baseline, there.baseline.metrics)):
            assert measured.peak_force == pytest.approx(run.metrics.peak_force, rel=1e-3)
            assert measured.residual == pytest.approx(run.metrics.residual, rel=1e-2)


@pytest.mark.slow
def test_the_region_is_as_new_as_the_code():
    path = ROOT / "problems/friction-wheel.toml"
    problem, record = read_problem(path).problem, json.loads((ROOT / "results/friction-wheel/region.json").read_text())
    across = plane(problem, "gains.velocity", "gains.position", 8)
    made = region(problem, across, across.coarsest_squares())
    assert record["problem"]["text"] == path.read_text()
    assert record["edges"]["x"] == pytest.approx(across.edges[0].tolist())
    assert record["edges"]["y"] == pytest.approx(across.edges[1].tolist())
    for kind in Kind:
        assert record["areas"][kind.name.lower()] == pytest.approx(made.area(kind), abs=1e-4)
    again = recheck(problem, read_region(ROOT / "results/friction-wheel/region.json"))
    assert not again.lost and len(again.certified) == 1


def tracked() -> list[Path]:
    listed = subprocess.run(["git", "ls-files", "-z", "results"], cwd=ROOT, capture_output=True, text=True, check=True)
    return [ROOT / name for name in listed.stdout.split("\0") if name]


def test_results_are_small():
    assert sum(path.stat().st_size for path in tracked()) <= MOST_BYTES


def test_pictures_are_xml():
    """A browser that reads a picture as a file of its own stops at the first mistake."""
    pictures = [path for path in tracked() if path.suffix == ".svg"]
    assert len(pictures) > 20
    for path in pictures:
        ElementTree.parse(path)


def test_gallery_holds_nothing_else():
    folders = {path.name for path in (ROOT / "results").iterdir() if path.is_dir()}
    assert folders == {"bench", *(path.stem for path in (*PROBLEMS, *STUDIES))}


@pytest.mark.slow
@pytest.mark.parametrize("path", STUDIES, ids=stem)
def test_studies_are_as_new_as_the_code(path):
    study = read_study(path)
    with (ROOT / "results" / path.stem / "table.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    axes = list(rows[0])[: len(study.axes)]
    assert [name.partition(" [")[0] for name in axes] == [axis.key for axis in study.axes]
    assert [tuple(float(row[name]) for name in axes) for row in rows] == list(points(study))
    for row, values in list(zip(rows, points(study), strict=True))[::SPARSE]:
        solved = solve(study.at(values)[0])
        assert row["status"] == solved.status.value
        assert float(row["error"]) == pytest.approx(solved.judgement.transparency.error, rel=1e-5)
