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
CODE = re.compile(r"^### `([a-z-]+)`\n(.*?)(?=^#|\Z)", re.MULTILINE | re.DOTALL)
"""Pattern of a code's section in a guide: the heading with the code, and the text below it."""
KEYS = re.compile(r"<!-- (?:reference|log|columns) -->\n(.*?)<!-- /", re.DOTALL)
KEY = re.compile(r"^\| \*{0,2}`\[{0,2}([\w.]+)\]{0,2}`\*{0,2} \| (.*) \|$", re.MULTILINE)
GLOSSARY = re.compile(r"^## Glossary\n(.*?)(?=^## |\Z)", re.MULTILINE | re.DOTALL)
TABLE = re.compile(r"^\|(.*)\|\n\|[-|]*\|\n((?:^\|.*\|\n?)+)", re.MULTILINE)
LABEL_ENDS = (
    r"(, at|,| at) ([\d.]+ Hz|at rest)$",
    r", if .*$",
    r": .*$",
    r" [A-Za-z](_\w+)?$",
    r"_(hz|db|deg|s|per_s)$",
)
"""Pattern of an ending that a table's label or a JSON key adds to a word: a frequency, the number of a part, a symbol,
a unit."""
TURNING = (("inertia", "mass"), ("torque", "force"))
"""Words for a rotary device, each with the corresponding word for a linear device."""
CLAIMS_GUIDE = "vctune/proof/README.md"
CELLS = re.compile(r"(?<!\\)\|")


@dataclass(frozen=True, slots=True)
class Entry:
    """The text of the guides on one name.

    Attributes
    ----------
    kind : "code", "key", "term" or "claim"
    names : names under which `vctune explain` finds the entry
    text : text in Markdown
    guide : path of the guide that contains it
    """

    kind: Literal["code", "key", "term", "claim"]
    names: tuple[str, ...]
    text: str
    guide: str


def explain(name: str) -> ExplanationRecord:
    """Return the guides' text on a code, a key of a file, a word of the glossary or a claim.

    Parameters
    ----------
    name : a code, as in the brackets after a message; a key, complete or only its last part; a word or symbol of the
        glossary; or a claim's identifier or label

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
    asked = _plain(name)
    found = next(filter(None, map(_called, _alike(asked))), [])
    found = found or next(filter(None, (_called(each.lower(), str.lower) for each in _alike(asked))), [])
    if not found:
        names = [name for entry in entries() for name in entry.names]
        known = {_plain(each).lower(): each for name in names for each in (name, name.rpartition(".")[2])}
        meant = [known[near] for near in get_close_matches(asked.lower(), known, n=3, cutoff=0.6)]
        hint = f"did you mean {' or '.join(meant)}?" if meant else "`vctune explain` lists what there is"
        raise InputError.of(name, "unknown-name", f"is no code, key, claim or word of the glossary; {hint}")
    records = [EntryRecord(kind=entry.kind, name=entry.names[0], text=entry.text, guide=entry.guide) for entry in found]
    return ExplanationRecord(name=name, entries=records)


def contents() -> ExplanationRecord:
    """Return all names that `explain` knows, without their texts."""
    listed = [EntryRecord(kind=each.kind, name=each.names[0], text="", guide=each.guide) for each in entries()]
    return ExplanationRecord(name=None, entries=listed)


def _alike(asked: str) -> Iterator[str]:
    """Yield the names under which the guides may explain a label: the whole label, and the label without its variable
    parts."""
    linear = reduce(lambda words, pair: words.replace(*pair), TURNING, asked)
    stems = [re.sub(end, "", linear) for end in ("", *LABEL_ENDS)]
    yield from dict.fromkeys([asked, *stems, *(stem.replace("_", " ") for stem in stems)])


def _called(asked: str, compared: Callable[[str], str] = str) -> list[Entry]:
    """Return the entries of a name. If there is none, return the keys whose last part is the name."""
    return [
        entry
        for entry in entries()
        if asked in [compared(_plain(each)) for each in entry.names]
        or (entry.kind == "key" and entry.names[0].endswith(f".{asked}"))
    ]


@cache
def entries() -> tuple[Entry, ...]:
    """Return all entries, in the order of the guides."""
    told = (entry for guide, text in _guides(files("vctune"), "vctune") for entry in _entries(guide, text))
    return (*told, *map(_claim, CLAIMS.values()))


def _claim(claim: Claim) -> Entry:
    said = "; ".join(f"“{sentence}”" for sentence in dict.fromkeys(map(claim.said_of, DISPLAYS.values())))
    said = f"The certificate's claim {said}."
    proof = f"Proved by `vctune.{claim.margin}`. Its witness is {claim.witness}."
    return Entry("claim", (claim.id, claim.label), "\n\n".join([said, claim.explain, proof]), CLAIMS_GUIDE)


def _guides(folder: Traversable, place: str) -> Iterator[tuple[str, str]]:
    """Yield the path and the text of each guide of the package."""
    for child in sorted(folder.iterdir(), key=lambda each: (each.is_dir(), each.name)):
        if child.is_dir():
            yield from _guides(child, f"{place}/{child.name}")
        elif child.name == GUIDE:
            yield f"{place}/{GUIDE}", child.read_text(encoding="utf-8")


def _entries(guide: str, text: str) -> Iterator[Entry]:
    for code, page in CODE.findall(text):
        yield Entry("code", (code,), page.strip(), guide)
    for reference in KEYS.findall(text):
        rows = KEY.findall(reference)
        for key, meaning in rows:
            inner = [f"- `{other}`: {of}" for other, of in rows if other.rpartition(".")[0] == key]
            linear, rotary = (unit_of(tuple(key.split(".")), units) for units in (LINEAR, ROTARY))
            turned = f" Unit for a rotary device: {rotary}." if linear != rotary else ""
            yield Entry("key", (key,), "\n".join([meaning + turned, *(["", *inner] if inner else [])]), guide)
    for glossary in GLOSSARY.findall(text):
        for heads, rows in TABLE.findall(glossary):
            yield from (_term(guide, _cells(heads), _cells(row.strip("|"))) for row in rows.splitlines())


def _cells(row: str) -> list[str]:
    return [cell.strip() for cell in CELLS.split(row)]


def _term(guide: str, heads: list[str], cells: list[str]) -> Entry:
    """Return a glossary row as an entry. If the row has several words or symbols, each is a name of the entry."""
    row = {head: cell.replace("\\|", "|") for head, cell in zip(heads, cells, strict=True)}
    symbols = [part for part in re.findall(r"\$([^$]*)\$|([^$,]+)", row.get("symbol", "")) for part in part if part]
    terms = row["term"].split(", ")
    names = [*terms, *(symbol.split(" = ")[0] for symbol in symbols)]
    names += [term.split()[-1] for term in terms if re.search(r" [A-Za-z]_\w+$", term)]
    names += re.findall(r"`(?:\w+\.)*([a-z]+_\w+)`", row.get("in the code", ""))
    said = [f"{label}: {row[label]}" for label in ("symbol", "unit", "in the code") if row.get(label)]
    text = "\n\n".join([row["meaning"], "; ".join(said)]) if said else row["meaning"]
    return Entry("term", (row["term"], *names), text, guide)


def _plain(name: str) -> str:
    """Return a name in the form used for comparisons: without quotes, brackets and formula marks."""
    return re.sub(r"[\[\]`$\\{}\"']", "", name).strip()
