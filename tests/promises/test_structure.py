"""Imports go one way, public names are there, and `--help` loads nothing heavy."""

from __future__ import annotations

import ast
import subprocess
import sys

import pytest
from conftest import ROOT

import vctune

FLOORS = {
    **dict.fromkeys(("version", "interrupt", "running", "exit_codes"), 0),
    "model": 1,
    "proof": 2,
    "analysis": 3,
    "document": 4,
    "simulation": 5,
    "identification": 6,
    "design": 7,
    "study": 8,
    "firmware": 9,
    "report": 10,
    "bench": 11,
    "api": 12,
    "cli": 13,
}
ROOMS = {
    "design": {
        **dict.fromkeys(("variables", "prepared"), 0),
        "judging": 1,
        "nlp": 2,
        "search": 3,
        "bound": 4,
        "result": 5,
        "solve": 6,
        **dict.fromkeys(("advice", "felt_record"), 7),
        "design_record": 8,
        "check": 9,
        "ros": 10,
    },
    "proof": {
        **dict.fromkeys(("enclosures", "outcome"), 0),
        **dict.fromkeys(("boxes", "device_box"), 1),
        "halving": 2,
        "prover": 3,
        "box_tests": 4,
        "claims": 5,
        "certificate": 6,
    },
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
    floors = ROOMS[package]
    for here, there in imports(PACKAGE / package):
        if here[0] != "__init__":
            assert floors[there[0]] <= floors[here[0]], f"{package}: {here} imports {there}"


def test_help_loads_nothing_heavy():
    code = (
        "import sys; sys.argv = ['vctune', '--help']\nimport vctune.cli\n"
        "try: vctune.cli.run()\nexcept SystemExit: pass\n"
        "assert not {'casadi', 'numpy', 'pydantic', 'rich', 'matplotlib'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)


def test_public_names_are_there():
    for name in vctune.__all__:
        assert getattr(vctune, name) is not None
