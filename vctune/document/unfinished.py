"""The file of an unfinished search for a bound: its open boxes, so that it can go on."""

from __future__ import annotations

import zlib
from io import BytesIO
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from vctune.version import __version__

Arrays = dict[str, NDArray[np.float64]]


def unfinished_bytes(sha256: str, arrays: Arrays) -> bytes:
    """Return the content of the file: the arrays, and whose they are."""
    stream = BytesIO()
    np.savez_compressed(stream, owner=np.array(_owner(sha256)), **arrays)  # type: ignore[arg-type]
    return stream.getvalue()


def read_unfinished(path: Path, sha256: str, names: set[str]) -> Arrays | None:
    """Return the arrays of an earlier search of the same problem by the same vctune; None if there are none."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            if str(file["owner"]) != _owner(sha256) or not names <= set(file.files):
                return None
            return {name: file[name] for name in names}
    except (OSError, EOFError, ValueError, KeyError, BadZipFile, zlib.error):
        return None


def _owner(sha256: str) -> str:
    return f"{sha256} {__version__}"
