"""The layout is the pipeline, and imports go one way."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections import Counter
from functools import cache
from pathlib import Path

import pytest
from conftest import ROOT

FLOORS = [
    "version",
    "markup",
    "interrupt",
    "running",
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
    "bench",
    "api",
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


def named(tree):
    """Yield what a module imports to run, without what only its types need."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        yield from named(node)


def test_commands_call_the_library_alone():
    """What a command does anybody can: it takes public names, functions of api, and what knows nothing of devices."""
    import vctune

    public = {f"vctune.{name}" for name in vctune.__all__}
    below = ("vctune.cli.", "vctune.api.", "vctune.running.", "vctune.interrupt.", "vctune.exit_codes.")
    for path in (PACKAGE / "cli").rglob("*.py"):
        for name in named(ast.parse(path.read_text())):
            allowed = name in public or name == "vctune.version.__version__" or name.startswith(below)
            assert allowed or not name.startswith("vctune"), f"{path} imports {name}"


def test_the_proof_knows_no_optimiser_and_no_estimate():
    for path in (PACKAGE / "proof").rglob("*.py"):
        for name in imports(path):
            assert not name.startswith(("casadi", "vctune.design", "vctune.analysis")), path


def test_the_bound_knows_of_the_search_only_how_a_problem_is_posed_and_judged():
    known = ("bound.", "prepared", "variables", "search.shapes", "verdict.judge")
    found = {"search.py", "strong_branching.py", "stability_bound.py", "nodes.py", "resume.py"}
    for path in (PACKAGE / "design/bound").glob("*.py"):
        for name in imports(path):
            if name.startswith("vctune.design."):
                assert name.removeprefix("vctune.design.").startswith(known), f"{path} imports {name}"
            assert path.name in found or not name.startswith(("casadi", "vctune.analysis")), path


def test_no_name_of_a_module_stands_for_two_things():
    """A command bears the name of the stage of work that it runs; no other name is used twice."""
    rooms = [path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py") if path.name != "__init__.py"]
    names = Counter(path.name for path in rooms if path.parent != Path("cli/commands"))
    assert [name for name, times in names.items() if times > 1] == []


def test_heavy_libraries_stay_in_their_rooms():
    homes = {
        # the simulation's step runs in CasADi's virtual machine; a benchmark runs CasADi's other solvers on the NLP
        "casadi": (
            "design/nlp/nlp.py",
            "design/nlp/ipopt_version.py",
            "simulation/mechanics/step.py",
            "simulation/mechanics/step_symbols.py",
            "simulation/mechanics/stretches.py",
            "bench/dense.py",
        ),
        "pydantic": "document",
        "flint": ("proof", "design/bound/objective.py"),
        "click": "cli",
        "rich": "cli",
        "matplotlib": "report",
        "contourpy": "report/figures/hands_figure.py",
        "distributed": "study/executors.py",
        "pyarrow": "study/study_table.py",
        "control": "analysis/responses/transfer.py",
        "pandas": ("study/study_table.py", "api/studies.py"),
        "polars": ("study/study_table.py", "api/studies.py"),
        "scipy": ("bench", "identification"),
        "mpmath": "bench",
        "yaml": "document/ros.py",
        "ctypes": "simulation/firmware/library.py",
    }
    for library, home in homes.items():
        for path in PACKAGE.rglob("*.py"):
            if any(name.split(".")[0] == library for name in imports(path)):
                assert str(path.relative_to(PACKAGE)).startswith(home), f"{path} imports {library}"


@pytest.mark.parametrize(
    ("option", "heavy"),
    [
        ("--help", {"casadi", "numpy", "flint", "pydantic", "rich", "matplotlib"}),
        (
            "--version",
            {"flint", "pydantic", "rich", "matplotlib", "scipy", "vctune.model", "vctune.cli.commands.solve"},
        ),
    ],
)
def test_help_and_version_import_nothing_heavy(option, heavy):
    code = (
        f"import sys; sys.argv = ['vctune', {option!r}]\n"
        "import vctune.cli\n"
        "try: vctune.cli.run()\n"
        "except SystemExit: pass\n"
        f"heavy = {heavy!r} & set(sys.modules)\n"
        "sys.exit(str(heavy) if heavy else 0)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)


def test_public_names_are_there():
    import vctune

    for name in vctune.__all__:
        assert getattr(vctune, name) is not None


def public_functions(tree):
    """Yield the functions and methods of a module that others may call, but commands, whose docstring is their help."""
    for node in tree.body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from public_functions(node)
        elif isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            command = any(ast.unparse(each).startswith("click.command") for each in node.decorator_list)
            if not command:
                yield node


def lacking(function):
    """Yield what the docstring of a function does not say, in NumPy's sections or in its first line."""
    text = ast.get_docstring(function) or ""
    arguments = [each.arg for each in (*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs)]
    arguments = [name for name in arguments if name not in ("self", "cls")]
    parts = re.split(r"\n\n(\w+)\n-{3,}\n", text)
    summary, sections = parts[0], dict(zip(parts[1::2], parts[2::2], strict=True))
    if len(arguments) > 1:
        entries = re.findall(r"^(\S.*?) : ", sections.get("Parameters", ""), re.MULTILINE)
        named = {name.lstrip("*") for entry in entries for name in entry.split(", ")}
        yield from (name for name in arguments if name not in named)
        returns = function.returns is not None and ast.unparse(function.returns) not in ("None", "NoReturn")
        said = re.search(r"\b(return|yield)s? ", summary, re.IGNORECASE) or {"Returns", "Yields"} & sections.keys()
        yield from ["Returns"] if returns and not said else []
    raised = [ast.unparse(node.exc) for node in ast.walk(function) if isinstance(node, ast.Raise) and node.exc]
    if any(name.startswith("InputError") for name in raised) and "Raises" not in sections:
        yield "Raises"


def test_public_functions_say_what_they_take_give_and_refuse():
    for path in PACKAGE.rglob("*.py"):
        for function in public_functions(ast.parse(path.read_text())):
            assert list(lacking(function)) == [], f"{path.relative_to(PACKAGE)}: {function.name}"


def test_the_guide_names_each_file_of_tests_in_one_row():
    folder = ROOT / "tests"
    rows = [line for line in (folder / "README.md").read_text().splitlines() if line.startswith("|")]
    files = sorted(str(path.relative_to(folder)) for path in folder.rglob("test_*.py"))
    assert len(files) > 80
    named = {file: sum(f"`{file}`" in row for row in rows) for file in files}
    assert {file: count for file, count in named.items() if count != 1} == {}
    assert set(re.findall(r"`(\w+/test_\w+\.py)`", "\n".join(rows))) == set(files)
