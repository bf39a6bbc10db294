"""The sampled loop with a hand at the handle, and what the environment meets of it (model/README.md, section 14).

Of the states of device and hand (`plant_in_hand`) the position x_1, the velocity estimate and the sensed force f make
the return difference and what the environment meets,

    Delta = 1 + K_v G_v + K_p G_x,   Z_seen = -G_f (K_v + (T/2) K_p (1 + z^-1)/d)/Delta,

f being sampled just before the next command acts. Cleared of denominators they are F and P/(2 j s), numbers
even + j s odd that stay regular at theta = 0, and affine in the gains with constants that only device and hand know:

    R = -Re Z_seen = -o/(2 |F|^2),   P conj F = e + j s o.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from vctune.model.coupling import sampled_resistance
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains, SpringDamper
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import Vector, nothing
from vctune.model.numbers.pair import EvenOdd
from vctune.model.sampled.impedance_display import ForceInHand, Offered, Required, firmware_filter, offered_by_spring
from vctune.model.sampled.plant_in_hand import PlantInHand, equations, numerators

OfParts = Callable[[Number, Number], Any]
"""Makes a complex number even + j s odd of its parts."""


class LoopInHand(NamedTuple):
    """F = open + K_v velocity + K_p position and P = K_v seen_velocity + K_p seen_position at theta = omega T.

    Attributes
    ----------
    open, velocity, position : parts of F, dimensionless with their gains
    seen_velocity, seen_position : parts of P
    """

    open: EvenOdd
    velocity: EvenOdd
    position: EvenOdd
    seen_velocity: EvenOdd
    seen_position: EvenOdd

    def closed(self, gains: Gains) -> EvenOdd:
        """Return F."""
        return self.open + self.velocity.scaled(gains.velocity) + self.position.scaled(gains.position)

    def numerator(self, gains: Gains) -> EvenOdd:
        """Return P, of Z_seen = P/(2 j s F)."""
        return self.seen_velocity.scaled(gains.velocity) + self.seen_position.scaled(gains.position)


AnyLoopInHand = LoopInHand | ForceInHand
"""The loop of an admittance display in a hand, or of an impedance display."""


def loop_in_hand(plant: PlantInHand, theta: Number, ops: Arithmetic) -> AnyLoopInHand:
    """Evaluate the loop in a hand on the unit circle.

    Parameters
    ----------
    plant : device and hand
    theta : omega T, rad, in [0, pi]
    ops : arithmetic of both

    Returns
    -------
    LoopInHand or ForceInHand
        Each part of the shape of theta.
    """
    at, T = _circle(theta, ops), plant.sample_time
    d = EvenOdd(2 * at.square, 2 * at.cos, at.square)

    def number(even: Number, odd: Number) -> EvenOdd:
        return EvenOdd(even, odd, at.square)

    def states(older: Vector | None) -> dict[int, EvenOdd]:
        return numerators(equations(plant.rates, plant.step, plant.push, older, at.cos, at.square))

    if plant.renders_force:
        found = states(plant.older)
        position = found[0] * at.late(plant.delays.loop, number)
        return _force_in_hand(plant, found[len(plant.push)], position, at.cos, at.square)
    open_loop, velocity, position, felt = _answers(plant, at, number, states, d, plant.felt[0])
    unit = T / plant.mass
    return LoopInHand(
        open=open_loop,
        velocity=velocity.scaled(unit),
        position=position.scaled(unit * T),
        seen_velocity=felt * EvenOdd(0, 2, at.square),
        seen_position=felt.scaled(T * at.cos),
    )


class NextToRest(NamedTuple):
    """Where what vanishes at theta = 0 in a hand without stiffness, and with K_p = 0, comes from.

    Attributes
    ----------
    rho : 2 s + (K + K_p) T^2/m
    turned, spring, integrator : shares of 2 s, of K and of K_p in it; their sum is 1
    """

    rho: Number
    turned: Number
    spring: Number
    integrator: Number


def required_in_limp_hand(
    plant: PlantInHand, velocity: Number, theta: Number, rest: NextToRest, ops: Arithmetic
) -> Required:
    """Return what `required_in_hand` does over rho^2, next to theta = 0, a hand without stiffness and K_p = 0.

    There F and the sensed force vanish with rho, and so does what the law makes of a position. With rho x_1 in the
    place of the position x_1 they are divided by it: its column of the equations is, in which 2 s and K are factors.
    Numbers are even + j turned odd.

    Parameters
    ----------
    plant : at one or several hands
    velocity : K_v, N s/m
    theta : omega T, rad, in [0, pi]
    rest : need not be those of theta, the hand and K_p
    ops : arithmetic of all of these
    """
    at, turned, half = _circle(theta, ops), rest.turned, rest.rho / 2
    square = turned * turned

    def number(even: Number, odd: Number) -> EvenOdd:
        return EvenOdd(even, half * odd, square)

    def states(older: Vector | None) -> dict[int, EvenOdd]:
        exact = equations(plant.rates, plant.step, plant.push, older, at.cos, at.square)
        rows = [[None if entry is None else number(entry.even, entry.odd) for entry in row] for row in exact]
        for row, rates, step in zip(rows, plant.rates, plant.step, strict=True):
            # the hand's spring acts as -K x_1 wherever it does
            row[0] = EvenOdd(0 if nothing(rates[0]) else at.cos * rest.spring, step[0], square)
        return numerators(rows)

    moved = EvenOdd(square * half, at.cos, square)  # d/rho
    grip = 0 if nothing(plant.felt[0]) else rest.spring
    open_loop, speed, position, felt = _answers(plant, at, number, states, moved, grip)
    unit = plant.mass / plant.sample_time
    F = open_loop + speed.scaled(velocity / unit) + position.scaled(rest.integrator)
    P = felt * EvenOdd(rest.integrator * unit * at.cos, velocity, square)
    return Required(P.even * F.odd - P.odd * F.even, F.abs2())


class _Circle(NamedTuple):
    """z = e^{j theta}, with s = sin(theta/2), c = cos(theta/2) and s^2."""

    theta: Number
    sin: Number
    cos: Number
    square: Number
    ops: Arithmetic

    def late(self, whole: Number, number: OfParts) -> Any:
        """Return e^{-j (N + 1/2) theta}."""
        if isinstance(whole, int) and whole == 0:
            return number(self.cos, -1)
        steps, ops = whole + 0.5, self.ops
        sine = -2 * steps * (ops.sinc(self.theta * steps) / ops.sinc(self.theta / 2))
        return number(ops.cos(self.theta * steps), sine)


def _circle(theta: Number, ops: Arithmetic) -> _Circle:
    sin, cos = ops.sin(theta / 2), ops.cos(theta / 2)
    return _Circle(theta, sin, cos, sin * sin, ops)


def _answers(
    plant: PlantInHand,
    at: _Circle,
    number: OfParts,
    states: Callable[[Vector | None], dict[int, Any]],
    moved: Any,
    grip: Number,
) -> tuple[Any, Any, Any, Any]:
    """Return the determinant, and what velocity estimate, position and sensed force are times it.

    Parameters
    ----------
    number : makes complex numbers even + j s odd
    states : what the states are times the determinant, and it, of b_1
    moved : d times the position's unit
    grip : what is felt of a position of that unit
    """

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
    if plant.low_pass is not None:
        a = plant.low_pass
        passed, once = number(a * at.cos, a), number(a * at.cos, 2 - a)
        for _ in range(plant.order):
            velocity = velocity * passed
            open_loop, position, felt = open_loop * once, position * once, felt * once
    return open_loop, velocity, position, felt


def _force_in_hand(
    plant: PlantInHand, open_loop: EvenOdd, position: EvenOdd, cos: Number, square: Number
) -> ForceInHand:
    """Return the loop of an impedance display from its determinant and the numerator of its position."""
    d, unit = EvenOdd(2 * square, 2 * cos, square), plant.sample_time / plant.mass
    velocity, met = position * d, position * EvenOdd(-4 * cos, 4, square)  # -4 e^{-j theta/2} G_x/T
    if plant.low_pass is not None:
        # a quotient, unlike in `loop_in_hand`: what is met stays free of the filter, and boxes of hands tight
        a, rest = plant.low_pass, 2 - plant.low_pass
        below = 1 / (a * a * (cos * cos) + rest * rest * square)
        passed = EvenOdd((a * cos * cos + rest * square) * (a * below), 2 * (a - 1) * a * (cos * below), square)
        for _ in range(plant.order):
            velocity = velocity * passed
    return ForceInHand(open_loop, velocity.scaled(unit), met.scaled(unit))


def required_in_hand(loop: AnyLoopInHand, gains: Gains) -> Required:
    """Return -o/2 and |F|^2, whose quotient is R.

    Parameters
    ----------
    loop : at one or several angles
    gains : in its numbers
    """
    F, P = loop.closed(gains), loop.numerator(gains)
    return Required(-0.5 * (P.odd * F.even - P.even * F.odd), F.abs2())


def offered(coupling: AnyCoupling, device: Device, theta: Number, ops: Arithmetic) -> Number:
    """Return Re Z_c of the coupling as the firmware runs it, and of an impedance display Re(1/Z_c)/sin^2(theta/2).

    Parameters
    ----------
    coupling : in numbers of the arithmetic
    device : whose firmware runs it
    theta : omega T, rad, in [0, pi]
    ops : arithmetic of all of these
    """
    if isinstance(coupling, SpringDamper):
        return _by_spring(coupling, device, theta, ops).quotient
    return sampled_resistance(coupling, device.sample_time, theta, ops)


def room(
    coupling: AnyCoupling, device: Device, required: Required, factor: Number, theta: Number, ops: Arithmetic
) -> Number:
    """Return what is offered less factor R, times something positive: no quotient is formed that may be of 0 by 0.

    Parameters
    ----------
    coupling : in numbers of the arithmetic
    device : whose firmware runs it
    required : R there
    factor : > 0
    theta : omega T, rad, in [0, pi]
    ops : arithmetic of all of these
    """
    if isinstance(coupling, SpringDamper):
        there = _by_spring(coupling, device, theta, ops)
        return there.above * required.size - factor * (required.lost * there.below)
    return sampled_resistance(coupling, device.sample_time, theta, ops) * required.size - factor * required.lost


def _by_spring(coupling: SpringDamper, device: Device, theta: Number, ops: Arithmetic) -> Offered:
    return offered_by_spring(coupling, device.sample_time, firmware_filter(device, theta, ops), theta, ops)
