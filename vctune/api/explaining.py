"""Provide `vctune explain` as a function: return the guides' text on a code, a key, a term or a claim."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache, reduce
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Literal

from vctune.document.records.printed_json import EntryRecord, ExplanationRecord
from vctune.document.schema.number_units import unit_of
from vctune.document.text.errors import InputError
from vctune.model.display import DISPLAYS
from vctune.model.numbers.units import LINEAR, ROTARY
from vctune.proof.claims.registry import CLAIMS, Claim

GUIDE = "README.md"
CODES = ["code", "meaning", "what to do"]  # Heads of a guide's table of codes
# Pattern of a table of keys in a guide: the text between `<!-- reference -->` and the comment that ends it
KEY_TABLES = re.compile(r"<!-- (?:reference|log|columns) -->\n(.*?)<!-- /", re.DOTALL)
# Pattern of a key's row in such a table: its key and its meaning, as in "| `device.mass` | Mass, kg
KEY_ROW = re.compile(r"^\| \*{0,2}`\[{0,2}([\w.]+)\]{0,2}`\*{0,2} \| (.*) \|$", re.MULTILINE)
# Pattern of a guide's glossary: the text below its heading
GLOSSARY = re.compile(r"^## Glossary\n(.*?)(?=^## |\Z)", re.MULTILINE | re.DOTALL)
# Pattern of a table in Markdown: the cells of its heads, and its rows
TABLE = re.compile(r"^\|(.*)\|\n\|[-|]*\|\n((?:^\|.*\|\n?)+)", re.MULTILINE)
# Patterns of the endings that labels of tables and JSON keys add to a term: a frequency, a condition, a text after a
# colon, a symbol, a unit
VARIABLE_ENDINGS = (
    r"(, at|,| at) ([\d.]+ Hz|at rest)$",
    r", if .*$",
    r": .*$",
    r" [A-Za-z](_\w+)?$",
    r"_(hz|db|deg|s|per_s)$",
)
# Words for a rotary device, each with the corresponding word for a linear device
LINEAR_WORDS = (("inertia", "mass"), ("torque", "force"))
CLAIMS_GUIDE = "vctune/proof/README.md"  # Guide that the entry of a claim names
CELLS = re.compile(r"(?<!\\)\|")  # Pattern of the border between two cells: "|", but not "\|", as in "\|S\|"


@dataclass(frozen=True, slots=True)
class Entry:
    """The text of the guides on one name."""

    kind: Literal["code", "key", "term", "claim"]  # "code", "key", "term" or "claim"
    names: tuple[str, ...]  # names under which `vctune explain` finds the entry
    text: str  # text in Markdown
    guide: str  # path of the guide that contains it


def explain(name: str) -> ExplanationRecord:
    """Return the guides' text on a code, a key of a file, a word of the glossary or a claim.

    Parameters
    ----------
    name : str
        A code, as in the brackets after a message; a key, complete or only its last part; a word or symbol of
        the glossary; or a claim's identifier or label.

    Returns
    -------
    ExplanationRecord
        `entries`; each has its `kind` ("code", "key", "term" or "claim"), its `name`, its `text` in Markdown, and its
            `guide`.

    Raises
    ------
    InputError
        If no entry has this name; the message suggests the nearest names.
    """
    # first compare the name and its stems exactly, and then without regard to capitals
    label = _plain(name)
    entries_found = next(filter(None, map(_entries_named, _names_of_label(label))), [])
    entries_found = entries_found or next(
        filter(None, (_entries_named(stem.lower(), str.lower) for stem in _names_of_label(label))), []
    )
    if not entries_found:
        names = [name for entry in entries() for name in entry.names]
        name_of_form = {_plain(form).lower(): form for name in names for form in (name, name.rpartition(".")[2])}
        similar = [name_of_form[near] for near in get_close_matches(label.lower(), name_of_form, n=3, cutoff=0.6)]
        hint = f"did you mean {' or '.join(similar)}?" if similar else "`vctune explain` lists what there is"
        raise InputError.of(name, "unknown-name", f"is no code, key, claim or word of the glossary; {hint}")
    records = [
        EntryRecord(kind=entry.kind, name=entry.names[0], text=entry.text, guide=entry.guide) for entry in entries_found
    ]
    return ExplanationRecord(name=name, entries=records)


def contents() -> ExplanationRecord:
    """Return the first name of each entry that `explain` knows, without the texts."""
    listed = [EntryRecord(kind=entry.kind, name=entry.names[0], text="", guide=entry.guide) for entry in entries()]
    return ExplanationRecord(name=None, entries=listed)


def _names_of_label(label: str) -> Iterator[str]:
    """Yield the names under which the guides may explain a label: the whole label, and the label without its variable
    parts."""
    linear = reduce(lambda words, pair: words.replace(*pair), LINEAR_WORDS, label)
    stems = [re.sub(end, "", linear) for end in ("", *VARIABLE_ENDINGS)]
    yield from dict.fromkeys([label, *stems, *(stem.replace("_", " ") for stem in stems)])


def _entries_named(name: str, folded: Callable[[str], str] = str) -> list[Entry]:
    """Return the entries with a name, and the keys whose last part is the name. The function `folded` is applied to an
    entry's names before the comparison."""
    return [
        entry
        for entry in entries()
        if name in [folded(_plain(entry_name)) for entry_name in entry.names]
        or (entry.kind == "key" and entry.names[0].endswith(f".{name}"))
    ]


@cache
def entries() -> tuple[Entry, ...]:
    """Return all entries, in the order of the guides."""
    of_guides = (entry for guide, text in _guides(files("vctune"), "vctune") for entry in _entries(guide, text))
    return (*of_guides, *map(_claim, CLAIMS.values()))


def _claim(claim: Claim) -> Entry:
    """Return a claim as an entry: its sentences for all kinds of display, its explanation, and the place of its
    proof."""
    sentences = "; ".join(f"“{sentence}”" for sentence in dict.fromkeys(map(claim.said_of, DISPLAYS.values())))
    statement = f"The certificate's claim {sentences}."
    proof = f"Proved by `vctune.{claim.margin}`. Its witness is {claim.witness}."
    return Entry("claim", (claim.id, claim.label), "\n\n".join([statement, claim.explain, proof]), CLAIMS_GUIDE)


def _guides(folder: Traversable, place: str) -> Iterator[tuple[str, str]]:
    """Yield the path and the text of each guide of the package."""
    for child in sorted(folder.iterdir(), key=lambda path: (path.is_dir(), path.name)):
        if child.is_dir():
            yield from _guides(child, f"{place}/{child.name}")
        elif child.name == GUIDE:
            yield f"{place}/{GUIDE}", child.read_text(encoding="utf-8")


def _entries(guide: str, text: str) -> Iterator[Entry]:
    """Yield the entries of a guide: codes, keys, and terms of the glossary. The entry of a table lists the keys in
    it."""
    for heads, rows in TABLE.findall(text):
        for row in rows.splitlines() if _cells(heads) == CODES else ():
            code, meaning, remedy = (cell.replace("\\|", "|") for cell in _cells(row.strip("|")))
            yield Entry("code", (code.strip("`"),), f"{meaning}\n\nWhat to do: {remedy}", guide)
    for reference in KEY_TABLES.findall(text):
        rows = KEY_ROW.findall(reference)
        for key, meaning in rows:
            inner = [
                f"- `{other}`: {meaning_of_inner}"
                for other, meaning_of_inner in rows
                if other.rpartition(".")[0] == key
            ]
            linear, rotary = (unit_of(tuple(key.split(".")), units) for units in (LINEAR, ROTARY))
            turned = f" Unit for a rotary device: {rotary}." if linear != rotary else ""
            yield Entry("key", (key,), "\n".join([meaning + turned, *(["", *inner] if inner else [])]), guide)
    for glossary in GLOSSARY.findall(text):
        for heads, rows in TABLE.findall(glossary):
            yield from (_term(guide, _cells(heads), _cells(row.strip("|"))) for row in rows.splitlines())


def _cells(row: str) -> list[str]:
    """Return the cells of a row of a table in Markdown."""
    return [cell.strip() for cell in CELLS.split(row)]


def _term(guide: str, heads: list[str], cells: list[str]) -> Entry:
    """Return a glossary row as an entry. If the row has several words or symbols, each is a name of the entry."""
    row = {head: cell.replace("\\|", "|") for head, cell in zip(heads, cells, strict=True)}
    symbols = [
        part for part in re.findall(r"\$([^$]*)\$|([^$,]+)", row.get("symbol", "")) for part in part if part.strip()
    ]
    terms = row["term"].split(", ")
    names = [*terms, *(symbol.split(" = ")[0] for symbol in symbols)]
    names += [term.split()[-1] for term in terms if re.search(r" [A-Za-z]_\w+$", term)]
    names += re.findall(r"`(?:\w+\.)*([a-z]+_\w+)`", row.get("in the code", ""))
    details = [f"{label}: {row[label]}" for label in ("symbol", "unit", "in the code") if row.get(label)]
    text = "\n\n".join([row["meaning"], "; ".join(details)]) if details else row["meaning"]
    return Entry("term", (row["term"], *names), text, guide)


def _plain(name: str) -> str:
    """Return a name in the form used for comparisons: without quotes, brackets and formula marks."""
    return re.sub(r"[\[\]`$\\{}\"']", "", name).strip()
