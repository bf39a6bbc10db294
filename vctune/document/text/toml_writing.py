"""Write a document as TOML text, which `vctune.document.text.toml` reads."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any


def toml_text(document: Mapping[str, Any]) -> str:
    """Return the TOML text of a document."""
    plain = {key: value for key, value in document.items() if not _headed(value)}
    blocks = ["\n".join(_entries(plain))] if plain else []
    for key, value in document.items():
        if isinstance(value, Mapping):
            blocks.append("\n".join([f"[{_key(key)}]", *_entries(value)]))
        elif _headed(value):
            blocks += ["\n".join([f"[[{_key(key)}]]", *_entries(table)]) for table in value]
    return "\n\n".join(blocks) + "\n"


def quoted(text: str) -> str:
    """Return a TOML basic string. JSON's escapes are valid in TOML. TOML must also escape DEL."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _headed(value: Any) -> bool:
    """Return whether TOML writes a value under headings, because it is a table or a list of tables."""
    tables = isinstance(value, list | tuple) and len(value) > 0 and all(isinstance(item, Mapping) for item in value)
    return isinstance(value, Mapping) or tables


def _entries(table: Mapping[str, Any]) -> Iterator[str]:
    return (f"{_key(key)} = {_value(value)}" for key, value in table.items())


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else quoted(key)


def _value(value: Any) -> str:
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        return f"{{ {', '.join(_entries(value))} }}" if value else "{}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    return repr(value)
