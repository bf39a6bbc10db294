"""Numbers of a document that may be wrong elsewhere."""

from __future__ import annotations

from typing import Any


def number_at(raw: dict[str, Any], *path: str | int) -> float | None:
    """Return the number at a path, or None where there is none that is finite."""
    node: Any = raw
    for step in path:
        try:
            node = node[step]
        except (KeyError, IndexError, TypeError):
            return None
    return float(node) if isinstance(node, int | float) and not isinstance(node, bool) and abs(node) < 1e300 else None
