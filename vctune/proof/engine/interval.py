"""Prove a margin over an interval by halving it until each box is decided (proof/README.md, section 3)."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from math import sqrt

from flint import arb, arb_series

from vctune.model.device import Device
from vctune.model.hands import Hand
from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.units import hertz
from vctune.proof.enclosures.arb_balls import box
from vctune.running import check_time, report_progress

MAX_BOXES = 200_000  # Number of boxes after which a claim stays undecided
RESOLUTION = 1e-13  # Least width of a box, relative to its position
LOWEST = 1e-40  # Least upper edge of a box that starts at 0, relative to the interval's upper edge
# Ratio of the ends of a box above which the prover does not use the derivative, because its enclosure is too wide there
WIDE = 2.0
CURVED = 1.1  # Ratio of the ends of a box above which the prover does not use the second derivative
GROWTH = 1.5  # Power by which the ratio of the ends grows from a proved box to the next


class Verdict(StrEnum):
    """The verdict of a proof."""

    PROVED = "proved"
    REFUTED = "refuted"
    UNDECIDED = "undecided"


def worst_verdict(verdicts: Iterable[Verdict]) -> Verdict:
    """Return refuted if any verdict is refuted, else undecided if any is undecided, else proved."""
    found = set(verdicts)
    return next(verdict for verdict in (Verdict.REFUTED, Verdict.UNDECIDED, Verdict.PROVED) if verdict in found)


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of a proof."""

    verdict: Verdict  # proved, refuted, or undecided
    boxes: int  # number of evaluated boxes
    witness: float | None = None  # frequency where the claim is refuted or undecided, rad/s
    device: Device | None = None  # device of the box for which the claim is refuted or undecided
    hand: Hand | None = None  # hand of the box in which the claim is refuted or undecided
    cut: bool = False  # whether the claim is undecided because the time limit ended the proof

    @property
    def witness_hz(self) -> float | None:
        """The witness in Hz; None without a witness."""
        return None if self.witness is None else hertz(self.witness)


def prove_boxes(
    decide: Callable[[float, float], Verdict], low: float, high: float, max_boxes: int = MAX_BOXES
) -> Outcome:
    """Go from low to high in boxes until `decide` has proved all of them or has refuted one."""
    left, right = low, high
    for boxes in range(1, max_boxes + 1):
        check_time()
        report_progress(partial(_stage, boxes - 1, (left - low) / (high - low or 1.0)))
        verdict, middle = decide(left, right), _middle(left, right)
        if verdict is Verdict.PROVED and right == high:
            return Outcome(Verdict.PROVED, boxes)
        finest = right - left <= RESOLUTION * right if left > 0 else right <= LOWEST * high
        if verdict is Verdict.REFUTED or (verdict is Verdict.UNDECIDED and finest):
            return Outcome(verdict, boxes, middle)
        if verdict is Verdict.PROVED:
            ratio = right / left if left > 0 else WIDE
            left, right = right, min(right * ratio**GROWTH, high)
        else:
            right = middle
    return Outcome(Verdict.UNDECIDED, max_boxes, middle)


def _stage(boxes: int, proved: float) -> str:
    return f"{boxes} boxes, {proved:.1%} proved"


def _middle(low: float, high: float) -> float:
    """Return where to halve a box: at the mean of the logarithms if it is wide, near 0 if it starts at 0."""
    if low == 0:
        return high / 16
    return sqrt(low) * sqrt(high) if high > WIDE * low else (low + high) / 2


def prove_positive(
    margin: Callable[[Number], Number], low: float, high: float, max_boxes: int = MAX_BOXES, *, curved: bool = False
) -> Outcome:
    """Prove margin > 0 on [low, high], or find a point where it is negative."""

    def decide(left: float, right: float) -> Verdict:
        omega = box(left, right)
        if right > WIDE * left:
            return _sign(margin(omega))
        series = _series(margin, omega, 2)
        if series is None:
            return Verdict.UNDECIDED
        if series[0] > 0:
            return Verdict.PROVED
        centre = arb((left + right) / 2)
        at_centre = margin(centre)
        if at_centre < 0:
            return Verdict.REFUTED
        verdict = _sign(at_centre + series[1] * (omega - centre))
        if curved and verdict is Verdict.UNDECIDED and right < CURVED * left:
            return _by_curvature(margin, omega, centre)
        return verdict

    return prove_boxes(decide, low, high, max_boxes)


def _by_curvature(margin: Callable[[Number], Number], omega: arb, centre: arb) -> Verdict:
    """Prove a margin positive on a box by Taylor's formula of second order."""
    over_box, at_centre = _series(margin, omega, 3), _series(margin, centre, 2)
    if over_box is None or at_centre is None:
        return Verdict.UNDECIDED
    (value, slope), curvature, h = (at_centre[0], at_centre[1]), over_box[2], omega - centre
    proved = value + slope * h + curvature * (h * h) > 0
    proved = proved or (curvature > 0 and value - slope * slope / (4 * curvature) > 0)
    return Verdict.PROVED if proved else Verdict.UNDECIDED


def _series(margin: Callable[[Number], Number], omega: arb, terms: int) -> arb_series | None:
    """Return the Taylor coefficients of a margin over a ball; None if the ball of a denominator contains 0."""
    try:
        return margin(arb_series([omega, 1], terms))
    except ValueError:
        return None


def _sign(value: arb) -> Verdict:
    return Verdict.PROVED if value > 0 else Verdict.REFUTED if value < 0 else Verdict.UNDECIDED
