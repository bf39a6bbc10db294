"""Prove that the poles of the exact sampled loop lie inside the unit circle, and that |S| is below a limit
(model/README.md, section 7)."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import numpy as np
from flint import acb_poly, arb, ctx

from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.pair import Pair
from vctune.model.sampled.characteristic import characteristic_polynomial
from vctune.model.sampled.velocity_loop import SampledPlant, return_difference, sampled_plant, split_delay
from vctune.proof.claims.margins_of_claims import HALF_TURN, Design, sensitivity_margin, unmodelled_margin
from vctune.proof.enclosures.arb_balls import BALLS, PRECISION, as_series, ball, device_ball, gains_ball
from vctune.proof.engine.interval import Outcome, Verdict, prove_positive
from vctune.proof.engine.winding import turned_angle

ISOLATED_DEGREE = 40  # Greatest degree for which the displayed spectral radius comes from isolated roots
ROOT_TOLERANCE = 1e-16  # Radius of the enclosures of poles, finer than a double


def prove_sensitivity(design: Design, max_sensitivity: float) -> Outcome:
    """Prove |S| < max_sensitivity of the sampled loop at every frequency."""
    plant, gains, limit = exact_plant(design.device), gains_ball(design.gains), ball(max_sensitivity)
    in_series = (
        plant.converted(as_series),
        Gains(as_series(gains.velocity), as_series(gains.position)),
        as_series(limit),
    )

    def margin(theta: Number) -> Number:
        numbers = (plant, gains, limit) if isinstance(theta, arb) else in_series
        return sensitivity_margin(numbers[0], numbers[1], theta, numbers[2], BALLS)

    return in_rad_per_s(prove_positive(margin, 0.0, HALF_TURN, curved=True), design.device)


def unmodelled_at(device: Device, gains: Gains, radii: tuple[tuple[float, float], ...], theta: float) -> Outcome:
    """Return whether |1 - S| r > 1 is certain at one angle, where r is the radius of the disc there."""
    radius = BALLS.interpolated(arb(theta / (2 * pi * device.sample_time)), radii)
    margin = unmodelled_margin(exact_plant(device), gains_ball(gains), arb(theta), radius, BALLS)
    if margin < 0:
        return in_rad_per_s(Outcome(Verdict.REFUTED, 1, theta), device)
    return Outcome(Verdict.UNDECIDED, 1)


def prove_sampled_poles(device: Device, gains: Gains) -> Outcome:
    """Prove that the spectral radius of the exact sampled loop is below 1."""
    law, plant = gains_ball(gains), exact_plant(device)

    def curve(theta: arb) -> Pair:
        return return_difference(plant, theta, BALLS, position=gains.position > 0).closed(law)

    outcome, angle = turned_angle(curve, 0.0, HALF_TURN)
    if outcome.verdict is not Verdict.PROVED:
        return in_rad_per_s(outcome, device)
    start, stop = curve(arb(0)).re, curve(arb.pi()).re
    if abs(angle) < pi / 2 and start > 0 and stop > 0:
        return outcome
    return Outcome(Verdict.REFUTED, outcome.boxes)


def in_rad_per_s(outcome: Outcome, device: Device) -> Outcome:
    """Return an outcome with its witness theta = omega T converted to omega."""
    witness = outcome.witness / device.sample_time if outcome.witness is not None else None
    return replace(outcome, witness=witness)


def exact_plant(device: Device) -> SampledPlant:
    """Return the sampled plant of a device with its decimals enclosed."""
    exact = device_ball(device)
    whole, fraction = split_delay(device.delay, device.sample_time)
    return sampled_plant(exact, whole, BALLS, fractional=fraction > 0)


def spectral_radius(device: Device, gains: Gains) -> float:
    """Return the greatest modulus of the sampled loop's poles, from enclosures where the poles can be isolated."""
    with ctx.workprec(PRECISION):
        coefficients = characteristic_polynomial(exact_plant(device), gains_ball(gains))
        if len(coefficients) <= ISOLATED_DEGREE:
            try:
                return max(float(abs(root)) for root in acb_poly(coefficients[::-1]).roots(tol=ROOT_TOLERANCE))
            except ValueError:  # FLINT cannot isolate multiple poles
                pass
        return float(np.abs(np.roots([float(c) for c in coefficients])).max())
