"""Turn tutorials into notebooks: each command and each block of Python becomes a cell, and the other text stays text.

`python docs/notebooks.py docs/tutorials/NAME.md...` runs each tutorial as a notebook in an empty folder, and replaces
the output below each command in the tutorial. In a ```console block, a command begins with "$ ", and its further lines
begin with "> ". A cell that fails is an error.
"""

from __future__ import annotations

import json
import os
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

BLOCK = re.compile(r"^```(console|python)\n(.*?)^```\n", re.MULTILINE | re.DOTALL)
ANSI = re.compile(r"\x1b\[[\d;]*m")
"""Escape sequences for bold and coloured text, which commands print in a notebook."""
COMMAND = re.compile(r"^\$ (.*(?:\n> .*)*)\n?", re.MULTILINE)


def as_notebook(text: str) -> str:
    """Return a tutorial as a notebook, without outputs.

    Parameters
    ----------
    text : the tutorial in Markdown
    """
    return json.dumps(_notebook(text), indent=1) + "\n"


def refreshed(text: str) -> str:
    """Return a tutorial with the present output of its commands.

    Parameters
    ----------
    text : the tutorial in Markdown
    """
    printed = iter(_run(_notebook(text)))

    def made(block: re.Match[str]) -> str:
        if block[1] == "python":
            next(printed)
            return block[0]
        sessions = "".join(f"$ {command}\n{next(printed)}" for command in COMMAND.findall(block[2]))
        return f"```console\n{sessions}```\n"

    return BLOCK.sub(made, text)


def _notebook(text: str) -> dict[str, Any]:
    cells, end = [], 0
    for block in BLOCK.finditer(text):
        cells.append(_cell("markdown", text[end : block.start()]))
        commands = ["%%bash\n" + each.replace("\n> ", "\n") for each in COMMAND.findall(block[2])]
        cells += [_cell("code", source) for source in (commands if block[1] == "console" else [block[2]])]
        end = block.end()
    cells.append(_cell("markdown", text[end:]))
    kept = [cell for cell in cells if cell["source"]]
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    numbered = [{"id": f"cell-{number}", **cell} for number, cell in enumerate(kept)]
    return {"cells": numbered, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}


def _cell(kind: str, source: str) -> dict[str, Any]:
    code = {"execution_count": None, "outputs": []} if kind == "code" else {}
    return {"cell_type": kind, "metadata": {}, "source": source.strip(), **code}


def _run(notebook: dict[str, Any]) -> list[str]:
    """Run a notebook in an empty folder, and return the output of each cell of code.

    The commands installed with this Python interpreter take precedence over others.
    """
    import nbformat
    from nbclient import NotebookClient

    with tempfile.TemporaryDirectory() as folder:
        search = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        os.environ |= {"PATH": search, "COLUMNS": "120", "IPYTHONDIR": f"{folder}/.ipython"}
        notes = nbformat.reads(json.dumps(notebook), as_version=4)
        NotebookClient(notes, timeout=None, resources={"metadata": {"path": folder}}).execute()
    return [_printed(cell.outputs) for cell in notes.cells if cell.cell_type == "code"]


def _printed(outputs: list[Any]) -> str:
    text = ANSI.sub("", "".join(each.text for each in outputs if each.output_type == "stream"))
    return "".join(f"{line.rstrip()}\n" for line in text.splitlines())


if __name__ == "__main__":
    for page in map(Path, sys.argv[1:]):
        page.write_text(refreshed(page.read_text("utf-8")), encoding="utf-8")
