"""Tests of many cells over a band of frequency; a test that fails halves the band."""

from __future__ import annotations

from collections.abc import Callable

from vctune.proof.enclosures.array_intervals import Floats
from vctune.proof.engine.boxes import Boxes, Cells, band_of, over_cells
from vctune.proof.engine.branching import Proofs, Test, prove

STEP = 1.4
"""Ratio of the edges of the first intervals. Its square root takes 60 % more boxes, its square 16 % fewer; a cell that
is nearly blurred is proved by the one and not the other."""
HALVINGS = 24
"""Greatest number of halvings of an interval of frequency for a single design: to 2e-8 of it, where an optimal design
touches its constraint. Half and twice as often prove the same designs around those of problems/."""
CELL_HALVINGS = 10
"""The same for a cell, whose own size soon blurs a curve more than the interval does. Half as often leaves cells open,
up to half of those near the edge of the feasible ones; twice as often proves no more."""
MAX_BOXES = 4_000
"""Boxes of a cell that are evaluated for one claim before it is left open; most take some hundred. Half and twice as
many prove the same cells."""


def cells_over_band(
    test: Test,
    cells: Cells,
    low: float,
    high: float,
    measure: Callable[[Boxes], Floats] | None = None,
    *,
    in_parts: bool = False,
) -> Proofs:
    """Prove a test for cells over a band, from intervals of the ratio `STEP` on.

    Parameters
    ----------
    test : test of boxes of frequency and cell
    cells : n cells of designs
    low, high : edges of the band, in the test's unit of frequency
    measure : number that is summed over the proved boxes of a cell, such as the angle of a turn; None for none
    in_parts : whether to halve the cells too, beside the frequency, each interval's in its own way

    Returns
    -------
    Proofs
        For each of the n cells.
    """
    return prove(
        test,
        over_cells(cells, band_of(low, high, STEP)),
        len(cells),
        halved=[True] * (1 + len(cells.keys)) if in_parts else halved_rows(cells, 1),
        max_halvings=CELL_HALVINGS if cells.extended else HALVINGS,
        max_boxes=MAX_BOXES,
        measure=measure,
    )


def halved_rows(cells: Cells, rows: int) -> tuple[bool, ...]:
    """Return which rows of boxes may be halved: all but those of the cell.

    Parameters
    ----------
    cells : cells, whose keys are the last rows
    rows : number of rows before them, those of frequency and hand

    Returns
    -------
    tuple of bool
        One for each row.
    """
    return (*[True] * rows, *[False] * len(cells.keys))
