"""Prove Llewellyn's conditions near omega = 0, where the ratio may be 0/0 (model/README.md, section 6)."""

from __future__ import annotations

from collections.abc import Callable

from flint import arb

from vctune.model.loop.limits import low_frequency_limit
from vctune.proof.claims.margins_of_claims import Design, low_margin, resistance_apart, resistance_margin
from vctune.proof.enclosures.arb_balls import BALLS, box, design_ball
from vctune.proof.engine.interval import Verdict, prove_boxes

SHRINK = 4.0  # Factor between two trial frequencies; the margin near 0 is proved up to one of them
STEPS = 120  # Number of trial frequencies, down to 1e-72 of the first
END_BOXES = 64  # Number of boxes for a trial frequency


def low_end_verdict(design: Design) -> Verdict:
    """Compare the exact limits of Re Z_c and R for omega -> 0. Return undecided if they are equal."""
    exact = design_ball(design)
    limit = low_frequency_limit(exact.device, exact.gains, exact.series, BALLS)
    if limit.coupling < limit.required:
        return Verdict.REFUTED
    return Verdict.PROVED if limit.coupling > limit.required else Verdict.UNDECIDED


def prove_low_end(design: Design, factor: float, below: float) -> float | None:
    """Find an omega_0 <= below such that Re G_hh > 0 and Re Z_c >= factor R are proved on (0, omega_0]."""
    exact, threshold = design_ball(design), arb(repr(factor))
    if not design.gains.closed:  # without feedback R = 0
        return below if design.device.least_damping > 0 else None

    def met(omega: arb) -> bool:
        apart = resistance_apart(design.device) and not resistance_margin(exact, omega, BALLS) > 0
        return bool(not apart and low_margin(exact, omega, threshold, BALLS) > 0)

    return _largest(met, below)


def _largest(met: Callable[[arb], bool], start: float) -> float | None:
    """Return the greatest of start, start/4, start/16, ... up to which the conditions are proved, beginning at 0."""

    def decide(low: float, high: float) -> Verdict:
        return Verdict.PROVED if met(box(low, high)) else Verdict.UNDECIDED

    edge = start
    for _ in range(STEPS):
        if prove_boxes(decide, 0.0, edge, END_BOXES).verdict is Verdict.PROVED:
            return edge
        edge /= SHRINK
    return None
