"""Define a recording of a device, columns of equal length in SI units, and read it from the table of a log."""

from __future__ import annotations

import csv
import re
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from hashlib import sha256
from io import BytesIO, TextIOWrapper
from itertools import chain, islice
from math import isfinite, nan
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vctune.document.schema.validation import MAX_MISTAKES, shown
from vctune.document.text.errors import InputError, Mistake, Note
from vctune.document.text.toml import decoded
from vctune.model.numbers.units import UNITS, Units

Floats = NDArray[np.float64]
# Roles of the columns in a device's log
ROLES = ("time", "position", "velocity", "command", "force", "hand", "handle")
SERVO_COMMANDS = ("velocity_command", "position_command")  # Roles of a servo's command
RESPONSE_ROLES = ("frequency", "real", "imag", "gain", "phase")  # Roles of the columns in a measured response
SERVO_ROLES = (
    "time",
    "position",
    "velocity",
    *SERVO_COMMANDS,
    "force",
    "hand",
)  # Roles of the columns in a servo's log


@dataclass(frozen=True, slots=True)
class Channel:
    """One column of a recording."""

    header: str  # header of the column in the file
    values: Floats  # numbers in SI units, shape (n,)
    scale: float  # SI units per unit of the column; negative if the column has the opposite sign
    quantum: float | None  # resolution that the map states, SI units; None if it states none
    limit: float | None  # value at which the column saturates, SI units; None if it is not known


@dataclass(frozen=True, slots=True)
class Recording:
    """One log as columns."""

    source: str  # path of its file
    sha256: str  # SHA-256 digest of the file, in hexadecimal
    first_line: int  # line of the file that contains the first sample
    channels: Mapping[str, Channel]  # columns by their role, one of `ROLES`, `SERVO_ROLES` or `RESPONSE_ROLES`
    ignored: tuple[str, ...]  # headers of unused columns
    rotary: bool  # whether positions are angles
    notes: tuple[Note, ...] = ()  # remarks on how it was read

    @property
    def name(self) -> str:
        """The name of the file without its folder."""
        return Path(self.source).name

    @property
    def units(self) -> Units:
        """The units of the recording."""
        return UNITS["rotary" if self.rotary else "linear"]

    @property
    def is_response(self) -> bool:
        """Whether the recording is a measured response and not a log over time."""
        return "frequency" in self.channels

    def __len__(self) -> int:
        return next((channel.values.size for channel in self.channels.values()), 0)

    def values(self, role: str) -> Floats | None:
        """Return a column by its role; None if the log lacks it."""
        return self.channels[role].values if role in self.channels else None


MAX_BYTES = 400_000_000  # Greatest size of a log, bytes
# First bytes of gzipped files, of new workbooks, and of old workbooks
GZIP, ZIP, OLE = b"\x1f\x8b", b"PK\x03\x04", b"\xd0\xcf\x11\xe0"
SEPARATORS = (",", ";", "\t")
LOOKED_AT = 10  # Number of rows in which the reader looks for decimal commas
# A whole number, and a number with a decimal comma, both also in quotes
WHOLE, COMMA = (re.compile(rf'"?[+-]?\d+{more}(e[+-]?\d+)?"?', re.IGNORECASE) for more in ("", r",\d+"))


@dataclass(frozen=True, slots=True)
class LogTable:
    """The table of a log, before its columns have roles."""

    headers: list[str]
    numbers: Floats  # shape (rows, columns); finite in the columns that are used
    first_line: int  # line of the file that contains the first row of numbers, from 1
    sha256: str  # SHA-256 digest of the file, in hexadecimal


def read_table(path: Path, used: Callable[[list[str]], Collection[str]] = list) -> LogTable:
    """Read a table, of which the columns that are used are numbers; `used` returns their headers from all."""
    packed, data = _read(path)
    try:
        headers, separator, first_line = _headers(path, data)
        numbers = _numbers(path, data, separator, headers, first_line, used(headers))
    except UnicodeDecodeError:
        decoded(data, str(path), "export the log as CSV")
        raise
    return LogTable(headers, numbers, first_line, sha256(packed).hexdigest())


def headers_of(path: Path) -> list[str]:
    """Return the headers of a table."""
    _, data = _read(path)
    try:
        return _headers(path, data)[0]
    except UnicodeDecodeError:
        decoded(data, str(path), "export the log as CSV")
        raise


def _read(path: Path) -> tuple[bytes, bytes]:
    """Return the content of a file, and its text."""
    try:
        with path.open("rb") as file:
            packed = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise _unreadable(path, f"cannot be read: {error.strerror}") from None
    except ValueError:
        raise _unreadable(path, "is no path: it contains a null character") from None
    return packed, _text_of(path, packed)


def _unreadable(path: Path, message: str) -> InputError:
    return InputError.of(str(path), "unreadable-file", message)


def _text_of(path: Path, data: bytes) -> bytes:
    """Return the text of a file, unpacked if gzipped. The limit stops a small file that unpacks to a huge one too."""
    how = "is longer than"
    if data.startswith((ZIP, OLE)):
        what = "an Excel workbook" if data.startswith(OLE) or b"xl/workbook" in data else "a zip archive"
        raise InputError.of(str(path), "log-text", f"is {what} and not text; save it as CSV")
    if data.startswith(GZIP) and len(data) <= MAX_BYTES:
        how, unpacker = "unpacks to more than", zlib.decompressobj(wbits=31)
        try:
            data = unpacker.decompress(data, MAX_BYTES + 1)
        except zlib.error:
            data = b""
        if not unpacker.eof and len(data) <= MAX_BYTES:
            raise _unreadable(path, "is a damaged gzip file; copy it again")
    if len(data) > MAX_BYTES:
        raise _unreadable(path, f"{how} {MAX_BYTES} bytes; split the log")
    return data


def _stream(data: bytes) -> TextIOWrapper:
    return TextIOWrapper(BytesIO(data), encoding="utf-8-sig")


def _headers(path: Path, data: bytes) -> tuple[list[str], str, int]:
    """Return the headers, their separator, and the line of the first row."""
    try:
        number, line = next(
            (number, line)
            for number, line in enumerate(_stream(data), 1)
            if line.strip() and not line.startswith("#")
        )  # fmt: skip
    except StopIteration:
        message = "is empty; a log is a line of headers and a line for each sample"
        raise InputError.of(str(path), "log-text", message) from None
    separator = next((candidate for candidate in SEPARATORS if candidate in line), SEPARATORS[0])
    headers = _cells(path, line, separator, number)
    if numbers := [header for header in headers if _is_number(header)]:
        message = f"{shown(numbers[0])} is a number where a header should be; give the columns a line of names"
        raise InputError.of(str(path), "log-text", message, line=number)
    if twice := sorted({header for header in headers if headers.count(header) > 1}):
        message = "two columns have this header; rename one"
        raise InputError.of(str(path), "log-text", message, key=twice[0], line=number)
    return headers, separator, number + 1


def _numbers(
    path: Path, data: bytes, separator: str, headers: list[str], first_line: int, used: Collection[str]
) -> Floats:
    """Return the rows of numbers, or refuse them with their faults."""
    data, gaps = data.rstrip(), list[int]()
    wanted = [header in used for header in headers]

    def rows() -> Iterator[str]:
        for number, line in enumerate(islice(_stream(data), first_line - 1, None), first_line):
            if not line.strip():  # which loadtxt would skip
                gaps.append(number)
            yield line

    if next(rows(), None) is None:
        raise InputError.of(str(path), "log-text", "has headers and no samples", line=first_line)
    try:
        numbers = np.loadtxt(rows(), delimiter=separator, ndmin=2, comments=None)
    except UnicodeDecodeError:
        raise
    except ValueError:
        return _from_cells(path, data, separator, headers, first_line, wanted)
    if gaps or numbers.shape[1] != len(headers) or not np.isfinite(numbers[:, wanted]).all():
        return _from_cells(path, data, separator, headers, first_line, wanted)
    return np.asarray(numbers)


def _cells(path: Path, line: str, separator: str, number: int) -> list[str]:
    """Return the cells of a line; a quote that is not closed ends with its line, so that no row is lost in it."""
    try:
        return [cell.strip() for cell in next(csv.reader([line.strip()], delimiter=separator), [])]
    except csv.Error as error:
        raise InputError.of(str(path), "log-text", f"is no row of a table: {error}", line=number) from None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return text.isascii() and "_" not in text  # Python reads more than a table of numbers may have


def _from_cells(
    path: Path, data: bytes, separator: str, headers: list[str], first_line: int, wanted: list[bool]
) -> Floats:
    """Return rows of which some columns are no numbers, or refuse them: decimal commas, a wrong number of cells, and
    cells of a wanted column without a finite number."""
    lines = enumerate(islice(_stream(data), first_line - 1, None), first_line)
    rows = ((number, _cells(path, line, separator, number)) for number, line in lines)
    first = list(islice(rows, LOOKED_AT))
    if comma := _decimal_comma([cells for _, cells in first], separator, wanted):
        message = f"has a decimal comma in {shown(comma[1])}; export the log with decimal points"
        raise InputError.of(str(path), "log-text", message, line=first[comma[0]][0])
    missing = list[tuple[int, str, str]]()  # first cell without a finite number of each such row
    numbers = list[list[float]]()

    def faults() -> Iterator[Mistake]:
        for number, cells in chain(first, rows):
            if len(cells) != len(headers):
                message = f"has {len(cells) or 1} columns, not {len(headers)}; repair or remove the row"
                yield Mistake("log-text", "", message, number)
                continue
            row = list[float]()
            for header, cell, is_wanted in zip(headers, cells, wanted, strict=True):
                if not is_wanted:
                    row.append(nan)
                elif not _is_number(cell):
                    message = f"{shown(cell)} is not a number; repair or remove the row"
                    yield Mistake("log-text", header, message, number)
                else:
                    row.append(float(cell))
                    if not isfinite(row[-1]) and (not missing or missing[-1][0] != number):
                        missing.append((number, header, cell))
            numbers.append(row)

    found = list(islice(faults(), MAX_MISTAKES))
    if missing:
        number, header, cell = missing[0]
        more = f", and {len(missing) - 1} more rows are like it" if len(missing) > 1 else ""
        message = f"{cell} is no finite number: the sample is missing{more}; record again"
        found = sorted([*found, Mistake("log-text", header, message, number)], key=lambda each: each.line or 0)
    if found:
        raise InputError(str(path), found)
    return np.array(numbers)


def _decimal_comma(rows: list[list[str]], separator: str, wanted: list[bool]) -> tuple[int, str] | None:
    """Return the first row with a decimal comma, counted from 0, and the number there; None without one."""
    columns = len(wanted)
    whole = separator == "," and all(WHOLE.fullmatch(cell) for cells in rows for cell in cells)
    torn = whole and 2 * sum(columns < len(cells) <= 2 * columns for cells in rows) > len(rows)
    for number, cells in enumerate(rows):
        if torn and len(cells) > columns:
            return number, ",".join(cells[:2])
        looked_at = [cell for column, cell in enumerate(cells) if column >= columns or wanted[column]]
        if comma := next((cell for cell in looked_at if COMMA.fullmatch(cell)), None):
            return number, comma
    return None
