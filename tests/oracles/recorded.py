"""Answers that were right: how a recorded one and one of today differ."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from math import isclose, isfinite
from typing import Any

import numpy as np
from conftest import ROOT

FILE = ROOT / "tests/golden.json"
RECORDS: dict[str, Any] = json.loads(FILE.read_text()) if FILE.exists() else {}
DIGITS = 6
OF_WORDS = 3e-3
"""Relative difference of numbers in words, which are rounded, that says nothing."""
SOUGHT, PLACES = 3e-3, ("hand", "worst", "hz", "witness")
"""Relative difference of a place at which something is least or greatest, and words in the keys of such places."""
WORK = 0.2
"""Relative difference of the boxes of a proof: more of them make it slower, fewer prove less than the whole."""
ELSEWHERE = ("versions", "sha256", "problem", "schema", "solver", "curve")
"""Parts of a record that are of the release or of the input, and traces, whose pictures are looked at."""
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")


def changes(name: str, answer: Any, near: float = 1e-4) -> list[str]:
    """Return how an answer differs from its record, which is replaced by it if VCTUNE_REFRESH is set."""
    now = plain(answer)
    then = RECORDS.get(name)
    if os.environ.get("VCTUNE_REFRESH"):
        RECORDS[name] = now
        lines = (f"{json.dumps(each)}: {json.dumps(RECORDS[each], separators=(',', ':'))}" for each in sorted(RECORDS))
        FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n")
    return [*differences(then, now, near)]


def plain(part: Any) -> Any:
    """Return a part of an answer as JSON without what is null and without rounding errors of the last digits."""
    if isinstance(part, dict):
        return {str(key): plain(value) for key, value in part.items() if key not in ELSEWHERE and value is not None}
    if isinstance(part, list | tuple | np.ndarray):
        return [plain(value) for value in part]
    if isinstance(part, float | np.floating):
        return float(f"{part:.{DIGITS}g}") if isfinite(part) else str(part)
    return part


def differences(then: Any, now: Any, near: float, path: str = "") -> Iterator[str]:
    """Yield each part of an answer that is not as it was, with its path."""
    if isinstance(then, dict) and isinstance(now, dict):
        for key in sorted(then.keys() | now.keys()):
            sought = max(near, SOUGHT) if any(word in key for word in PLACES) else near
            yield from differences(then.get(key), now.get(key), WORK if key == "boxes" else sought, f"{path}.{key}")
    elif isinstance(then, list) and isinstance(now, list) and len(then) == len(now):
        for k, (one, other) in enumerate(zip(then, now, strict=True)):
            yield from differences(one, other, near, f"{path}[{k}]")
    elif not alike(then, now, near):
        yield f"{path} was {then!r} and is {now!r}"


def alike(then: Any, now: Any, near: float) -> bool:
    """Return whether two values say the same: numbers up to rounding, also those in words."""
    if isinstance(then, str) and isinstance(now, str):
        numbers = zip(NUMBER.findall(then), NUMBER.findall(now), strict=False)
        return NUMBER.sub("0", then) == NUMBER.sub("0", now) and all(
            isclose(
                float(one), float(other), rel_tol=OF_WORDS, abs_tol=max(1e-12, 1.01 * last(one), 1.01 * last(other))
            )
            for one, other in numbers
        )
    if isinstance(then, bool) or isinstance(now, bool) or None in (then, now) or isinstance(then, str | list | dict):
        return bool(then == now)
    return isclose(then, now, rel_tol=near, abs_tol=1e-12)


def last(number: str) -> float:
    """Return one unit in the last place of a number in words, by which a rounding may differ; 0 of a whole number."""
    digits, _, exponent = number.partition("e")
    whole = "." not in digits and not exponent
    return 0.0 if whole else 10.0 ** (int(exponent or 0) - len(digits.partition(".")[2]))
