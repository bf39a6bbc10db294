"""TOML with line numbers: tomllib parses, and finds the line of a key by parsing beginnings of the text."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from typing import Any

from vctune.document.errors import InputError, Mistake

MAX_BYTES = 1_000_000

KeyPath = Sequence[str | int]


def read_text(path: Path) -> str:
    """Return the text of a small UTF-8 file.

    Raises
    ------
    InputError
        If it is missing, a directory, unreadable, longer than `MAX_BYTES` or not UTF-8.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise InputError(str(path), [Mistake("", "no such file")]) from None
    except IsADirectoryError:
        raise InputError(str(path), [Mistake("", "is a directory; name the .toml file in it")]) from None
    except OSError as error:
        raise InputError(str(path), [Mistake("", f"cannot be read: {error.strerror}")]) from None
    if len(data) > MAX_BYTES:
        raise InputError(str(path), [Mistake("", f"is longer than {MAX_BYTES} bytes; this is not a vctune file")])
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        message = f"is not UTF-8 text (byte 0x{data[error.start]:02x}); save it as UTF-8"
        raise InputError(str(path), [Mistake("", message, line)]) from None


def parse(text: str, source: str) -> dict[str, Any]:
    """Parse TOML.

    Raises
    ------
    InputError
        With the line of the first syntax error.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        found = re.search(r"\(at (?:line (\d+), column \d+|end of document)\)", str(error))
        line = int(found[1]) if found and found[1] else text.count("\n") + 1
        message = re.sub(r"\s*\(at .*\)$", "", str(error))
        raise InputError(source, [Mistake("", f"not valid TOML: {message[:200]}", line)]) from None
    except (RecursionError, ValueError) as error:
        raise InputError(source, [Mistake("", f"not valid TOML: {str(error)[:200] or 'nested too deeply'}")]) from None


def locate(text: str, path: KeyPath) -> int | None:
    """Return the line on which the key at `path` starts, or None if the text does not have it.

    The last line of the longest parsable beginning that lacks the key is the line before it. Whether a beginning
    has the key grows with its length, so a bisection finds the place in a few parses.
    """
    lines = [line + "\n" for line in text.split("\n")]
    without, having = 0, len(lines)
    if not _has(lines, having, path):
        return None
    while (probe := _parsable_between(lines, without, having)) is not None:
        if _has(lines, probe, path):
            having = probe
        else:
            without = probe
    return without + 1


def _parsed(lines: list[str], count: int) -> dict[str, Any] | None:
    try:
        return tomllib.loads("".join(lines[:count]))
    except (ValueError, RecursionError):
        return None


def _has(lines: list[str], count: int, path: KeyPath) -> bool:
    node: Any = _parsed(lines, count)
    for step in path:
        try:
            node = node[step]
        except (KeyError, IndexError, TypeError):
            return False
    return True


def _parsable_between(lines: list[str], without: int, having: int) -> int | None:
    middle = (without + having) // 2
    outwards = chain(range(middle, having), range(middle - 1, without, -1))
    return next((n for n in outwards if n > without and _parsed(lines, n) is not None), None)
