"""The folder of a design: it is of one problem file, and nothing in it passes for a part of another design."""

from __future__ import annotations

import json
import shutil
import tomllib

import pytest
from command import run
from conftest import DEVICE, FIXED, for_passive_hands

import vctune
from vctune.exit_codes import ExitCode

EXPERIMENT = '[[experiment]]\nname = "free"\noperator = { to = 0.005, cycles = 1, motion = "sine" }\n'
TEXT = for_passive_hands(DEVICE + FIXED.format(160.0) + EXPERIMENT)
DESIGN = "results/device/design.json"
EDITED = TEXT.replace("160.0", "170.0")
FREE = for_passive_hands(DEVICE + EXPERIMENT)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Where a/device.toml was solved, exported and simulated, once."""
    place = tmp_path_factory.mktemp("made")
    for name in ("a", "b"):
        (place / name).mkdir()
    (place / "a/device.toml").write_text(TEXT)
    for command, given in (("solve", "a/device.toml"), ("export", DESIGN), ("simulate", "a/device.toml")):
        assert run(command, given, cwd=place).returncode == ExitCode.OK
    return place


@pytest.fixture
def solved(made, tmp_path):
    """The folder of its design, in a copy of that place."""
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    return tmp_path / "results/device"


def damping(folder):
    return json.loads((folder / "design.json").read_text())["coupling"]["damping"]


@pytest.mark.parametrize(
    ("command", "text", "more"),
    [
        ("solve", FREE, []),
        ("simulate", FREE, ["mine.toml"]),
        ("export", EDITED, []),
        ("region", FREE, []),
        ("bound", FREE, []),
    ],
    ids=lambda given: given if isinstance(given, str) and given.isalpha() else "",
)
def test_another_file_of_the_same_name_is_refused(solved, tmp_path, command, text, more):
    (tmp_path / "b/device.toml").write_text(text)
    (tmp_path / "mine.toml").write_text(FIXED.format(170.0))
    before = {path: path.read_bytes() for path in solved.rglob("*") if path.is_file()}
    done = run(command, "b/device.toml", *more, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (ExitCode.BAD_INPUT, "")
    for part in ("[folder-in-use]", "a/device.toml", "b/device.toml", "--out"):
        assert part in done.stderr
    assert before == {path: path.read_bytes() for path in solved.rglob("*") if path.is_file()}


def test_each_remedy_of_the_refusal_works(solved, tmp_path):
    other = tmp_path / "b/device.toml"
    other.write_text(EDITED)
    assert run("solve", other, cwd=tmp_path).returncode == ExitCode.BAD_INPUT
    assert run("solve", other, "--out", "elsewhere", cwd=tmp_path).returncode == ExitCode.OK
    other.write_text('name = "other"\n' + EDITED)
    assert run("solve", other, cwd=tmp_path).returncode == ExitCode.OK
    assert (damping(solved), damping(tmp_path / "results/other")) == (160.0, 170.0)


def test_the_same_file_is_known_however_it_is_called_and_wherever_the_tree_lies(solved, tmp_path):
    calls = ((tmp_path, tmp_path / "a/device.toml", "results"), (tmp_path / "b", "../a/device.toml", "../results"))
    for number, (place, called, out) in enumerate(calls):
        (tmp_path / "a/device.toml").write_text(EDITED.replace("170.0", f"{171 + number}.0"))
        assert run("solve", called, "--out", out, cwd=place).returncode == ExitCode.OK
        assert damping(solved) == 171 + number
    shutil.copytree(tmp_path / "a", tmp_path / "moved/a")
    shutil.copytree(tmp_path / "results", tmp_path / "moved/results")
    (tmp_path / "moved/a/device.toml").write_text(EDITED)
    assert run("solve", "a/device.toml", cwd=tmp_path / "moved").returncode == ExitCode.OK
    assert (tmp_path / "moved/results/device/problem-file.txt").read_text() == "../../a/device.toml\n"


def test_the_same_problem_in_another_file_loses_nothing_and_is_solved(solved, tmp_path):
    (tmp_path / "b/device.toml").write_text(f"# the same\n{TEXT}")
    assert run("solve", "b/device.toml", cwd=tmp_path).returncode == ExitCode.OK
    assert (solved / "firmware/vctune_controller.c").exists()
    (tmp_path / "b/device.toml").write_text(EDITED)
    assert run("solve", "b/device.toml", cwd=tmp_path).returncode == ExitCode.OK  # whose folder it is now


def test_what_is_of_an_earlier_design_is_renamed_and_the_same_design_leaves_it(solved, tmp_path):
    """Firmware, simulation and region of an edited problem; a second edit replaces what was set aside by the first."""
    names = ("firmware", "simulation.json", "traces.npz", "region.json")
    kept = ("firmware.previous", "simulation.previous.json", "traces.previous.npz", "region.previous.json")
    (solved / "region.json").write_text("first")
    assert run("solve", "a/device.toml", cwd=tmp_path).stderr == ""
    assert all((solved / name).exists() for name in names)
    for text, region in ((EDITED, "first"), (TEXT, "second")):
        (tmp_path / "a/device.toml").write_text(text)
        edited = run("solve", "a/device.toml", cwd=tmp_path)
        assert edited.returncode == ExitCode.OK
        for name, renamed in zip(names, kept, strict=True):
            assert f"results/device/{name}: of an earlier design, renamed to {renamed}" in edited.stderr
            assert (solved / renamed).exists() and not (solved / name).exists()
        assert (solved / "region.previous.json").read_text() == region
        for renamed, name in zip(kept, names, strict=True):
            (solved / renamed).rename(solved / name) if name != "region.json" else (solved / name).write_text("second")


def test_a_problem_without_a_file_works_again_and_again_but_not_over_one_with_a_file(solved, tmp_path):
    for b_c in (160.0, 170.0):
        tables = tomllib.loads(TEXT.replace("160.0", f"{b_c}")) | {"name": "device"}
        found = vctune.solve(tables)
        assert damping(vctune.write_design(tables, found, tmp_path / "notebook").parent) == b_c
    with pytest.raises(vctune.InputError, match=r"a/device\.toml.*folder-in-use"):
        vctune.write_design(tables, found, solved)
    assert damping(solved) == 160.0
