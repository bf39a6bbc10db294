"""Store the rows of a study in an append-only file, with one line of JSON for each finished point."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from hashlib import sha256
from math import inf
from pathlib import Path
from typing import Any

from vctune.document.study_file import Study
from vctune.document.text.errors import InputError
from vctune.document.text.json import digest, problem_digest
from vctune.document.text.output_files import write_together
from vctune.model.problem import Problem
from vctune.model.transparency import Terms
from vctune.study.row_record import RowsHeader
from vctune.version import __version__

FAILED = "failed"  # Status of a point whose worker died or failed

PointRow = dict[str, Any]


def key_of(problem: Problem) -> str:
    """Return the digest of everything that determines a point's row: the meaning of the problem, and the version."""
    return digest([__version__, problem_digest(problem)])


def constraints_key(problem: Problem) -> str:
    """Return a digest that is equal for problems with the same feasible designs, which differ only in the weights."""
    return key_of(replace(problem, transparency=replace(problem.transparency, weights=Terms(1.0, 1.0, 1.0))))


def invalid_key(document: dict[str, Any]) -> str:
    """Return the digest of a document that states no problem."""
    return sha256(json.dumps([__version__, document], sort_keys=True, default=str).encode()).hexdigest()


@dataclass(slots=True)
class StudyRows:
    """An open file of rows."""

    path: Path  # path of the file, and its file descriptor
    handle: int
    known: dict[str, PointRow] = field(default_factory=dict)  # latest row of each key that needs no further try
    dropped: int = 0  # number of lines that were not complete rows

    def append(self, row: PointRow) -> None:
        """Append the row of a finished point."""
        line = (json.dumps(row, allow_nan=False) + "\n").encode()
        try:
            if os.write(self.handle, line) < len(line):
                raise OSError(28, "No space left on device")
        except OSError as error:
            raise _refusal(self.path, f"cannot grow: {error.strerror}; its rows are kept, run again to go on") from None
        self.known[row["key"]] = row


@contextmanager
def open_rows(path: Path, study: Study, *, restart: bool, time_limit: float = inf) -> Iterator[StudyRows]:
    """Open the rows of a study, creating the file if needed. Only one process at a time may write the file."""
    header = json.dumps(RowsHeader(study=study.sha256, axes=[axis.key for axis in study.axes]).to_json()) + "\n"
    if not path.exists() or not path.stat().st_size:
        write_together({path: header})
    elif restart:
        with _opened(path) as handle:
            _read(path, handle, study, time_limit)
            write_together({path: header})
    with _opened(path) as handle:
        yield _read(path, handle, study, time_limit)
        os.fsync(handle)


@contextmanager
def _opened(path: Path) -> Iterator[int]:
    """Open a file for one writer at a time, and yield its descriptor."""
    try:
        handle = os.open(path, os.O_RDWR | os.O_APPEND)
    except OSError as error:
        raise _refusal(path, f"cannot be written: {error.strerror}; choose another folder") from None
    try:
        if sys.platform != "win32":
            from fcntl import LOCK_EX, LOCK_NB, flock

            try:
                flock(handle, LOCK_EX | LOCK_NB)
            except OSError:
                raise _refusal(path, "is being written by another run; wait for it or choose another folder") from None
        yield handle
    finally:
        os.close(handle)


def _read(path: Path, handle: int, study: Study, time_limit: float) -> StudyRows:
    """Read the rows of a file, and cut off a torn last line. Rows that a lower time limit cut short are left out."""
    header, *lines = path.read_bytes().splitlines(keepends=True)
    _check_header(path, header, study)
    rows = StudyRows(path, handle)
    for line in lines:
        row = _parsed(line)
        if row is None:
            rows.dropped += 1
        elif "schema" in row:
            _check_header(path, line, study)
        elif row["status"] != FAILED and row.get("time_limit", time_limit) >= time_limit:
            rows.known[row["key"]] = row
    torn = lines[-1] if lines and not lines[-1].endswith(b"\n") else b""
    os.ftruncate(handle, os.fstat(handle).st_size - len(torn))
    return rows


def _parsed(line: bytes) -> PointRow | None:
    """Return the row or the header on a line; None if the line is torn."""
    try:
        row = json.loads(line)
    except ValueError:
        return None
    complete = isinstance(row, dict) and ("schema" in row or {"key", "status"} <= set(row))
    return row if complete and line.endswith(b"\n") else None


def _check_header(path: Path, line: bytes, study: Study) -> None:
    """Refuse a file whose header is of another version or study."""
    header = _parsed(line)
    if header is None or header.get("schema") != RowsHeader.SCHEMA:
        raise _refusal(path, "is not a file of rows that this version wrote; choose another folder, or remove it")
    if header.get("study") != study.sha256:
        message = (
            f"holds rows of another study, of {', '.join(header.get('axes', []))}; the problem file or the axes' keys "
            "were changed since: choose another folder, or remove it"
        )
        raise _refusal(path, message)


def _refusal(path: Path, message: str) -> InputError:
    return InputError.of(str(path), "rows-file", message)
