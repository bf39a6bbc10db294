"""Round the variables of a design to the decimals that vctune writes, judges and uses."""

from __future__ import annotations

from vctune.analysis.in_walls import in_decimals
from vctune.design.variables import Point, ranges
from vctune.model.problem import Problem, Range

DIGITS = 8
"""Number of significant digits in `gains.toml`. A design very near a limit may need more digits (`optimum`)."""


def rounded(problem: Problem, values: Point, digits: int = DIGITS) -> Point:
    """Return the variables of a design, rounded to a given number of digits. A value that is near a bound becomes the
    bound.

    The function rounds the corner frequency of the multiplier for walls to the digits that `corner_of` gives.

    Parameters
    ----------
    problem : problem with the bounds, SI units
    values : variables of the design, SI units
    digits : number of significant digits

    Returns
    -------
    Point
        The rounded variables, within the bounds.
    """
    known = tuple(_rounded(value, bounds, digits) for value, bounds in zip(values, ranges(problem), strict=False))
    return (*known, *map(in_decimals, values[len(known) :]))


def _rounded(value: float, bounds: Range, digits: int) -> float:
    for bound in (bounds.min, bounds.max):
        if near(value, bound, bounds, digits):
            return bound
    return min(max(float(f"{value:.{digits}g}"), bounds.min), bounds.max)


def near(value: float, bound: float, bounds: Range, digits: int = DIGITS) -> bool:
    """Return whether a value equals a bound to `digits` digits or, for the bound 0, is negligible beside the upper
    bound.

    Parameters
    ----------
    value : any variable of the design
    bound : one of the two ends of its range
    bounds : range of the variable
    digits : number of significant digits
    """
    return abs(value - bound) <= (10.0 ** (1 - digits) * abs(bound) if bound else 10.0 ** (-1 - digits) * bounds.max)
