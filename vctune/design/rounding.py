"""From the optimiser's doubles in its own units to the decimals that are written, judged and used."""

from __future__ import annotations

from vctune.design.variables import Point, ranges
from vctune.document.problem import Problem, Range

DIGITS = 8
"""Significant digits written; the demands are sharpened by more than this rounding can cost."""
AT_BOUND = 1e-7
"""Relative distance at which a value counts as on its bound."""
NOTHING = 1e-9
"""Size, relative to the upper bound, below which a value that may be 0 is 0."""


def rounded(problem: Problem, values: Point) -> Point:
    """Return five physical numbers rounded to `DIGITS` digits, on their bounds where they reach them."""
    return tuple(_rounded(value, bounds) for value, bounds in zip(values, ranges(problem.bounds), strict=True))  # type: ignore[return-value]


def _rounded(value: float, bounds: Range) -> float:
    for bound in (bounds.min, bounds.max):
        if near(value, bound, bounds):
            return bound
    return min(max(float(f"{value:.{DIGITS}g}"), bounds.min), bounds.max)


def near(value: float, bound: float, bounds: Range) -> bool:
    """Return whether a value counts as on a bound."""
    return abs(value - bound) <= (AT_BOUND * abs(bound) if bound else NOTHING * bounds.max)
