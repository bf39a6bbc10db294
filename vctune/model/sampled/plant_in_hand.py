"""Model device and hand as one mechanism, held and sampled exactly (model/README.md, section 14)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from vctune.model.device import Device, devices_as_one
from vctune.model.hands import Hand
from vctune.model.loop.filters import (
    COMMAND,
    drive_rows,
    drive_states,
    force_sections,
    low_pass_rates,
    pushed,
    velocity_sections,
)
from vctune.model.mechanism import MOTOR, Rates, chain, forces, motion
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import (
    Matrix,
    Vector,
    add,
    added,
    applied,
    column,
    exponential_less_one,
    half_coth,
    identity,
    nothing,
    scaled,
    times,
)
from vctune.model.numbers.minors import minors
from vctune.model.numbers.pair import EvenOdd
from vctune.model.sampled.circle import left_by_older, split_delay
from vctune.model.sampled.rigid_sample import half_coth_of, powers_of, share_of_older
from vctune.model.sampled.servo_plant import SensedDelay, ServoPlant, servo_plant
from vctune.model.sections import Section


@dataclass(frozen=True, slots=True)
class Delays:
    """Two delays, each as a number of whole samples and a flag for a remaining fraction of a sample."""

    loop: Number  # N, the number of whole samples in the device's delay; an array for several devices
    loop_fractional: bool  # whether a fraction remains; an older force then acts at the start of each sample
    felt: Number  # the number of whole samples in the sum of the device's and the force sensor's delay
    felt_fractional: bool  # whether a fraction remains in this sum


def delays_of(device: Device) -> Delays:
    """Return the delays of a device with plain numbers."""
    loop, left = split_delay(device.latency, device.sample_time)
    felt, felt_left = split_delay(device.sensed_latency, device.sample_time)
    return Delays(loop, left > 0, felt, felt_left > 0)


class MechanismInHand(NamedTuple):
    """E x' = A x + b u, the equation of a device in a hand, dimensionless."""

    names: list[str]  # names of the states
    rates: Matrix  # rows of A
    push: Vector  # b
    inertia: dict[str, Number]  # diagonal entries of E by state; the entry of a state without a key is 1
    sensed: dict[str, Number]
    felt: dict[str, Number]  # coefficient of each state in M a + B v + K x, which is minus the sensed force, by state
    felt_inertia: Number | None = None
    handle: str = "velocity"  # name of the state that is the handle's velocity

    @classmethod
    def of(cls, rows: Rates, inertia: dict[str, Number] | None = None, **felt: Any) -> MechanismInHand:
        """Return the equations whose right sides are rows of coefficients by state."""
        rates = tuple(tuple(row.get(name, 0) for name in rows) for row in rows.values())
        push = tuple(row.get(COMMAND, 0) for row in rows.values())
        return cls(list(rows), rates, push, inertia or {}, **{"sensed": {}, "felt": {}} | felt)


@dataclass(frozen=True, slots=True)
class PlantInHand:
    """A device in a hand over one sample, in the equation of this module."""

    rates: Matrix  # A and Q
    step: Matrix
    push: Vector  # b, b_1 of the loop, and b_1 of the sensed force, whose delay may be longer; None for a b_1 of 0
    older: Vector | None
    felt_older: Vector | None
    felt: Vector  # coefficient of each state in minus the sensed force, without the inertia of the hand
    felt_inertia: tuple[Vector, Vector] | None
    delays: Delays  # whole samples of the delays
    sample_time: Number  # T and m, the units of time and mass: s, and kg of the device without the hand
    mass: Number
    difference: bool = False  # whether the firmware differences positions to get the velocity
    filters: tuple[Section, ...] = ()  # the firmware's filters of the velocity and of the sensed force
    felt_filters: tuple[Section, ...] = ()
    summed: bool = False  # whether x_e is x_e + T v_e, instead of the trapezoidal rule
    meets_position: bool = False  # whether the environment acts on the position, as on an impedance display

    @property
    def poles(self) -> int:
        """Return the number of poles of F, without those of delays and, on an impedance display, of filters."""
        return len(self.push) + (0 if self.meets_position else self.filter_poles)

    @property
    def filter_poles(self) -> int:
        """The number of poles of the filter of the velocity."""
        return sum(each.order for each in self.filters)


@dataclass(frozen=True, slots=True)
class ServoInHand:
    """A servo over one sample, and the hand that holds it. The hand does not move the servo."""

    plant: ServoPlant  # the servo and its force sensor
    hand: Hand  # the hand; its numbers may be arrays

    @property
    def poles(self) -> int:
        """Return 0, because a servo has no loop, and F = 1."""
        return 0


AnyPlantInHand = PlantInHand | ServoInHand  # A device in a hand over one sample


def plant_in_hand(device: Device, hand: Hand, delays: Delays, ops: Arithmetic) -> AnyPlantInHand:
    """Sample a device in a hand exactly (model/README.md, section 14)."""
    if device.servo is not None:
        own = SensedDelay(delays.loop, delays.loop_fractional)
        return ServoInHand(servo_plant(device, SensedDelay(delays.felt, delays.felt_fractional, own), ops), hand)
    return over_sample(mechanism_in_hand(device, hand, ops), device, delays, ops)


def plants_in_spring(device: Device, hand: Hand, delays: Delays, ops: Arithmetic) -> tuple[PlantInHand, PlantInHand]:
    """Return a device in a hand whose spring pulls with 0 and with m/T^2 instead of its stiffness, but is sampled with
    it. The loop in the hand itself is an affine function of the stiffness between the two."""
    sample, T = _sample(mechanism_in_hand(device, hand, ops), ops), device.sample_time
    one = device.mass / (T * T)
    pulled = (mechanism_in_hand(device, replace(hand, stiffness=stiffness), ops) for stiffness in (0, one))
    soft, stiff = (over_sample(each, device, delays, ops, sample=sample._replace(rates=each.rates)) for each in pulled)
    return soft, stiff


def over_sample(
    parts: MechanismInHand,
    device: Device,
    delays: Delays,
    ops: Arithmetic,
    *,
    let_go: bool = False,
    sample: Sample | None = None,
) -> PlantInHand:
    """Sample the equations of a device exactly, in a hand or let go."""
    T = device.sample_time
    at = {name: index for index, name in enumerate(parts.names)}
    sample = sample or _sample(parts, ops, let_go=let_go)

    def older(delay: Number, whole: Number, *, fractional: bool) -> Vector | None:
        return sample.older((delay - whole * T) / T) if fractional else None

    before = felt_before = older(device.delay, delays.loop, fractional=delays.loop_fractional)
    if not ops.is_zero(device.sensing.delay):
        felt_before = older(device.sensed_latency, delays.felt, fractional=delays.felt_fractional)
    felt_inertia = None
    if parts.felt_inertia is not None:
        row = at[parts.handle]
        moved = tuple(
            times(add(q, times(a, 0.5)), parts.felt_inertia)
            for q, a in zip(sample.step[row], parts.rates[row], strict=True)
        )
        left = () if felt_before is None else (times(felt_before[row], parts.felt_inertia),)
        felt_inertia = moved, left
    return PlantInHand(
        rates=sample.rates,
        step=sample.step,
        push=sample.push,
        older=before,
        felt_older=felt_before,
        felt=tuple(parts.felt.get(name, 0) for name in parts.names),
        felt_inertia=felt_inertia,
        delays=delays,
        sample_time=T,
        mass=device.mass,
        difference=device.differences,
        filters=velocity_sections(device, ops),
        felt_filters=force_sections(device),
        summed=device.summed,
        meets_position=not device.kind.senses_force,
    )


class Sample(NamedTuple):
    """A mechanism over one sample, in an equation of the form that `equations` has."""

    rates: Matrix  # A, Q and b
    step: Matrix
    push: Vector
    older: Callable[[Number], Vector]  # b_1 as a function of the share of the sample for which the older force acts


def _sample(parts: MechanismInHand, ops: Arithmetic, *, let_go: bool = False) -> Sample:
    """Return a mechanism over one sample."""
    simple = len(parts.names) == 2  # without a mode that may be at a multiple of the sampling rate
    return _rigid(parts, ops) or (_held(parts, ops) if simple or not let_go else _let_go(parts, ops))


def _rigid(parts: MechanismInHand, ops: Arithmetic) -> Sample | None:
    """Return the sample of a rigid device without further states, in closed form."""
    if len(parts.names) > 2 or ops.arrays is None:
        return None
    arrays, (_, (spring, damper)), inertia = ops.arrays, parts.rates, parts.inertia.get("velocity", 1)
    c, k = -damper / inertia, times(-spring, 1 / inertia)
    powers = powers_of(c, k, arrays)
    if powers is None:
        return None
    own = half_coth_of(powers, arrays)

    def older(share: Number) -> Vector:
        left = share_of_older(powers, share, arrays)
        return left.slope / inertia, left.constant - left.slope * c

    step = (own.constant, own.slope), (times(own.slope, spring), own.constant * inertia + own.slope * damper)
    return Sample(parts.rates, step, parts.push, older)


def _held(parts: MechanismInHand, ops: Arithmetic) -> Sample:
    """Return the sample of any mechanism by f(A), which keeps enclosures of boxes of hands narrow."""
    at = {name: index for index, name in enumerate(parts.names)}
    over = _over_inertia(parts, at)
    rounded = half_coth(over, ops)

    def older(share: Number) -> Vector:
        left = left_by_older(driven(over, parts.push), share, ops)
        return applied(added(rounded, scaled(over, -0.5)), left[:-1])

    return Sample(parts.rates, _times_inertia(rounded, parts, at), parts.push, older)


def _let_go(parts: MechanismInHand, ops: Arithmetic) -> Sample:
    """Return the sample of a mechanism that nobody holds by e^A; f(A) has a pole at multiples of the sampling rate."""
    rows = driven(parts.rates, parts.push)
    change = exponential_less_one(rows, ops)[:-1]
    rates = tuple(row[:-1] for row in change)
    step = added(identity(len(rates)), scaled(rates, 0.5))
    return Sample(rates, step, column(change, -1), lambda share: left_by_older(rows, share, ops)[:-1])


def driven(rates: Matrix, push: Vector) -> Matrix:
    """Return the matrix of the states and of a constant force."""
    return (*((*row, force) for row, force in zip(rates, push, strict=True)), (0,) * (len(push) + 1))


def mechanism_in_hand(device: Device, hand: Hand, ops: Arithmetic) -> MechanismInHand:
    """Return the equations of a device in a hand. The hand's force on the handle is -(M a + B v + K x)."""
    T, m, sensor = device.sample_time, device.mass, device.sensing
    one = 0 * T + 1  # a number of the arithmetic, so that the code encloses the quotient below
    carried, held, grip = (
        times(x, unit) for x, unit in ((hand.mass, 1 / m), (hand.damping, T / m), (hand.stiffness, T * T / m))
    )
    masses = chain(device, ops).in_units(m, T)
    handle, inertia = masses.velocities[-1], masses.masses
    inertia[handle] = add(inertia[handle], carried)
    filtered = sensor.bandwidth_hz is not None
    names = [*masses.states, *drive_states(device), *(("felt", "felt rate")[: sensor.order] if filtered else ())]
    rows: Rates = {name: {} for name in names} | motion(masses, one) | forces(masses)
    felt = dict.fromkeys(masses.place, grip) | {handle: held}
    for name, share in felt.items():
        rows[handle][name] = add(rows[handle].get(name, 0), -share)
    rows[MOTOR] |= pushed(drive_rows(rows, device, ops), one)
    sensed: dict[str, Number] = {}
    if filtered:
        corner = low_pass_rates(rows, ("felt", "felt rate"), sensor.bandwidth_hz * T, sensor.order, ops)
        driven = ("felt", "felt rate")[sensor.order - 1]
        rows[driven] |= {name: -share for name, share in felt.items()}
        sensed[driven], felt = carried, {"felt": -corner}  # divided by the corner: A/E then lacks the corner squared
    weightless = filtered or nothing(carried)
    felt_inertia = None if weightless else carried / inertia[handle]
    inertia = {name: number for name, number in inertia.items() if type(number) is not int}
    return MechanismInHand.of(rows, inertia, sensed=sensed, felt=felt, felt_inertia=felt_inertia, handle=handle)


def modes_in_hand(device: Device, hand: Hand, ops: Arithmetic) -> Any:
    """Return the eigenvalues s T of a device in hands, which nothing drives, in double precision.

    Parameters
    ----------
    hand : Hand
        Hands as arrays of shape (hands, 1).

    Returns
    -------
    array of complex, shape (hands, states)
    """
    parts = mechanism_in_hand(device, hand, ops)
    rows = _over_inertia(parts, {name: index for index, name in enumerate(parts.names)})
    shape = np.shape(hand.mass)
    entries = [[np.broadcast_to(np.asarray(entry, float), shape) for entry in row] for row in rows]
    return np.linalg.eigvals(np.moveaxis(np.array(entries)[..., 0], -1, 0))


def _over_inertia(parts: MechanismInHand, at: dict[str, int]) -> Matrix:
    """Return A/E."""
    rows = [list(row) for row in parts.rates]
    handle = at[parts.handle]
    for row in rows:
        for name, sensed in parts.sensed.items():
            row[handle] = add(row[handle], times(-sensed, row[at[name]]))
        for name, inertia in parts.inertia.items():
            entry = row[at[name]]
            row[at[name]] = entry if nothing(entry) else entry / inertia
    return tuple(map(tuple, rows))


def _times_inertia(matrix: Matrix, parts: MechanismInHand, at: dict[str, int]) -> Matrix:
    """Return a matrix times E."""
    rows = [list(row) for row in matrix]
    handle = at[parts.handle]
    for row in rows:
        for name, inertia in parts.inertia.items():
            row[at[name]] = times(row[at[name]], inertia)
        for name, sensed in parts.sensed.items():
            row[handle] = add(row[handle], times(sensed, row[at[name]]))
    return tuple(map(tuple, rows))


def equations(
    rates: Matrix, step: Matrix, push: Vector, older: Vector | None, cos: Number, square: Number
) -> list[list[EvenOdd | None]]:
    """Return the linear equations (2 j s Q - c A) x = b - d b_1 for the n states x on the unit circle."""
    d = EvenOdd(2 * square, 2 * cos, square)

    def entry(a: Number, q: Number) -> EvenOdd | None:
        if nothing(a) and nothing(q):
            return None
        return EvenOdd(0 if nothing(a) else -(cos * a), 0 if nothing(q) else 2 * q, square)

    pushed = [None if nothing(x) else EvenOdd(x, 0, square) for x in push]
    if older is not None:
        pushed = [
            b if nothing(x) else d.scaled(-x) if b is None else b + d.scaled(-x)
            for b, x in zip(pushed, older, strict=True)
        ]
    return [[*map(entry, a, q), b] for a, q, b in zip(rates, step, pushed, strict=True)]


def numerators(rows: list[list[EvenOdd | None]], ops: Arithmetic) -> dict[int, EvenOdd]:
    """Return the solution of n linear equations by Cramer's rule: the determinant, and the determinant times each
    unknown."""
    n = len(rows)
    # the right-hand side, the last column, moves past n - 1 - j others to column j
    return {j: minor.scaled(-1) if (n - 1 - j) % 2 and j < n else minor for j, minor in minors(rows, ops).items()}


class SeveralDevices(NamedTuple):
    """Several devices, joined into one."""

    device: Device  # device whose numbers are plain where all devices agree, and arrays elsewhere
    delays: Delays  # whole samples of the device's delays, plain where all devices agree, and arrays elsewhere


def alike(devices: Sequence[Device]) -> list[list[int]]:
    """Return groups of devices that `as_one` can join, by their indices."""
    groups: dict[object, list[int]] = {}
    for place, device in enumerate(devices):
        delays = delays_of(device)
        form = device.with_numbers(dict.fromkeys(device.numbers(), 0.0))
        own = place if device.servo is not None else None
        kind = (form, tuple(device.numbers()), delays.loop_fractional, delays.felt_fractional, own)
        groups.setdefault(kind, []).append(place)
    return list(groups.values())


def as_one(devices: Sequence[Device], shape: tuple[int, ...]) -> SeveralDevices:
    """Return similar devices (`alike`) as one device."""
    delays = [delays_of(device) for device in devices]
    whole = (np.reshape([float(getattr(each, name)) for each in delays], shape) for name in ("loop", "felt"))
    loop, felt = (part if np.ptp(part) else int(part.flat[0]) for part in whole)
    return SeveralDevices(devices_as_one(devices, shape), replace(delays[0], loop=loop, felt=felt))
