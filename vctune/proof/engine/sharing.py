"""Compute only once the parts that many boxes have in common, such as the plant of one hand at all its frequencies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from vctune.model.numbers.arithmetic import Number
from vctune.proof.enclosures.array_intervals import Enclosure, raised, selected
from vctune.proof.enclosures.jets import Jet
from vctune.proof.enclosures.taylor import Taylor


def shared(f: Callable[..., Any], rows: Sequence[Number]) -> Any:
    """Evaluate f on the rows of boxes, once for each set of boxes that have equal rows."""
    plain = [_values(row) for row in rows]
    n = max(np.size(row.mid) for row in plain)
    columns = np.stack([np.broadcast_to(part, n) for row in plain for part in (row.mid, row.rad)], axis=1)
    as_bytes = np.ascontiguousarray(columns).view(np.dtype((np.void, columns.itemsize * columns.shape[1]))).ravel()
    _, first, inverse = np.unique(as_bytes, return_index=True, return_inverse=True)
    few = [_selected(row, first) for row in rows]
    found, radii = f(*few), {}
    for row in few:
        if isinstance(row, Jet):
            radii[next(place for place, slope in enumerate(row.slopes) if slope is not None)] = row.value.rad
    if radii:
        middle = f(*(Enclosure(row.value.mid) if isinstance(row, Jet) else row for row in few))
        found = _map_trees(lambda over, at: _narrowed(over, at, radii), found, middle)
    return _map_trees(lambda number: _selected(number, inverse), found)


def _values(row: Number) -> Enclosure:
    """Return an enclosure of all values of a row."""
    if isinstance(row, Taylor):
        return row.enclosed()
    return row.value if isinstance(row, Jet) else row


def _narrowed(over: Number, at: Number, radii: dict[int, Any]) -> Number:
    """Return a number over a box, narrowed by the value at the middle and by the slopes."""
    if not isinstance(over, Jet):
        return over
    slopes = [(over.slopes[place], rad) for place, rad in radii.items() if place < len(over.slopes)]
    reach = sum((np.abs(slope.mid) + slope.rad) * rad for slope, rad in slopes if slope is not None)
    rad = raised(at.rad + reach, 1 + len(slopes))
    return Jet(selected(np.asarray(rad < over.value.rad), Enclosure(at.mid, rad), over.value), over.slopes)


def _selected(number: Number, at: Any) -> Number:
    """Return some of a number's elements. A number with a single element stays as it is."""
    if isinstance(number, Jet):
        slopes = tuple(None if slope is None else _selected(slope, at) for slope in number.slopes)
        return Jet(_selected(number.value, at), slopes)
    if isinstance(number, Taylor):
        return number.subset(at)
    if np.size(number.mid) > 1:
        return number.subset(at)
    return (
        number
        if np.size(number.rad) == 1
        else Enclosure(np.broadcast_to(number.mid, number.rad.shape), number.rad).subset(at)
    )


def _map_trees(f: Callable[..., Number], *trees: Any) -> Any:
    """Apply f to the numbers of several trees of the same shape. Everything else comes from the first tree."""
    first = trees[0]
    if isinstance(first, Enclosure | Jet | Taylor):
        return f(*trees)
    if isinstance(first, tuple):
        return tuple(_map_trees(f, *parts) for parts in zip(*trees, strict=True))
    if is_dataclass(first) and not isinstance(first, type):
        names = [field.name for field in fields(first)]
        return replace(first, **{name: _map_trees(f, *(getattr(tree, name) for tree in trees)) for name in names})
    return first
