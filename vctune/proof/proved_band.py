"""Extend a proved band of frequencies, with edges of few digits."""

from __future__ import annotations

from collections.abc import Callable
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal
from math import pi

import numpy as np

from vctune.proof.enclosures.intervals import Flags, Floats

LOWEST_EDGE = 1e-18  # Lowest frequency, relative to the edge of the required band, to which a proof is extended
FINEST_STEP = 1e-6  # Relative step at which the extension of a proved band ends
PIECES = 64  # Number of intervals that are proved together
EDGE_DIGITS = 5  # Number of digits of an edge in Hz outside the required band
BEYOND = 1e-12  # Relative amount by which an edge in rad/s lies outside the edge in hertz


def extend_band(proved: Callable[[Floats], Flags], edge: float, goal: float) -> float:
    """Return the farthest point from an edge towards a goal up to which a proof holds.

    `proved` tells on which of the intervals between neighbouring frequencies the proof holds.
    """
    start, end = edge, goal
    while abs(end / edge - 1) > FINEST_STEP:
        edges = np.geomspace(edge, end, PIECES + 1)
        edges[0], edges[-1] = edge, end
        held = int(np.argmin([*proved(edges), False]))
        if held == PIECES and end == goal:
            return goal
        edge, end = float(edges[held]), float(edges[min(held + 1, PIECES)])
    return _decimal_edge(lambda low, high: bool(proved(np.array([low, high]))[0]), edge, start, goal)


def _decimal_edge(holds: Callable[[float, float], bool], edge: float, start: float, goal: float) -> float:
    """Return the farthest proved edge, rad/s, that has `EDGE_DIGITS` digits in hertz and is near a given proved
    edge."""
    away = -1 if goal < start else 1
    inner, place = _rounded(Decimal(edge / (2 * pi)), away)
    for decimals in (inner + away * place, inner, inner - away * place):
        found = 2 * pi * float(decimals) * (1 + away * BEYOND)
        found = max(found, goal) if away < 0 else min(found, goal)
        if away * (found - edge) <= 0 or holds(min(edge, found), max(edge, found)):
            return found if away * (found - start) > 0 else start
    return edge


def edge_in_hertz(edge: float, *, upper: bool) -> float:
    """Return an edge of a proved band in hertz."""
    away = 1 if upper else -1
    return float(_rounded(Decimal(edge / (2 * pi) * (1 - away * BEYOND / 10)), away)[0])


def _rounded(hertz: Decimal, away: int) -> tuple[Decimal, Decimal]:
    """Return a frequency rounded inwards to `EDGE_DIGITS` digits, and the value of its last digit's place."""
    place = Decimal(1).scaleb(hertz.adjusted() - EDGE_DIGITS + 1)
    return hertz.quantize(place, ROUND_FLOOR if away > 0 else ROUND_CEILING), place
