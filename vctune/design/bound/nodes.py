"""The open nodes of the branch and bound, which are boxes that may contain a better design, and their saved state."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from vctune.design.bound.design_boxes import Axis, DesignBoxes, all_designs
from vctune.design.bound.design_boxes import joined as joined_boxes
from vctune.proof.enclosures.intervals import Flags, Floats
from vctune.version import __version__


@dataclass(frozen=True, slots=True)
class ResumeState:
    """The state of a search, from which a later search continues."""

    nodes: OpenNodes  # nodes that are still open
    pruned_bound: float  # the least lower bound of the pruned boxes
    boxes: int  # number of lower bounds computed so far


def resume_bytes(sha256: str, state: ResumeState) -> bytes:
    """Return the content of the file from which a later search of the same problem continues."""
    nodes, stream = state.nodes, BytesIO()
    np.savez_compressed(
        stream,
        owner=np.array(_owner(sha256)),
        low=nodes.boxes.low,
        high=nodes.boxes.high,
        bound=nodes.bound,
        stable=nodes.stable,
        counts=np.array([state.pruned_bound, state.boxes]),
    )
    return stream.getvalue()


def read_resume(path: Path, sha256: str) -> ResumeState | None:
    """Return the state of an earlier search of the same problem by the same version of vctune."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            if str(file["owner"]) != _owner(sha256):
                return None
            nodes = OpenNodes(DesignBoxes(file["low"], file["high"]), file["bound"], file["stable"])
            pruned_bound, boxes = file["counts"].tolist()
            return ResumeState(nodes, pruned_bound, int(boxes))
    except (OSError, EOFError, ValueError, KeyError, BadZipFile, zlib.error):
        return None


def _owner(sha256: str) -> str:
    return f"{sha256} {__version__}"


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
