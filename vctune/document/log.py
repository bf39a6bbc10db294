"""Logs, read: a CSV file, plain or .gz, and the map that says which of its columns is what."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from vctune.document import toml
from vctune.document.errors import InputError, Mistake
from vctune.document.log_schema import UNITS, ColumnTable, LogDocument
from vctune.document.recording import ROLES, Channel, Floats, Recording
from vctune.document.validation import MAX_MISTAKES, Contradiction, shown, validated

MAX_BYTES = 400_000_000
"""A log of a million samples with ten columns has a quarter of it."""
KINDS = {
    "time": ("s", "ms", "us"),
    "position": ("m", "mm", "um", "rad", "mrad", "deg"),
    "command": ("N", "mN", "kN", "Nm", "mNm"),
}
KIND_OF = {"force": "command", "hand": "command", "handle": "position", "reference": "position"}
"""Roles that have the units of another."""
ANGLES = ("rad", "mrad", "deg", "Nm", "mNm")


@dataclass(frozen=True, slots=True)
class LogMap:
    """A log.toml.

    Attributes
    ----------
    document : as written, checked
    source : path of the file; "log.toml" where there is none
    text : of the file, "" where there is none
    """

    document: LogDocument
    source: str = "log.toml"
    text: str = ""


def read_log_map(path: Path | None) -> LogMap:
    """Read a log.toml; None for the map of a log whose headers say everything.

    Raises
    ------
    InputError
        Listing every mistake, each with line, dotted key, value and remedy.
    """
    if path is None:
        return LogMap(LogDocument.model_validate({}))
    text = toml.read_text(path)
    return LogMap(validated(LogDocument, text, str(path), _contradictions), str(path), text)


def read_log(path: Path, known: LogMap) -> Recording:
    """Read a log.

    Parameters
    ----------
    path : of a CSV file, or of one packed by gzip; separated by commas, semicolons or tabs, with a line of headers
    known : which column is what

    Returns
    -------
    Recording
        Columns in SI units, by what they are.

    Raises
    ------
    InputError
        Listing what cannot be read, each with its line and column.
    """
    data = _bytes(path)
    text = _text(path, data)
    lines = text.splitlines()
    first = next((i for i, line in enumerate(lines) if line.strip() and not line.startswith("#")), None)
    if first is None:
        raise InputError.of(str(path), "log-text", "is empty; a log is a line of headers and a line for each sample")
    separator = next((each for each in (",", ";", "\t") if each in lines[first]), ",")
    headers = [header.strip().strip('"') for header in lines[first].split(separator)]
    _check_headers(path, headers, first + 1)
    table = _numbers(path, lines[first + 1 :], separator, headers, first + 2)
    columns = _columns(path, headers, known)
    channels = {
        role: _channel(header, table[:, headers.index(header)], stated, known, role)
        for role, (header, stated) in columns.items()
    }
    used = {header for header, _ in columns.values()}
    return Recording(
        source=str(path),
        sha256=sha256(data).hexdigest(),
        first_line=first + 2,
        channels=channels,
        ignored=tuple(header for header in headers if header not in used),
        rotary=known.document.rotary,
    )


def _bytes(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise InputError.of(str(path), "unreadable-file", f"cannot be read: {error.strerror}") from None
    except ValueError:
        raise InputError.of(str(path), "unreadable-file", "is no path: it contains a null character") from None
    if len(data) > MAX_BYTES:
        raise InputError.of(str(path), "unreadable-file", f"is longer than {MAX_BYTES} bytes; split the log")
    return data


def _text(path: Path, data: bytes) -> str:
    if data[:2] == b"\x1f\x8b":
        try:
            unpacker = zlib.decompressobj(wbits=31)
            data = unpacker.decompress(data, MAX_BYTES + 1)
            if not unpacker.eof and len(data) <= MAX_BYTES:
                raise EOFError
        except (OSError, EOFError, zlib.error, gzip.BadGzipFile):
            raise InputError.of(str(path), "unreadable-file", "is a damaged gzip file; copy it again") from None
        if len(data) > MAX_BYTES:
            raise InputError.of(str(path), "unreadable-file", f"unpacks to more than {MAX_BYTES} bytes; split the log")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        message = f"is not UTF-8 text (byte 0x{data[error.start]:02x}); export the log as CSV"
        raise InputError.of(str(path), "unreadable-file", message, line=line) from None


def _check_headers(path: Path, headers: list[str], line: int) -> None:
    numbers = [header for header in headers if _is_number(header)]
    if numbers:
        message = f"{shown(numbers[0])} is a number where a header should be; give the columns a line of names"
        raise InputError.of(str(path), "log-text", message, line=line)
    twice = sorted({header for header in headers if headers.count(header) > 1})
    if twice:
        raise InputError.of(
            str(path), "log-text", "two columns have this header; rename one", key=twice[0] or "", line=line
        )


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _numbers(path: Path, lines: list[str], separator: str, headers: list[str], first_line: int) -> Floats:
    """Return the samples, shape (n, columns); a fault of the text with its line and column."""
    while lines and not lines[-1].strip():
        lines = lines[:-1]
    if not lines:
        raise InputError.of(str(path), "log-text", "has headers and no samples", line=first_line)
    try:
        table = np.loadtxt(lines, delimiter=separator, ndmin=2, comments=None)
        if table.shape == (len(lines), len(headers)) and np.isfinite(table).all():
            return table
    except ValueError:
        pass
    raise InputError(str(path), list(_faults(lines, separator, headers, first_line))[:MAX_MISTAKES])


def _faults(lines: list[str], separator: str, headers: list[str], first_line: int) -> Iterable[Mistake]:
    for number, line in enumerate(lines, first_line):
        cells = [cell.strip() for cell in line.split(separator)]
        if len(cells) != len(headers):
            yield Mistake(
                "log-text", "", f"has {len(cells)} columns, not {len(headers)}; repair or remove the row", number
            )
            continue
        for header, cell in zip(headers, cells, strict=True):
            if not _is_number(cell):
                yield Mistake("log-text", header, f"{shown(cell)} is not a number; repair or remove the row", number)
            elif not np.isfinite(float(cell)):
                yield Mistake(
                    "log-text", header, f"{cell} is no finite number: the sample is missing; record again", number
                )


def _columns(path: Path, headers: list[str], known: LogMap) -> dict[str, tuple[str, ColumnTable]]:
    """Return the header and the map's entry of each role that the log has."""
    found: dict[str, tuple[str, ColumnTable]] = {}
    faults = []
    for role in ROLES:
        entry = getattr(known.document.columns, role)
        if entry is None:
            ends = [f"{role}_{unit}" for unit in KINDS[KIND_OF.get(role, role)]]
            entry = next((header for header in headers if header in ends), None)
        if entry is None:
            continue
        table = entry if isinstance(entry, ColumnTable) else ColumnTable(column=entry)
        if table.column not in headers:
            message = f"{path}: has no column {shown(table.column)}; it has {', '.join(headers)}"
            faults.append(Mistake("log-columns", f"columns.{role}", message))
        found[role] = (table.column, table)
    if faults:
        raise InputError(known.source, faults)
    _check_needed(path, headers, found, known)
    return found


def _check_needed(path: Path, headers: list[str], found: dict[str, Any], known: LogMap) -> None:
    missing = []
    if "position" not in found:
        missing.append(("columns.position", "without a position nothing can be identified; name its column"))
    if not {"command", "force", "hand"} & set(found):
        missing.append(("columns.command", "without a force nothing can be identified; name the column of the command"))
    if "time" not in found and known.document.sample_time is None:
        missing.append(("sample_time", "there is no column time; name it in [columns], or write sample_time"))
    if missing:
        here = f"{path} has the columns {', '.join(headers)}"
        raise InputError(known.source, [Mistake("log-columns", key, f"{message} ({here})") for key, message in missing])


def _channel(header: str, values: Floats, stated: ColumnTable, known: LogMap, role: str) -> Channel:
    scale = stated.scale if stated.scale is not None else UNITS[_unit(header, stated, known, role)]
    quantum = None if stated.quantum is None else stated.quantum * abs(scale)
    limit = None if stated.limit is None else stated.limit * abs(scale)
    return Channel(header, values * scale, scale, quantum, limit)


def _unit(header: str, stated: ColumnTable, known: LogMap, role: str) -> str:
    """Return the unit of a column: the stated one, or what its header ends with."""
    fitting = KINDS[KIND_OF.get(role, role)]
    if role != "time":
        fitting = tuple(unit for unit in fitting if (unit in ANGLES) == known.document.rotary)
    unit = stated.unit or header.rpartition("_")[2]
    if unit in fitting:
        return unit
    said = f"its unit {unit} is none" if stated.unit else "its header does not end with a unit"
    other = ""
    if role != "time" and (unit in ANGLES) != known.document.rotary and unit in UNITS:
        other = "; write rotary = true" if unit in ANGLES else "; or is the device not rotary?"
    message = (
        f"column {shown(header)}: {said} of {', '.join(fitting)}; write its unit, or scale = SI units per unit{other}"
    )
    raise InputError.of(known.source, "log-columns", message, key=f"columns.{role}")


def _contradictions(raw: dict[str, Any]) -> list[Contradiction]:
    faults: list[Contradiction] = []
    columns = raw.get("columns")
    for role, entry in columns.items() if isinstance(columns, dict) else ():
        if isinstance(entry, dict) and "unit" in entry and "scale" in entry:
            faults.append((("columns", role, "scale"), "says the same as unit; leave one of them out"))
    device = raw.get("device")
    if isinstance(device, dict) and device.get("delay_uncertainty") and "delay" not in device:
        faults.append((("device", "delay_uncertainty"), "there is no device.delay that is known; write it, or neither"))
    return faults
