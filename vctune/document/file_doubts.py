"""Find the values in a problem file that are probably not intended, each with its line and its key."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from vctune.document.reading import ProblemFile
from vctune.document.schema.plausibility import doubts
from vctune.document.schema.validation import dotted
from vctune.document.text.codes import Note


def file_doubts(file: ProblemFile, source: str | None = None) -> Iterator[Note]:
    """Yield notes on values that are probably not intended, with the place of the key if a note is about one key."""
    for note in doubts(file.problem):
        if not note.path:
            yield note
            continue
        place = f"{source or file.source}:{file.line_of(note.path)}: {dotted(note.path)}"
        yield replace(note, text=f"{place}: {note.text}", path=())
