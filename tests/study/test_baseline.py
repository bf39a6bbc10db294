"""The region's file and `vctune check --region`: what was proved once, held against the problem of today."""

from __future__ import annotations

import json
import shutil
import signal
import tomllib

import numpy as np
import pytest
from command import run, strict, strike
from conftest import DEVICE, FIXED, ROOT, for_passive_hands
from test_region import B_0, B_C, K_P, K_V, M_C, found

from vctune import region
from vctune.document.records.region_json import read_region
from vctune.exit_codes import ExitCode
from vctune.study.region import Kind
from vctune.study.region_check import RegionFinding

PLAIN = DEVICE + "[coupling]\ndamping = { min = 10.0, max = 3000.0 }\nmass = { min = 0.05, max = 4.0 }\n"


@pytest.fixture(scope="module")
def baseline(tmp_path_factory):
    """A folder with a problem and its region at 1/32."""
    folder = tmp_path_factory.mktemp("baseline")
    (folder / "device.toml").write_text(for_passive_hands(PLAIN))
    done = run("region", "device.toml", "--resolution", "0.03125", cwd=folder)
    assert done.returncode == ExitCode.OK and done.stderr == ""
    assert done.stdout.splitlines()[0].startswith("feasible ")
    return folder


def record_of(folder):
    return strict((folder / "results/device/region.json").read_text())


@pytest.mark.slow
def test_the_file_holds_the_region(baseline):
    record = record_of(baseline)
    written = {path.name for path in (baseline / "results/device").iterdir()}
    assert written == {"region.json", "region.svg"}
    assert record["problem"]["text"] == for_passive_hands(PLAIN)
    assert record["axes"] == {"x": K_V, "y": K_P}
    assert record["others"] == {B_C: {"min": 10.0, "max": 3000.0}, M_C: {"min": 0.05, "max": 4.0}, B_0: 0.0}
    assert sum(record["areas"].values()) == pytest.approx(1)
    again = found(PLAIN, K_V, K_P, 5)
    assert record["edges"] == {"x": again.plane.edges[0].tolist(), "y": again.plane.edges[1].tolist()}
    assert [cell[:4] for cell in record["cells"]] == again.squares.T.tolist()
    assert [cell[4] for cell in record["cells"]] == [Kind(kind).name.lower() for kind in again.kinds]
    for *_, verdict, b_c in record["cells"]:
        assert (b_c is not None and 10 <= b_c <= 3000) == (verdict == "feasible")
    assert len(record["designs"]) == 1


def test_the_region_of_a_device_as_heavy_as_a_file_may_say_is_a_baseline(tmp_path):
    (tmp_path / "device.toml").write_text(
        for_passive_hands("[device]\nmass = 1e19\ndamping = 0.0\nsample_time = 1e-3\n[coupling]\nmass = 1e19\n")
    )
    assert run("region", "device.toml", "--resolution", "0.125", cwd=tmp_path).returncode == ExitCode.OK
    done = run("check", "device.toml", "--region", "results/device/region.json", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (ExitCode.OK, "")


def test_what_is_read_is_written_again_to_the_byte(baseline):
    for path in (baseline / "results/device/region.json", ROOT / "results/friction-wheel/region.json"):
        assert json.dumps(read_region(path).to_json(), allow_nan=False) + "\n" == path.read_text()


@pytest.mark.parametrize(
    ("tables", "expected"),
    [
        ("[stability]\nmax_sensitivity = 1.15\n", ExitCode.OK),
        ("[gains]\nvelocity = { min = 2e3, max = 3e3 }\n", ExitCode.FAILED),
        (PLAIN.removeprefix(DEVICE) + "[stability]\nsafety_factor = 1e8\n", ExitCode.UNDECIDED),
    ],
    ids=["a design, no cell", "neither", "not known"],
)
def test_a_coarse_region_is_not_said_to_be_empty(tmp_path, monkeypatch, tables, expected):
    """The exit code tells what is known of the problem: a design, a proof that there is none, or neither."""
    if expected is ExitCode.UNDECIDED:
        monkeypatch.setattr("vctune.design.solve.EARLY_BOXES", -1)
        monkeypatch.setattr("vctune.design.solve.SEARCH_BOXES", -1)
    (tmp_path / "device.toml").write_text(for_passive_hands(DEVICE + tables))
    code, out, _ = run("region", "device.toml", "--resolution", "0.125", cwd=tmp_path)
    assert "feasible      0.00 %" in out
    assert code == expected
    checked = run("check", "device.toml", "--region", "results/device/region.json", "--strict", cwd=tmp_path)
    assert len(record_of(tmp_path)["designs"]) == (expected is ExitCode.OK)
    empty = expected is not ExitCode.OK  # nothing is proved again, and the check says so
    assert (checked[0] == ExitCode.FAILED, "[nothing-proved]" in checked[1]) == (empty, empty)


def test_the_same_problem_passes(baseline):
    region_file = "results/device/region.json"
    code, out, err = run("check", "device.toml", "--region", region_file, cwd=baseline)
    assert (code, err) == (ExitCode.OK, "")
    area = record_of(baseline)["areas"]["feasible"]
    assert out.startswith(f"passed     device.toml: proved again: {100 * area:.4g} % of the plane")
    assert not (baseline / "results/device/lost.json").exists()


@pytest.mark.parametrize("style", ["text", "json", "github"])
def test_a_worse_device_loses_cells(baseline, tmp_path, style):
    (tmp_path / "device.toml").write_text(for_passive_hands(PLAIN.replace("[coupling]", "delay = 2e-4\n[coupling]")))
    arguments = ("check", "device.toml", "--region", baseline / "results/device/region.json", "--format", style)
    code, out, err = run(*arguments, cwd=tmp_path)
    assert code == ExitCode.FAILED
    assert err == "the lost cells and gain sets are listed and drawn in results/device: lost.json, lost.svg\n"
    assert ("device.toml" in out or style == "json") and "lost" in out
    lost = json.loads((tmp_path / "results/device/lost.json").read_text())
    assert lost["status"] == "lost" and len(lost["lost_designs"]) == 1
    assert lost["areas"]["kept"] + lost["areas"]["lost"] == pytest.approx(record_of(baseline)["areas"]["feasible"])
    assert all(a <= b and c <= d for a, b, c, d in lost["lost_cells"]) and lost["lost_cells"]
    assert {path.name for path in (tmp_path / "results/device").iterdir()} == {"lost.json", "lost.svg"}
    if style == "json":
        assert json.loads(out) == [lost]


def test_a_greater_factor_loses_cells_and_wider_bounds_keep_them(baseline, tmp_path):
    region_file = baseline / "results/device/region.json"
    for text, expected in (
        (PLAIN.replace("max = 4.0", "max = 5.0"), ExitCode.OK),
        (PLAIN + "[stability]\nmax_sensitivity = 2.5\n", ExitCode.OK),
        (PLAIN + "[stability]\nsafety_factor = 1.5\n", ExitCode.FAILED),
    ):
        (tmp_path / "device.toml").write_text(for_passive_hands(text))
        code, out, _ = run("check", "device.toml", "--region", region_file, cwd=tmp_path)
        assert (code, "another version of the problem" in out) == (expected, True)
        left = {path.name for path in (tmp_path / "results").rglob("lost.*")}
        assert left == (set() if code == ExitCode.OK else {"lost.json", "lost.svg"})


def test_a_listed_gain_set_below_the_safety_factor_is_lost(baseline, tmp_path):
    """Its ratio is 1.05, which a factor of 1.06 refuses; what a later check has not lost is removed again."""
    region_file = baseline / "results/device/region.json"
    (tmp_path / "device.toml").write_text(for_passive_hands(PLAIN + "[stability]\nsafety_factor = 1.06\n"))
    code, out, _ = run("check", "device.toml", "--region", region_file, cwd=tmp_path)
    assert code == ExitCode.FAILED and "lost their proof: 1 of 1 listed gain sets" in out
    assert len(json.loads((tmp_path / "results/device/lost.json").read_text())["lost_designs"]) == 1
    (tmp_path / "device.toml").write_text(for_passive_hands("# mended\n" + PLAIN))
    (tmp_path / "results/device/gains.toml").write_text("of somebody else")
    code, out, err = run("check", "device.toml", "--region", region_file, cwd=tmp_path)
    assert code == ExitCode.OK and "another version" not in out
    assert err == "everything is proved again: removed lost.json, lost.svg from results/device\n"
    assert [path.name for path in (tmp_path / "results/device").iterdir()] == ["gains.toml"]


def test_strict_fails_for_another_version_of_the_problem(baseline, tmp_path):
    arguments = ("check", "device.toml", "--region", baseline / "results/device/region.json", "--format", "github")
    for text, expected in (("# a remark\n" + PLAIN, ExitCode.OK), (PLAIN.replace("4.0", "5.0"), ExitCode.FAILED)):
        (tmp_path / "device.toml").write_text(for_passive_hands(text))
        assert run(*arguments, cwd=tmp_path)[0] == ExitCode.OK
        code, out, _ = run(*arguments, "--strict", cwd=tmp_path)
        assert code == expected and ("::error" in out) == (expected is ExitCode.FAILED)


def test_a_listed_gain_set_that_fails_is_lost(baseline, tmp_path):
    record = record_of(baseline)
    del record["sha256"]  # as in a file of an earlier version
    record["designs"].append(
        {"gains": {"velocity": 1.0, "position": 5e4}, "coupling": {"damping": 1.0, "mass": 1.0, "drag": 0.0}}
    )
    (tmp_path / "region.json").write_text(json.dumps(record))
    (tmp_path / "device.toml").write_text(for_passive_hands(PLAIN))
    code, out, _ = run("check", "device.toml", "--region", "region.json", cwd=tmp_path)
    assert code == ExitCode.FAILED
    assert "lost their proof: 1 of 2 listed gain sets" in out
    (gone,) = json.loads((tmp_path / "results/device/lost.json").read_text())["lost_designs"]
    assert gone == {K_V: 1.0, K_P: 5e4, B_C: 1.0, M_C: 1.0, B_0: 0.0}


def test_a_baseline_of_another_plane_is_refused(baseline, tmp_path):
    (tmp_path / "device.toml").write_text(for_passive_hands(PLAIN + "[gains]\nposition = 6000.0\n"))
    region_file = baseline / "results/device/region.json"
    code, out, err = run("check", "device.toml", "--region", region_file, cwd=tmp_path)
    assert (code, err) == (ExitCode.BAD_INPUT, "")
    assert "device.toml: gains.position: is fixed at 6000 and spans no plane" in out


def damaged(change):
    def broken(record):
        change(record)
        return json.dumps(record)

    return broken


DAMAGE = {
    "cut off": (lambda record: json.dumps(record)[:1000], "is not JSON"),
    "a list": (lambda record: "[]", "schema: is not vctune/region/1"),
    "a design": (lambda record: '{"schema": "vctune/design/1"}', "schema: is not vctune/region/1"),
    "nan": (lambda record: json.dumps(record).replace(str(record["edges"]["x"][1]), "NaN"), "is no finite number"),
    "no cells": (damaged(lambda record: record.pop("cells")), "cells: Field required"),
    "axis": (damaged(lambda record: record["axes"].update(x="gains.speed")), "axes.x: Input should be"),
    "edges": (damaged(lambda record: record["edges"]["x"].reverse()), "the edges of x do not rise"),
    "fewer edges": (damaged(lambda record: record["edges"]["x"].pop()), "32 edges of x and 33 of y"),
    "outside": (damaged(lambda record: record["cells"][3].__setitem__(1, 33)), "cell 3 does not lie on the edges"),
    "negative": (damaged(lambda record: record["cells"][3].__setitem__(0, -1)), "cells[3][0]"),
    "verdict": (damaged(lambda record: record["cells"][3].__setitem__(4, "fine")), "cells[3][4]"),
    "gain": (damaged(lambda record: record["designs"][0]["gains"].update(velocity=-1.0)), "designs[0].gains.velocity"),
    "other gain": (
        damaged(lambda record: record["designs"][0]["gains"].update(velocity=9.0)),
        "sha256: does not belong",
    ),
    "other text": (damaged(lambda record: record["problem"].update(text=PLAIN)), "problem.sha256: does not belong"),
    "other digest": (damaged(lambda record: record.update(sha256="0" * 64)), "sha256: does not belong to the rest"),
    "slip": (damaged(lambda record: record["designs"][0]["coupling"].update(drga=1.0)), "designs[0].coupling.drga"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damaged_baselines_are_refused(baseline, tmp_path, name):
    break_it, message = DAMAGE[name]
    (tmp_path / "device.toml").write_text(for_passive_hands(PLAIN))
    (tmp_path / "region.json").write_text(break_it(record_of(baseline)))
    code, out, err = run("check", "device.toml", "--region", "region.json", cwd=tmp_path)
    assert (code, err) == (ExitCode.BAD_INPUT, "")
    assert out.startswith("bad input  region.json: ") and message in out


def test_a_damaged_region_is_one_annotation_and_the_gains_beside_it_are_checked(tmp_path):
    (tmp_path / "device.toml").write_text(for_passive_hands(DEVICE))
    (tmp_path / "gains.toml").write_text(FIXED.format(160.0))
    (tmp_path / "region.json").write_text("{")
    command = ("check", "device.toml", "gains.toml", "--region", "region.json", "--format", "github")
    code, out, _ = run(*command, cwd=tmp_path)
    assert code == ExitCode.BAD_INPUT and out.count("::error") == 1
    assert "::error file=region.json," in out and "::notice file=gains.toml," in out


@pytest.fixture
def interrupted(baseline, tmp_path, monkeypatch):
    """The folder of a region at 1/32 that was interrupted in the midst of its cells."""
    shutil.copy(baseline / "device.toml", tmp_path)
    strike(monkeypatch, 3000, signal.SIGTERM)
    done = run("region", "device.toml", "--resolution", "0.03125", cwd=tmp_path)
    assert done.returncode == ExitCode.UNDECIDED and "[interrupted]" in done.stderr
    assert "%  interrupted: the search did not examine the whole plane\n" in done.stdout
    monkeypatch.undo()
    return tmp_path


def finest(record):
    """The verdict on each of the finest cells, and on those of the line K_p = 0, by their lower edges."""
    return {
        ("line" if y_low == y_high else "plane", i, j): verdict
        for x_low, x_high, y_low, y_high, verdict, _ in record["cells"]
        for i in range(x_low, x_high)
        for j in range(y_low, max(y_high, y_low + 1))
    }


def test_an_interrupted_region_holds_what_was_decided(baseline, interrupted):
    """Each cell that is decided is as in the whole region, and all others are undecided: they tile the plane."""
    part, whole = record_of(interrupted), record_of(baseline)
    assert part["interrupted"] is True and "interrupted" not in whole
    kinds, all_kinds = finest(part), finest(whole)
    assert kinds.keys() == all_kinds.keys()
    decided = {place: kind for place, kind in kinds.items() if kind != "undecided"}
    assert decided.items() <= all_kinds.items() and set(decided.values()) == {"feasible", "infeasible"}
    for kind, share in part["areas"].items():
        cells = [place for place, found in kinds.items() if found == kind and place[0] == "plane"]
        assert share == pytest.approx(len(cells) / 32**2)
    assert 0 < whole["areas"]["undecided"] < part["areas"]["undecided"] < 1
    assert part["designs"] == whole["designs"]
    assert (
        "interrupted: some undecided cells were not examined" in (interrupted / "results/device/region.svg").read_text()
    )
    left = {path.name for path in (interrupted / "results/device").iterdir()}
    assert left == {"region.json", "region.svg"}


def test_an_interrupted_region_is_a_baseline_of_what_it_has(interrupted):
    region_file = "results/device/region.json"
    done = run("check", "device.toml", "--region", region_file, "--strict", cwd=interrupted)
    area = record_of(interrupted)["areas"]["feasible"]
    assert (done.returncode, done.stderr) == (ExitCode.OK, "")
    assert f"proved again: {100 * area:.4g} % of the plane and the listed gain sets, 1" in done.stdout
    (interrupted / "device.toml").write_text(for_passive_hands(PLAIN.replace("mass = 0.4", "mass = 0.6", 1)))
    assert run("check", "device.toml", "--region", region_file, cwd=interrupted).returncode == ExitCode.FAILED


def test_two_interrupts_leave_nothing(baseline, tmp_path, monkeypatch):
    strike(monkeypatch, 3, signal.SIGINT, signal.SIGINT)
    shutil.copy(baseline / "device.toml", tmp_path)
    with pytest.raises(KeyboardInterrupt):  # of which `vctune.cli.run` makes exit code 130
        run("region", "device.toml", "--resolution", "0.03125", cwd=tmp_path)
    assert not [*(tmp_path / "results/device").iterdir()]


def test_lost_cells_are_listed_by_their_edges() -> None:
    """Each once, and together, in shares of the plane, the area that is lost."""
    ranges = "[gains]\nvelocity = { min = 1.0, max = 200.0 }\nposition = { min = 0.0, max = 2e5 }\n"
    text = for_passive_hands(DEVICE + ranges + "[coupling]\ndamping = 160.0\nmass = 0.35\n")
    mapped = region(tomllib.loads(text), resolution=0.125)
    lost = RegionFinding(mapped.file, mapped.region, [], [], False, []).record()
    (x, y), cells = mapped.region.plane.edges, np.array(lost["lost_cells"])
    assert len(np.unique(cells, axis=0)) == len(cells) > 8
    wide, high = (np.diff(np.searchsorted(*each)) for each in ((x, cells[:, :2]), (y, cells[:, 2:])))
    assert (wide * high).sum() / mapped.region.plane.side**2 == pytest.approx(lost["areas"]["lost"], rel=1e-12)
