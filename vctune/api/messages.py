"""Provide versions, probable mistakes and schemas for the commands."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from vctune.document.text.codes import Code as Code
from vctune.document.text.codes import coded as coded
from vctune.document.text.codes import has_code as has_code
from vctune.document.text.errors import InputError as InputError
from vctune.document.text.errors import printable as printable

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vctune.document.reading import ProblemFile
    from vctune.document.text.codes import Note
    from vctune.model.problem import Problem


def versions() -> dict[str, str | None]:
    """Return the versions of vctune and of the libraries that affect a result."""
    from vctune.design.nlp.ipopt import ipopt_version
    from vctune.version import versions as of

    return of(ipopt_version())


def doubts(stated: Problem | ProblemFile) -> Iterator[Note]:
    """Yield probable mistakes in a problem, with their places if the problem comes from a file."""
    from vctune.document.file_doubts import file_doubts
    from vctune.document.schema.plausibility import doubts as of
    from vctune.model.problem import Problem

    return of(stated) if isinstance(stated, Problem) else file_doubts(stated)


def schema_of(kind: str) -> dict[str, Any]:
    """Return the JSON Schema of a kind of document."""
    from vctune.document.records.json_schemas import SCHEMAS

    return SCHEMAS[kind]()
