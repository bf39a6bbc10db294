"""Read the text of a log: either a table of headers and numbers, or a list of faults with line and column."""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from hashlib import sha256
from io import BytesIO, TextIOWrapper
from pathlib import Path

import numpy as np

from vctune.document.recording import Floats
from vctune.document.schema.validation import MAX_MISTAKES, shown
from vctune.document.text.errors import InputError, Mistake

MAX_BYTES = 400_000_000  # Greatest size of a log, bytes
# First bytes of gzipped files, of new workbooks, and of old workbooks
GZIP, ZIP, OLE = b"\x1f\x8b", b"PK\x03\x04", b"\xd0\xcf\x11\xe0"
SEPARATORS = (",", ";", "\t")  # Separators of columns
LOOKED_AT = 10  # Number of rows in which the reader looks for decimal commas
WHOLE = re.compile(r'"?[+-]?\d+(e[+-]?\d+)?"?', re.IGNORECASE)
# A whole number, and a number with a decimal comma, both also in quotes
COMMA = re.compile(r'"?[+-]?\d+,\d+(e[+-]?\d+)?"?', re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class LogTable:
    """The table of a log, before its columns have roles."""

    headers: list[str]  # headers of the columns
    numbers: Floats  # finite numbers, shape (rows, columns)
    first_line: int  # line of the file that contains the first row of numbers, from 1
    sha256: str  # SHA-256 digest of the file, in hexadecimal


def read_table(path: Path) -> LogTable:
    """Read a table of numbers."""
    packed = _bytes(path)
    _check_text(path, packed)
    data = _unpacked(path, packed) if packed.startswith(GZIP) else packed
    headers, separator, first_line = _headers(path, data)
    numbers = _at_once(data, separator, len(headers), first_line)
    if numbers is None:
        numbers = _row_by_row(path, data, separator, headers, first_line)
    return LogTable(headers, numbers, first_line, sha256(packed).hexdigest())


def _bytes(path: Path) -> bytes:
    """Return the content of a file, or refuse it as unreadable or too long."""
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


def _check_text(path: Path, data: bytes) -> None:
    what = "an Excel workbook" if data.startswith(OLE) or b"xl/workbook" in data else "a zip archive"
    if data.startswith((ZIP, OLE)):
        raise InputError.of(str(path), "log-text", f"is {what} and not text; save it as CSV")


def _unpacked(path: Path, packed: bytes) -> bytes:
    """Return unpacked data; the limit on its size also stops a small file that unpacks to a huge one."""
    try:
        unpacker = zlib.decompressobj(wbits=31)
        data = unpacker.decompress(packed, MAX_BYTES + 1)
    except zlib.error:
        data = None
    if data is None or not (unpacker.eof or len(data) > MAX_BYTES):
        raise InputError.of(str(path), "unreadable-file", "is a damaged gzip file; copy it again")
    if len(data) > MAX_BYTES:
        raise InputError.of(str(path), "unreadable-file", f"unpacks to more than {MAX_BYTES} bytes; split the log")
    return data


def _headers(path: Path, data: bytes) -> tuple[list[str], str, int]:
    """Return the headers, their separator, and the line of the first row."""
    try:
        for number, line in enumerate(_stream(data), 1):
            if line.strip() and not line.startswith("#"):
                separator = next((candidate for candidate in SEPARATORS if candidate in line), SEPARATORS[0])
                headers = [header.strip().strip('"') for header in line.split(separator)]
                _check_headers(path, headers, number)
                return headers, separator, number + 1
    except UnicodeDecodeError:
        _decoded(path, data)
    raise InputError.of(str(path), "log-text", "is empty; a log is a line of headers and a line for each sample")


def _stream(data: bytes) -> TextIOWrapper:
    return TextIOWrapper(BytesIO(data), encoding="utf-8-sig")


def _decoded(path: Path, data: bytes) -> str:
    """Return data as text. A byte that is not UTF-8 is refused with its line."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        message = f"is not UTF-8 text (byte 0x{data[error.start]:02x}); export the log as CSV"
        raise InputError.of(str(path), "unreadable-file", message, line=line) from None


def _check_headers(path: Path, headers: list[str], line: int) -> None:
    """Refuse headers that are numbers, and headers that appear twice."""
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


def _at_once(data: bytes, separator: str, columns: int, first_line: int) -> Floats | None:
    """Return the samples of a table without faults; None if the table has a fault."""
    stream = _stream(data)
    try:
        for _ in range(first_line - 1):
            stream.readline()
        table = np.loadtxt(stream, delimiter=separator, ndmin=2, comments=None)
    except ValueError:
        return None
    rows = data.rstrip().count(b"\n") + 2 - first_line
    return table if table.shape == (rows, columns) and rows > 0 and np.isfinite(table).all() else None


def _row_by_row(path: Path, data: bytes, separator: str, headers: list[str], first_line: int) -> Floats:
    """Return the samples, or raise the faults of the text, each with line and column."""
    lines = _decoded(path, data).splitlines()[first_line - 1 :]
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
    _check_point(path, lines[:LOOKED_AT], separator, len(headers), first_line)
    raise InputError(str(path), list(_faults(lines, separator, headers, first_line))[:MAX_MISTAKES])


def _check_point(path: Path, lines: list[str], separator: str, columns: int, first_line: int) -> None:
    """Raise one error for decimal commas."""
    rows = [[cell.strip() for cell in line.split(separator)] for line in lines]
    whole = separator == "," and all(WHOLE.fullmatch(cell) for cells in rows for cell in cells)
    torn = whole and 2 * sum(columns < len(cells) <= 2 * columns for cells in rows) > len(rows)
    for number, cells in enumerate(rows, first_line):
        comma = next((cell for cell in cells if COMMA.fullmatch(cell)), None)
        comma = ",".join(cells[:2]) if torn and len(cells) > columns else comma
        if comma is not None:
            message = f"has a decimal comma in {shown(comma)}; export the log with decimal points"
            raise InputError.of(str(path), "log-text", message, line=number)


def _faults(lines: list[str], separator: str, headers: list[str], first_line: int) -> Iterable[Mistake]:
    """Yield the faults of the rows: a wrong number of cells, and cells without a finite number."""
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
