"""Tests of many cells over a band of frequencies. A test that fails halves the interval."""

from __future__ import annotations

from collections.abc import Callable

from vctune.proof.enclosures.array_intervals import Floats
from vctune.proof.engine.boxes import Boxes, Cells, band_of, over_cells
from vctune.proof.engine.branching import Proofs, Test, prove

STEP = 1.4  # Ratio of the edges of the first intervals
HALVINGS = 24  # Greatest number of halvings of an interval of frequency for a single design
CELL_HALVINGS = 10  # Greatest number of halvings for a cell
MAX_BOXES = 4_000  # Number of boxes for one claim after which the prover leaves a cell open


def cells_over_band(
    test: Test,
    cells: Cells,
    low: float,
    high: float,
    measure: Callable[[Boxes], Floats] | None = None,
    *,
    in_parts: bool = False,
) -> Proofs:
    """Prove a test for cells over a band, beginning with intervals of the ratio `STEP`."""
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
    """Return which rows of boxes the prover may halve: all except the rows of the cell."""
    return (*[True] * rows, *[False] * len(cells.keys))
