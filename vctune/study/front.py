"""Predefine two studies, one for each trade-off of a design."""

from __future__ import annotations

from dataclasses import replace
from math import inf, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats
from vctune.document.study_axes import Axis, Scale, number_keys
from vctune.document.study_file import Study
from vctune.model.problem import Problem, Range
from vctune.study.study_table import Table

EXPONENTS = np.arange(-6, 7) / 2  # Exponents k of the factors 10^k that multiply the weight of |Z_c|/Z_0
# Number of values of K_p, or of K_v for an impedance display, and number of decades below the upper bound at which they
# start if the gain may be 0
POSITIONS, DECADES = 24, 4
EDGES = 41  # Number of values of the upper edge of the stability band
DIGITS = 5  # Number of significant digits in which two designs must differ so that one dominates the other
OWN_ERROR = "error_with_own_weights"  # The name of the error's column if each row has its own weights


def terms_study(document: dict[str, Any], problem: Problem) -> Study:
    """Return the study whose designs trade off |Z_0 G_hh|, |1 - G_he| and |Z_c|/Z_0."""
    if problem.device.kind.inverse:  # a greater K_v worsens free motion, so the best K_v depends on the weights
        velocity = _list("gains.velocity", _values(problem.bounds.velocity))
        return Study("terms", document, (velocity,), problem)
    weight = problem.transparency.weights.coupling or 1.0
    if not problem.device.kind.own_loop:  # only one term differs between designs
        return Study("terms", document, (_list("transparency.weights.coupling", [weight]),), problem)
    weights = [float(f"{weight * 10**k:.6g}") for k in EXPONENTS]
    axes = (
        _list("transparency.weights.coupling", weights),
        _list(
            "gains.position", _values(problem.bounds.position)
        ),  # varies fastest: an infeasible K_p is then found once
    )
    return Study("terms", document, axes, problem)


def _values(bounds: Range) -> list[float]:
    """Return geometrically spaced values of a gain from its lower to its upper bound, with 0 if that is the lower
    bound."""
    if bounds.fixed:
        return [bounds.min]
    low = bounds.min or bounds.max * 10.0**-DECADES
    between = [float(f"{K_p:.6g}") for K_p in np.geomspace(low, bounds.max, POSITIONS)]
    return sorted({bounds.min, *(K_p for K_p in between if bounds.min < K_p < bounds.max), bounds.max})


def band_study(document: dict[str, Any], problem: Problem) -> Study:
    """Return the study whose designs trade off the error against the upper edge of the stability band."""
    nyquist = 0.5 / problem.device.sample_time
    low = problem.stability.band.min / (2 * pi)
    first = min(max(problem.transparency.band.max / (2 * pi), 2 * low), 0.99 * nyquist)
    edges = [float(f"{edge:.6g}") for edge in np.geomspace(first, nyquist, EDGES)[:-1]]
    axes = (
        _list("stability.band_hz[0]", [float(f"{low:.12g}")]),
        _list("stability.band_hz[1]", [*(edge for edge in edges if edge > low), nyquist]),
    )
    return Study("band", document, axes, problem)


def _list(key: str, values: list[float]) -> Axis:
    scale: Scale = "list"
    return Axis(key, number_keys()[key], scale, tuple(values), len(values))


def terms_front(table: Table) -> Table:
    """Return the designs that no other design dominates in the three terms, sorted by |Z_c|/Z_0."""
    costs = np.column_stack([table.numbers[f"{term}_term"] for term in ("admittance", "tracking", "coupling")])
    front = _front(table, costs, by=2)
    numbers = {OWN_ERROR if name == "error" else name: each for name, each in front.numbers.items()}
    return replace(front, numbers=numbers)


def band_front(table: Table) -> Table:
    """Return the designs that no other design dominates in error and upper band edge, sorted by error."""
    edge = table.axes["stability.band_hz[1]"]
    return _front(table, np.column_stack([-edge, table.numbers["error"]]), by=1)


def _front(table: Table, costs: Floats, by: int) -> Table:
    """Return the certified, nondominated rows of a table, sorted by a column of their costs."""
    costs = np.where(table.certified[:, None], costs, inf)
    chosen = nondominated(_rounded(costs))
    order = np.argsort(costs[chosen, by], kind="stable")
    return table.subset(chosen[order])


def _rounded(costs: Floats) -> Floats:
    """Return costs rounded to `DIGITS` digits, so that designs within a solver's tolerance count as equal."""
    return np.array([[float(f"{cost:.{DIGITS}g}") for cost in row] for row in costs]).reshape(costs.shape)


def nondominated(costs: Floats) -> NDArray[np.intp]:
    """Return the indices of the rows with finite cost that no other row dominates."""
    chosen = []
    for i, cost in enumerate(costs):
        no_worse = (costs <= cost).all(axis=1)
        better = no_worse & (costs < cost).any(axis=1)
        twin = no_worse[:i] & (costs[:i] == cost).all(axis=1)
        if np.isfinite(cost).all() and not better.any() and not twin.any():
            chosen.append(i)
    return np.array(chosen, dtype=np.intp)
