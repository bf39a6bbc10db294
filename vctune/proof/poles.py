"""No pole in the closed right half plane, no sampled pole on or outside the unit circle (DESIGN 1.4 (i), 1.7)."""

from __future__ import annotations

from math import pi

import numpy as np
from flint import acb_poly, arb, ctx

from vctune.model.loop import hold_response, loop_response
from vctune.model.pair import Pair
from vctune.model.quantities import Device, Gains
from vctune.model.sampled import (
    SampledPlant,
    characteristic_polynomial,
    return_difference,
    sampled_plant,
    whole_samples,
)
from vctune.proof.balls import BALLS, PRECISION, device_ball, gains_ball
from vctune.proof.claims import HALF_TURN
from vctune.proof.interval import Outcome, Verdict
from vctune.proof.winding import turned_angle

ISOLATED_DEGREE = 40
ROOT_TOLERANCE = 1e-16
"""Radius of the enclosures of poles; without it they are only kept apart."""


def prove_model_poles(device: Device, gains: Gains) -> Outcome:
    """Prove that the zeros of D, the poles of G_hh, lie in the open left half plane.

    D (times j omega when K_p > 0) is followed from omega = 0, where it is real and positive, to omega_1, beyond which
    |C| < |m omega|/2 because |H| <= 1: from there arg D tends to pi/2 without another turn. With no zero on the axis,
    there is none to its right if and only if the argument has turned by less than a turn there.
    """
    exact, law, integrator = device_ball(device), gains_ball(gains), gains.position > 0
    if gains.velocity == 0 and not integrator:
        return Outcome(Verdict.PROVED if device.damping > 0 else Verdict.REFUTED, 1)

    def curve(omega: arb) -> Pair:
        D = loop_response(exact, law, omega, hold_response(exact, omega, BALLS), integrator=integrator).D
        return Pair(-D.im, D.re) if integrator else D

    last = 4 * max(gains.velocity / device.mass, (gains.position / device.mass) ** 0.5)
    outcome, angle = turned_angle(curve, 0.0, last)
    if outcome.verdict is not Verdict.PROVED:
        return outcome
    least = pi / 2 if integrator else 0.0
    upright = least - 1e-6 < angle < least + pi + 1e-6
    return outcome if upright else Outcome(Verdict.REFUTED, outcome.boxes)


def prove_sampled_poles(device: Device, gains: Gains) -> Outcome:
    """Prove that the exact sampled loop has its spectral radius below 1.

    z^-n times the characteristic polynomial of degree n is followed along the upper half of the unit circle: real at
    both ends, it must come back without a turn. The witness is in rad/s.
    """
    law, integrator, plant = gains_ball(gains), gains.position > 0, _plant(device)

    def curve(theta: arb) -> Pair:
        return return_difference(plant, theta, BALLS, integrator=integrator).closed(law, integrator=integrator)

    outcome, angle = turned_angle(curve, 0.0, HALF_TURN)
    if outcome.verdict is not Verdict.PROVED:
        witness = outcome.witness / device.sample_time if outcome.witness is not None else None
        return Outcome(outcome.verdict, outcome.boxes, witness)
    start, stop = curve(arb(0)).re, curve(arb.pi()).re
    if abs(angle) < pi / 2 and start > 0 and stop > 0:
        return outcome
    return Outcome(Verdict.REFUTED, outcome.boxes)


def _plant(device: Device) -> SampledPlant:
    exact = device_ball(device)
    whole, fraction = whole_samples(device.delay, device.sample_time)
    return sampled_plant(exact, whole, exact.delay - whole * exact.sample_time, fraction > 0, BALLS)


def spectral_radius(device: Device, gains: Gains) -> float:
    """Return the greatest modulus of the sampled loop's poles, from enclosures wherever they can be isolated."""
    law, integrator = gains_ball(gains), gains.position > 0
    with ctx.workprec(PRECISION):
        coefficients = characteristic_polynomial(_plant(device), law, integrator=integrator)
        if len(coefficients) <= ISOLATED_DEGREE:
            try:
                return max(float(abs(root)) for root in acb_poly(coefficients[::-1]).roots(tol=ROOT_TOLERANCE))
            except ValueError:  # a multiple pole cannot be isolated
                pass
        return float(np.abs(np.roots([float(c) for c in coefficients])).max())
