"""From the optimiser's doubles in its own units to the decimals that vctune writes, judges and uses."""

from __future__ import annotations

from vctune.analysis.in_walls import in_decimals
from vctune.design.variables import Point, ranges
from vctune.model.problem import Problem, Range

DIGITS = 8
"""Significant digits of a written number, unless a design so near the limit of any coupling needs more."""


def rounded(problem: Problem, values: Point, digits: int = DIGITS) -> Point:
    """Return five physical numbers with so many digits, on their bounds if they reach them.

    A corner that follows them is rounded to as many as `corner_of` has.

    Parameters
    ----------
    problem : problem with the bounds, SI units
    values : K_v, K_p, b_c, m_c, b_0, SI units
    digits : significant ones

    Returns
    -------
    Point
        Within the bounds.
    """
    known = tuple(_rounded(value, bounds, digits) for value, bounds in zip(values, ranges(problem), strict=False))
    return (*known, *map(in_decimals, values[len(known) :]))


def _rounded(value: float, bounds: Range, digits: int) -> float:
    for bound in (bounds.min, bounds.max):
        if near(value, bound, bounds, digits):
            return bound
    return min(max(float(f"{value:.{digits}g}"), bounds.min), bounds.max)


def near(value: float, bound: float, bounds: Range, digits: int = DIGITS) -> bool:
    """Return whether a value is on a bound: it shares so many digits with it, or is negligible beside max.

    Parameters
    ----------
    value : any of the five numbers
    bound : one of the two ends of its range
    bounds : that range
    digits : significant ones
    """
    return abs(value - bound) <= (10.0 ** (1 - digits) * abs(bound) if bound else 10.0 ** (-1 - digits) * bounds.max)
