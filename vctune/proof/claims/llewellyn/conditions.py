"""Prove Llewellyn's conditions on a band, and find the widest band on which they hold. See model/README.md, section 4;
proof/README.md, section 3."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import pi

from flint import arb

from vctune.model.gains import coupling_impedance
from vctune.model.loop.limits import low_frequency_limit
from vctune.model.numbers.arithmetic import Number
from vctune.proof.claims.llewellyn.polynomials import conditions, is_rational, widest
from vctune.proof.claims.llewellyn.polynomials import prove as prove_polynomials
from vctune.proof.claims.margins_of_claims import (
    Design,
    conditions_margin,
    low_margin,
    outwards,
    resistance_apart,
    resistance_margin,
)
from vctune.proof.enclosures.arb_balls import BALLS, as_series, box, design_ball, design_series
from vctune.proof.engine.bands import extend_band
from vctune.proof.engine.interval import Outcome, Verdict, prove_boxes, prove_positive

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


EXTENSION_BOXES = 2_000  # Number of boxes for one step beyond the band
# Lowest frequency, relative to the edge of the required band, to which the code extends a proof that does not reach 0
LOWEST_EDGE = 1e-18


Margin = Callable[[Number], Number]


def _margins(design: Design, factor: float) -> list[Margin]:
    """Return the margins of a design's decimals as functions of omega. The first is `conditions_margin`."""
    exact, threshold = design_ball(design), arb(repr(factor))
    if not design.gains.closed:
        damping = exact.device.least_damping
        return [lambda omega: 2 * damping * coupling_impedance(exact.series, omega).re]
    series, in_series = design_series(exact), as_series(threshold)

    def conditions_met(omega: Number) -> Number:
        if isinstance(omega, arb):
            return conditions_margin(exact, omega, threshold, BALLS)
        return conditions_margin(series, omega, in_series, BALLS)

    def resistance(omega: Number) -> Number:
        return resistance_margin(exact if isinstance(omega, arb) else series, omega, BALLS)

    return [conditions_met, resistance] if resistance_apart(design.device) else [conditions_met]


def prove_conditions(design: Design, low: float, high: float, factor: float) -> Outcome:
    """Prove Re G_hh > 0 and Re Z_c >= factor R on [low, high], in the hand of the least operator."""
    wider = outwards((low, high))
    if is_rational(design.device):
        return prove_polynomials(conditions(design, factor), *wider)
    margins = _margins(design, factor)
    start = wider[0] if low > 0 else _low_start(design, factor, high)
    if start is None:
        return _end_failure(low_end_verdict(design), margins[0], min(high, 1.0))
    outcome, boxes = Outcome(Verdict.PROVED, 1), 0
    for margin in margins if start < wider[1] else []:
        outcome = prove_positive(margin, start, wider[1])
        boxes += outcome.boxes
        if outcome.verdict is not Verdict.PROVED:
            break
    return replace(outcome, boxes=max(boxes, 1))


def conditions_at(design: Design, factor: float, omega: float) -> Outcome:
    """Return whether the conditions certainly fail at one frequency."""
    fails = any(margin(arb(omega)) < 0 for margin in _margins(design, factor))
    return Outcome(Verdict.REFUTED, 1, omega) if fails else Outcome(Verdict.UNDECIDED, 1)


def _low_start(design: Design, factor: float, high: float) -> float | None:
    return prove_low_end(design, factor, min(high, 1 / design.device.sample_time))


def _end_failure(verdict: Verdict, margin: Margin, start: float) -> Outcome:
    """Return the outcome if the proof fails at omega = 0, with a witness if the conditions certainly fail."""
    omega = start
    for tries in range(1, 400):
        if margin(arb(omega)) < 0:
            return Outcome(Verdict.REFUTED, tries, omega)
        omega /= 4
    return Outcome(Verdict.UNDECIDED, tries, 0.0)


def widest_band(design: Design, low: float, high: float) -> tuple[float, float]:
    """Return the widest band around a proved band on which Re G_hh > 0 and Re Z_c >= R are proved."""
    if is_rational(design.device):
        return widest(conditions(design, 1.0), low, high)
    margins = _margins(design, 1.0)
    return _lowest(design, margins, low), extend_band(partial(_proved, margins), high, pi / design.device.sample_time)


def _proved(margins: list[Margin], low: float, high: float) -> bool:
    return all(prove_positive(margin, low, high, EXTENSION_BOXES).verdict is Verdict.PROVED for margin in margins)


def _lowest(design: Design, margins: list[Margin], low: float) -> float:
    if low == 0:
        return 0.0
    if low_end_verdict(design) is Verdict.PROVED:
        start = _low_start(design, 1.0, low)
        if start is not None and (start >= low or _proved(margins, start, low)):
            return 0.0
    return extend_band(partial(_proved, margins), low, low * LOWEST_EDGE)
