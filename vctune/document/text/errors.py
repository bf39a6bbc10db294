"""Define the errors in the user's input, whose text tells how to correct it, and list the stable codes of all refusals,
warnings, remarks and omitted lines."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from typing import Literal

# All codes
Code = Literal[
    "ambiguous-files", "bad-option", "cannot-write", "contradiction", "damaged-document", "file-exists",
    "internal-error", "interrupted", "limit-band", "limit-differ", "limit-floor", "limit-friction", "limit-handle",
    "limit-jitter", "limit-latency", "limit-residuals", "limit-stated", "limit-zero", "log-columns", "log-samples",
    "log-signal", "log-text", "log-unexplained", "missing-key", "more-mistakes", "no-design",
    "no-experiment", "no-plane", "no-workers", "not-certified", "not-fixed", "not-json", "not-toml", "not-yaml",
    "nothing-free", "nothing-proved", "other-document", "other-kind", "other-version", "out-of-range",
    "remark-actuator-lag", "remark-assumed-sensor", "remark-assumed-velocity",
    "remark-columns", "remark-cut", "remark-finer", "remark-held",
    "remark-highest-line", "remark-jitter", "remark-latency-only", "remark-order",
    "remark-saturated", "remark-slow-log", "remark-slow-motion", "remark-spring", "remark-stated-delay",
    "remark-unpushed", "remark-unused", "remark-weak-delay", "ros-angle", "ros-integers", "ros-unknown-key",
    "ros-no-damping",
    "ros-other-law", "ros-parameter", "ros-rotation",
    "ros-slow-filter", "ros-step", "ros-unmodelled", "ros-unused-ratio", "rows-file", "rows-torn", "time-limit",
    "unknown-key", "unknown-name", "unreadable-file", "usage", "warn-acceleration", "warn-band-edge", "warn-bound",
    "warn-buzzes", "warn-environment", "warn-gain", "warn-idle", "warn-latency", "warn-limp", "warn-margin",
    "warn-mass", "warn-name", "warn-residual", "warn-rings",
    "warn-sample-time", "warn-stiffness", "warn-table", "warn-yields", "wrong-type",
]  # fmt: skip
ENDING = re.compile(r" \[([a-z]+(?:-[a-z]+)*)\]$")  # A code in brackets at the end of a line


def coded(text: str, code: Code) -> str:
    """Return a line with its code in brackets at the end, as an argument for `vctune explain`."""
    return f"{text} [{code}]"


def code_of(line: str) -> str:
    """Return the code at the end of a line; "" without one."""
    match = ENDING.search(line)
    return match[1] if match else ""


def has_code(line: str | None, code: Code) -> bool:
    """Return whether a line ends with a code."""
    return code_of(line or "") == code


@dataclass(frozen=True, slots=True)
class Note:
    """A note for the reader: a warning, a part that a search omitted, or a remark on a log."""

    code: Code  # code of the note
    text: str  # text of the note
    path: tuple[str | int, ...] = ()  # key of the problem file that the note is about

    @property
    def line(self) -> str:
        """The text, with its code at the end."""
        return coded(self.text, self.code)


@dataclass(frozen=True, slots=True)
class Mistake:
    """One mistake in a document."""

    code: Code  # code of the mistake; `vctune explain CODE` tells more
    key: str  # dotted key; "" for the document as a whole
    message: str  # the fault, with the value and what to do
    line: int | None = None  # line number from 1; None without a line


def printable(text: str) -> str:
    """Return a text with all unprintable characters escaped."""
    return "".join(char if is_plain(char) else _escaped(ord(char)) for char in text)


def is_plain(char: str) -> bool:
    """Return whether a character prints as itself: it is not a control, format, separator, surrogate or
    noncharacter."""
    return unicodedata.category(char) not in ("Cc", "Cf", "Cs", "Zl", "Zp") and ord(char) & 0xFFFE != 0xFFFE


def _escaped(code: int) -> str:
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


class InputError(ValueError):
    """Error in the user's input: a file, an option or a number.

    Attributes
    ----------
    source : str
        Path of the file, or another source of the faults.
    mistakes : list[Mistake]
        The faults; the text of the error has a line for each.
    """

    def __init__(self, source: str, mistakes: list[Mistake]) -> None:
        self.source = source
        self.mistakes = mistakes
        super().__init__(str(self))

    @classmethod
    def of(cls, source: str, code: Code, message: str, *, key: str = "", line: int | None = None) -> InputError:
        """Return the error with a single mistake: the fault, its amount, and what to do."""
        return InputError(source, [Mistake(code, key, message, line)])

    def __str__(self) -> str:
        return "\n".join(self._line(mistake) for mistake in self.mistakes)

    def _line(self, mistake: Mistake) -> str:
        place = self.source if mistake.line is None else f"{self.source}:{mistake.line}"
        said = printable(": ".join(part for part in (place, mistake.key, mistake.message) if part))
        return coded(said, mistake.code)
