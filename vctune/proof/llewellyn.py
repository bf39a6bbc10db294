"""Proof of Llewellyn's conditions on a band, and the widest band on which they hold.

See model/README.md, section 4; proof/README.md, section 3.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import pi, sqrt

from flint import arb

from vctune.model.arithmetic import Number
from vctune.model.coupling import coupling_impedance
from vctune.proof.balls import BALLS, design_ball, design_series, lifted
from vctune.proof.claims import Design, conditions_margin, outwards
from vctune.proof.exact import conditions, is_rational, widest
from vctune.proof.exact import prove as prove_polynomials
from vctune.proof.interval import Outcome, Verdict, prove_positive
from vctune.proof.low_end import low_end_verdict, prove_low_end

MARCH_BOXES = 2_000
FINEST_STEP = 1e-8
LOWEST_EDGE = 1e-18
"""How far below the requested band a proof that does not reach 0 is carried, relative to its edge."""


def _margin(design: Design, factor: float) -> Callable[[Number], Number]:
    """Return `conditions_margin` of a design's decimals as a function of omega; without a loop C = N = 0."""
    exact, threshold = design_ball(design), arb(repr(factor))
    if not design.gains.closed:
        damping = exact.device.held.damping
        return lambda omega: 2 * damping * coupling_impedance(exact.coupling, omega).re
    series, in_series = design_series(exact), lifted(threshold)

    def margin(omega: Number) -> Number:
        given, demand = (exact, threshold) if isinstance(omega, arb) else (series, in_series)
        return conditions_margin(given, omega, demand, BALLS)

    return margin


def prove_conditions(design: Design, low: float, high: float, factor: float) -> Outcome:
    """Prove Re(D + Z_h) > 0 and Re Z_c >= factor R on [low, high], which may start at 0.

    With hold "lag" and no delay it may be [0, inf], and the proof is exact. Finite edges are widened by the rounding of
    2 pi f.
    """
    wider = outwards((low, high))
    if is_rational(design.device):
        return prove_polynomials(conditions(design, factor), *wider)
    margin = _margin(design, factor)
    start = wider[0] if low > 0 else _low_start(design, factor, high)
    if start is None:
        return _end_failure(low_end_verdict(design), margin, min(high, 1.0))
    return prove_positive(margin, start, wider[1]) if start < wider[1] else Outcome(Verdict.PROVED, 1)


def _low_start(design: Design, factor: float, high: float) -> float | None:
    return prove_low_end(design, factor, min(high, 1 / design.device.sample_time))


def _end_failure(verdict: Verdict, margin: Callable[[Number], Number], start: float) -> Outcome:
    """Return the outcome when omega = 0 is not proved, with a witness where the conditions demonstrably fail."""
    omega = start
    for tries in range(1, 400):
        if margin(arb(omega)) < 0:
            return Outcome(Verdict.REFUTED, tries, omega)
        omega /= 4
    return Outcome(Verdict.UNDECIDED, tries, 0.0)


def widest_band(design: Design, low: float, high: float) -> tuple[float, float]:
    """Return the widest band around a proved one on which Re(D + Z_h) > 0 and ratio >= 1 are proved, rad/s.

    Upwards it ends at the Nyquist frequency, beyond which the frequency model means nothing, but for hold "lag"
    without delay, whose model is good for a proof to inf.
    """
    if is_rational(design.device):
        return widest(conditions(design, 1.0), low, high)
    margin = _margin(design, 1.0)
    return _lowest(design, margin, low), march(partial(_proved, margin), high, pi / design.device.sample_time)


def _proved(margin: Callable[[Number], Number], low: float, high: float) -> bool:
    return prove_positive(margin, low, high, MARCH_BOXES).verdict is Verdict.PROVED


def _lowest(design: Design, margin: Callable[[Number], Number], low: float) -> float:
    if low == 0:
        return 0.0
    if low_end_verdict(design) is Verdict.PROVED:
        start = _low_start(design, 1.0, low)
        if start is not None and (start >= low or _proved(margin, start, low)):
            return 0.0
    return march(partial(_proved, margin), low, low * LOWEST_EDGE)


def march(holds: Callable[[float, float], bool], edge: float, goal: float) -> float:
    """Return how far from edge towards goal a proof holds, to `FINEST_STEP`."""
    down = goal < edge
    step = 4.0
    while step - 1 > FINEST_STEP and edge != goal:
        ahead = max(goal, edge / step) if down else min(goal, edge * step)
        if holds(min(edge, ahead), max(edge, ahead)):
            edge, step = ahead, min(step * step, 16.0)
        else:
            step = sqrt(step)
    return edge
