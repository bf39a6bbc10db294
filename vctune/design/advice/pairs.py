"""Two changes together, each of the same relative size, for where no change of one value suffices."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

from vctune.design.advice.parameter_changes import ParameterChange

SIZES = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)  # Relative sizes that are tried, the same for both changes
MOST_CHANGES = 8  # Greatest number of changes of which pairs are tried


@dataclass(frozen=True, slots=True)
class Pair:
    """Two changes as one, whose value is the relative size of both."""

    first: ParameterChange
    second: ParameterChange
    old: float = 0.0
    limit: float = SIZES[-1]
    switch: bool = False

    @property
    def both(self) -> tuple[ParameterChange, ParameterChange]:
        """The two changes."""
        return self.first, self.second

    @property
    def meaning(self) -> str:
        """What both change, in words."""
        return f"{self.first.meaning} and {self.second.meaning}"

    def values(self, size: float) -> tuple[float, float]:
        """Return the new values of both at a relative size, each at most at its limit."""
        first, second = (each.rounded(each.at(min(size, each.relative(each.limit)))) for each in self.both)
        return first, second

    def between(self, first: float, second: float) -> float:
        """Return a size between two."""
        return (first * second) ** 0.5 if first > 0 else 0.5 * (first + second)

    def applied(self, document: dict[str, Any], size: float) -> dict[str, Any]:
        """Return the document with both values changed."""
        for change, new in zip(self.both, self.values(size), strict=True):
            document = change.applied(document, new)
        return document


def pairs(changes: Sequence[ParameterChange]) -> Iterator[Pair]:
    """Yield the pairs of changes of the design and of the device, not of what is assumed."""
    own = sorted((each for each in changes if not each.assumes and not each.switch), key=lambda each: not each.chooses)
    for first, second in combinations(own[:MOST_CHANGES], 2):
        if first.key != second.key:
            yield Pair(first, second)
