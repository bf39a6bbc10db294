"""Makes README.md's generated parts: console sessions and the file reference. `python tests/readme.py` writes them.

A console block is run line by line in one empty folder that has the problems; a line that starts with "$ " is a
command, what follows it is its output.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from vctune.document.schema import json_schema

ROOT = Path(__file__).parent.parent
CONSOLE = re.compile(r"```console\n(.*?)```", re.DOTALL)
REFERENCE = re.compile(r"(<!-- reference -->\n).*?(<!-- /reference -->)", re.DOTALL)
NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")


def generated(text: str) -> str:
    """Return README's text with its generated parts made anew."""
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(ROOT / "problems", Path(folder) / "problems")
        text = CONSOLE.sub(lambda block: f"```console\n{session(block[1], folder)}```", text)
    return REFERENCE.sub(lambda found: found[1] + reference() + found[2], text)


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


def reference() -> str:
    """Return the keys of the problem file as a table, from its JSON Schema."""
    schema = json_schema()
    rows = ["| key | meaning |", "|---|---|"]

    def add(prefix: str, table: dict) -> None:
        for key, entry in table["properties"].items():
            form = entry.get("items", entry) if entry.get("type") == "array" else entry
            target = schema["$defs"].get(form.get("$ref", "").removeprefix("#/$defs/"))
            name = f"{prefix}{key}"
            if target and "properties" in target:
                shown = f"[{name}]" if form is entry else f"[[{name}]]"
                rows.append(f"| **`{shown}`** | {target['description']} |")
                add(f"{name}.", target)
            else:
                default = entry.get("default")
                shown = "" if default in (None, "") else f" Default {str(default).lower()}."
                rows.append(f"| `{name}` | {entry.get('description', '')}{shown} |")

    add("", schema)
    escaped = [re.sub(r"\|(S|1 - G_he|G_hh|Z_c)\|", r"\\|\1\\|", row) for row in rows]
    return "\n".join(escaped) + "\n"


if __name__ == "__main__":
    readme = ROOT / "README.md"
    readme.write_text(generated(readme.read_text()))
