"""Write the files of one run together. vctune first writes each file beside its final place, and then moves all files
in an order that never mixes two runs."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path

from vctune.document.text.errors import InputError, is_plain
from vctune.interrupt import interrupt_deferred, raise_lost_interrupt

Content = str | bytes | memoryview
MAX_NAME_BYTES = 100  # Greatest length of a folder's name, in bytes of UTF-8
# Names of devices on Windows, which a file or folder cannot have
RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d) *(\.|$)", re.IGNORECASE)


def write_together(files: Mapping[Path, Content], stale: Iterable[Path] = ()) -> None:
    """Replace the files of an earlier run with the files of a new run. SIGINT and SIGTERM take effect only
    afterwards."""
    raise_lost_interrupt()
    first, *others = files
    with interrupt_deferred():
        complete: dict[Path, str] = {}
        place = first
        try:
            for place in (*files, *stale):
                if place.is_dir():
                    raise IsADirectoryError(21, "Is a directory")
            for place, content in files.items():
                handle, complete[place] = tempfile.mkstemp(dir=place.parent, prefix=f".{place.name}.")
                _fill(handle, content)
                os.chmod(complete[place], 0o666 & ~_umask())
            for place in (*stale, *reversed(others)):
                place.unlink(missing_ok=True)
            for place in files:
                os.replace(complete.pop(place), place)
        except OSError as error:
            raise _unwritable(place, error) from None
        finally:
            for name in complete.values():
                Path(name).unlink(missing_ok=True)


def make_folder(path: Path) -> None:
    """Create a folder with its parents and make sure that it can be written to."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except UnicodeError:
        message = "cannot be written in this locale's file names; set a UTF-8 locale or another name"
        raise InputError.of(str(path), "cannot-write", message) from None
    except OSError as error:
        raise _unwritable(path, error) from None


def folder_name(name: str) -> str:
    """Return a design's name as a folder name that is valid on any system."""
    plain = "".join(char if is_plain(char) and char not in '/\\:*?"<>|' else "_" for char in name)
    short = plain.encode()[:MAX_NAME_BYTES].decode(errors="ignore").strip().lstrip(".").rstrip(". ")
    return f"_{short}" if RESERVED.match(short) else short or "design"


def _fill(handle: int, content: Content) -> None:
    with os.fdopen(handle, "wb") as file:
        file.write(content.encode() if isinstance(content, str) else content)
        file.flush()
        os.fsync(file.fileno())


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _unwritable(path: Path, error: OSError) -> InputError:
    return InputError.of(str(path), "cannot-write", f"cannot be written: {error.strerror}; choose another folder")


def today() -> str:
    """Return the day in UTC, such as 2026-01-31."""
    stated = os.environ.get("SOURCE_DATE_EPOCH", "")
    now = datetime.fromtimestamp(int(stated), UTC) if stated.isdigit() else datetime.now(UTC)
    return now.date().isoformat()
