"""Save the state of a search for a bound in a file, and read it, so that a later search can continue."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from vctune.design.bound.design_boxes import DesignBoxes
from vctune.design.bound.nodes import OpenNodes
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
