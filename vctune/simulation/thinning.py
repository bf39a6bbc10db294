"""Reduce a curve to fewer points that look the same (Ramer, Douglas and Peucker)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vctune.model.numbers.arithmetic import Floats

Indices = NDArray[np.intp]


def thinned(x: Floats, y: Floats, tolerance: tuple[float, float]) -> Indices:
    """Return the indices of a subset of points whose polyline stays close to all other points."""
    curve = x / tolerance[0] + 1j * (y / tolerance[1])
    kept = np.zeros(len(curve), bool)
    kept[[0, -1]] = True
    spans = [(0, len(curve) - 1)]
    while spans:
        low, high = spans.pop()
        if high - low < 2:
            continue
        away = _distances(curve[low + 1 : high], curve[low], curve[high])
        farthest = int(away.argmax())
        if away[farthest] > 1.0:
            middle = low + 1 + farthest
            kept[middle] = True
            spans += [(low, middle), (middle, high)]
    return np.flatnonzero(kept)


def _distances(points: NDArray[np.complex128], start: complex, end: complex) -> Floats:
    """Return the distances of points in the complex plane from a segment."""
    along = end - start
    length = abs(along)
    if length == 0:
        return np.abs(points - start)
    turned = (points - start) * (along.conjugate() / length)
    beyond = turned.real - np.clip(turned.real, 0.0, length)
    return np.hypot(beyond, turned.imag)
