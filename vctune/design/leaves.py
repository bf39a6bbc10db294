"""What is left of a branch and bound: its open boxes, and how they are kept in a file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.design.boxes import Axis
from vctune.proof.array_intervals import Flags
from vctune.proof.quadratics import DesignBoxes


@dataclass(frozen=True, slots=True)
class Leaves:
    """Boxes that are still open.

    Attributes
    ----------
    boxes : the boxes
    bound : a lower bound on the error in each
    settled : whether all of its loops are known to be stable
    """

    boxes: DesignBoxes
    bound: Floats
    settled: Flags

    def subset(self, at: Flags) -> Leaves:
        """Return some of the leaves."""
        return Leaves(self.boxes.subset(at), self.bound[at], self.settled[at])


def root(axes: tuple[Axis, ...]) -> Leaves:
    """Return the box of all designs."""
    low, high = (np.array([[getattr(axis, end)] for axis in axes]) for end in ("low", "high"))
    return Leaves(DesignBoxes(low, high), np.zeros(1), np.zeros(1, bool))


def joined(parts: list[Leaves]) -> Leaves:
    """Return several sets of leaves as one."""
    low, high = (np.concatenate([getattr(part.boxes, end) for part in parts], axis=1) for end in ("low", "high"))
    bound, settled = (np.concatenate([getattr(part, name) for part in parts]) for name in ("bound", "settled"))
    return Leaves(DesignBoxes(low, high), bound, settled)


@dataclass(frozen=True, slots=True)
class Unfinished:
    """What a search needs to go on.

    Attributes
    ----------
    leaves : boxes that are still open
    fallen : the least lower bound of the boxes that have fallen
    boxes : lower bounds worked out so far
    """

    leaves: Leaves
    fallen: float
    boxes: int

    def arrays(self) -> dict[str, Floats]:
        """Return everything as arrays, to be kept in a file."""
        leaves = self.leaves
        return {
            "low": leaves.boxes.low,
            "high": leaves.boxes.high,
            "bound": leaves.bound,
            "settled": leaves.settled.astype(float),
            "counts": np.array([self.fallen, self.boxes]),
        }


ARRAYS = {"low", "high", "bound", "settled", "counts"}


def unfinished(arrays: dict[str, Floats]) -> Unfinished:
    """Return what `Unfinished.arrays` had made of a search."""
    fallen, boxes = arrays["counts"].tolist()
    leaves = Leaves(DesignBoxes(arrays["low"], arrays["high"]), arrays["bound"], arrays["settled"] > 0)
    return Unfinished(leaves, fallen, int(boxes))
