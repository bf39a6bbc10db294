"""List the points of a study in a fixed order."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.document.study_axes import Axis
from vctune.document.study_file import Study

DIGITS = 12  # Number of significant digits of the computed values

Values = tuple[float, ...]


def points(study: Study) -> Iterator[Values]:
    """Yield the values of the axes at every point; the last axis of a grid varies fastest."""
    if study.sample.kind == "lhs":
        return latin_hypercube(study.axes, study.sample.n, study.sample.seed)
    columns = [axis_values(axis) for axis in study.axes]
    return product(*columns) if study.sample.kind == "grid" else zip(*columns, strict=True)


def axis_values(axis: Axis) -> Values:
    """Return the values of an axis: its list, or n values of its range."""
    if axis.scale == "list" or axis.n is None:
        return axis.values
    return _spread(axis, np.arange(axis.n) / (axis.n - 1))


def latin_hypercube(axes: tuple[Axis, ...], n: int, seed: int) -> Iterator[Values]:
    """Yield n points of a Latin hypercube."""
    generator = np.random.default_rng(seed)
    shares = [(generator.permutation(n) + generator.random(n)) / n for _ in axes]
    columns = [_spread(axis, share) for axis, share in zip(axes, shares, strict=True)]
    return zip(*columns, strict=True)


def _spread(axis: Axis, share: Floats) -> Values:
    """Return the values of an axis at given shares of its range, between 0 and 1."""
    if axis.scale == "list":
        return tuple(axis.values[int(t * len(axis.values))] for t in share)
    low, high = axis.values
    made = low * (high / low) ** share if axis.scale == "log" else low + (high - low) * share
    return tuple(min(max(float(f"{value:.{DIGITS}g}"), low), high) for value in made)
