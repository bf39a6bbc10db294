"""Zero exclusion for many cells at once: a loop cannot become unstable within a cell where its curve misses 0."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vctune.model.pair import Pair
from vctune.proof.cells import MOST, Cells, Integers, Pairs, Values, in_chunks, joined, located
from vctune.proof.enclosures import Enclosure, Flags, Floats

Curve = Callable[[Enclosure, Values], Pair]


def missing_zero(curve: Curve) -> Callable[[Enclosure, Values], Flags]:
    """Return where the rectangle that encloses a curve's image does not contain 0."""

    def misses(x: Enclosure, values: Values) -> Flags:
        image = curve(x, values)
        return image.re.positive() | image.re.negative() | image.im.positive() | image.im.negative()

    return misses


@dataclass(frozen=True, slots=True)
class Excluded:
    """Where a curve misses 0: closed and open pairs, and for each cell the pairs looked at."""

    closed: Pairs
    open: Pairs
    boxes: Integers


@np.errstate(all="ignore")
def exclude(misses: Callable[[Enclosure, Values], Flags], cells: Cells, pairs: Pairs, rounds: int) -> Excluded:
    """Close the pairs on which a curve is shown to miss 0, halving the others for some rounds."""
    none, boxes = pairs.taken(np.zeros(0, np.intp)), np.zeros(len(cells), np.intp)
    closed, kept = [none], [none]
    values = cells.values()
    for again in range(rounds + 1):
        if not len(pairs):
            break
        boxes += pairs.count(len(cells))
        missed = in_chunks(lambda part: misses(*located(values, part)), pairs)
        halve = ~missed & ((boxes < MOST) & (again < rounds))[pairs.cell]
        closed.append(pairs.taken(missed))
        kept.append(pairs.taken(~(missed | halve)))
        pairs = pairs.taken(halve).halved()
    return Excluded(joined(*closed), joined(*kept), boxes)


@np.errstate(all="ignore")
def turns(curve: Curve, points: Cells, closed: Pairs) -> Floats:
    """Return how far the curve of each point turns over its closed pairs, rad (`vctune.proof.winding`).

    It is nan where rounding leaves open on which side of half a turn a pair lies.
    """
    values = points.values()

    def turn(part: Pairs) -> Floats:
        start, stop = (curve(*located(values, Pairs(part.cell, edge, edge))) for edge in (part.low, part.high))
        cross = start.re * stop.im - start.im * stop.re
        dot = start.re * stop.re + start.im * stop.im
        sided = cross.positive() | cross.negative() | dot.positive()
        return np.where(sided, np.arctan2(cross.mid, dot.mid), np.nan)

    total = np.zeros(len(points))
    np.add.at(total, closed.cell, in_chunks(turn, closed))
    return total
