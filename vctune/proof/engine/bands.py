"""Tests of many cells over a band of frequencies. A test that fails halves the interval."""

from __future__ import annotations

from collections.abc import Callable

from vctune.proof.enclosures.array_intervals import Floats
from vctune.proof.engine.boxes import Boxes, Cells, band_of, over_cells
from vctune.proof.engine.branching import Proofs, Test, prove

STEP = 1.4
"""Ratio of the edges of the first intervals. Its square root takes 60 % more boxes, its square 16 % fewer. Of the cells
whose margin is nearly blurred, one ratio proves some and the other does not."""
HALVINGS = 24
"""Greatest number of halvings of an interval of frequency for a single design. They reach 2e-8 of the interval, where
an optimal design touches its constraint. Half and twice as many prove the same designs around those of problems/."""
CELL_HALVINGS = 10
"""Greatest number of halvings for a cell, whose own size soon blurs a curve more than the interval does. Half as many
leave cells open, up to half of those near the edge of the feasible ones; twice as many prove no more."""
MAX_BOXES = 4_000
"""Number of boxes for one claim after which a cell stays open; most cells take some hundred. Half and twice as many
prove the same cells."""


def cells_over_band(
    test: Test,
    cells: Cells,
    low: float,
    high: float,
    measure: Callable[[Boxes], Floats] | None = None,
    *,
    in_parts: bool = False,
) -> Proofs:
    """Prove a test for cells over a band, beginning with intervals of the ratio `STEP`.

    Parameters
    ----------
    test : test of boxes with rows for frequency and cell
    cells : n cells of designs
    low, high : edges of the band, in the test's unit of frequency
    measure : function of boxes that is summed over the proved boxes of a cell, such as the angle of a turn; None for no
        sum
    in_parts : whether to halve the cells as well as the frequency, in each interval separately

    Returns
    -------
    Proofs
        The result for each of the n cells.
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
    """Return which rows of boxes may be halved: all except those of the cell.

    Parameters
    ----------
    cells : cells, whose keys are the last rows
    rows : number of rows before them, for frequency and hand

    Returns
    -------
    tuple of bool
        One bool for each row.
    """
    return (*[True] * rows, *[False] * len(cells.keys))
