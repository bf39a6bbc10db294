"""Makes the generated parts of every README.md: console sessions, key reference, gallery.

`python tests/readme.py [README.md]...` writes them. A console block is run line by line in one empty folder that has
the problems, one folder a page; a line that starts with "$ " is a command, what follows it is its output.
"""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

from gallery import gallery

from vctune.document.records.rows_json import SHOWN_COLUMNS
from vctune.document.schema.log_schema import LogDocument
from vctune.document.schema.problem_schema import json_schema, schema_of
from vctune.model.display import DISPLAYS
from vctune.model.numbers.units import LINEAR
from vctune.proof.claims.registry import CLAIMS

ROOT = Path(__file__).parent.parent
PAGES = [
    ROOT / "README.md",
    *sorted(page for top in ("vctune", "problems", "results", "tests") for page in (ROOT / top).rglob("README.md")),
]
CONSOLE = re.compile(r"```console\n(.*?)```", re.DOTALL)
NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")


def with_sessions(text: str) -> str:
    """Return a page's text with its console sessions made anew."""
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(ROOT / "problems", Path(folder) / "problems")
        return CONSOLE.sub(lambda block: f"```console\n{session(block[1], folder)}```", text)


def with_tables(text: str) -> str:
    """Return a page's text with its generated tables made anew."""
    for name, make in TABLES.items():
        marks = re.compile(rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)", re.DOTALL)
        if marks.search(text):
            table = make()
            text = marks.sub(lambda found, table=table: found[1] + table + found[2], text)
    return text


def session(block: str, folder: str) -> str:
    """Run the commands of a console block and return them with what they print."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    env = {**os.environ, "PATH": path, "COLUMNS": "100"}
    lines = []
    for command in re.findall(r"^\$ (.*(?:\n> .*)*)", block, re.MULTILINE):
        script = command.replace("\n> ", "\n")
        done = subprocess.run(
            ["bash", "-c", script], cwd=folder, env=env, check=False, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        lines += [f"$ {command}", *(line.rstrip() for line in done.stdout.splitlines())]
    return "\n".join(lines) + "\n"


def reference(schema: dict) -> str:
    """Return the keys of a file as a table, from its JSON Schema."""
    rows = ["| key | meaning |", "|---|---|"]

    def add(prefix: str, table: dict) -> None:
        for key, entry in table["properties"].items():
            form = entry.get("items", entry) if entry.get("type") == "array" else entry
            forms = [one.get("$ref", "").removeprefix("#/$defs/") for one in (form, *form.get("oneOf", ()))]
            targets = [target for one in forms if "properties" in (target := schema["$defs"].get(one, {}))]
            name = f"{prefix}{key}"
            for target in targets:
                shown = f"[{name}]" if form is entry else f"[[{name}]]"
                rows.append(f"| **`{shown}`** | {_of_table(entry, target)} |")
                add(f"{name}.", target)
            if targets:
                continue
            default = entry.get("default")
            shown = "" if default in (None, "") else f" Default {str(default).lower()}."
            rows.append(f"| `{name}` | {entry.get('description', '')}{shown} |")

    add("", schema)
    escaped = [re.sub(r"\|(S|1 - G_he|G_hh|Z_c|1/G_hh|1 - A H/N|1/Z_c)\|", r"\\|\1\\|", row) for row in rows]
    return "\n".join(escaped) + "\n"


def _of_table(entry: dict, table: dict) -> str:
    """Return the description of a key that holds a table: its own, and that of the table."""
    own, general = "" if "items" in entry else entry.get("description", ""), table["description"]
    both = (general, own) if own.startswith("Default") else (own, general)
    return " ".join(" ".join(both).split())


def columns() -> str:
    """Return the columns of a study's table that are no axes, as a table."""
    rows = [
        "| column | meaning |",
        "|---|---|",
        "| `status` | as of a design; invalid if the values do not form a valid problem, failed if the worker failed |",
        "| `idle` | whether a certified design hardly uses its velocity loop: \\|1 - G_he\\| is above 0.5 |",
    ]
    for name, shown in SHOWN_COLUMNS.items():
        label = shown.label.replace("|", "\\|")
        unit = LINEAR.of(shown.of)
        rows.append(f"| `{name}` | {label}{f', {unit}' if unit else ''} |")
    return "\n".join([*rows, "| `reason` | why there is no certified design |"]) + "\n"


def claims() -> str:
    """Return the claims that a certificate makes, as a table."""
    rows = ["| id | claim | meaning |", "|---|---|---|"]
    for claim in CLAIMS.values():
        sentences = dict.fromkeys(map(claim.said_of, DISPLAYS.values()))
        cells = [f"`{claim.id}`", "; ".join(sentences), claim.explain]
        rows.append(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |")
    return "\n".join(rows) + "\n"


def modules(package: str) -> str:
    """Return the modules of a package, room by room, each with what its docstring says first."""
    top = ROOT / package
    rows = ["| module | what it is about |", "|---|---|"]
    for folder in [top, *sorted(path.parent for path in top.rglob("__init__.py") if path.parent != top)]:
        if folder != top and (folder / "README.md").exists():
            continue  # it has a guide of its own
        if folder != top:
            rows.append(f"| **`{folder.relative_to(top)}/`** | **{_first(folder / '__init__.py')}** |")
        rows += [f"| `{path.name}` | {_first(path)} |" for path in sorted(folder.glob("[!_]*.py"))]
    return "\n".join(rows) + "\n"


def _first(path: Path) -> str:
    """Return the first paragraph of a module's docstring, in a cell of a table."""
    text = ast.get_docstring(ast.parse(path.read_text())) or ""
    return " ".join(text.partition("\n\n")[0].split()).replace("|", "\\|")


PACKAGES = [
    path.parent.relative_to(ROOT).as_posix()
    for path in sorted((ROOT / "vctune").rglob("README.md"))
    if path.parent != ROOT / "vctune"
]
"""The folders whose guide names their modules."""
TABLES: dict[str, Callable[[], str]] = {
    **{f"modules of {package}": partial(modules, package) for package in PACKAGES},
    "reference": lambda: reference(json_schema()),
    "log": lambda: reference(schema_of(LogDocument, "vctune log")),
    "columns": columns,
    "claims": claims,
    "gallery": gallery,
}
"""What makes the table between the comments of this name."""


if __name__ == "__main__":
    for page in [Path(name) for name in sys.argv[1:]] or PAGES:
        page.write_text(with_tables(with_sessions(page.read_text())))
