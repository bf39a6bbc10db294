"""The wheel and the sdist, as their users get them: whole, and tested from an empty environment."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from email import message_from_string
from pathlib import Path

import pytest
from conftest import ROOT

from vctune.document.reading import parse_problem
from vctune.document.text.json import problem_digest
from vctune.version import __version__

pytestmark = pytest.mark.slow
ALONE = [
    "tests/document/test_hints.py", "tests/document/test_kinds.py", "tests/promises/test_witness.py",
]  # fmt: skip
"""Fast tests that need nothing but pytest and hypothesis."""
BUILT = ("__pycache__", ".egg-info")


def ran(*command, cwd):
    """Run a command and return what it says."""
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [str(part) for part in command], cwd=cwd, env=env, text=True, check=False,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    return done.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The sdist, and the wheel that is built from it."""
    folder = tmp_path_factory.mktemp("dist")
    ran(sys.executable, "-m", "build", "-o", folder, ROOT, cwd=folder)
    (sdist,), (wheel,) = folder.glob("*.tar.gz"), folder.glob("*.whl")
    return sdist, wheel


@pytest.fixture(scope="module")
def empty(built, tmp_path_factory):
    """The tools of an environment with the wheel and nothing else, and an empty folder."""
    folder = tmp_path_factory.mktemp("empty")
    venv.create(folder / "venv", with_pip=True)
    tools = folder / "venv" / ("Scripts" if os.name == "nt" else "bin")
    ran(tools / "python", "-m", "pip", "install", "-q", "--disable-pip-version-check", built[1], cwd=folder)
    return tools, folder


def installed(tools, *packages, cwd):
    ran(tools / "python", "-m", "pip", "install", "-q", "--disable-pip-version-check", *packages, cwd=cwd)


def test_an_index_would_take_both(built):
    said = ran(sys.executable, "-m", "twine", "check", "--strict", *built, cwd=ROOT)
    assert said.count("PASSED") == 2


def test_both_hold_every_file_that_is_tracked(built):
    sdist, wheel = built
    with tarfile.open(sdist) as packed:
        there = {name.partition("/")[2] for name in packed.getnames()}
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    tracked = {name for name in listed.splitlines() if (ROOT / name).exists()}
    assert tracked - there == set()
    with zipfile.ZipFile(wheel) as packed:
        names = set(packed.namelist())
    data = {name for name in tracked if name.startswith("vctune/")}
    data |= {f"vctune/{name}" for name in tracked if name.startswith("problems/")}
    assert data - names == set()
    assert not [name for name in names | there if any(mark in name for mark in BUILT)]


def test_the_wheel_says_who_made_it_and_how_to_cite_it(built):
    with zipfile.ZipFile(built[1]) as packed:
        (name,) = (each for each in packed.namelist() if each.endswith("/METADATA"))
        said = message_from_string(packed.read(name).decode())
    assert said["Version"] == __version__ and said["Author"] and "CITATION.cff" in said.get_payload()


def test_the_wheel_solves_checks_exports_and_explains_in_an_empty_environment(empty):
    tools, folder = empty
    assert ran(tools / "vctune", "--version", cwd=folder).startswith(f"vctune {__version__}")
    for command in (
        "example friction-wheel", "solve friction-wheel.toml", "explain unknown-key", "schema design",
        "check friction-wheel.toml results/friction-wheel/gains.toml", "export results/friction-wheel/design.json",
    ):  # fmt: skip
        assert ran(tools / "vctune", *command.split(), cwd=folder)
    made = tomllib.loads((folder / "results/friction-wheel/gains.toml").read_text())
    text = (ROOT / "problems/friction-wheel.toml").read_text()
    assert made["design"]["sha256"] == problem_digest(parse_problem(text, "friction-wheel", "friction-wheel"))
    assert (folder / "results/friction-wheel/report.html").exists()
    assert (folder / "results/friction-wheel/firmware/vctune_controller.c").exists()


def test_the_wheel_passes_tests_of_the_sdist(built, empty):
    tools, folder = empty
    with tarfile.open(built[0]) as packed:
        packed.extractall(folder, filter="data")
    (tree,) = folder.glob("vctune-*")
    shutil.rmtree(tree / "vctune")  # so that the wheel is what is tested
    installed(tools, "pytest", "hypothesis", cwd=folder)
    said = ran(tools / "python", "-P", "-m", "pytest", "-q", "-p", "no:cacheprovider", *ALONE, cwd=tree)
    assert re.search(r"\d+ passed", said)


def test_every_extra_that_a_guide_names_is_one_of_the_wheel_and_of_a_checkout(built):
    with zipfile.ZipFile(built[1]) as packed:
        (name,) = (each for each in packed.namelist() if each.endswith("/METADATA"))
        extras = message_from_string(packed.read(name).decode()).get_all("Provides-Extra")
    stated = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert sorted(extras) == sorted(stated)
    pages = "\n".join(path.read_text() for path in (*ROOT.glob("*.md"), *Path(ROOT / "vctune").rglob("*.md")))
    named = {extra for found in re.findall(r"\[([a-z,]+)\]\"", pages) for extra in found.split(",")}
    assert named and named <= set(stated)


STUDY = 'problem = "knob.toml"\n[axes]\n"device.damping" = [0.002, 0.003]\n'
COMMANDS = """
example friction-wheel
example paddle
example knob
solve friction-wheel.toml
report results/friction-wheel/design.json
check friction-wheel.toml results/friction-wheel/gains.toml
simulate friction-wheel.toml results/friction-wheel/gains.toml
export results/friction-wheel/design.json
region paddle.toml --resolution 0.125
sweep study.toml
explain hold
schema problem
"""


@pytest.mark.skipif(sys.version_info >= (3, 13), reason="the lowest versions have no wheels for this Python")
def test_the_lowest_versions_that_pyproject_names_run_every_command(built, tmp_path):
    venv.create(tmp_path / "venv", with_pip=True)
    tools = tmp_path / "venv" / ("Scripts" if os.name == "nt" else "bin")
    named = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    lowest = [each.replace(">=", "==") for each in named]
    installed(tools, built[1], *lowest, cwd=tmp_path)
    listed = ran(tools / "python", "-m", "pip", "list", "--format", "freeze", cwd=tmp_path).lower()
    assert all(re.search(rf"^{each.lower()}(\.0)*$", listed, re.MULTILINE) for each in lowest), listed
    (tmp_path / "study.toml").write_text(STUDY)
    for command in COMMANDS.strip().splitlines():
        said = ran(tools / "python", "-m", "vctune", *command.split(), cwd=tmp_path)
        assert "Warning:" not in said, (command, said)
