"""The layout is the pipeline, and imports go one way."""

from __future__ import annotations

import ast
import subprocess
import sys
from functools import cache

from conftest import ROOT

FLOORS = [
    "version",
    "markup",
    "interrupt",
    "exit_codes",
    "model",
    "proof",
    "analysis",
    "document",
    "simulation",
    "identification",
    "design",
    "study",
    "firmware",
    "report",
    "api",
    "bench",
    "cli",
]
"""A room imports only from itself and from what stands before it."""
PACKAGE = ROOT / "vctune"


@cache
def imports(path):
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            found += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return found


def room(name):
    parts = name.split(".")
    return parts[1] if len(parts) > 1 else ""


def test_imports_go_one_way():
    for path in PACKAGE.rglob("*.py"):
        here = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        if room(here) not in FLOORS:
            continue
        for name in imports(path):
            if name.startswith("vctune.") and room(name) in FLOORS:
                assert FLOORS.index(room(name)) <= FLOORS.index(room(here)), f"{here} imports {name}"


def test_the_library_knows_no_command():
    assert not any(name.startswith("vctune.cli") for name in imports(PACKAGE / "__init__.py"))
    import vctune

    assert not any(home.startswith("cli.") for home in vctune._HOME.values())


def test_the_proof_knows_no_optimiser_and_no_estimate():
    for path in (PACKAGE / "proof").glob("*.py"):
        for name in imports(path):
            assert not name.startswith(("casadi", "vctune.design", "vctune.analysis")), path


def test_the_bound_knows_of_the_search_only_how_a_problem_is_posed_and_judged():
    known = {"bound", "prepared", "variables", "shapes", "judge"}
    found = {"search.py", "branching.py", "stability.py", "nodes.py", "resume.py"}
    for path in (PACKAGE / "design/bound").glob("*.py"):
        for name in imports(path):
            if name.startswith("vctune.design."):
                assert name.split(".")[2] in known, f"{path} imports {name}"
            assert path.name in found or not name.startswith(("casadi", "vctune.analysis")), path


def test_heavy_libraries_stay_in_their_rooms():
    homes = {
        # the simulation's step runs in CasADi's virtual machine; a benchmark runs CasADi's other solvers on the NLP
        "casadi": ("design/nlp.py", "simulation/step.py", "simulation/stretches.py", "bench/dense.py"),
        "pydantic": "document",
        "flint": ("proof", "design/bound/objective.py"),
        "click": "cli",
        "rich": "cli",
        "matplotlib": "report",
        "distributed": "study/executors.py",
        "pyarrow": "study/table.py",
        "scipy": ("bench", "identification"),
        "mpmath": "bench",
        "yaml": "document/ros.py",
        "ctypes": "simulation/library.py",
    }
    for library, home in homes.items():
        for path in PACKAGE.rglob("*.py"):
            if any(name.split(".")[0] == library for name in imports(path)):
                assert str(path.relative_to(PACKAGE)).startswith(home), f"{path} imports {library}"


def test_help_imports_nothing_heavy():
    code = (
        "import sys; sys.argv = ['vctune', '--help']\n"
        "import vctune.cli\n"
        "try: vctune.cli.run()\n"
        "except SystemExit: pass\n"
        "heavy = {'casadi', 'numpy', 'flint', 'pydantic', 'rich', 'matplotlib'} & set(sys.modules)\n"
        "sys.exit(str(heavy) if heavy else 0)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)


def test_public_names_are_there():
    import vctune

    for name in vctune.__all__:
        assert getattr(vctune, name) is not None


def test_top_level_holds_what_the_users_named():
    allowed = {"pyproject.toml", "vctune", "problems", "tests", "results", "README.md", "LICENSE"}
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False).stdout.split(
        "\n"
    )
    tops = {line.split("/")[0] for line in tracked if line and not line.startswith(".")}
    assert tops <= allowed
