"""Evaluate the sampled velocity loop without a hand, in a form whose enclosures stay narrow for uncertain
parameters."""

from __future__ import annotations

from dataclasses import dataclass

from vctune.model.device import Device
from vctune.model.loop.drive import COMMAND, Rows, drive_rows, drive_states, pushed
from vctune.model.loop.filters import low_pass_coefficients
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import Matrix, Vector, added, applied, half_coth, scaled
from vctune.model.numbers.pair import EvenOdd, Pair
from vctune.model.sampled import velocity_loop as sampled
from vctune.model.sampled.plant_in_hand import equations, numerators
from vctune.model.sampled.state_space import left_by_older
from vctune.model.sampled.velocity_loop import ReturnDifference, SampledPlant


@dataclass(frozen=True, slots=True)
class PlantLetGo:
    """A device without a hand over one sample, in the equation of this module with T = 1."""

    rates: Matrix  # A and Q
    step: Matrix
    push: Vector  # b and b_1; b_1 is None if it is 0
    older: Vector | None
    handle_share: Number | None  # handle's share r of the mass
    whole_samples: Number  # N, the number of whole samples in the delay
    sample_time: Number  # T and m, which define the units
    mass: Number
    difference: bool = False  # whether the firmware differences positions to get the velocity
    low_pass: Number | None = None  # a and r of the firmware's low-passes of the velocity
    order: int = 0


# A sampled device without a hand, in the polynomial form or in the form of this module
Plant = SampledPlant | PlantLetGo


# Greatest resonance frequency, in units of the sampling frequency, for which the code uses this form
HIGHEST_RESONANCE = 0.75
# Indices of the first states: the motor's position, the velocity of the centre of mass, the bend, and its rate
POSITION, VELOCITY, BEND, BENDING = range(4)


def prefers_this_form(device: Device) -> bool:
    """Return whether the proof uses this form for an uncertain device, and not the polynomials of `velocity_loop`."""
    if device.structure is not None:
        return bool(device.structure.frequency_hz * device.sample_time < HIGHEST_RESONANCE)
    return bool(drive_states(device))


def plant_let_go(device: Device, whole_samples: Number, ops: Arithmetic, *, fractional: bool) -> PlantLetGo:
    """Sample a device without a hand exactly, in the form of this module (model/README.md, section 14)."""
    T, estimate = device.sample_time, device.velocity
    rates, push, handle_share, mass = _mechanism(device, ops)
    rounded, older = half_coth(rates, ops), None
    if fractional:
        rows = (*((*row, b) for row, b in zip(rates, push, strict=True)), (0,) * (len(push) + 1))
        left = left_by_older(rows, (device.delay - whole_samples * T) / T, ops)
        older = applied(added(rounded, scaled(rates, -0.5)), left[:-1])
    low_pass, order = None, 0
    if estimate is not None and estimate.filter_hz is not None:
        (low_pass, _), order = low_pass_coefficients(estimate.filter_hz, T, ops), estimate.filter_order
    differenced = estimate is not None and estimate.source == "difference"
    return PlantLetGo(
        rates=rates,
        step=rounded,
        push=push,
        older=older,
        handle_share=handle_share,
        whole_samples=whole_samples,
        sample_time=T,
        mass=mass,
        difference=differenced,
        low_pass=low_pass,
        order=order,
    )


def _mechanism(device: Device, ops: Arithmetic) -> tuple[Matrix, Vector, Number | None, Number]:
    """Return A, b, the handle's share of the mass, and the unit of mass in b."""
    T, structure = device.sample_time, device.structure
    one = 0 * T + 1  # a number of the arithmetic, so that the code encloses the quotient below
    names = ["position", "velocity"]  # in the order of POSITION, VELOCITY, BEND, BENDING
    names += ["bend", "bending"] if structure is not None else []
    names += drive_states(device)
    rows: Rows = {name: {} for name in names}
    rows["position"]["velocity"], shares = one, {"velocity": one}
    load = structure.load if structure is not None else None
    mass, handle_share = device.mass if load is None else device.mass + load.mass, None
    damping_rate = device.damping * T / mass
    rows["velocity"]["velocity"] = -damping_rate
    if structure is not None:
        handle = structure.handle_mass if load is None else structure.handle_mass + load.mass
        handle_share = handle / mass
        motor_share, resonance = 1 - handle_share, 2 * ops.pi * structure.frequency_hz * T
        stiffness, loss = resonance * resonance, 2 * structure.damping_ratio * resonance
        if load is not None:
            load_factor = structure.handle_mass / handle * (mass / device.mass)
            stiffness, loss = stiffness * load_factor, loss * load_factor
        rows["position"]["bending"], rows["velocity"]["bending"] = handle_share, -(damping_rate * handle_share)
        rows["bend"]["bending"] = one
        rows["bending"] = {
            "velocity": -(damping_rate / motor_share),
            "bend": -stiffness,
            "bending": -(loss + damping_rate * handle_share / motor_share),
        }
        shares["bending"] = 1 / motor_share
        if load is not None:
            load_rate = load.damping * T / mass
            rows["velocity"]["velocity"] = -(damping_rate + load_rate)
            rows["velocity"]["bending"] = load_rate * motor_share - damping_rate * handle_share
            rows["bending"]["velocity"] = load_rate / handle_share - damping_rate / motor_share
            rows["bending"]["bending"] = -(
                loss + damping_rate * handle_share / motor_share + load_rate * motor_share / handle_share
            )
    force = drive_rows(rows, device, ops)
    for name, share in shares.items():
        rows[name] |= pushed(force, share)
    rates = tuple(tuple(row.get(name, 0) for name in names) for row in rows.values())
    return rates, tuple(row.get(COMMAND, 0) for row in rows.values()), handle_share, mass


def return_difference(plant: Plant, theta: Number, ops: Arithmetic, *, position: bool) -> ReturnDifference:
    """Evaluate the parts of the return difference F at z = e^{j theta}."""
    if isinstance(plant, SampledPlant):
        return sampled.return_difference(plant, theta, ops, position=position)
    sin, cos = ops.sin(theta / 2), ops.cos(theta / 2)
    square, steps, unit = sin * sin, plant.whole_samples + 0.5, plant.sample_time / plant.mass

    def pair(x: EvenOdd) -> Pair:
        """Return the value at the angle: an odd part has the factor j sin."""
        return Pair(x.even, sin * x.odd)

    rows = equations(plant.rates, plant.step, plant.push, plant.older, cos, square)
    rows[POSITION][POSITION] = EvenOdd(1, 0, square)  # the unknown is 2 j s times the position
    solved = numerators(rows)  # the numerator of each state, then the determinant
    delayed = Pair(ops.cos(theta * steps), -ops.sin(theta * steps))  # z^-(N + 1/2)
    half_sample_back = Pair(cos, -sin)  # z^(-1/2): the difference 1 - 1/z is 2 j s z^(-1/2)
    open_loop, travel = pair(solved[len(rows)]), pair(solved[POSITION]) * delayed * half_sample_back
    motor = solved[VELOCITY]
    if plant.handle_share is not None:
        motor = motor + solved[BENDING].scaled(plant.handle_share)
    velocity = travel if plant.difference else pair(motor) * delayed
    if plant.low_pass is not None:
        a = plant.low_pass  # a/(1 - (1 - a)/z), numerator and denominator times z^(1/2)
        for _ in range(plant.order):
            denominator = Pair(a * cos, (2 - a) * sin)
            velocity, open_loop = velocity * Pair(a * cos, a * sin), open_loop * denominator
            travel = travel * denominator
    if not position:
        return ReturnDifference(open_loop, velocity.scaled(unit), Pair(0, 0))
    difference = Pair(2 * square, 2 * sin * cos)  # 1 - 1/z; the position is the travel in one sample over 1 - 1/z
    return ReturnDifference(
        open_loop * difference, velocity.scaled(unit) * difference, travel.scaled(unit * plant.sample_time)
    )
