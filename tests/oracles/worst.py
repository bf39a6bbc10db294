"""Where a demand is nearest to failing, over frequency and whatever else varies: a scan, then uphill."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np
from scipy.optimize import minimize

Floats = np.ndarray


def worst(
    need: Callable[[Floats, Floats], Floats], low: Floats, high: Floats, theta: Floats, rng: np.random.Generator,
    some: int = 24, closer: int = 3,
) -> tuple[float, float, Floats]:  # fmt: skip
    """Return the greatest need, its angle and its place.

    Parameters
    ----------
    need : of angles and one place, an array
    low, high : ends of what varies; places are scanned at corners, on edges and inside
    theta : angles of the scan
    some : random places
    closer : how many of the best places are followed uphill
    """
    wide = np.flatnonzero(high > low)
    corners = (
        [low + (high - low) * np.array(each) for each in product((0.0, 1.0), repeat=len(low))] if len(wide) else [low]
    )
    corners = list({tuple(corner): corner for corner in corners}.values())[:256]
    shares = rng.uniform(size=(some if len(wide) else 0, len(low))) ** rng.choice([1, 3], (some if len(wide) else 0, 1))
    shares = np.where(rng.random(shares.shape) < 0.5, np.round(shares), shares)
    found: list[tuple[float, float, Floats]] = []
    for place in [*corners, *(low + (high - low) * share for share in shares)]:
        values = np.nan_to_num(need(theta, place), nan=-np.inf, neginf=-np.inf)
        peaks = np.flatnonzero(np.r_[True, values[1:] >= values[:-1]] & np.r_[values[:-1] >= values[1:], True])
        for at in peaks[np.argsort(-values[peaks])][:2]:
            found.append((float(values[at]), float(theta[at]), place))
    found.sort(key=lambda each: -each[0])
    best = found[0]
    if np.isinf(best[0]):
        return best
    for value, angle, place in found[:closer]:
        best = max(
            best,
            _uphill(need, low, high, (value, angle, place), (float(theta[0]), float(theta[-1]))),
            key=lambda each: each[0],
        )
    return best


def _uphill(
    need: Callable[[Floats, Floats], Floats], low: Floats, high: Floats, start: tuple[float, float, Floats],
    ends: tuple[float, float],
) -> tuple[float, float, Floats]:  # fmt: skip
    value, angle, place = start
    wide = np.flatnonzero(high > low)

    def there(x: Floats) -> tuple[float, Floats]:
        moved = place.copy()
        moved[wide] = low[wide] + (high - low)[wide] * np.clip(x[1:], 0, 1) ** 3
        return float(np.clip(angle * np.exp(x[0]), *ends)), moved

    def less(x: Floats) -> float:
        at, moved = there(x)
        return -min(float(need(np.array([at]), moved)[0]), 1e300)

    x = np.r_[0.0, np.cbrt(np.clip((place[wide] - low[wide]) / (high - low)[wide], 0, 1))] if len(wide) else np.zeros(1)
    for size in (0.03, 1e-3):
        simplex = np.vstack([x, *(x + np.where(x[k] > 0.5, -size, size) * np.eye(len(x))[k] for k in range(len(x)))])
        options = {"initial_simplex": simplex, "xatol": 1e-8, "fatol": 1e-12 * abs(value), "maxfev": 200 * len(x)}
        x = minimize(less, x, method="Nelder-Mead", options=options).x
    found, (at, moved) = -less(x), there(x)
    return (found, at, moved) if found > value else start
