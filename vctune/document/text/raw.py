"""Get and set numbers of a document whose other parts may be invalid."""

from __future__ import annotations

from collections.abc import Iterable
from copy import deepcopy
from itertools import pairwise
from typing import Any


def number_at(raw: dict[str, Any], *path: str | int) -> float | None:
    """Return the number at a path; None if there is none, or if its magnitude is 1e300 or more, as for inf."""
    node: Any = raw
    for step in path:
        try:
            node = node[step]
        except (KeyError, IndexError, TypeError):
            return None
    return float(node) if isinstance(node, int | float) and not isinstance(node, bool) and abs(node) < 1e300 else None


def placed(document: dict[str, Any], numbers: Iterable[tuple[tuple[str | int, ...], float]]) -> dict[str, Any]:
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
