"""Compute only once the parts that many boxes have in common, such as the plant of one hand at all its frequencies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from vctune.model.numbers.arithmetic import Number
from vctune.proof.enclosures.intervals import Enclosure
from vctune.proof.enclosures.taylor import Taylor


def shared(f: Callable[..., Any], rows: Sequence[Number]) -> Any:
    """Evaluate f on the rows of boxes, once for each set of boxes that have equal rows."""
    plain = [_values(row) for row in rows]
    n = max(np.size(row.mid) for row in plain)
    columns = np.stack([np.broadcast_to(part, n) for row in plain for part in (row.mid, row.rad)], axis=1)
    as_bytes = np.ascontiguousarray(columns).view(np.dtype((np.void, columns.itemsize * columns.shape[1]))).ravel()
    _, first, inverse = np.unique(as_bytes, return_index=True, return_inverse=True)
    found = f(*(_selected(row, first) for row in rows))
    return _mapped(lambda number: _selected(number, inverse), found)


def _values(row: Number) -> Enclosure:
    """Return an enclosure of all values of a row."""
    if isinstance(row, Taylor):
        return row.enclosed()
    return row


def _selected(number: Number, at: Any) -> Number:
    """Return some of a number's elements. A number with a single element stays as it is."""
    if isinstance(number, Taylor):
        return number.subset(at)
    if np.size(number.mid) > 1:
        return number.subset(at)
    return (
        number
        if np.size(number.rad) == 1
        else Enclosure(np.broadcast_to(number.mid, number.rad.shape), number.rad).subset(at)
    )


def _mapped(f: Callable[[Number], Number], tree: Any) -> Any:
    """Apply f to the numbers of a tree."""
    if isinstance(tree, Enclosure | Taylor):
        return f(tree)
    if isinstance(tree, tuple):
        return tuple(_mapped(f, part) for part in tree)
    if is_dataclass(tree) and not isinstance(tree, type):
        return replace(tree, **{field.name: _mapped(f, getattr(tree, field.name)) for field in fields(tree)})
    return tree
