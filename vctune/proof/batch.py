"""The claims of a certificate for many cells at once, on arrays (DESIGN 1.10); what stays open is left to Arb."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi

import numpy as np

from vctune.model.arithmetic import Number
from vctune.model.llewellyn import required_resistance
from vctune.model.loop import hold_response, loop_response
from vctune.model.pair import Pair
from vctune.model.quantities import Coupling, Device, Gains
from vctune.model.sampled import difference_slope, return_difference, sampled_plant, whole_samples
from vctune.proof.cells import Cells, Integers, Margin, Pairs, Values, all_pairs, image_at, sift
from vctune.proof.claims import (
    Design,
    along_hold,
    conditions_margin,
    outwards,
    sensitivity_floor,
    sensitivity_margin,
)
from vctune.proof.enclosures import Enclosure, Flags, Floats, decimal
from vctune.proof.exclusion import Curve, exclude, misses_zero, turns
from vctune.proof.jets import ENCLOSURES as OPS

STEP = 1.4
"""Ratio of the edges of the first intervals."""
ROUNDS = 24
"""How often an interval of frequency is halved for a single design."""
CELL_ROUNDS = 6
"""The same for a cell, whose own size soon blurs a curve more than the interval does."""
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
    required : the least admissible Re Z_c where Re G_hh > 0
    floor : proves as much as `sensitivity`, next to omega = 0 for every K_p >= 0
    model_poles, sampled_poles : curves that must not turn around 0, of omega and of theta = omega T
    model_floor, sampled_floor : where positive, the curve is not 0 for any K_p > 0
    """

    conditions: Margin
    sensitivity: Margin
    required: Margin
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

    def required(omega: Number, values: Values) -> Number:
        """Return R where Re D > 0 throughout; nothing is known of it elsewhere."""
        hold = hold_response(device, omega, OPS)
        return required_resistance(loop_response(device, Gains(*values[:2]), omega, hold, integrator=integrator), OPS)

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
        required,
        lambda omega, v: sensitivity_floor(device, Gains(*v[:2]), omega, limit, OPS),
        model_curve,
        sampled_curve,
        lambda omega, v: along_hold(device, Gains(*v[:2]), omega, OPS)[0],
        sampled_floor,
    )


def certified(demands: Demands, cells: Cells) -> Flags:
    """Return the cells all of whose designs are proved to meet all demands.

    A cell whose K_p starts at 0 does not contain K_p = 0 itself, which takes the position out of the loop; a cell
    whose K_p is 0 throughout does. A band from 0 or to infinity is beyond arrays: nothing is proved then.
    """
    proved = np.zeros(len(cells), bool)
    if demands.band[0] > 0 and demands.band[1] < inf:
        for integrator, at in by_integrator(cells):
            proved[at] = _certified(demands, cells.taken(at), integrator)
    return proved


def by_integrator(cells: Cells) -> list[tuple[bool, Integers]]:
    """Return which cells have an integrator and which have not."""
    parts = [(integrator, np.flatnonzero((cells.high[1] > 0) == integrator)) for integrator in (True, False)]
    return [(integrator, at) for integrator, at in parts if len(at)]


def _certified(demands: Demands, cells: Cells, integrator: bool) -> Flags:
    """Prove claim after claim for the cells that are left."""
    claims, device = claims_of(demands, integrator=integrator), demands.device
    left, rounds = np.arange(len(cells)), CELL_ROUNDS if any(cells.moving()) else ROUNDS

    def poles_stay(cells: Cells) -> Flags:
        model, sampled = unstable_poles(claims, device, cells.centres(), integrator=integrator)
        stable = (model == 0) & (sampled == 0)
        return stable & np.logical_and(*steady(claims, device, cells)) if any(cells.moving()) else stable

    def sensitivity_holds(cells: Cells) -> Flags:
        pairs = all_pairs(len(cells), 0.0, pi / device.sample_time * (1 + NEAR), STEP)
        return untouched(sift(claims.sensitivity, cells, pairs, rounds, claims.floor).open, cells)

    def conditions_hold(cells: Cells) -> Flags:
        pairs = all_pairs(len(cells), *outwards(demands.band), STEP)
        return untouched(sift(claims.conditions, cells, pairs, rounds).open, cells)

    for holds in (conditions_hold, sensitivity_holds, poles_stay):
        left = left[holds(cells.taken(left))] if len(left) else left
    proved = np.zeros(len(cells), bool)
    proved[left] = True
    return proved


def refuted(demands: Demands, cells: Cells, omega: Floats, omega_S: Floats) -> Flags:
    """Return the cells none of whose designs meets all demands.

    Parameters
    ----------
    demands : what is to be met
    cells : as for `certified`
    omega : rad/s, for each cell a frequency of the band at which Llewellyn's conditions may fail throughout
    omega_S : rad/s, for each cell a frequency up to Nyquist at which |S| may be too great throughout
    """
    fails = np.zeros(len(cells), bool)
    for integrator, at in by_integrator(cells):
        claims, part = claims_of(demands, integrator=integrator), cells.taken(at)
        lost = image_at(claims.conditions, part, omega[at]).negative()
        lost |= image_at(claims.sensitivity, part, omega_S[at]).negative()
        left = np.flatnonzero(~lost)
        if len(left):
            part = part.taken(left)
            poles = unstable_poles(claims, demands.device, part.centres(), integrator=integrator)
            kept = steady(claims, demands.device, part)
            for count, same in zip(poles, kept, strict=True):
                lost[left] |= (count != 0) & np.isfinite(count) & same
        fails[at] = lost
    return fails


def unstable_poles(claims: Claims, device: Device, points: Cells, *, integrator: bool) -> tuple[Floats, Floats]:
    """Return how often the model's and the sampled loop's curve go around 0: 0 where stable, nan where not settled.

    The arguments of `vctune.proof.poles` for many designs: the model's curve ends within a quarter turn of where it
    goes; the sampled loop's begins at F(1) > 0 and ends on the real axis.
    """
    angle, whole = _turned(claims.model_poles, points, stiffest(device, points))
    goal = pi if integrator else pi / 2
    model = np.where(whole, np.round((goal - angle) / (2 * pi)), np.nan)
    angle, whole = _turned(claims.sampled_poles, points, pi)
    return model, np.where(whole, np.round(angle / pi), np.nan)


def _turned(curve: Curve, points: Cells, high: float) -> tuple[Floats, Flags]:
    """Return the turns of each point's curve from 0 to high, and whether it is proved to miss 0 on the way."""
    closed, left = exclude(
        lambda x, values: misses_zero(curve(x, values)), points, all_pairs(len(points), 0.0, high, STEP), ROUNDS
    )
    return turns(curve, points, closed), untouched(left, points)


def steady(claims: Claims, device: Device, cells: Cells) -> tuple[Flags, Flags]:
    """Return where no pole of the model, and none of the sampled loop, crosses the boundary within a cell."""

    def uncrossed(curve: Curve, floor: Margin, high: float) -> Flags:
        pairs = all_pairs(len(cells), 0.0, high, STEP)
        misses = lambda x, values: misses_zero(curve(x, values)) | floor(x, values).positive()  # noqa: E731
        return untouched(exclude(misses, cells, pairs, CELL_ROUNDS)[1], cells)

    model = uncrossed(claims.model_poles, claims.model_floor, stiffest(device, cells))
    return model, uncrossed(claims.sampled_poles, claims.sampled_floor, pi)


def stiffest(device: Device, cells: Cells) -> float:
    """Return a frequency beyond which |C| < |m omega|/2 in every cell, because |H| <= 1, rad/s."""
    K_v, K_p = cells.high[:2]
    return 4 * (1 + NEAR) * float(np.maximum(K_v / device.mass, np.sqrt(K_p / device.mass)).max())


def untouched(left: Pairs, cells: Cells) -> Flags:
    """Return the cells that have no pair left."""
    return np.bincount(left.cell, minlength=len(cells)) == 0
