"""Imports go one way, public names are there, and a command imports only what it uses."""

from __future__ import annotations

import ast
import os
import subprocess
import sys

import pytest
from conftest import ROOT

import vctune


def floors(text):
    """Return the floor of each name: one floor after the other, the lowest first."""
    return {name: floor for floor, names in enumerate(text.split("|")) for name in names.split()}


FLOORS = floors(
    "version interrupt running exit_codes | model | proof | analysis | document | simulation | identification | design"
    " | study | firmware | report | bench | api | cli"
)
ROOMS = {
    "design": floors(
        "variables uncertain prepared | judging | nlp | search | bound | result | solve | advice | records | check"
        " | ros"
    ),
    "proof": floors(
        "enclosures outcome | boxes device_box | halving | prover | box_tests | claims | certificate cells"
    ),
}
PACKAGE = ROOT / "vctune"


def imports(folder):
    """Yield each module of a folder and a module that it imports, as names relative to the folder."""
    prefix = ".".join(("vctune", *folder.relative_to(PACKAGE).parts)) + "."
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(prefix):
                yield path.relative_to(folder).with_suffix("").parts, node.module.removeprefix(prefix).split(".")


def test_imports_go_one_way():
    """A package imports only from itself and from what stands before it."""
    for here, there in imports(PACKAGE):
        if here[0] in FLOORS and there[0] in FLOORS:
            assert FLOORS[there[0]] <= FLOORS[here[0]], f"{here} imports {there}"


@pytest.mark.parametrize("package", ROOMS)
def test_imports_of_rooms_go_one_way(package):
    """So do the rooms and modules of a package."""
    rooms = ROOMS[package]
    for here, there in imports(PACKAGE / package):
        if here[0] != "__init__":
            assert rooms[there[0]] <= rooms[here[0]], f"{package}: {here} imports {there}"


UNUSED = {"scipy", "matplotlib", "contourpy", "jinja2", "yaml", "unittest", "vctune.identification", "vctune.bench"}
IMPORTED = """
import sys
before = set(sys.modules)
import vctune.cli
try:
    vctune.cli.run()
except SystemExit as end:
    assert not end.code, end.code
print(*sorted(set(sys.modules) - before), file=sys.stderr)
"""


@pytest.mark.parametrize(
    ("arguments", "unused", "most"),
    [
        (["--help"], {*UNUSED, "casadi", "numpy", "pydantic", "rich", "vctune.design"}, 18),
        (["check", str(ROOT / "problems" / "fixed-gains.toml")], UNUSED, 165),
        (["solve", str(ROOT / "problems" / "friction-wheel.toml"), "--no-report", "--out", "."], UNUSED, 220),
    ],
    ids=["help", "check", "solve"],
)
def test_a_command_imports_what_it_uses(arguments, unused, most, tmp_path):
    """And few modules of libraries besides: every user of the command waits for what it imports."""
    command = [sys.executable, "-c", IMPORTED, *arguments]
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    ran = subprocess.run(command, check=True, capture_output=True, text=True, cwd=tmp_path, env=env)
    modules = ran.stderr.splitlines()[-1].split()
    assert "vctune.cli" in modules and not unused & set(modules)
    tops = {*sys.stdlib_module_names, "vctune"}
    others = [name for name in modules if name.partition(".")[0] not in tops]
    assert len(others) <= most, (len(others), others)


def test_public_names_are_there():
    for name in vctune.__all__:
        assert getattr(vctune, name) is not None
