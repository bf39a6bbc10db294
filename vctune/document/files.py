"""Files that appear whole or not at all: written beside their place, then renamed."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Mapping
from pathlib import Path

from vctune.document.errors import InputError, Mistake
from vctune.interrupt import interrupt_deferred

MAX_NAME_BYTES = 100


def write_together(files: Mapping[Path, str | bytes | memoryview]) -> None:
    """Write files that belong together, replacing older ones only when all the new ones are complete.

    Ctrl-C waits until they are in place.

    Raises
    ------
    InputError
        If a place cannot be written; the older files are then untouched.
    """
    with interrupt_deferred():
        temporary: dict[Path, str] = {}
        path = Path()
        try:
            for path, content in files.items():
                if path.is_dir():
                    raise IsADirectoryError(21, "Is a directory")
                handle, temporary[path] = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
                with os.fdopen(handle, "wb") as file:
                    file.write(content.encode() if isinstance(content, str) else content)
                    file.flush()
                    os.fsync(file.fileno())
                os.chmod(temporary[path], 0o666 & ~_umask())
            for path in files:
                os.replace(temporary.pop(path), path)
        except OSError as error:
            raise _unwritable(path, error) from None
        finally:
            for name in temporary.values():
                Path(name).unlink(missing_ok=True)


def set_aside(path: Path) -> Path:
    """Rename a file NAME.SUFFIX that is not up to date any more to NAME.previous.SUFFIX, and return that path.

    Raises
    ------
    InputError
        If it cannot be renamed.
    """
    previous = path.with_suffix(f".previous{path.suffix}")
    try:
        path.replace(previous)
    except OSError as error:
        raise _unwritable(previous, error) from None
    return previous


def make_folder(path: Path) -> None:
    """Create a folder with its parents and make sure that it can be written to.

    Raises
    ------
    InputError
        If it cannot.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except UnicodeError:
        message = "cannot be written in this locale's file names; set a UTF-8 locale or another name"
        raise InputError(str(path), [Mistake("", message)]) from None
    except OSError as error:
        raise _unwritable(path, error) from None


def folder_name(name: str) -> str:
    """Return a design's name as the name of one folder: without separators, control characters or leading dots."""
    plain = re.sub(r'[\x00-\x1f\x7f/\\:*?"<>|]', "_", name).encode()[:MAX_NAME_BYTES].decode(errors="ignore")
    return plain.strip().lstrip(".").rstrip(". ") or "design"


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _unwritable(path: Path, error: OSError) -> InputError:
    return InputError(str(path), [Mistake("", f"cannot be written: {error.strerror}; choose another place with --out")])
