"""A servo and its force sensor over a sample, exactly (model/README.md, section 17).

All are polynomials of y = sin^2(theta/2). Velocity, acceleration and position pass servo and sensor alike, so that the
sensor's low-pass may follow the servo's and both delays add up to (N + delta) T. In w = z^-1 and d = 1 - w the pulse
transfer functions from the held velocity are

    G_v = w^N V/O,   G_a = w^N A/O,   G_x = w^N X/(d O),

with polynomials that are homogeneous in d and w, of degree n + 1, n + 1, n + 2 and n. On the unit circle d = 2 j s
e^(-j theta/2) and w = (c - j s) e^(-j theta/2), s = sin(theta/2), c = cos(theta/2). Divided by powers of e^(-j
theta/2), each polynomial is one of 2 j s and c with real coefficients, and the factors of 1/O are multiplied out:

    G_x = e^(-j mu theta) (e(y) + j s c o(y))/(2 j s D(y)),   D = |O|^2,   mu = N + 1/2,

and likewise G_v and G_a with 2 j s V and 2 j s A instead of X. A filter y += a (x - y) of the sensed samples is

    a/(1 - b w) = a (a + 2 b y - 2 j b s c)/(a^2 + 4 b y),   b = 1 - a.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from math import comb

from vctune.model.device import Device
from vctune.model.loop.filters import filter_rows
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import Matrix, Vector, add, dot, times
from vctune.model.parts import Servo
from vctune.model.sampled.state_space import sampled_chain
from vctune.model.sampled.velocity_loop import split_delay


@dataclass(frozen=True, slots=True)
class Numerator:
    """e(y) + j s c o(y), coefficients of the powers of y.

    Attributes
    ----------
    even, odd : e and o
    """

    even: Vector
    odd: Vector

    def converted(self, number: Callable[[Number], Number]) -> Numerator:
        """Return it in numbers of another arithmetic."""
        return Numerator(tuple(map(number, self.even)), tuple(map(number, self.odd)))


@dataclass(frozen=True, slots=True)
class ServoPlant:
    """The response of a servo to a held velocity command, in the equations of this module.

    Attributes
    ----------
    size : D, coefficients of the powers of y
    acceleration, velocity, position : numerators of G_a, G_v and G_x over 2 j s D; 1/s, 1 and s
    turns : mu, for a position command half more
    interpolated : whether the command is a position: all is times cos(theta/2)
    sample_time : T, s
    pull : the firmware's own spring; None without it
    radii : radii of a disc of responses, `Servo.radii`
    """

    size: Vector
    acceleration: Numerator
    velocity: Numerator
    position: Numerator
    turns: Number
    interpolated: bool
    sample_time: Number
    pull: Pull | None = None
    radii: tuple[tuple[float, float], ...] = ()

    def converted(self, number: Callable[[Number], Number]) -> ServoPlant:
        """Return the plant in numbers of another arithmetic."""
        pull = self.pull
        return replace(
            self,
            size=tuple(map(number, self.size)),
            acceleration=self.acceleration.converted(number),
            velocity=self.velocity.converted(number),
            position=self.position.converted(number),
            sample_time=number(self.sample_time),
            pull=pull and Pull(pull.plant.converted(number), number(pull.stiffness)),
        )


@dataclass(frozen=True, slots=True)
class Pull:
    """A spring of the firmware between the measured position and a reference.

    Attributes
    ----------
    plant : the servo without force sensor
    stiffness : N/m
    """

    plant: ServoPlant
    stiffness: Number


@dataclass(frozen=True, slots=True)
class SensedDelay:
    """N of the delays of servo and sensor together, and whether a part of a sample remains.

    Attributes
    ----------
    whole, fractional : N, and whether delta > 0
    moved : those of the servo alone; None if they are the same
    """

    whole: int
    fractional: bool
    moved: SensedDelay | None = None


def sensed_delay(device: Device) -> SensedDelay:
    """Return the delays of a device whose numbers are plain, in samples."""
    whole, left = split_delay(device.sensed_latency, device.sample_time)
    moved, rest = split_delay(device.latency, device.sample_time)
    return SensedDelay(whole, left > 0, SensedDelay(moved, rest > 0))


def servo_plant(device: Device, delay: SensedDelay, ops: Arithmetic) -> ServoPlant:
    """Sample a servo and its force sensor exactly (model/README.md, section 17).

    The sensor reads the force just before the next command acts. With a delay of whole samples, the previous command
    still causes that force.

    Parameters
    ----------
    device : a servo, in SI units
    delay : whole samples of the delays of servo and sensor together, and of the servo alone
    ops : arithmetic of the device's numbers

    Returns
    -------
    ServoPlant
        Its numbers have the shape of the device's.
    """
    T, rates = device.sample_time, _rates(device, ops)
    older = (device.sensed_latency - delay.whole * T) / T if delay.fractional else None
    chain, inner = sampled_chain(rates, older, ops), rates[1][1:-1]
    direct, n = rates[1][-1], len(inner)  # row 1: the sensed velocity; column -1: the command
    below_all = (*chain.open, 1)
    newer, late = chain.states
    velocity = _with_older([x[0] for x in newer], [x[0] for x in late])
    felt = [dot(inner, x) for x in late]
    # just before the sample the older command of it acts
    felt = [add(x, times(direct, c)) for x, c in zip((*felt, 0), below_all, strict=True)]
    acceleration = _with_older([dot(inner, x) for x in newer], felt)
    position = _with_older(*chain.position)
    below = _half_angles(below_all, n)
    D, _ = _by_square(_times_conjugate(below, below))
    servo, share = device.servo, device.sensing.filter_coefficient
    assert servo is not None

    def numerator(polynomial: Sequence[Number], degree: int, unit: Number) -> Numerator:
        halves = _half_angles(polynomial, degree)
        halves = [0] * (n + 2 - degree) + [times(unit, x) for x in halves]
        found = Numerator(*_by_square(_times_conjugate(halves, below)))
        return found if share is None else _smoothed(found, share)

    interpolated = servo.command == "position"
    return ServoPlant(
        size=D if share is None else _polynomial_product(D, (share, 4 * (1 - share) / share)),
        acceleration=numerator(acceleration, n + 1, 1 / T),
        velocity=numerator(velocity, n + 1, 1),
        position=numerator(position, n + 2, T),
        turns=delay.whole + (1.0 if interpolated else 0.5),
        interpolated=interpolated,
        sample_time=T,
        pull=_pull(device, servo, delay, ops),
        radii=servo.radii,
    )


def _pull(device: Device, servo: Servo, delay: SensedDelay, ops: Arithmetic) -> Pull | None:
    if servo.stiffness is None:
        return None
    known = delay.moved is not None or ops.is_zero(device.sensing.delay)
    assert known, "the delay of the servo alone is not told"
    alone = replace(device.sensing_at_once, servo=replace(servo, stiffness=None))
    return Pull(servo_plant(alone, delay.moved or delay, ops), servo.stiffness)


def _smoothed(part: Numerator, share: Number) -> Numerator:
    """Return a numerator behind a filter of the samples, which multiplies the size by a + 4 b y/a."""
    twice, late = (share, 2 * (1 - share)), (0, 2 * (1 - share))
    even = _sum(_polynomial_product(part.even, twice), _polynomial_product(part.odd, (*late, -late[1])))
    odd = _sum(_polynomial_product(part.odd, twice), [times(-late[1], x) for x in part.even])
    return Numerator(even, odd)


def _polynomial_product(a: Sequence[Number], b: Sequence[Number]) -> Vector:
    found: list[Number] = [0] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            found[i + j] = add(found[i + j], times(x, y))
    return tuple(found)


def _sum(a: Sequence[Number], b: Sequence[Number]) -> Vector:
    return tuple(add(x, y) for x, y in zip_longest(a, b, fillvalue=0))


def _rates(device: Device, ops: Arithmetic) -> Matrix:
    """Return d/dt of (way that is sensed, velocity that is sensed, ..., command), T = 1."""
    T, servo, sensor = device.sample_time, device.servo, device.sensing
    assert servo is not None
    one = 0 * T + 1  # in the arithmetic, so that what it is divided by is enclosed
    moved: tuple[str, ...] = ("moved", "moving")[: servo.order]
    felt: tuple[str, ...] = ()
    if sensor.bandwidth_hz is not None:
        felt = ("felt", "felt rate")[: sensor.order]
    names = ["position", *felt, *moved, "command"]
    rows: dict[str, dict[str, Number]] = {name: {} for name in names}
    rows["position"][names[1]] = one
    rows[moved[-1]]["command"] = filter_rows(rows, ("moved", "moving"), servo.bandwidth_hz * T, servo.order, ops)
    if felt:
        corner = filter_rows(rows, ("felt", "felt rate"), sensor.bandwidth_hz * T, sensor.order, ops)
        rows[felt[-1]]["moved"] = corner
    return tuple(tuple(row.get(name, 0) for name in names) for row in rows.values())


def _with_older(newer: Sequence[Number], older: Sequence[Number]) -> list[Number]:
    """Return newer + w older of polynomials of degree m in d and w as one of degree m + 1, w + d being 1."""
    width = max(len(newer), len(older)) + 1
    a, b = ([*x, *[0] * (width - len(x))] for x in (newer, older))
    return [add(add(x, y), before) for x, y, before in zip(a, b, (0, *a), strict=False)]


def _half_angles(polynomial: Sequence[Number], degree: int) -> list[Number]:
    """Return the coefficients of (2 j s)^k c^(m - k) of the sum of a_k (2 j s)^k (c - j s)^(m - k), m the degree."""
    found: list[Number] = [0] * (degree + 1)
    for k, a in enumerate(polynomial):
        for i in range(degree - k + 1):
            found[k + i] = add(found[k + i], times(a, comb(degree - k, i) * (-0.5) ** i))  # j s = 2 j s/2
    return found


def _times_conjugate(a: Sequence[Number], b: Sequence[Number]) -> list[Number]:
    """Return a conj b of polynomials of 2 j s and c."""
    found: list[Number] = [0] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            found[i + j] = add(found[i + j], times(times(x, y), (-1) ** j))  # conj (2 j s)^j
    return found


def _by_square(polynomial: Sequence[Number]) -> tuple[Vector, Vector]:
    """Return e and o, by powers of y, of a polynomial e(y) + j s c o(y) of 2 j s and c, whose degree is even."""
    half = (len(polynomial) - 1) // 2

    def powers(coefficients: Sequence[Number], degree: int) -> Vector:
        found: list[Number] = [0] * (degree + 1)
        for k, a in enumerate(coefficients):  # a (-4 y)^k (1 - y)^(degree - k)
            for i in range(degree - k + 1):
                found[k + i] = add(found[k + i], times(a, (-4) ** k * comb(degree - k, i) * (-1) ** i))
        return tuple(found)

    return powers(polynomial[::2], half), powers([times(2, a) for a in polynomial[1::2]], half - 1)
