"""Evaluate the sampled loop with a hand at the handle, and the impedance that the environment sees (model/README.md,
section 14)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains, SpringDamper, sampled_resistance, series_coupling
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import Vector, nothing
from vctune.model.numbers.pair import EvenOdd
from vctune.model.sampled.circle import Circle, OfParts, circle
from vctune.model.sampled.impedance_display import (
    ForceInHand,
    Required,
    YOffered,
    firmware_filter,
    offered_by_spring,
)
from vctune.model.sampled.loop_in_worlds import ZOffered, ZSeen, offered_at
from vctune.model.sampled.plant_in_hand import AnyPlantInHand, PlantInHand, ServoInHand, equations, numerators
from vctune.model.sampled.servo_in_hand import blur_of, seen_of_servo
from vctune.model.sections import Section


class LoopInHand(NamedTuple):
    """The loop of an admittance display in a hand, at theta = omega T."""

    open: EvenOdd  # coefficients of F; each is dimensionless together with its gain
    velocity: EvenOdd
    position: EvenOdd
    seen_velocity: EvenOdd  # coefficients of P, dimensionless and in s; P is in N s/m
    seen_position: EvenOdd

    def closed(self, gains: Gains) -> EvenOdd:
        """Return F."""
        return self.open + self.velocity.scaled(gains.velocity) + self.position.scaled(gains.position)

    def numerator(self, gains: Gains) -> EvenOdd:
        """Return P in Z_seen = P/(2 j s F)."""
        return self.seen_velocity.scaled(gains.velocity) + self.seen_position.scaled(gains.position)


class CommandInHand(NamedTuple):
    """The impedance that a servo in a hand presents to the environment, Z_seen = seen/(2 j s), whatever the gains."""

    seen: EvenOdd  # numerator, N s/m, regular at theta = 0
    blur: Number = 0  # greatest increase of -odd/2 over the disc of responses, `Servo.radii`, N s/m; 0 without a disc

    def closed(self, _gains: Gains) -> EvenOdd:
        """Return F; a servo has no loop, so F = 1."""
        return EvenOdd(1, 0, self.seen.square)

    def numerator(self, _gains: Gains) -> EvenOdd:
        """Return P."""
        return self.seen


# The loop of an admittance display in a hand, the loop of an impedance display, or a servo's response to commands
AnyLoopInHand = LoopInHand | ForceInHand | CommandInHand


def loop_in_hand(plant: AnyPlantInHand, theta: Number, ops: Arithmetic) -> AnyLoopInHand:
    """Evaluate the sampled loop with a hand at the handle, at z = e^{j theta} (model/README.md, section 14)."""
    if isinstance(plant, ServoInHand):
        seen, half = seen_of_servo(plant.plant, plant.hand, theta, ops), ops.sin(theta / 2)
        blur = blur_of(plant.plant, seen, theta, ops)
        return CommandInHand(EvenOdd(seen.even, seen.odd, half * half), blur)
    at, T = circle(theta, ops), plant.sample_time
    d = EvenOdd(2 * at.square, 2 * at.cos, at.square)

    def number(even: Number, odd: Number) -> EvenOdd:
        return EvenOdd(even, odd, at.square)

    def states(older: Vector | None) -> dict[int, EvenOdd]:
        return numerators(equations(plant.rates, plant.step, plant.push, older, at.cos, at.square), ops)

    if plant.meets_position:
        found, late = states(plant.older), at.late(plant.delays.loop, number)
        return _force_in_hand(plant, found[len(plant.push)], found[0] * late, found[1] * late, at)
    open_loop, velocity, position, felt = _answers(plant, at, number, states, d, plant.felt[0])
    unit = T / plant.mass
    integrated = felt.scaled(T * at.cos)  # K_p (T/2) (z + 1)/(z - 1) times 2 j s
    if plant.summed:  # K_p T z/(z - 1)
        integrated = integrated + felt * EvenOdd(0, T, at.square)
    return LoopInHand(
        open=open_loop,
        velocity=velocity.scaled(unit),
        position=position.scaled(unit * T),
        seen_velocity=felt * EvenOdd(0, 2, at.square),
        seen_position=integrated,
    )


class NextToRest(NamedTuple):
    """The terms of rho. If the hand has no stiffness and K_p = 0, rho vanishes at theta = 0."""

    rho: Number  # 2 s + (K + K_p) T^2/m
    turned: Number  # shares of the terms 2 s, K T^2/m and K_p T^2/m in rho; they add up to 1
    spring: Number
    integrator: Number


def required_in_limp_hand(
    plant: PlantInHand, velocity: Number, theta: Number, rest: NextToRest, ops: Arithmetic
) -> Required:
    """Return `required_in_hand` divided by rho^2, near the limit in which theta, the hand's stiffness and K_p are 0."""
    F, felt = _next_to_rest(plant, velocity, theta, rest, ops)
    # with K_p = integrator rho m/T^2 and 2 s = turned rho, both terms of the law have the denominator j turned
    push = rest.integrator * (plant.mass / plant.sample_time)
    ahead = push * (rest.rho / 2) if plant.summed else 0
    P = felt * EvenOdd(push * ops.cos(theta / 2), velocity + ahead, F.square)
    return Required(P.even * F.odd - P.odd * F.even, F.abs2())


def seen_in_limp_hand(plant: PlantInHand, velocity: Number, theta: Number, rest: NextToRest, ops: Arithmetic) -> ZSeen:
    """Return `seen_in_hand` divided by rho^2, with the swing also divided by s, for K_p = 0."""
    F, felt = _next_to_rest(plant, velocity, theta, rest, ops)
    lost = velocity * (felt.even * F.even + F.square * (felt.odd * F.odd))
    swing = velocity * rest.turned * (felt.even * F.odd - felt.odd * F.even)
    return ZSeen(-lost, swing, F.abs2())


def _next_to_rest(
    plant: PlantInHand, velocity: Number, theta: Number, rest: NextToRest, ops: Arithmetic
) -> tuple[EvenOdd, EvenOdd]:
    """Return F and minus the sensed force, both divided by rho, as numbers even + j turned odd."""
    at, turned, half = circle(theta, ops), rest.turned, rest.rho / 2
    square = turned * turned

    def number(even: Number, odd: Number) -> EvenOdd:
        return EvenOdd(even, half * odd, square)

    def states(older: Vector | None) -> dict[int, EvenOdd]:
        exact = equations(plant.rates, plant.step, plant.push, older, at.cos, at.square)
        rows = [[None if entry is None else number(entry.even, entry.odd) for entry in row] for row in exact]
        for row, rates, step in zip(rows, plant.rates, plant.step, strict=True):
            # the hand's spring acts only through -K x_1
            row[0] = EvenOdd(0 if nothing(rates[0]) else at.cos * rest.spring, step[0], square)
        return numerators(rows, ops)

    moved = EvenOdd(square * half, at.cos, square)  # d/rho
    grip = 0 if nothing(plant.felt[0]) else rest.spring
    open_loop, speed, position, felt = _answers(plant, at, number, states, moved, grip)
    driven = speed.scaled(velocity * (plant.sample_time / plant.mass)) + position.scaled(rest.integrator)
    return open_loop + driven, felt


def _answers(
    plant: PlantInHand,
    at: Circle,
    number: OfParts,
    states: Callable[[Vector | None], dict[int, Any]],
    moved: Any,
    grip: Number,
) -> tuple[Any, Any, Any, Any]:
    """Return the determinant, and the products of the determinant with velocity, position and minus the sensed
    force."""

    def of_states(shares: Vector, first: Any) -> Any:
        others = (
            felt_states[j].scaled(x) for j, x in enumerate(shares) if j > 0 and j in felt_states and not nothing(x)
        )
        return sum(others, start=first)

    delays, back = plant.delays, number(at.cos, -1)
    found = states(plant.older)
    felt_states = found if plant.felt_older is plant.older else states(plant.felt_older)
    turned = at.late(delays.loop, number)
    open_loop, position = found[len(plant.push)], found[0] * turned
    velocity = position * moved if plant.difference else found[1] * turned
    felt = of_states(plant.felt, felt_states[0].scaled(grip))
    if plant.felt_inertia is not None:
        shares, left = plant.felt_inertia
        felt = felt + felt_states[0].scaled(shares[0]) * moved
        carried = of_states(shares, number(0, 0))
        for share in left:
            carried = carried + open_loop.scaled(share) * back
        felt = felt + carried * number(2 * at.square, 2 * at.cos)
    felt = felt * at.late(delays.felt, number)
    for section in plant.felt_filters:
        felt = felt * number(*quotient(section, at.cos, at.square))
    for section in plant.filters:
        once = number(*section.below(at.cos, at.square))
        velocity = velocity * number(*section.above(at.cos, at.square))
        open_loop, position, felt = open_loop * once, position * once, felt * once
    return open_loop, velocity, position, felt


def _force_in_hand(
    plant: PlantInHand, open_loop: EvenOdd, position: EvenOdd, measured: EvenOdd, at: Circle
) -> ForceInHand:
    """Return the loop of an impedance display from the determinant and the numerators of position and velocity."""
    # met = 2 j s F G_y/s^2 with G_y = 2 j s e^{-j theta/2} G_x/T, and (2 j s)^2/s^2 = -4
    cos, square, unit = at.cos, at.square, plant.sample_time / plant.mass
    velocity = position * EvenOdd(2 * square, 2 * cos, square) if plant.difference else measured
    met = position * EvenOdd(-4 * cos, 4, square)  # -4 e^{-j theta/2} G_x/T
    for section in plant.filters:
        # a quotient, unlike in `loop_in_hand`, so that `met` does not contain the filter, and enclosures for boxes of
        # hands stay tight
        velocity = velocity * EvenOdd(*quotient(section, cos, square), square)
    return ForceInHand(open_loop, velocity.scaled(unit), met.scaled(unit), position.scaled(unit * plant.sample_time))


def quotient(section: Section, cos: Number, square: Number) -> tuple[Number, Number]:
    """Return the even and the odd part of a section."""
    below = 1 / section.below2(square)
    return section.along(square) * below, -2 * section.across(square) * (cos * below)


def required_in_hand(loop: AnyLoopInHand, gains: Gains) -> Required:
    """Return -o/2 and |F|^2, whose quotient is R (model/README.md, sections 14, 15 and 17)."""
    if isinstance(loop, CommandInHand):
        return Required(loop.blur - 0.5 * loop.seen.odd, 1)
    F, P = loop.closed(gains), loop.numerator(gains)
    return Required(-0.5 * (P.odd * F.even - P.even * F.odd), F.abs2())


def seen_in_hand(loop: AnyLoopInHand, gains: Gains) -> ZSeen:
    """Return Z_seen, the impedance that the loop in a hand presents to the environment."""
    if isinstance(loop, CommandInHand):
        return ZSeen(-0.5 * loop.seen.odd, 0.5 * loop.seen.even, 1, loop.blur)
    required = required_in_hand(loop, gains)
    F, P = loop.closed(gains), loop.numerator(gains)
    return ZSeen(required.lost, 0.5 * (P.even * F.even + F.square * (P.odd * F.odd)), required.size)


def met_in_hand(
    loop: AnyLoopInHand, device: Device, gains: Gains, coupling: AnyCoupling, theta: Number, ops: Arithmetic
) -> tuple[ZOffered, ZSeen]:
    """Return the two parts of the impedance that an environment meets: the coupling's and the loop's."""
    return offered_at(series_coupling(coupling), device.sample_time, device.rule, theta, ops), seen_in_hand(loop, gains)


def offered(coupling: AnyCoupling, device: Device, theta: Number, ops: Arithmetic) -> Number:
    """Return Re Z_c of the coupling in the firmware; for an impedance display Re(1/Z_c)/sin^2(theta/2)."""
    if isinstance(coupling, SpringDamper):
        return offered_at_spring(coupling, device, theta, ops).quotient
    return sampled_resistance(coupling, device.sample_time, device.rule, theta, ops)


def room(
    coupling: AnyCoupling, device: Device, required: Required, factor: Number, theta: Number, ops: Arithmetic
) -> Number:
    """Return (offered - factor R) times a positive number, so that the result has the sign of the margin."""
    if isinstance(coupling, SpringDamper):
        there = offered_at_spring(coupling, device, theta, ops)
        return there.above * required.size - factor * (required.lost * there.below)
    there = sampled_resistance(coupling, device.sample_time, device.rule, theta, ops)
    return there * required.size - factor * required.lost


def offered_at_spring(coupling: SpringDamper, device: Device, theta: Number, ops: Arithmetic) -> YOffered:
    """Return 1/Z_c/sin^2(theta/2) of an impedance display's coupling in the firmware."""
    return offered_by_spring(coupling, device.sample_time, firmware_filter(device, theta, ops), theta, ops)
