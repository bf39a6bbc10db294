"""The minors of matrices, one by one and all of a row at once, against the definition of a determinant."""

from itertools import combinations, permutations
from math import prod

import numpy as np
import pytest

from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.minors import ROWS, minors
from vctune.model.numbers.pair import EvenOdd
from vctune.proof.enclosures.intervals import ENCLOSURES, Enclosure


def determinant(rows: np.ndarray) -> complex:
    """Return a determinant by its definition; numbers of small whole parts are not rounded."""
    total = 0j
    for columns in permutations(range(len(rows))):
        exchanges = sum(i > j for i, j in combinations(columns, 2))
        total += (-1) ** exchanges * prod(complex(row[j]) for row, j in zip(rows, columns, strict=True))
    return total


@pytest.mark.parametrize("count", [1, 7], ids=["a point", "points"])
@pytest.mark.parametrize("size", [ROWS - 1, ROWS, ROWS + 2])
def test_minors_are_determinants(size, count):
    rng = np.random.default_rng((size, count))
    even, odd = rng.integers(-4, 5, (2, size, size + 1, count)).astype(float)
    s = np.arange(1.0, count + 1)
    there = rng.random((size, size + 1)) < 0.8
    whole = (even + 1j * s * odd) * there[..., None]
    for ops, number in ((FLOATS, np.asarray), (ENCLOSURES, Enclosure)):
        square = number(s * s)
        rows = [
            [EvenOdd(*map(number, parts), square) if known else None for *parts, known in zip(*row, strict=True)]
            for row in zip(even, odd, there, strict=True)
        ]
        found = minors(rows, ops)
        for column in range(size + 1):
            expected = np.array([determinant(np.delete(whole[..., k], column, axis=1)) for k in range(count)])
            assert column in found or not expected.any()
            if column in found:
                for part, values in ((found[column].even, expected.real), (found[column].odd, expected.imag / s)):
                    middle, radius = (part.mid, part.rad) if isinstance(part, Enclosure) else (part, 1e-9)
                    assert (np.abs(middle - values) <= radius).all()
