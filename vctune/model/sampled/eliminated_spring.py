"""Write the margin of a rigid device in a hand as a quadratic in the part of the loop that the hand's spring
changes."""

from __future__ import annotations

from typing import NamedTuple

from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.hands import Hand
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import Vector
from vctune.model.numbers.pair import EvenOdd
from vctune.model.sampled.circle import circle
from vctune.model.sampled.plant_in_hand import PlantInHand


class InSpring(NamedTuple):
    """The margin in a hand as A (x^2 + s^2 p^2) + L x + E p + C."""

    square: Number  # A, L, E and C
    linear: Number
    rise: Number
    constant: Number
    damped: Number  # p for the least damping, `least_damping` of `margin_in_spring`
    half_sine: Number  # s^2

    @property
    def for_every_spring(self) -> tuple[Number, Number, Number]:
        """Three numbers. If all are positive, the margin is positive for every x and every p from `damped` on."""
        bent = self.half_sine * (self.square * self.damped)
        least = (bent + self.rise) * self.damped + self.constant
        return 4 * (self.square * least) - self.linear * self.linear, self.square, 2 * bent + self.rise


def moves_as_two_states(device: Device) -> bool:
    """Return whether `margin_in_spring` holds for a device."""
    parts = (device.velocity, device.actuator, device.structure, device.servo, device.sensing.bandwidth_hz)
    return device.kind.senses_force and device.kind.own_loop and all(part is None for part in parts)


def margin_in_spring(
    plant: PlantInHand,
    device: Device,
    hand: Hand,
    least_damping: Number,
    gains: Gains,
    offered: Number,
    factor: Number,
    theta: Number,
    ops: Arithmetic,
) -> InSpring:
    """Return the margin |F|^2 (Re Z_c - factor R) |S|^4 of a device that `moves_as_two_states`."""
    at, T, delays = circle(theta, ops), plant.sample_time, plant.delays

    def number(even: Number, odd: Number) -> EvenOdd:
        return EvenOdd(even, odd, at.square)

    (alpha, beta), (_, inertia) = plant.step
    held, grip, own = -plant.rates[1][1], plant.felt[0], device.damping * T / device.mass
    turned, late = number(at.cos, -2 * beta), number(at.cos, -1)  # S and e^{-j theta/2}
    moved, slowed = number(0 * alpha, 2 * alpha), number(at.cos * held, 2 * inertia)
    change = number(2 * at.square, 2 * at.cos)

    def pushed(older: Vector | None) -> tuple[EvenOdd | None, EvenOdd]:
        """Return the force on the position, and the product of the determinant and the position without delay."""
        if older is None:
            return None, turned
        push = change.scaled(-older[0])
        return push, turned * change.scaled(-older[1]).plus(1) + slowed * push

    push, position = pushed(plant.older)
    felt_push, felt_position = (push, position) if plant.felt_older is plant.older else pushed(plant.felt_older)
    # F S = F_1 (x + j s p) + F_0 and P S^2 = P_1 (x + j s p) + P_0, F_1 and F_0 without a common factor S
    loop, felt = at.late(delays.loop, number), at.late(delays.felt, number)
    unit = T / plant.mass
    F_1 = turned if push is None else turned + (loop * push).scaled(-(gains.velocity * unit))
    F_0 = loop * position * (moved.scaled(gains.velocity * unit) + turned.scaled(gains.position * (unit * T)))
    share = device.mass / (device.mass + hand.mass)
    through = turned * turned * late.scaled(hand.mass / (device.mass + hand.mass)) + felt_position.scaled(share)
    if felt_push is not None:
        through = through + (turned * felt_push).scaled(own - share * held)
    law = number(gains.position * (T * at.cos), 2 * gains.velocity) * felt * number(at.cos, 2 * beta)
    P_1 = law * through
    P_0 = (law * felt_position * moved * (moved + turned.scaled(own))).scaled(-1)
    resistance, half = offered * turned.abs2(), 0.5 * factor

    def joined(P: EvenOdd, F: EvenOdd) -> Number:
        return half * (P.odd * F.even - P.even * F.odd)

    def common(a: EvenOdd, b: EvenOdd) -> Number:
        return 2 * (resistance * (a.even * b.even + a.square * (a.odd * b.odd)))

    sideways_F, sideways_P = _times_js(F_1), _times_js(P_1)
    return InSpring(
        square=resistance * F_1.abs2() + joined(P_1, F_1),
        linear=common(F_1, F_0) + joined(P_1, F_0) + joined(P_0, F_1),
        rise=common(sideways_F, F_0) + joined(sideways_P, F_0) + joined(P_0, sideways_F),
        constant=resistance * F_0.abs2() + joined(P_0, F_0),
        damped=2 * at.cos * (alpha * ((device.damping + least_damping) * unit) - 2 * (beta * grip)),
        half_sine=at.square,
    )


def _times_js(x: EvenOdd) -> EvenOdd:
    """Return j s x."""
    return EvenOdd(-(x.square * x.odd), x.even, x.square)
