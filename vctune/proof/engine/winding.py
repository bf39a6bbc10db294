"""Count the turns of a curve around 0 by boxes whose images exclude 0: a rigorous argument principle."""

from __future__ import annotations

from collections.abc import Callable
from math import atan2

from flint import arb

from vctune.model.numbers.pair import Pair, re_conj_product
from vctune.proof.enclosures.arb_balls import box
from vctune.proof.engine.interval import Outcome, Verdict, prove_boxes

Curve = Callable[[arb], Pair]


def turned_angle(curve: Curve, low: float, high: float) -> tuple[Outcome, float]:
    """Return the turn of arg(curve) from low to high, rad."""
    angle, edge = 0.0, curve(arb(low))

    def decide(left: float, right: float) -> Verdict:
        nonlocal angle, edge
        image = curve(box(left, right))
        if not (image.re.is_finite() and image.im.is_finite()) or (image.re.contains(0) and image.im.contains(0)):
            return Verdict.UNDECIDED
        start, edge = edge, curve(arb(right))
        angle += _principal_turn(start, edge)
        return Verdict.PROVED

    outcome = prove_boxes(decide, low, high)
    return outcome, angle


def _principal_turn(start: Pair, stop: Pair) -> float:
    cross = start.re * stop.im - start.im * stop.re
    scale = (start.abs2() * stop.abs2()).sqrt()
    return atan2(float(cross / scale), float(re_conj_product(start, stop) / scale))
