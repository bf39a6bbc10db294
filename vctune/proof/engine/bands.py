"""Tests of many cells over a band of frequencies. A test that fails halves the interval."""

from __future__ import annotations

from collections.abc import Callable
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal
from math import pi, sqrt

from vctune.proof.boxes import Boxes, Cells, band_of, over_cells
from vctune.proof.enclosures.intervals import Floats
from vctune.proof.prover import Proofs, Test, prove
from vctune.running import OutOfTimeError

FINEST_STEP = 1e-6  # Relative step at which the extension of a proved band ends
EDGE_DIGITS = 5  # Number of digits of an edge in Hz outside the required band
BEYOND = 1e-12  # Relative amount by which an edge in rad/s lies outside the edge in hertz


def extend_band(holds: Callable[[float, float], bool], edge: float, goal: float) -> float:
    """Return the farthest point from an edge towards a goal up to which a proof holds."""
    down, start = goal < edge, edge
    step, held = 4.0, True  # a ratio of frequencies; a second success squares it, a failure takes its square root
    try:
        while step - 1 > FINEST_STEP and edge != goal:
            ahead = max(goal, edge / step) if down else min(goal, edge * step)
            if holds(min(edge, ahead), max(edge, ahead)):
                edge, step, held = ahead, min(step * step, 16.0) if held else step, True
            else:
                step, held = sqrt(step), False
        return goal if edge == goal else _decimal_edge(holds, edge, start, goal)
    except OutOfTimeError:
        return edge


def _decimal_edge(holds: Callable[[float, float], bool], edge: float, start: float, goal: float) -> float:
    """Return the farthest proved edge, rad/s, that has `EDGE_DIGITS` digits in hertz and is near a given proved
    edge."""
    away = -1 if goal < start else 1
    inner, place = _rounded(Decimal(edge / (2 * pi)), away)
    for decimals in (inner + away * place, inner, inner - away * place):
        found = 2 * pi * float(decimals) * (1 + away * BEYOND)
        found = max(found, goal) if away < 0 else min(found, goal)
        if away * (found - edge) <= 0 or holds(min(edge, found), max(edge, found)):
            return found if away * (found - start) > 0 else start
    return edge


def edge_in_hertz(edge: float, *, upper: bool) -> float:
    """Return an edge of a proved band in hertz."""
    away = 1 if upper else -1
    return float(_rounded(Decimal(edge / (2 * pi) * (1 - away * BEYOND / 10)), away)[0])


def _rounded(hertz: Decimal, away: int) -> tuple[Decimal, Decimal]:
    """Return a frequency rounded inwards to `EDGE_DIGITS` digits, and the value of its last digit's place."""
    place = Decimal(1).scaleb(hertz.adjusted() - EDGE_DIGITS + 1)
    return hertz.quantize(place, ROUND_FLOOR if away > 0 else ROUND_CEILING), place


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
        few=0,
    )


def halved_rows(cells: Cells, rows: int) -> tuple[bool, ...]:
    """Return which rows of boxes the prover may halve: all except the rows of the cell."""
    return (*[True] * rows, *[False] * len(cells.keys))
