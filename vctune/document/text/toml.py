"""Read TOML, find its lines, get and set numbers of its tables, and write it."""

from __future__ import annotations

import json
import re
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

from vctune.document.text.errors import InputError
from vctune.document.text.hints import hint_on_line

MAX_BYTES = 100_000  # Greatest size of a file that people write, bytes
STDIN = Path("-")  # Path that stands for standard input instead of a file

KeyPath = Sequence[str | int]


def read_text(path: Path) -> str:
    """Return the text of a small UTF-8 file, or of standard input for "-"."""
    source = str(called(path))
    if path == STDIN and (sys.stdin is None or sys.stdin.buffer.closed):
        raise InputError.of(source, "unreadable-file", "is closed, or has been read already; name a file")
    try:
        with sys.stdin.buffer if path == STDIN else path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise InputError.of(source, "unreadable-file", "no such file") from None
    except IsADirectoryError:
        raise InputError.of(source, "unreadable-file", "is a directory; name the file in it") from None
    except OSError as error:
        raise InputError.of(source, "unreadable-file", f"cannot be read: {error.strerror}") from None
    except ValueError:
        raise InputError.of(source, "unreadable-file", "is no path: it contains a null character") from None
    if len(data) > MAX_BYTES:
        raise InputError.of(source, "unreadable-file", f"is longer than {MAX_BYTES} bytes; this is not a vctune file")
    return decoded(data, source, "save it as UTF-8")


def decoded(data: bytes, source: str, remedy: str) -> str:
    """Return the text of a file in UTF-8."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        message = f"is not UTF-8 text (byte 0x{data[error.start]:02x}); {remedy}"
        raise InputError.of(source, "unreadable-file", message, line=line) from None


def called(path: Path) -> Path:
    """Return the name of a file for messages: its path, or "stdin"."""
    return Path("stdin") if path == STDIN else path


def parse(text: str, source: str) -> dict[str, Any]:
    """Parse TOML."""
    try:
        return unlisted(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        match = re.search(r"\(at (?:line (\d+), column \d+|end of document)\)", str(error))
        line = int(match[1]) if match and match[1] else text.count("\n") + 1
        message = re.sub(r"\s*\(at .*\)$", "", str(error))
        hint = hint_on_line(text.splitlines()[line - 1]) if line <= len(text.splitlines()) else ""
        if text.lstrip().startswith("{"):
            hint = "; this is JSON: the gains of a design.json are in the gains.toml beside it"
        raise InputError.of(source, "not-toml", f"not valid TOML: {message[:200]}{hint}", line=line) from None
    except RecursionError:
        raise InputError.of(source, "not-toml", "not valid TOML: nested too deeply") from None
    except ValueError:
        raise InputError.of(source, "not-toml", "not valid TOML: a number has thousands of digits") from None


def unlisted(raw: dict[str, Any]) -> dict[str, Any]:
    """Return tables in which [[device.structure]] is a table for each spring: structure, structure_2, structure_3."""
    device = raw.get("device")
    if not isinstance(device, dict) or "structure_2" in device:
        return raw
    listed = device.get("structure")
    if not isinstance(listed, list) or not listed:
        return raw
    named = {f"structure_{k + 1}" if k else "structure": one for k, one in enumerate(listed)}
    return raw | {"device": device | named}


class Lines:
    """Finds the line of a key in a TOML text."""

    def __init__(self, text: str) -> None:
        self._lines = [line + "\n" for line in text.split("\n")]
        self._parsed: dict[int, dict[str, Any] | None] = {}

    def locate(self, path: KeyPath) -> int | None:
        """Return the line on which the key at `path` starts; None if the text does not have the key."""
        without, having = 0, len(self._lines)
        if not self._has(having, path):
            return None
        while (probe := self._parsable_between(without, having)) is not None:
            if self._has(probe, path):
                having = probe
            else:
                without = probe
        return without + 1

    def nearest(self, path: KeyPath) -> int:
        """Return the line of a key or, if it is absent, of the innermost table that should contain it."""
        return next((line for end in range(len(path), 0, -1) if (line := self.locate(path[:end]))), 1)

    def _beginning(self, count: int) -> dict[str, Any] | None:
        """Return the first lines of the text, parsed; None if they do not parse."""
        if count not in self._parsed:
            try:
                self._parsed[count] = unlisted(tomllib.loads("".join(self._lines[:count])))
            except (ValueError, RecursionError):
                self._parsed[count] = None
        return self._parsed[count]

    def _has(self, count: int, path: KeyPath) -> bool:
        """Return whether the first lines of the text have a key."""
        return value_at(self._beginning(count), path) is not None

    def _parsable_between(self, without: int, having: int) -> int | None:
        """Return a count of first lines that parse, as near the middle of two counts as possible; None if none does."""
        middle = (without + having) // 2
        outwards = chain(range(middle, having), range(middle - 1, without, -1))
        return next((n for n in outwards if n > without and self._beginning(n) is not None), None)


def value_at(raw: Any, path: KeyPath) -> Any:
    """Return the value at a path; None if there is none."""
    node: Any = raw
    for step in path:
        try:
            node = node[step]
        except (KeyError, IndexError, TypeError):
            return None
    return node


def number_at(raw: dict[str, Any], *path: str | int) -> float | None:
    """Return the number at a path; None if there is none, or if its magnitude is 1e300 or more, as for inf."""
    value = value_at(raw, path)
    return (
        float(value) if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300 else None
    )


def placed(document: dict[str, Any], numbers: Iterable[tuple[KeyPath, Any]]) -> dict[str, Any]:
    """Return a copy of a document with numbers set at their paths. The function creates missing tables and pairs."""
    copy = deepcopy(document)
    for path, number in numbers:
        node: Any = copy
        for step, inner in pairwise(path):
            if isinstance(node, dict) and not isinstance(node.get(step), dict | list):
                node[step] = [None, None] if isinstance(inner, int) else {}
            node = node[step]
        node[path[-1]] = number
    return copy


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
