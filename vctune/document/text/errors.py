"""Define the errors in the user's input. The text of an error tells the user how to correct it."""

from __future__ import annotations

import unicodedata
from dataclasses import dataclass

from vctune.document.text.codes import Code, coded


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
