"""Zero exclusion for many cells at once: a loop cannot become unstable within a cell where its curve misses 0."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vctune.model.pair import Pair
from vctune.proof.cells import Cells, Integers, Pairs, Values, in_chunks, joined, located
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
    closed, boxes = [pairs.taken(np.zeros(0, np.intp))], np.zeros(len(cells), np.intp)
    values = cells.values()
    for again in range(rounds + 1):
        boxes += pairs.count(len(cells))
        missed = in_chunks(lambda part: misses(*located(values, part)), pairs)
        closed.append(pairs.taken(missed))
        pairs = pairs.taken(~missed)
        if not len(pairs) or again == rounds:
            break
        pairs = pairs.halved()
    return Excluded(joined(*closed), pairs, boxes)


@np.errstate(all="ignore")
def turns(curve: Curve, points: Cells, closed: Pairs) -> Floats:
    """Return how far the curve of each point turns over its closed pairs, rad (`vctune.proof.winding`)."""
    values = points.values()

    def turn(part: Pairs) -> Floats:
        start, stop = (curve(*located(values, Pairs(part.cell, edge, edge))) for edge in (part.low, part.high))
        cross = start.re.mid * stop.im.mid - start.im.mid * stop.re.mid
        dot = start.re.mid * stop.re.mid + start.im.mid * stop.im.mid
        return np.arctan2(cross, dot)

    total = np.zeros(len(points))
    np.add.at(total, closed.cell, in_chunks(turn, closed))
    return total
