"""Tests of many cells over a band of frequencies. A test that fails halves the interval."""

from __future__ import annotations

from collections.abc import Callable

from vctune.proof.enclosures.array_intervals import Floats
from vctune.proof.engine.boxes import Boxes, Cells, band_of, over_cells
from vctune.proof.engine.branching import Proofs, Test, prove

STEP = 1.4
"""Ratio of the edges of the first intervals. With the square root of this ratio, the proofs take 60 % more boxes; with
its square, 16 % fewer. If rounding and cell size nearly hide the sign of a margin, this ratio decides whether the cell
is proved."""
HALVINGS = 24
"""Greatest number of halvings of an interval of frequency for a single design. The narrowest interval is 2e-8 of the
first one. An optimal design needs such intervals where it touches its constraint. With half or twice as many halvings,
the prover proves the same designs near the optimal designs of the problems in problems/."""
CELL_HALVINGS = 10
"""Greatest number of halvings for a cell. After few halvings, the size of the cell widens an enclosure more than the
interval does. With half as many halvings, the prover leaves up to half of the cells near the border of the feasible
region open. With twice as many, it proves no more cells."""
MAX_BOXES = 4_000
"""Number of boxes for one claim after which the prover leaves a cell open. Most cells take a few hundred boxes. With
half or twice as many, the prover proves the same cells."""


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
    measure : function of boxes, such as the angle of a turn; the prover sums its values over the proved boxes of a
        cell; None for no sum
    in_parts : whether to halve the cells as well as the frequency, separately in each interval

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
    """Return which rows of boxes the prover may halve: all except the rows of the cell.

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
