"""Makes the tables of the guides that stand between two comments; `python tests/promises/guide_tables.py` writes them.

The keys come from the schemas of the files, the claims from the registry, and the columns from the records of rows.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from vctune.document.records.part import how_shown
from vctune.document.schema.log_schema import LogDocument
from vctune.document.schema.problem_schema import json_schema
from vctune.document.schema.validation import schema_of
from vctune.model.display import DISPLAYS
from vctune.model.fields import MOST
from vctune.model.numbers.units import LINEAR
from vctune.proof.claims.registry import CLAIMS
from vctune.study.row_record import ROW_PARTS, RowRecord

Schema = dict[str, Any]
ROOT = Path(__file__).parents[2]


def with_table(text: str, name: str) -> str:
    """Return the text of a guide with the table between the comments of this name made anew."""
    before, start, rest = text.partition(f"<!-- {name} -->\n")
    _, end, after = rest.partition(f"<!-- /{name} -->\n")
    assert start and end, f"the guide has no lines <!-- {name} --> and <!-- /{name} -->"
    return before + start + TABLES[name][1]() + end + after


def keys(schema: Schema, elsewhere: Schema | None = None) -> str:
    """Return the keys of a file as a table, without those of tables that the schema `elsewhere` has too."""
    return _table("key | value | meaning", _keys_in(schema, schema, "", (elsewhere or {}).get("$defs", {})))


def _keys_in(schema: Schema, table: Schema, prefix: str, known: Schema) -> Iterator[tuple[str, str, str]]:
    """Yield the rows of a table's keys, plain ones first as TOML has them; of tables that several keys share, one."""
    tables = {key: _tables_of(schema, entry) for key, entry in table["properties"].items()}
    shared = Counter(id(form) for forms in tables.values() for form in forms)
    for key in sorted(tables, key=lambda key: bool(tables[key]) and not tables[key][0]["properties"].keys() <= RANGE):
        entry, name, own = table["properties"][key], f"{prefix}{key}", [x for x in tables[key] if shared[id(x)] == 1]
        required = ["required"] if key in table.get("required", ()) else []
        for form in own:
            there = form["title"] in known
            shown = f"[[{name}]]" if entry.get("type") == "array" else f"[{name}]"
            value = [_values(schema, entry)] if "oneOf" in entry and len(own) == 1 else []
            yield (
                f"**`{shown}`**",
                ", ".join(value + required),
                _said(entry, form) + (" Keys as in a problem file." if there else ""),
            )
            yield from () if there else _keys_in(schema, form, f"{name}.", known)
        if not own:
            yield f"`{name}`", ", ".join([_values(schema, entry), *required]), _said(entry)
    for form in {id(form): form for forms in tables.values() for form in forms if shared[id(form)] > 1}.values():
        yield f"**`[{prefix}NAME]`**", "", _said({}, form)
        yield from _keys_in(schema, form, f"{prefix}NAME.", known)


def _forms(schema: Schema, entry: Schema) -> list[Schema]:
    """Return the forms of a key's value, each without references."""
    if "$ref" in entry:
        return [schema["$defs"][entry["$ref"].removeprefix("#/$defs/")]]
    return [form for one in entry.get("oneOf", ()) for form in _forms(schema, one)] or [entry]


RANGE = {"min", "max"}


def _is_range(form: Schema) -> bool:
    """Return whether a table is bounds without defaults, which the row of its key states."""
    return set(form.get("required", ())) == RANGE == form["properties"].keys()


def _tables_of(schema: Schema, entry: Schema) -> list[Schema]:
    """Return the tables that a key may hold, one or many of them, and that have rows of their own."""
    forms = [form for one in _forms(schema, entry) for form in _forms(schema, one.get("items", one))]
    return [form for form in forms if "properties" in form and not _is_range(form)]


def _values(schema: Schema, entry: Schema) -> str:
    """Return the values that a key may have, in words."""
    return ", or ".join(_value(schema, form) for form in _forms(schema, entry))


def _value(schema: Schema, form: Schema) -> str:
    """Return the values of one form: a choice, a text, a list, a table, or a number and its limits."""
    if "enum" in form:
        return ", ".join(f'"{each}"' for each in form["enum"])
    if "prefixItems" in form:
        return f"[{', '.join(_value(schema, each) for each in form['prefixItems'])}]"
    if "items" in form:
        return f"[{_values(schema, form['items'])}, ...]"
    if "properties" in form:
        return f"{{ {', '.join(form['properties'])} }}" if form["properties"].keys() <= RANGE else "table"
    return {"string": "text", "boolean": "true, false"}.get(form["type"]) or _number(form)


def _number(form: Schema) -> str:
    """Return the limits of a number; those that only keep numbers within the reach of floats are left out."""
    low, high, below = form.get("minimum"), form.get("maximum"), form.get("exclusiveMaximum")
    if form["type"] == "integer":
        return f"{low} or {high}" if high == low + 1 else f"{low} to {high}"
    if low is None or low < 0:
        return "number"
    limits = [f">= {low:g}" if low == 0 else "> 0"]
    limits += [f"<= {high:g}"] if high is not None and high < MOST else [f"< {below:g}"] if below is not None else []
    return ", ".join(limits) + (" or inf" if high is None and below is None else "")


def _said(entry: Schema, table: Schema | None = None) -> str:
    """Return what a key means, or the table that it holds, with its default."""
    own, general = entry.get("description", ""), (table or {}).get("description", "")
    default = entry.get("default", "") if table is None else ""
    shown = "" if default == "" else f" Default {json.dumps(default)}."
    return " ".join(f"{'' if own and not own.startswith('Default') else general} {own}{shown}".split())


def claims() -> str:
    """Return the claims that a certificate makes as a table."""
    return _table(
        "id | claim | made | meaning", ((f"`{x.id}`", _sentences(x), x.when, x.explain) for x in CLAIMS.values())
    )


def _sentences(claim: Any) -> str:
    return "; ".join(dict.fromkeys(map(claim.said_of, DISPLAYS.values())))


def columns() -> str:
    """Return the columns of a study's table that are no axes, in groups."""
    own = RowRecord.model_fields
    rows = [(f"`{name}`", str(own[name].description)) for name in ("status", "idle", "reason")]
    for part in ROW_PARTS:
        rows.append(("", f"**{' '.join(str(part.__doc__).split())}**"))
        for name, shown in how_shown(part).items():
            rows.append((f"`{name}`", ", ".join(filter(None, (shown.label, LINEAR.of(shown.of) or shown.unit)))))
    return _table("column | meaning", [*rows[:2], *rows[3:], rows[2]])


def _table(heads: str, rows: Any) -> str:
    """Return rows as a table in Markdown."""
    lines = [" | ".join(cell.replace("|", r"\|") for cell in row) for row in rows]
    border = "|" + "---|" * len(heads.split(" | ")) + "\n"
    return f"| {heads} |\n{border}" + "".join(f"| {line} |\n" for line in lines)


# Guide of each table, and the function that makes it
TABLES: dict[str, tuple[str, Callable[[], str]]] = {
    "reference": ("vctune/document/README.md", partial(keys, json_schema())),
    "log": ("vctune/identification/README.md", partial(keys, schema_of(LogDocument, "vctune log"), json_schema())),
    "claims": ("vctune/proof/README.md", claims),
    "columns": ("vctune/study/README.md", columns),
}


if __name__ == "__main__":
    for name, (guide, _) in TABLES.items():
        page = ROOT / guide
        page.write_text(with_table(page.read_text(encoding="utf-8"), name), encoding="utf-8")
