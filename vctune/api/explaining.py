"""Provide `vctune explain` and `vctune example` as functions.

The text on a key comes from the schema of its file, on a code from the table of codes, on a term from the glossary, and
on a claim from the table of claims.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from vctune.api.json_schemas import SCHEMAS
from vctune.document.text.errors import InputError
from vctune.document.text.json import printed
from vctune.document.text.output_files import make_folder, write_together
from vctune.model.display import DISPLAYS
from vctune.model.numbers.units import LINEAR, SAME, UNIT
from vctune.proof.claims.registry import CLAIMS
from vctune.study.row_record import SHOWN_COLUMNS

# Guides with the table of codes, the glossary, the claims, and the columns of a sweep
CODES, TERMS, PROOFS, COLUMNS = (f"vctune/{place}README.md" for place in ("cli/", "", "proof/", "study/"))
DEVICES = "vctune/document/off-the-menu.md"  # Guide to devices that have no key of their own
TASKS = "docs/README.md"  # Guide with the index of tasks, in a checkout; an installed package has it inside
FILES = {"problem": "vctune/document/README.md", "log": "vctune/identification/README.md"}  # guide of each kind of file
TABLE = re.compile(r"^\|(.*)\|\n\|[-|]*\|\n((?:^\|.*\|\n?)+)", re.MULTILINE)  # A table in Markdown: heads and rows
CELLS = re.compile(r"(?<!\\)\|")  # The border between two cells: "|", but not "\|"
# What labels of tables and JSON keys add to a term: a frequency, a condition, a text, a symbol, a unit
MENTIONED = 6  # Number of entries that are named for a word that is in their texts
MISTYPED = 0.85  # Least likeness of a word that the user may have meant; what is less alike is another word
ENDINGS = (r"(, at|,| at) ([\d.]+ Hz|at rest)$", r", if .*$", r": .*$", r" [A-Za-z](_\w+)?$", r"_(hz|db|deg|s|per_s)$")
LINK = re.compile(r"\[([^]]*)\]\(([^)#]*)[^)]*\)")  # a link in Markdown: its text and its file
PROBLEMS, SCHEMA_LINE = "problems", re.compile(r"\A#:schema .*\n")


@dataclass(frozen=True, slots=True)
class Entry:
    """The text on one name, in Markdown."""

    kind: str  # "code", "key", "term", "device", "claim" or "task"
    names: tuple[str, ...]
    text: str
    guide: str  # path of the guide about it

    @property
    def name(self) -> str:
        """The first name."""
        return self.names[0]


@dataclass(frozen=True, slots=True)
class Explanation:
    """The entries of a name; all entries without one."""

    name: str | None
    entries: list[Entry]

    def to_json(self) -> dict[str, Any]:
        """Return the object for JSON; the list of all names has no texts."""
        found = [
            {"kind": each.kind, "name": each.name, "text": each.text if self.name else "", "guide": each.guide}
            for each in self.entries
        ]
        return printed("explanation", name=self.name, entries=found)


def explain(name: str) -> Explanation:
    """Return the text on a code, a key of a file, a word of the glossary, a kind of device or a claim.

    Parameters
    ----------
    name : str
        A code, as in the brackets after a message; a key, complete or only its last part; a word or symbol of
        the glossary; a word for a device that has no key; or a claim's identifier or label.

    Returns
    -------
    Explanation
        `entries`; each has its `kind` ("code", "key", "term", "device", "claim" or "task"), its `name`, its `text` in
        Markdown, and its `guide`.

    Raises
    ------
    InputError
        If no entry has this name; the message suggests the nearest names.
    """
    asked = _plain(name)
    linear = asked.replace("inertia", "mass").replace("torque", "force")
    stems = [re.sub(end, "", linear) for end in ("$", *ENDINGS)]
    known = {fold: _by_name(fold) for fold in (str, str.lower)}
    for fold, entries_of in known.items():
        for label in (asked, *stems, *(stem.replace("_", " ") for stem in stems)):
            if found := entries_of.get(fold(label)):
                return Explanation(name, found)
    near, there = nearest(asked), mentioning(asked)
    hint = "`vctune explain tasks` lists what there is to do"
    if near or there:
        hint = f"did you mean {' or '.join(near)}?" if near else f"these tell of it: {', '.join(there)}"
    raise InputError.of(name, "unknown-name", f"is no code, key, claim, device or word of the glossary; {hint}")


def nearest(name: str) -> list[str]:
    """Return the names that a user may have meant to type."""
    forms = {_plain(form).lower(): form for each in entries() for form in (*each.names, each.name.rpartition(".")[2])}
    return [forms[form] for form in get_close_matches(_plain(name).lower(), forms, n=3, cutoff=MISTYPED)]


def mentioning(name: str) -> list[str]:
    """Return the names of some entries whose text contains a word, the shortest texts first."""
    word = re.compile(rf"\b{re.escape(_plain(name))}s?\b", re.IGNORECASE)
    if not re.search(r"\w\w", name):
        return []
    found = sorted((each for each in entries() if word.search(each.text)), key=lambda each: len(each.text))
    return list(dict.fromkeys(each.name for each in found if each.kind != "task"))[:MENTIONED]


def tasks() -> str:
    """Return the index of tasks in Markdown, an item for each."""
    found = []
    for row in _tables(_guide(TASKS)):
        page = LINK.sub(lambda link: f"{link[1]}, {link[2].removeprefix('../')}", row["page"])
        found.append(f"- {row['I want to ...']}: {row.get('command') or page}")
    return "\n".join(found)


def _by_name(fold: Any) -> dict[str, list[Entry]]:
    """Return the entries of each name; the last part of a key is a name too."""
    found: dict[str, list[Entry]] = {}
    for entry in entries():
        parts = entry.name.split(".") if entry.kind == "key" else []
        ends = [".".join(parts[k:]) for k in range(1, len(parts))]
        for form in dict.fromkeys(fold(_plain(each)) for each in (*entry.names, *ends)):
            found.setdefault(form, []).append(entry)
    return found


@cache
def entries() -> tuple[Entry, ...]:
    """Return all entries."""
    codes = _rows(CODES, "## 3 Messages\n")
    what = "{meaning}\n\nWhat to do: {what to do}"
    columns = {key: (shown.label, LINEAR.of(shown.of)) for key, shown in SHOWN_COLUMNS.items()}
    return (
        *(Entry("code", (row["code"].strip("`"),), what.format_map(row), CODES) for row in codes),
        *(entry for kind, guide in FILES.items() for entry in _keys(SCHEMAS[kind](), guide)),
        *(
            Entry("key", (key,), f"Column of a sweep: {', '.join(filter(None, said))}.", COLUMNS)
            for key, said in columns.items()
        ),
        *(
            Entry("device", tuple(row["word"].split(", ")), row["what to write"], DEVICES)
            for row in _rows(DEVICES, "## What to write\n")
        ),
        *map(_term, _rows(TERMS, "## Glossary\n")),
        *map(_claim, CLAIMS.values()),
        Entry("task", ("tasks", "index", "help"), tasks(), TASKS),
    )


def _keys(schema: dict[str, Any], guide: str) -> Iterator[Entry]:
    """Yield the keys of a file from its schema; the text on a table lists the keys in it."""
    described = dict(_described(schema, schema, ""))
    for key, text in described.items():
        stated = UNIT.search(text)
        inner = [f"- `{other}`: {said}" for other, said in described.items() if other.rpartition(".")[0] == key]
        unit = f" Unit for a rotary device: {SAME[stated[0]]}." if stated else ""
        yield Entry("key", (key,), "\n".join([text + unit, *(["", *inner] if inner else [])]), guide)


def _described(schema: dict[str, Any], table: dict[str, Any], path: str) -> Iterator[tuple[str, str]]:
    """Yield the keys in a table of a schema, each with its description and its default."""
    for name, entry in table["properties"].items():
        items, key = entry.get("items", {}), f"{path}.{name}" if path else name
        form = items if {"$ref", "oneOf", "anyOf"} & items.keys() else entry  # of a list of tables, the table
        union = form.get("oneOf", form.get("anyOf", [form]))
        forms = [schema["$defs"][one["$ref"].rpartition("/")[2]] for one in union if "$ref" in one]
        # a number or a range is described by the key alone
        texts = [*(forms[:1] if len(forms) == len(union) else []), *([entry] if form is entry else [])]
        said = [str(each["description"]) for each in texts if "description" in each]
        default = entry.get("default")
        if default not in (None, "") and not forms:
            said.append(f"Default {str(default).lower() if isinstance(default, bool) else default}.")
        yield key, " ".join(said)
        for one in forms:
            yield from _described(schema, one, key) if "properties" in one else ()


def _claim(claim: Any) -> Entry:
    """Return a claim: its sentences for all kinds of display, its explanation, its condition and its proof."""
    said = "; ".join(f"“{sentence}”" for sentence in dict.fromkeys(map(claim.said_of, DISPLAYS.values())))
    margin = f"`{claim.margin.__module__}.{claim.margin.__name__}`"
    proof = f"A certificate makes it {claim.when}. Proved by {margin}. Its witness is {claim.witness}."
    text = "\n\n".join([f"The certificate's claim {said}.", claim.explain, proof])
    return Entry("claim", (claim.id, claim.label), text, PROOFS)


def _rows(guide: str, heading: str) -> Iterator[dict[str, str]]:
    """Yield the rows of the tables below a heading of a guide."""
    text = _guide(guide).partition(heading)[2]
    yield from _tables(re.split(r"^## ", text, flags=re.MULTILINE)[0])


def _guide(path: str) -> str:
    """Return the text of a guide."""
    package = Path(str(files("vctune")))
    inside = package / path
    return (inside if inside.is_file() else package.parent / path).read_text(encoding="utf-8")


def _tables(text: str) -> Iterator[dict[str, str]]:
    """Yield the rows of the tables in a text in Markdown."""
    for heads, rows in TABLE.findall(text):
        for row in rows.splitlines():
            cells = (cell.strip().replace("\\|", "|") for cell in CELLS.split(row.strip("|")))
            yield dict(zip((head.strip() for head in heads.split("|")), cells, strict=True))


def _term(row: dict[str, str]) -> Entry:
    """Return a row of the glossary. If the row has several words or symbols, each is a name of the entry."""
    symbols = [part for pair in re.findall(r"\$([^$]*)\$|([^$,]+)", row.get("symbol", "")) for part in pair]
    terms = row["term"].split(", ")
    names = [*terms, *(symbol.split(" = ")[0] for symbol in symbols if symbol.strip())]
    names += [term.split()[-1] for term in terms if re.search(r" [A-Za-z]_\w+$", term)]
    names += re.findall(r"`(?:\w+\.)*([a-z]+_\w+)`", row.get("in the code", ""))
    details = "; ".join(f"{label}: {row[label]}" for label in ("symbol", "unit", "in the code") if row.get(label))
    return Entry("term", (row["term"], *names), "\n\n".join(filter(None, (row["meaning"], details))), TERMS)


def _plain(name: str) -> str:
    """Return a name in the form used for comparisons: without quotes, brackets and formula marks."""
    return re.sub(r"[\[\]`$\\{}\"']", "", name).strip()


def example_names() -> list[str]:
    """Return the names of the example problems: those that show a feature, then devices that people own."""
    return list(_examples())


def example_purpose(name: str) -> str:
    """Return what an example is, from its description, or else the first sentence of its comment."""
    text = _examples()[name].read_text(encoding="utf-8")
    if stated := re.search(r'^description = "(.*)"', text, re.MULTILINE):
        return stated[1]
    comment = " ".join(re.findall(r"^# (.*)", text, re.MULTILINE))
    return re.split(r"[.:] ", comment)[0]


def write_example(name: str, folder: Path) -> Path:
    """Write the problem file of an example, which names the JSON Schema of this installation for editors. The function
    never replaces an existing file."""
    if name not in example_names():
        raise InputError.of(name, "unknown-name", f"is no example; there are: {', '.join(example_names())}")
    schema = (Path(str(files("vctune"))) / "document/problem.schema.json").as_uri()
    text = _examples()[name].read_text(encoding="utf-8")
    path = folder / f"{name}.toml"
    if path.exists():
        raise InputError.of(str(path), "file-exists", "is there already; name another folder by --out, or remove it")
    make_folder(folder)
    write_together({path: SCHEMA_LINE.sub(lambda _: f"#:schema {schema}\n", text)})
    return path


def _examples() -> dict[str, Path]:
    """Return the files of the example problems by name: inside an installed package, or next to the package in a
    checkout."""
    package = Path(str(files("vctune")))
    inside = package / PROBLEMS
    folder = inside if inside.is_dir() else package.parent / PROBLEMS
    paths = (
        path for of in (folder, folder / "devices") for path in sorted(of.glob("*.toml"), key=lambda path: path.stem)
    )
    return {path.stem: path for path in paths}
