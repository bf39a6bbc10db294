"""Evaluate the sampled velocity loop without a hand, in a form whose terms do not cancel if numbers are intervals.

See model/README.md, section 14. The polynomials of a sampled device are sums whose terms cancel, so that uncertain
numbers give wide enclosures. This module holds and samples x' = A x + b u exactly as

    (2 j s Q - c A) x = e^{j theta/2} z^-(N+1) (b - d b_1) u,   Q = (A/2) coth(A/2),

The enclosures of its numbers are hardly wider than their ranges. The states are the position of the motor, the velocity
of the centre of mass, and the bend of the spring with its rate. In these states the resonance does not depend on the
mass. Only the row of the position depends on the position, so the code divides this row by the integrator 2 j s.
"""

from __future__ import annotations

from dataclasses import dataclass

from vctune.model.device import Device
from vctune.model.loop.drive import COMMAND, Rows, drive_rows, drive_states, pushed
from vctune.model.loop.filters import smoothing
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import Matrix, Vector, added, applied, half_coth, scaled
from vctune.model.numbers.pair import EvenOdd, Pair
from vctune.model.sampled import velocity_loop as sampled
from vctune.model.sampled.plant_in_hand import equations, numerators
from vctune.model.sampled.state_space import left_by_older
from vctune.model.sampled.velocity_loop import ReturnDifference, SampledPlant


@dataclass(frozen=True, slots=True)
class PlantLetGo:
    """A device without a hand over one sample, in the equation of this module with T = 1.

    Attributes
    ----------
    rates, step : A and Q
    push, older : b and b_1; b_1 is None if it is 0
    lead : coefficient of the bend's rate in the motor's velocity, which is the centre of mass's velocity plus that
        term; None for a rigid device
    whole_samples : N, the number of whole samples in the delay
    sample_time, mass : T and m, which define the units
    difference : whether the firmware differences positions to get the velocity
    low_pass, order : a and r of the firmware's low-passes of the velocity; None and 0 without low-passes
    """

    rates: Matrix
    step: Matrix
    push: Vector
    older: Vector | None
    lead: Number | None
    whole_samples: Number
    sample_time: Number
    mass: Number
    difference: bool = False
    low_pass: Number | None = None
    order: int = 0


Plant = SampledPlant | PlantLetGo
"""A sampled device without a hand, in the polynomial form or in the form of this module."""


HIGHEST = 0.75
"""Greatest resonance frequency, in units of the sampling frequency, for which the code uses this form. At 1, the matrix
Q has a pole."""


def has_sharp_form(device: Device) -> bool:
    """Return whether this form encloses a device more tightly.

    This form is tighter for devices with an actuator or a structure, which the closed form does not cover.

    Parameters
    ----------
    device : device with plain numbers
    """
    if device.structure is not None:
        return bool(device.structure.frequency_hz * device.sample_time < HIGHEST)
    return bool(drive_states(device))


def plant_let_go(device: Device, whole_samples: Number, ops: Arithmetic, *, fractional: bool) -> PlantLetGo:
    """Sample a device without a hand exactly, in the form of this module (model/README.md, section 14).

    The result includes the structure's load. The result excludes the force sensor, because no loop without a hand
    contains the sensor.

    Parameters
    ----------
    device : device in SI units; the function uses its mechanism, actuator, delay and velocity estimate
    whole_samples : N, the number of whole samples in its delay
    ops : arithmetic of the device's numbers
    fractional : whether the delay is longer than N samples

    Returns
    -------
    PlantLetGo
        Dimensionless, with T = 1. The unit of mass is the device's mass including its load.
    """
    T, estimate = device.sample_time, device.velocity
    rates, push, lead, mass = _mechanism(device, ops)
    rounded, older = half_coth(rates, ops), None
    if fractional:
        rows = (*((*row, b) for row, b in zip(rates, push, strict=True)), (0,) * (len(push) + 1))
        left = left_by_older(rows, (device.delay - whole_samples * T) / T, ops)
        older = applied(added(rounded, scaled(rates, -0.5)), left[:-1])
    low_pass, order = None, 0
    if estimate is not None and estimate.filter_hz is not None:
        (low_pass, _), order = smoothing(estimate.filter_hz, T, ops), estimate.filter_order
    differenced = estimate is not None and estimate.source == "difference"
    return PlantLetGo(rates, rounded, push, older, lead, whole_samples, T, mass, differenced, low_pass, order)


def _mechanism(device: Device, ops: Arithmetic) -> tuple[Matrix, Vector, Number | None, Number]:
    """Return A, b, the coefficient `lead`, and the unit of mass in b.

    Let V be the velocity of the centre of mass, B the bend of the spring, and r the handle's share of the mass m.
    Without a load they follow

        m V' = u - b v,   B'' = (u - b v)/((1 - r) m) - w^2 B - 2 zeta w B',   v = V + r B'.
    """
    T, structure = device.sample_time, device.structure
    one = 0 * T + 1  # a number of the arithmetic, so that the quotient below is enclosed
    names = ["position", "velocity"]
    names += ["bend", "bending"] if structure is not None else []
    names += drive_states(device)
    rows: Rows = {name: {} for name in names}
    rows["position"]["velocity"], shares = one, {"velocity": one}
    load = structure.load if structure is not None else None
    mass, lead = device.mass if load is None else device.mass + load.mass, None
    own = device.damping * T / mass
    rows["velocity"]["velocity"] = -own
    if structure is not None:
        handle = structure.handle_mass if load is None else structure.handle_mass + load.mass
        lead = handle / mass
        rest, rate = 1 - lead, 2 * ops.pi * structure.frequency_hz * T
        stiff, loss = rate * rate, 2 * structure.damping_ratio * rate
        if load is not None:
            eased = structure.handle_mass / handle * (mass / device.mass)
            stiff, loss = stiff * eased, loss * eased
        rows["position"]["bending"], rows["velocity"]["bending"] = lead, -(own * lead)
        rows["bend"]["bending"] = one
        rows["bending"] = {"velocity": -(own / rest), "bend": -stiff, "bending": -(loss + own * lead / rest)}
        shares["bending"] = 1 / rest
        if load is not None:
            held = load.damping * T / mass
            rows["velocity"]["velocity"], rows["velocity"]["bending"] = -(own + held), held * rest - own * lead
            rows["bending"]["velocity"] = held / lead - own / rest
            rows["bending"]["bending"] = -(loss + own * lead / rest + held * rest / lead)
    force = drive_rows(rows, device, ops)
    for name, share in shares.items():
        rows[name] |= pushed(force, share)
    rates = tuple(tuple(row.get(name, 0) for name in names) for row in rows.values())
    return rates, tuple(row.get(COMMAND, 0) for row in rows.values()), lead, mass


def return_difference(plant: Plant, theta: Number, ops: Arithmetic, *, position: bool) -> ReturnDifference:
    """Evaluate the parts of the return difference F at z = e^{j theta}.

    The F of a `PlantLetGo` contains a factor without zeros, which cancels in F_0/F.

    Parameters
    ----------
    plant : a device without a hand, in either form
    theta : omega T, rad, in [0, pi]
    ops : arithmetic of plant and theta
    position : whether the law has K_p > 0; if not, the position's part is 0 and F is the F of the velocity loop

    Returns
    -------
    ReturnDifference
        Each part has the shape of theta.
    """
    if isinstance(plant, SampledPlant):
        return sampled.return_difference(plant, theta, ops, position=position)
    sin, cos = ops.sin(theta / 2), ops.cos(theta / 2)
    square, steps, unit = sin * sin, plant.whole_samples + 0.5, plant.sample_time / plant.mass

    def pair(x: EvenOdd) -> Pair:
        return Pair(x.even, sin * x.odd)

    rows = equations(plant.rates, plant.step, plant.push, plant.older, cos, square)
    rows[0][0] = EvenOdd(1, 0, square)  # over 2 j s
    found = numerators(rows)
    turned, back = Pair(ops.cos(theta * steps), -ops.sin(theta * steps)), Pair(cos, -sin)
    open_loop, travel = pair(found[len(rows)]), pair(found[0]) * turned * back
    # state 0 is the position, 1 the velocity, 2 the bend, 3 the bend's rate
    motor = found[1] if plant.lead is None else found[1] + found[3].scaled(plant.lead)
    velocity = travel if plant.difference else pair(motor) * turned
    if plant.low_pass is not None:
        a = plant.low_pass
        for _ in range(plant.order):
            once = Pair(a * cos, (2 - a) * sin)
            velocity, open_loop, travel = velocity * Pair(a * cos, a * sin), open_loop * once, travel * once
    if not position:
        return ReturnDifference(open_loop, velocity.scaled(unit), Pair(0, 0))
    d = Pair(2 * square, 2 * sin * cos)
    return ReturnDifference(open_loop * d, velocity.scaled(unit) * d, travel.scaled(unit * plant.sample_time))
