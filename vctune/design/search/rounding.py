"""Round the optimiser's doubles in its own units to the decimals that vctune writes, judges and uses."""

from __future__ import annotations

from vctune.analysis.in_walls import in_decimals
from vctune.design.variables import Point, ranges
from vctune.model.problem import Problem, Range

DIGITS = 8
"""Number of significant digits of a written number, unless a design very near the limit of any coupling needs more."""


def rounded(problem: Problem, values: Point, digits: int = DIGITS) -> Point:
    """Return a design's numbers with a given number of digits, or exactly on a bound that they reach.

    A corner among the numbers is rounded to as many digits as `corner_of` gives.

    Parameters
    ----------
    problem : problem with the bounds, SI units
    values : K_v, K_p, b_c, m_c, b_0, SI units
    digits : number of significant digits

    Returns
    -------
    Point
        The rounded numbers, within the bounds.
    """
    known = tuple(_rounded(value, bounds, digits) for value, bounds in zip(values, ranges(problem), strict=False))
    return (*known, *map(in_decimals, values[len(known) :]))


def _rounded(value: float, bounds: Range, digits: int) -> float:
    for bound in (bounds.min, bounds.max):
        if near(value, bound, bounds, digits):
            return bound
    return min(max(float(f"{value:.{digits}g}"), bounds.min), bounds.max)


def near(value: float, bound: float, bounds: Range, digits: int = DIGITS) -> bool:
    """Return whether a value is on a bound: it agrees with it to `digits` digits, or is negligible relative to max.

    Parameters
    ----------
    value : any number of the design
    bound : one of the two ends of its range
    bounds : range of the number
    digits : number of significant digits
    """
    return abs(value - bound) <= (10.0 ** (1 - digits) * abs(bound) if bound else 10.0 ** (-1 - digits) * bounds.max)
