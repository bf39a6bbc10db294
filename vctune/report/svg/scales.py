"""Define the scales of a panel: their limits, and the round numbers between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, log10

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.report.typography import tick

MARGIN = 0.05  # Margin beyond the outermost points if a scale has no limits, as a share of the scale


@dataclass(slots=True)
class Scale:
    """A scale of a panel."""

    logarithmic: bool = False  # whether the scale is logarithmic
    limits: tuple[float, float] | None = None  # both ends of the scale; None for the ends of its points, with `MARGIN`
    label: str = ""  # name of the scale
    ticks: Sequence[float] | None = None  # positions of the ticks and their texts; None for round numbers
    words: Sequence[str] | None = None
    minor: Sequence[float] = ()  # positions of the minor ticks

    def shares(self, values: Floats, limits: tuple[float, float]) -> Floats:
        """Return values as shares of the scale; nan for values that a logarithmic scale cannot show."""
        with np.errstate(all="ignore"):
            if self.logarithmic:
                low, high = np.log(limits)
                return np.asarray((np.log(np.where(values > 0, values, np.nan)) - low) / (high - low))
            return np.asarray((values - limits[0]) / (limits[1] - limits[0]))


def around(scale: Scale, given: list[Floats]) -> tuple[float, float]:
    """Return limits that contain the points of a scale, with a margin."""
    every = np.concatenate([np.zeros(0), *given])
    every = every[np.isfinite(every) & ((every > 0) | (not scale.logarithmic))]
    if not every.size:
        return (1.0, 10.0) if scale.logarithmic else (0.0, 1.0)
    low, high = float(every.min()), float(every.max())
    if scale.logarithmic:
        low, high = log10(low), log10(high)
    room = MARGIN * (high - low) or MARGIN * abs(high) or 1.0
    low, high = low - room, high + room
    return (10.0**low, 10.0**high) if scale.logarithmic else (low, high)


def ticks_of(scale: Scale, low: float, high: float, most: int = 7) -> list[tuple[float, str]]:
    """Return the ticks of a scale between its limits, and their texts."""
    ticks = scale.ticks
    if ticks is None:
        ticks = decades_between(low, high) if scale.logarithmic else round_numbers(low, high, most)
    words = [tick(value) for value in ticks] if scale.words is None else scale.words
    low, high = sorted((low, high))
    slack = 1e-9 * (high - low)
    return [(value, word) for value, word in zip(ticks, words, strict=True) if low - slack <= value <= high + slack]


def round_numbers(low: float, high: float, most: int = 7) -> list[float]:
    """Return round numbers between two numbers."""
    if not low < high:
        return [low]
    power = 10.0 ** floor(log10((high - low) / most))
    step = next(each * power for each in (1.0, 2.0, 2.5, 5.0, 10.0) if (high - low) / (each * power) <= most)
    return [step * k for k in range(ceil(low / step - 1e-9), floor(high / step + 1e-9) + 1)]


def decades_between(low: float, high: float, most: int = 8) -> list[float]:
    """Return powers of ten between two numbers, or 1, 2 and 5 times these powers if there are few of them."""
    first, last = floor(log10(low)), ceil(log10(high))
    every = max(ceil((log10(high) - log10(low)) / most), 1)
    steps = (1.0,) if high > 100 * low else (1.0, 2.0, 5.0)
    values = [step * 10.0**k for k in range(first, last + 1) if k % every == 0 for step in steps]
    inside = [value for value in values if low * (1 - 1e-9) <= value <= high * (1 + 1e-9)]
    return inside if len(inside) > 1 else round_numbers(low, high, 5)
