"""Round the variables of a design to the decimals that vctune writes, judges and uses."""

from __future__ import annotations

from vctune.analysis.in_walls import in_decimals
from vctune.design.variables import Point, ranges
from vctune.model.problem import Problem, Range

DIGITS = 8  # Number of significant digits in `gains.toml`


def rounded(problem: Problem, values: Point, digits: int = DIGITS) -> Point:
    """Return the variables of a design, rounded to a given number of digits. A value that is near a bound becomes the
    bound."""
    known = tuple(_rounded(value, bounds, digits) for value, bounds in zip(values, ranges(problem), strict=False))
    return (*known, *map(in_decimals, values[len(known) :]))


def _rounded(value: float, bounds: Range, digits: int) -> float:
    for bound in (bounds.min, bounds.max):
        if near(value, bound, bounds, digits):
            return bound
    return min(max(float(f"{value:.{digits}g}"), bounds.min), bounds.max)


def near(value: float, bound: float, bounds: Range, digits: int = DIGITS) -> bool:
    """Return whether a value equals a bound to `digits` digits or, for the bound 0, is negligible beside the upper
    bound."""
    return abs(value - bound) <= (10.0 ** (1 - digits) * abs(bound) if bound else 10.0 ** (-1 - digits) * bounds.max)
