"""Define `vctune explain`."""

from __future__ import annotations

import re
import shutil
import textwrap
from collections.abc import Iterator
from typing import TYPE_CHECKING

import click

from vctune.cli.options import command
from vctune.cli.runner import Run

if TYPE_CHECKING:
    from vctune.api.explaining import Entry

WIDEST = 100  # Greatest width of the text, characters
TITLES = {
    "code": "Codes",
    "key": "Keys of files",
    "term": "Terms",
    "device": "Devices without a key",
    "claim": "Claims",
    "task": "What to do",
}


def _names(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[str]:
    """Return the names that begin with the text that the user has typed."""
    from vctune.api.explaining import entries

    return sorted({name for entry in entries() for name in entry.names if name.startswith(incomplete)})


@command("Explain a code, a key, a term or a claim.")
@click.argument("name", required=False, metavar="[CODE|KEY|TERM|CLAIM]", shell_complete=_names)
def explain(run: Run, name: str | None) -> int:
    """Explain a NAME. Without NAME, list all names.

    NAME is a code, a key of a problem or log file, a term or symbol of the glossary, or the id of a claim in
    design.json. A code is the word in brackets after an error or a warning.
    """
    from vctune.api import explaining

    found = explaining.Explanation(None, [*explaining.entries()]) if name is None else explaining.explain(name)
    pages = _contents(found.entries) if name is None else map(_page, found.entries)
    run.say(found.to_json, lambda: (("\n\n".join(pages),) for _ in range(1)))
    return 0


def _contents(entries: list[Entry]) -> Iterator[str]:
    """Yield all known names, by kind."""
    for kind, title in TITLES.items():
        names = ", ".join(dict.fromkeys(entry.name for entry in entries if entry.kind == kind))
        yield f"{title}\n{_filled(names, '  ')}"


def _page(entry: Entry) -> str:
    """Return an entry as plain text: without the links, emphasis and formula marks of Markdown, in filled lines."""
    plain = re.sub(r"\[([^\]]+)\]\([^)]*\)", r"\1", entry.text)
    plain = re.sub(r"\*\*|[`$]", "", plain).replace("\\|", "|").replace(r"\lvert ", "|").replace(r" \rvert", "|")
    plain = re.sub(r"_\{(\w+)\}", r"_\1", plain)
    items = re.split(r"\n\s*\n|\n(?=- )", plain.strip())
    text = "\n".join(_filled(item, "  " if item.startswith("- ") else "") for item in items)
    return f"{entry.name} ({entry.kind})\n\n{text}\n\nfrom {entry.guide}"


def _filled(text: str, indent: str) -> str:
    width = min(WIDEST, shutil.get_terminal_size().columns)
    return textwrap.fill(text, width, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False)
