"""What every benchmark is: a measurement that makes tables of frozen rows, what they say, and a picture of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from vctune.report.benchmarks import Panel

Tick = Callable[[str], None]
"""Told what is being measured."""


@dataclass(frozen=True, slots=True)
class Size:
    """How much is measured: under a minute (`quick`), or everything; and the seed of what is random."""

    quick: bool
    seed: int


@dataclass(frozen=True, slots=True)
class Measured:
    """What a benchmark found.

    Attributes
    ----------
    title, reading : what it is, and how the picture is read
    tables : rows of one frozen dataclass each, by the name of their file
    facts : what the rows say, a sentence each
    panels : of the picture
    """

    title: str
    reading: str
    tables: dict[str, list[Any]]
    facts: list[str]
    panels: list[Panel]
