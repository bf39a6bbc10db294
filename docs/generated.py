"""Make pages from the code and from results/: explanations, the reference of the library, the designs of the
gallery."""

from __future__ import annotations

import re
from itertools import groupby
from pathlib import Path
from posixpath import relpath

import vctune
from vctune.api.explaining import Entry, entries

ROOT = Path(__file__).parent.parent
KINDS = {
    "code": ("codes", "Codes of messages", "Each message of vctune ends with a code in brackets."),
    "key": ("keys", "Keys of files", "The keys of problem files, log files and tables."),
    "term": ("words", "Words", "The words of tables, pages and guides."),
    "claim": ("claims", "Claims", "The statements that a certificate proves or refutes."),
}
LINK = re.compile(r"\]\((?!#|\w+://)([^)\s]+)")
LANGUAGES = {".py": "python", ".toml": "toml", ".json": "json"}
FIGURE = "![{0}]({0}.svg)"


def explanations() -> dict[str, str]:
    """Return the entries of `vctune explain` as pages, one page for each kind of name."""
    pages = {}
    for kind, (name, title, about) in KINDS.items():
        chosen = [entry for entry in entries() if entry.kind == kind]
        parts = [f"# {title}", f"{about} `vctune explain NAME` prints the same in a terminal."]
        for guide, group in groupby(chosen, key=lambda entry: entry.guide):
            parts.append(f"## From [{guide.removesuffix('/README.md')}](../{guide})")
            parts += [f"### `{_head(entry)}`\n\n{_moved(entry)}" for entry in group]
        pages[f"explain/{name}.md"] = "\n\n".join(parts) + "\n"
    return pages


def _head(entry: Entry) -> str:
    return re.sub(r"[`$]", "", entry.names[0])


def _moved(entry: Entry) -> str:
    """Return the text of an entry, with its links adapted to the entry's page on the site."""
    folder = entry.guide.removesuffix("/README.md")
    text = LINK.sub(lambda found: f"]({relpath(f'{folder}/{found[1]}', 'explain')}", entry.text)
    return re.sub(r"\]\(#", f"](../{entry.guide}#", text)


def reference() -> dict[str, str]:
    """Return the pages of the library's reference, made from docstrings: one for functions, one for the types of their
    values."""
    functions = [name for name, home in vctune._HOME.items() if not name[0].isupper()]
    types = [name for name in vctune._HOME if name not in functions]
    return {
        "reference/functions.md": _reference("Functions", functions, "autofunction"),
        "reference/types.md": _reference("Types", types, "autoclass"),
    }


def _reference(title: str, names: list[str], directive: str) -> str:
    def block(name: str) -> str:
        members = "\n   :members:" if directive == "autoclass" else ""
        return f"## {name}\n\n```{{eval-rst}}\n.. {directive}:: vctune.{name}{members}\n```\n"

    about = "Import every name of this page from `vctune`. [The library](../vctune/api/README.md) gives an overview."
    return "\n".join([f"# {title} of the library\n", about, "", *map(block, sorted(names, key=str.lower))])


def source_page(path: Path) -> str:
    """Return a page for a text file of the repository."""
    return f"# {path.name}\n\n{_fenced(path)}"


def folder_page(folder: Path) -> str:
    """Return a page for a folder of the repository: a design with its figures and files, or a list of files."""
    if not (folder / "gains.toml").exists() and not (folder / "design.json").exists():
        files = sorted(path for path in folder.iterdir() if path.is_file())
        return "\n".join([f"# {folder.name}\n", *map(_listed, files), ""])
    parts = [f"# {folder.name}"]
    problem = ROOT / "problems" / f"{folder.name}.toml"
    parts.append(f"The problem is [problems/{problem.name}](../../problems/{problem.name}).")
    if (folder / "report.html").exists():
        parts.append('<a href="report.html">The report of this design</a> is one page with all figures.')
    parts += [FIGURE.format(path.stem) for path in sorted(folder.glob("*.svg")) if path.stem in DRAWN]
    parts += [f"`{path.name}`:\n\n{_fenced(path)}" for path in (folder / "gains.toml", problem) if path.exists()]
    return "\n\n".join(parts)


DRAWN = ("hands", "any-hand", "llewellyn", "region", "simulation", "error")
"""Figures that results/ keeps."""


def _listed(path: Path) -> str:
    if path.suffix == ".svg":
        return f"{FIGURE.format(path.stem)}\n"
    return f"- [{path.name}]({path.name})"


def _fenced(path: Path) -> str:
    return f"````{LANGUAGES.get(path.suffix, 'text')}\n{path.read_text('utf-8').rstrip()}\n````\n"
