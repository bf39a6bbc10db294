"""Compute the minors of a small matrix of complex numbers without a division, so that enclosures of its entries may
contain 0."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import comb, prod
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vctune.model.numbers.arithmetic import Arithmetic, ArrayArithmetic, Number
from vctune.model.numbers.pair import EvenOdd

Indices = NDArray[np.intp]
Rows = Sequence[Sequence[EvenOdd | None]]  # None stands for an entry that is 0 by structure

ROWS = 4  # Number of rows from which one operation on all minors is faster than one on each
AT_ONCE = 12_000  # Greatest number of elements of such an operation, which fit into the processor's cache


def minors(rows: Rows, ops: Arithmetic) -> dict[int, EvenOdd]:
    """Return the n x n minors of n rows of n + 1 columns, by the index of the omitted column."""
    arrays = ops.arrays
    if arrays is not None and len(rows) >= ROWS:
        parts = [part for row in rows for entry in row if entry is not None for part in (entry.even, entry.odd)]
        square = next(entry.square for entry in rows[0] if entry is not None)
        shape = arrays.shape(square)
        few = comb(len(rows) + 1, (len(rows) + 1) // 2) * prod(shape) <= AT_ONCE
        if few and {arrays.shape(part) for part in parts} <= {(), shape}:
            return _together(rows, square, arrays)
    return _one_by_one(rows)


def _one_by_one(rows: Rows) -> dict[int, EvenOdd]:
    found: dict[int, EvenOdd | None] = {0: None}
    for row in rows:
        wider: dict[int, EvenOdd | None] = {}
        for columns, minor in found.items():
            for j, entry in enumerate(row):
                if entry is None or columns >> j & 1:
                    continue
                term = entry if minor is None else minor * entry
                # each column to the right of j that earlier rows have used counts as one exchange of columns
                if (columns >> j).bit_count() % 2:
                    term = term.scaled(-1)
                both, other = columns | 1 << j, wider.get(columns | 1 << j)
                wider[both] = term if other is None else other + term
        found = wider
    everything = (1 << len(rows) + 1) - 1
    return {(everything ^ columns).bit_length() - 1: minor for columns, minor in found.items() if minor is not None}


class _Step(NamedTuple):
    """How the minors of one row more follow: each is the sum of products of these minors and these entries."""

    minors: Indices  # shape (terms, minors of one row more)
    entries: Indices  # places among the row's entries, then their negatives, then a 0 for terms that do not exist


def _together(rows: Rows, square: Number, arrays: ArrayArithmetic) -> dict[int, EvenOdd]:
    present = tuple(tuple(j for j, entry in enumerate(row) if entry is not None) for row in rows)
    steps, omitted = _steps(present)
    zero, squares = 0 * square, arrays.stacked([square])
    found = EvenOdd(arrays.stacked([1 + zero]), arrays.stacked([zero]), squares)
    for row, step in zip(rows, steps, strict=True):
        entries = [entry for entry in row if entry is not None]
        parts = (
            arrays.stacked([*numbers, *(-number for number in numbers), zero])
            for numbers in ([entry.even for entry in entries], [entry.odd for entry in entries])
        )
        even, odd = parts
        terms = [
            EvenOdd(found.even[which], found.odd[which], squares) * EvenOdd(even[entry], odd[entry], squares)
            for which, entry in zip(step.minors, step.entries, strict=True)
        ]
        found = terms[0]
        for term in terms[1:]:
            found = found + term
    return {column: EvenOdd(found.even[k], found.odd[k], square) for k, column in enumerate(omitted)}


@lru_cache(maxsize=256)
def _steps(present: tuple[tuple[int, ...], ...]) -> tuple[list[_Step], list[int]]:
    """Return the steps for rows with entries in some columns, and the column that each last minor omits."""
    steps, before = list[_Step](), [0]
    for columns_of_row in present:
        terms: dict[int, list[tuple[int, int]]] = {}
        for place, columns in enumerate(before):
            for k, j in enumerate(columns_of_row):
                if not columns >> j & 1:
                    negative = (columns >> j).bit_count() % 2
                    terms.setdefault(columns | 1 << j, []).append((place, k + negative * len(columns_of_row)))
        most = max(map(len, terms.values()))
        padded = [[*of, *[(0, 2 * len(columns_of_row))] * (most - len(of))] for of in terms.values()]
        which, entries = np.array(padded, np.intp).transpose(2, 1, 0)
        steps.append(_Step(which, entries))
        before = [*terms]
    everything = (1 << len(present) + 1) - 1
    return steps, [(everything ^ columns).bit_length() - 1 for columns in before]
