"""Define `vctune explain`."""

from __future__ import annotations

import re
import shutil
import textwrap
from typing import TYPE_CHECKING

import click

from vctune.cli.printing.options import output_options

if TYPE_CHECKING:
    from vctune.document.records.printed_json import EntryRecord

WIDEST = 100  # Greatest width of the text, characters


def _names(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[str]:
    """Return the names that begin with the text that the user has typed."""
    from vctune.api.explaining import entries

    return sorted({name for entry in entries() for name in entry.names if name.startswith(incomplete)})


@click.command(short_help="Explain a code, a key, a term or a claim.")
@click.argument("name", required=False, metavar="[CODE|KEY|TERM|CLAIM]", shell_complete=_names)
@output_options()
def explain(name: str | None, style: str, quiet: bool) -> int:
    """Explain a NAME with the text of the project's guides. Without NAME, list all names.

    NAME is a code, a key of a problem or log file, a term or symbol of the glossary, or the id of a claim in
    design.json. A code is the word in brackets after an error or a warning.
    """
    from vctune.api.explaining import contents
    from vctune.api.explaining import explain as found_in_guides
    from vctune.cli.printing.output import answer
    from vctune.exit_codes import ExitCode

    if name is None:
        found = contents()
        answer(style, quiet, found.to_json, lambda: click.echo(_contents(found.entries)))
    else:
        found = found_in_guides(name)
        answer(style, quiet, found.to_json, lambda: click.echo("\n\n".join(map(_page, found.entries))))
    return ExitCode.OK


def _contents(entries: list[EntryRecord]) -> str:
    """Return all known names, by kind."""
    titles = {"code": "Codes", "key": "Keys of files", "term": "Terms", "claim": "Claims"}
    lists = {kind: ", ".join(dict.fromkeys(entry.name for entry in entries if entry.kind == kind)) for kind in titles}
    return "\n\n".join(f"{titles[kind]}\n{_filled(names, '  ')}" for kind, names in lists.items())


def _page(entry: EntryRecord) -> str:
    """Return an entry as plain text: its name, the text of the guide, and the name of the guide."""
    blocks = re.split(r"(```.*?```)", entry.text, flags=re.DOTALL)
    parts = [_verbatim(block) if block.startswith("```") else _paragraphs(block) for block in blocks]
    return "\n\n".join([f"{entry.name} ({entry.kind})", *filter(None, parts), f"from {entry.guide}"])


def _verbatim(block: str) -> str:
    """Return the content of a fenced block of code, indented."""
    return textwrap.indent("\n".join(block.splitlines()[1:-1]), "    ")


def _paragraphs(text: str) -> str:
    """Return Markdown without links, emphasis and formula marks, with filled paragraphs and items of lists."""
    plain = re.sub(r"\[([^\]]+)\]\([^)]*\)", r"\1", text)
    plain = re.sub(r"\*\*|[`$]", "", plain).replace("\\|", "|").replace(r"\lvert ", "|").replace(r" \rvert", "|")
    plain = re.sub(r"_\{(\w+)\}", r"_\1", plain)
    items = re.split(r"\n\s*\n|\n(?=- )", plain.strip())
    return "\n".join(_filled(item, "  " if item.startswith("- ") else "") for item in items)


def _filled(text: str, indent: str) -> str:
    width = min(WIDEST, shutil.get_terminal_size().columns)
    return textwrap.fill(text, width, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False)
