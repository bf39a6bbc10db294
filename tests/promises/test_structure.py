"""Imports go one way, public names are there, and `--help` loads nothing heavy."""

from __future__ import annotations

import ast
import subprocess
import sys

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
PACKAGE = ROOT / "vctune"


def test_imports_go_one_way():
    """A package imports only from itself and from what stands before it."""
    for path in PACKAGE.rglob("*.py"):
        here = path.relative_to(PACKAGE).with_suffix("").parts[0]
        for node in ast.walk(ast.parse(path.read_text())):
            name = node.module or "" if isinstance(node, ast.ImportFrom) else ""
            there = name.removeprefix("vctune.").split(".")[0]
            if here in FLOORS and name.startswith("vctune.") and there in FLOORS:
                assert FLOORS[there] <= FLOORS[here], f"{path} imports {name}"


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
