"""The claims of a certificate for many cells at once, on arrays (DESIGN 1.10); what stays open is left to Arb."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi

import numpy as np

from vctune.model.loop import hold_response, loop_response
from vctune.model.pair import Pair
from vctune.model.quantities import Coupling, Device, Gains
from vctune.model.sampled import difference_slope, return_difference, sampled_plant, whole_samples
from vctune.proof.cells import Cells, Margin, Values, all_pairs, sift
from vctune.proof.claims import (
    Design,
    along_hold,
    conditions_margin,
    outwards,
    sensitivity_floor,
    sensitivity_margin,
)
from vctune.proof.enclosures import UNIT, Enclosure, Flags, Floats, decimal
from vctune.proof.exclusion import Curve, exclude, misses_zero, turns
from vctune.proof.jets import ENCLOSURES as OPS

STEP = 1.4
"""Ratio of the edges of the first intervals."""
ROUNDS = 24
NEAR = 1e-6
"""Allowance for the rounding of an angle that is a whole number of quarter turns in the end."""


@dataclass(frozen=True, slots=True)
class Demands:
    """What a design has to meet.

    Attributes
    ----------
    device : the device
    band : rad/s, of Llewellyn's conditions; may be (0, inf)
    factor : least Re Z_c / R
    max_sensitivity : greatest |S| up to the Nyquist frequency
    """

    device: Device
    band: tuple[float, float]
    factor: float
    max_sensitivity: float


@dataclass(frozen=True, slots=True)
class Claims:
    """The claims about one device as functions of a frequency and a design, over enclosures.

    Attributes
    ----------
    conditions, sensitivity : margins that must be positive
    floor : proves as much as `sensitivity`, next to omega = 0 for every K_p >= 0
    model_poles, sampled_poles : curves that must not turn around 0, of omega and of theta = omega T
    model_floor, sampled_floor : where positive, the curve is not 0 for any K_p > 0
    """

    conditions: Margin
    sensitivity: Margin
    floor: Margin
    model_poles: Curve
    sampled_poles: Curve
    model_floor: Margin
    sampled_floor: Margin


def claims_of(demands: Demands, *, integrator: bool) -> Claims:
    """Return the claims with the device's decimals enclosed; the integrator is there for K_p > 0."""
    given = demands.device
    mass, damping, sample_time, delay = map(decimal, (given.mass, given.damping, given.sample_time, given.delay))
    device = Device(mass, damping, sample_time, delay, given.hold)
    factor, limit = decimal(demands.factor), decimal(demands.max_sensitivity)
    whole, fraction = whole_samples(given.delay, given.sample_time)
    plant = sampled_plant(device, whole, delay - whole * sample_time, fraction > 0, OPS)

    def model_curve(omega: Enclosure, values: Values) -> Pair:
        hold = hold_response(device, omega, OPS)
        D = loop_response(device, Gains(*values[:2]), omega, hold, integrator=integrator).D
        return Pair(-D.im, D.re) if integrator else D

    def sampled_curve(theta: Enclosure, values: Values) -> Pair:
        parts = return_difference(plant, theta, OPS, integrator=integrator)
        return parts.closed(Gains(*values[:2]), integrator=integrator)

    def sampled_floor(theta: Enclosure, values: Values) -> Enclosure:
        law = Gains(*values[:2])
        velocity_loop = return_difference(plant, theta, OPS, integrator=False).closed(law, integrator=False)
        turning = velocity_loop * difference_slope(theta, OPS)
        position = return_difference(plant, theta, OPS).position
        return turning.im * position.re - turning.re * position.im

    return Claims(
        lambda omega, v: conditions_margin(
            Design(device, Gains(*v[:2]), Coupling(*v[2:])), omega, factor, OPS, integrator=integrator
        ),
        lambda omega, v: sensitivity_margin(device, Gains(*v[:2]), omega, limit, OPS, integrator=integrator),
        lambda omega, v: sensitivity_floor(device, Gains(*v[:2]), omega, limit, OPS),
        model_curve,
        sampled_curve,
        lambda omega, v: along_hold(device, Gains(*v[:2]), omega, OPS)[0],
        sampled_floor,
    )


def stiffest(device: Device, cells: Cells) -> float:
    """Return a frequency beyond which |C| < |m omega|/2 in every cell, because |H| <= 1, rad/s."""
    K_v, K_p = cells.high[:2]
    return 4 * (1 + NEAR) * float(np.maximum(K_v / device.mass, np.sqrt(K_p / device.mass)).max())


def stable(claims: Claims, demands: Demands, points: Cells, *, integrator: bool) -> Flags:
    """Return which points are proved to have neither a pole of the model nor of the sampled loop that is unstable.

    The arguments of `vctune.proof.poles`, for many designs.
    """
    angle, whole = _turned(claims.model_poles, points, stiffest(demands.device, points))
    least = pi / 2 if integrator else 0.0
    settled = whole & (angle > least - NEAR) & (angle < least + pi + NEAR)
    angle, whole = _turned(claims.sampled_poles, points, pi)
    values = points.values()
    ends = [claims.sampled_poles(Enclosure(np.array(theta), 4 * UNIT), values).re for theta in (0.0, pi)]
    return settled & whole & (np.abs(angle) < pi / 2) & ends[0].positive() & ends[1].positive()


def _turned(curve: Curve, points: Cells, high: float) -> tuple[Floats, Flags]:
    """Return the turns of each point's curve from 0 to high, and whether it is proved to miss 0 on the way."""
    pairs = all_pairs(len(points), 0.0, high, STEP)
    closed, left = exclude(lambda omega, values: misses_zero(curve(omega, values)), points, pairs, ROUNDS)
    return turns(curve, points, closed), np.bincount(left.cell, minlength=len(points)) == 0


def certified(demands: Demands, points: Cells) -> Flags:
    """Return which designs are proved to meet all demands; the others need a closer look by Arb.

    Parameters
    ----------
    demands : a band from 0 or to infinity is beyond arrays: nothing is proved then
    points : cells whose edges meet
    """
    proved = np.zeros(len(points), bool)
    if demands.band[0] == 0 or demands.band[1] == inf:
        return proved
    for integrator in (True, False):
        at = np.flatnonzero((points.low[1] > 0) == integrator)
        if len(at):
            proved[at] = _certified(claims_of(demands, integrator=integrator), demands, points.taken(at), integrator)
    return proved


def _certified(claims: Claims, demands: Demands, points: Cells, integrator: bool) -> Flags:
    band = all_pairs(len(points), *outwards(demands.band), STEP)
    up_to_nyquist = all_pairs(len(points), 0.0, pi / demands.device.sample_time * (1 + NEAR), STEP)
    left = [
        sift(claims.conditions, points, band, ROUNDS).open,
        sift(claims.sensitivity, points, up_to_nyquist, ROUNDS, claims.floor).open,
    ]
    done = stable(claims, demands, points, integrator=integrator)
    for pairs in left:
        done[pairs.cell] = False
    return done
