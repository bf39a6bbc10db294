"""The open nodes of the branch and bound: boxes that may contain a better design."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vctune.design.bound.design_boxes import Axis, DesignBoxes, all_designs
from vctune.design.bound.design_boxes import joined as joined_boxes
from vctune.proof.enclosures.array_intervals import Flags, Floats


@dataclass(frozen=True, slots=True)
class OpenNodes:
    """Boxes that the search has neither pruned nor halved."""

    boxes: DesignBoxes  # n boxes
    bound: Floats  # a lower bound on the error in each box, shape (n,)
    stable: Flags  # whether all loops of the box are proved stable, shape (n,)

    def __len__(self) -> int:
        return len(self.bound)

    def subset(self, which: Flags) -> OpenNodes:
        """Return the nodes with the given flags."""
        return OpenNodes(self.boxes.subset(which), self.bound[which], self.stable[which])

    @property
    def lowest(self) -> float:
        """The least lower bound; inf if no node is open."""
        return float(self.bound.min(initial=np.inf))


def root(axes: tuple[Axis, ...]) -> OpenNodes:
    """Return the single node whose box contains all designs."""
    return OpenNodes(all_designs(axes), np.zeros(1), np.zeros(1, bool))


def joined(parts: list[OpenNodes]) -> OpenNodes:
    """Return several sets of nodes as one set."""
    boxes = joined_boxes([part.boxes for part in parts])
    return OpenNodes(
        boxes, np.concatenate([part.bound for part in parts]), np.concatenate([part.stable for part in parts])
    )
