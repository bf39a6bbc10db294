"""Processor time by parts of the work: chosen functions count their own time, whatever they call of other parts not."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from importlib import import_module
from time import process_time
from typing import Any

Parts = dict[str, tuple[str, ...]]
"""Functions by the part that they belong to, as module:name."""


@contextmanager
def charged(parts: Parts) -> Iterator[dict[str, float]]:
    """Give the seconds that each part takes in the block; functions of vctune are found wherever they are imported."""
    spent = dict.fromkeys(parts, 0.0)
    open_calls: list[list[float]] = []
    replaced: list[tuple[Any, str, Any]] = []
    try:
        for part, names in parts.items():
            for name in names:
                for owner, attribute, function in _places(name):
                    replaced.append((owner, attribute, function))
                    setattr(owner, attribute, _counting(function, part, spent, open_calls))
        yield spent
    finally:
        for owner, attribute, function in reversed(replaced):
            setattr(owner, attribute, function)


def _places(name: str) -> list[tuple[Any, str, Any]]:
    """Return where a function is known, by which name, and the function."""
    module, _, path = name.partition(":")
    *owners, attribute = path.split(".")
    owner: Any = import_module(module)
    for each in owners:
        owner = getattr(owner, each)
    function = getattr(owner, attribute)
    if owners:
        return [(owner, attribute, function)]
    known = [each for key, each in sys.modules.items() if key.startswith("vctune.")]
    return [(each, key, function) for each in known for key, value in vars(each).items() if value is function]


def _counting(
    function: Callable[..., Any], part: str, spent: dict[str, float], open_calls: list[list[float]]
) -> Callable[..., Any]:
    """Return the function with its time, less that of counted calls within, added to its part."""

    @wraps(function)
    def counted(*given: Any, **named: Any) -> Any:
        began, inner = process_time(), [0.0]
        open_calls.append(inner)
        try:
            return function(*given, **named)
        finally:
            took = process_time() - began
            open_calls.pop()
            spent[part] += took - inner[0]
            if open_calls:
                open_calls[-1][0] += took

    return counted
