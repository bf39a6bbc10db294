"""Evaluate the velocity loop at a frequency: affine in the gains, and regular at omega = 0 (model/README.md, sections
1, 2 and 12; paper eqs. 7, 9, 10, 11)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from vctune.model.gains import Gains
from vctune.model.loop.device_response import DeviceResponse
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.pair import EvenOdd, Pair

Complex = Any  # A `Pair` or an `EvenOdd`


@dataclass(frozen=True, slots=True)
class Affine:
    """A complex number that is affine in the gains at a frequency: constant + K_v velocity + K_p position."""

    constant: Complex  # the three coefficients; None for 0. An impedance has coefficients in N s/m, 1 and s
    velocity: Complex = None
    position: Complex = None

    def driven(self, gains: Gains) -> Complex:
        """Return the gains' part of the number, K_v velocity + K_p position; None for 0."""
        velocity = None if self.velocity is None else self.velocity.scaled(gains.velocity)
        position = None if self.position is None else self.position.scaled(gains.position)
        return _sum(velocity, position)

    def closed(self, gains: Gains) -> Complex:
        """Return the number for given gains; None for 0."""
        return _sum(self.constant, self.driven(gains))

    def mapped(self, of: Callable[[Complex], Any]) -> Affine:
        """Return the number with a function applied to its coefficients."""
        return Affine(*(None if each is None else of(each) for each in (self.constant, self.velocity, self.position)))

    def times(self, factor: EvenOdd) -> Affine:
        """Return the number times a complex factor."""
        return self.mapped(lambda each: factor * each)

    def plus(self, constant: EvenOdd) -> Affine:
        """Return a number without a constant plus a constant."""
        return replace(self, constant=constant)


class LoopConstants(NamedTuple):
    """The constants of the loop at a frequency, which do not depend on the gains. Impedances may have a factor u."""

    controller: Affine  # C_0 and F_s C_0
    C: Affine
    D: Affine  # D, D - C_0, N and W
    miss: Affine
    numerator: Affine
    motor: Affine
    further: tuple[Affine, ...] = ()  # forces of the springs after the first one, as W is that of the first


class LoopResponse(NamedTuple):
    """The loop's impedances times a scale, which is omega with an integrator, and 1 without."""

    C_scaled: Pair  # F_s C_0 = q D times the scale
    D_scaled: Pair  # D times the scale
    miss_scaled: Pair  # D - C_0 = (1 - G_he) D times the scale; for an ideal device D - C_0 = Z_d
    numerator: Pair | None  # N = G_hh D, dimensionless; None if it is 1; 0 for a servo
    scale2: Number  # the scale squared
    im_C_conj_D_scaled: Number  # scale * Im(F_s C_0 conj D), which is scale * |D|^2 Im q (model/README.md, section 5)
    im_slope: Number | None  # `im_C_conj_D_scaled` divided by omega, regular at omega = 0; None if it has a pole there
    resistance: Number  # Re(N conj D) + b_h |N|^2, not scaled, N s/m
    operator_relief: Number | None  # 2 b_h Re(F_s C_0 conj N); None without an operator


def loop_constants(at: DeviceResponse) -> LoopConstants:
    """Return the constants of a device's loop at omega > 0, with u = 1."""
    omega = at.omega
    found = _constants(at, scaled=False, position=True)

    def pairs(of: Affine) -> Affine:
        return of.mapped(lambda x: Pair(x.even, omega * x.odd))

    return LoopConstants(
        pairs(found.controller),
        pairs(found.C),
        pairs(found.D),
        pairs(found.miss),
        pairs(found.numerator),
        pairs(found.motor),
        tuple(map(pairs, found.further)),
    )


def loop_response(at: DeviceResponse, gains: Gains, ops: Arithmetic) -> LoopResponse:
    """Evaluate the velocity loop of a device at a frequency (model/README.md, sections 1, 2, 12 and 13)."""
    omega, integral, rigid = at.omega, not ops.is_zero(gains.position), not at.springs
    known, nothing = _constants(at, scaled=integral, position=integral), EvenOdd(0, 0, omega * omega)
    controller, C = (each.closed(gains) or nothing for each in (known.controller, known.C))
    D, miss, N = (each.closed(gains) or nothing for each in (known.D, known.miss, known.numerator))
    slope = C.odd * miss.even - C.even * miss.odd  # of Im(F_s C_0 conj(D - C_0))
    if at.sensor is not None:  # |C_0|^2 is real, so its term contains only the imaginary part of F_s
        slope = slope - at.sensor.lag * controller.abs2()
    im_slope = None if integral else slope
    lossless = at.sensor is None and ops.is_zero(at.damping) and (rigid or at.springs[-1].damping is None)
    if integral and lossless:
        rest = _lossless_miss(at).closed(gains) or nothing
        im_slope = omega * (C.even * rest.odd - C.odd * rest.even)

    def re(x: EvenOdd) -> Number:
        """Return Re(x/u)."""
        return x.odd if integral else x.even

    def re_conj(x: EvenOdd, y: EvenOdd) -> Number:
        """Return Re(x conj(y/u))."""
        if integral:
            return x.even * y.odd - x.odd * y.even
        return x.even * y.even + x.square * (x.odd * y.odd)

    if at.follows:
        resistance = 0 * omega
    elif at.factor is not None or at.at_handle:
        resistance = re(D) if rigid else re_conj(N, D)
    else:  # Re W + Re y |W|^2 + Re Z_h |N|^2, of which no two terms cancel
        W = known.motor.closed(gains) or nothing
        resistance = re(W)
        for spring, force in zip(at.springs, (W, *(each.closed(gains) for each in known.further)), strict=not rigid):
            resistance = resistance + spring.y_c * (force.abs2() if integral else omega * omega * force.abs2())
            resistance = resistance if spring.damping is None else resistance + spring.damping * N.abs2()
    operator_relief, simple = None, rigid and not at.follows
    if at.operator is not None:
        resistance = resistance + at.operator * (1 if simple else N.abs2())
        operator_relief = 2 * at.operator * (re(C) if simple else re_conj(N, C))

    def pair(x: EvenOdd) -> Pair:
        return Pair(omega * x.odd, -x.even) if integral else Pair(x.even, omega * x.odd)

    return LoopResponse(
        C_scaled=pair(C),
        D_scaled=pair(D),
        miss_scaled=pair(miss),
        numerator=None if simple else Pair(N.even, omega * N.odd),
        scale2=omega * omega if integral else 1,
        im_C_conj_D_scaled=slope if integral else omega * slope,
        im_slope=im_slope,
        resistance=resistance,
        operator_relief=operator_relief,
    )


def _constants(at: DeviceResponse, *, scaled: bool, position: bool) -> LoopConstants:
    """Return the constants of the loop, with the factor u = j omega if `scaled`: then they are regular at omega = 0."""
    square = at.omega * at.omega

    def number(even: Number, odd: Number) -> EvenOdd:
        return EvenOdd(even, odd, square)

    def raised(x: EvenOdd) -> EvenOdd:
        """Return x times u, if the constants are."""
        return raised_once(x) if scaled else x

    AH = number(at.drive.re, -at.drive.lag)
    F_s = None if at.sensor is None else number(at.sensor.re, -at.sensor.lag)
    if at.follows:
        drive, one = Affine(AH), Affine(number(1 + 0 * at.omega, 0 * at.omega))
        miss, zero = Affine(number(1 - at.drive.re, at.drive.lag)), Affine(number(0 * at.omega, 0 * at.omega))
        return LoopConstants(drive, drive if F_s is None else drive.times(F_s), one, miss, zero, one)
    integrated = None  # A H/(j omega), times u
    if position:
        integrated = AH if scaled else number(AH.odd, -(AH.even / square))
    C_0 = told = Affine(None, raised(AH), integrated)
    lost, Z_1 = Affine(None), raised(number(at.damping, at.mass))  # C_f - C_0, and Z_1
    if at.estimate is not None:
        lost = Affine(None, C_0.velocity * number(-(square * at.estimate.loss), -at.estimate.lag))
        told = Affine(None, C_0.velocity * number(at.estimate.re, -at.estimate.lag), integrated)  # C_f
    W, D, miss, N = told.plus(Z_1), told.plus(Z_1), lost.plus(Z_1), Affine(number(1, 0 * at.omega))
    further: tuple[Affine, ...] = ()
    if at.springs:
        masses = masses_behind(at)
        handle, base = masses[-1], number(at.damping, at.mass)
        carried = [each.held + base * each.kept.plus(1) for each in masses]  # the forces by the masses alone
        alone = handle.moved + raised_once(handle.bent) * base
        if at.at_handle:  # v_h D_0 = N f_h + u without a loop, for the chain is reciprocal
            D, N, miss = told.plus(raised(carried[-1])), Affine(alone), lost.plus(raised(carried[-1]))
        else:
            D = told.times(handle.kept.plus(1)).plus(raised(carried[-1]))
            N = told.times(handle.bent if scaled else raised_once(handle.bent)).plus(alone)
            lag = _sum(handle.kept * told.velocity, lost.velocity)
            miss = Affine(raised(carried[-1]), lag, integrated and handle.kept * integrated)
        further = tuple(
            told.times(each.kept.plus(1)).plus(raised(force)) for each, force in zip(masses[:-1], carried, strict=False)
        )
    if at.factor is not None:  # the mechanism's response times x divides its impedance by x
        x, size2 = number(at.factor.re, at.factor.im / at.omega), at.factor.abs2()
        inverse = number(x.even / size2, -(x.odd / size2))
        D, miss = (replace(each, constant=inverse * each.constant) for each in (D, miss))
        N = replace(N.times(x), constant=N.constant)
    return LoopConstants(C_0, C_0 if F_s is None else C_0.times(F_s), D, miss, N, W, further)


class Moved(NamedTuple):
    """A mass behind a spring: its velocity moved + bent u W and the force held + (1 + kept) W on what follows, for a
    motor with the velocity 1 and the force W on the first spring."""

    moved: EvenOdd
    bent: EvenOdd
    held: EvenOdd
    kept: EvenOdd


def masses_behind(at: DeviceResponse) -> list[Moved]:
    """Return the masses behind the motor, from each to the next: v + y F moves the mass behind a spring of force F, and
    Z v is the force on this mass."""
    square, nothing = at.omega * at.omega, 0 * at.omega
    last, found = Moved(EvenOdd(1, nothing, square), *[EvenOdd(nothing, nothing, square)] * 3), list[Moved]()
    for spring in at.springs:
        Z = EvenOdd(0 if spring.damping is None else spring.damping, spring.mass, square)
        moved = last.moved + EvenOdd(square * spring.y_c, spring.y_k, square) * last.held
        bent = last.bent + EvenOdd(spring.y_k, -spring.y_c, square) * last.kept.plus(1)
        last = Moved(moved, bent, last.held + Z * moved, last.kept + Z * raised_once(bent))
        found.append(last)
    return found


def raised_once(x: EvenOdd) -> EvenOdd:
    """Return x times u = j omega."""
    return EvenOdd(-(x.square * x.odd), x.even, x.square)


def _lossless_miss(at: DeviceResponse) -> Affine:
    """Return (D - C_0)/(j omega) of a device without damping, load and sensor, regular at omega = 0."""
    square = at.omega * at.omega
    AH, late, F = EvenOdd(at.drive.re, -at.drive.lag, square), None, EvenOdd(1, 0, square)
    if at.estimate is not None:
        late = AH * EvenOdd(-at.estimate.lag, at.estimate.loss, square)
        F = EvenOdd(at.estimate.re, -at.estimate.lag, square)
    if not at.springs:
        return Affine(EvenOdd(at.mass, 0, square), late)
    moved, bent = EvenOdd(1, 0 * at.omega, square), EvenOdd(0 * at.omega, 0 * at.omega, square)
    carried, held = bent, bent  # kept/u^2 and held/u of `Moved`
    for spring in at.springs:
        y_u = EvenOdd(spring.y_k, -spring.y_c, square)
        moved, bent = moved + y_u * held.scaled(-square), bent + y_u * carried.scaled(-square).plus(1)
        held, carried = held + moved.scaled(spring.mass), carried + bent.scaled(spring.mass)
    whole = held + carried.scaled(-square).plus(1).scaled(at.mass)
    if at.at_handle:
        return Affine(whole, late)
    return Affine(whole, _sum(raised_once(carried) * AH * F, late), carried * AH)


def _sum(x: Any, y: Any) -> Any:
    return y if x is None else x if y is None else x + y


def G_hh_abs2(loop: LoopResponse) -> Number:
    """Return |G_hh|^2 = |N|^2/|D|^2 (paper eq. 10), (m/(N s))^2; 0 for a servo."""
    above = loop.scale2 if loop.numerator is None else loop.scale2 * loop.numerator.abs2()
    return above / loop.D_scaled.abs2()


def tracking_abs2(loop: LoopResponse) -> Number:
    """Return |1 - G_he|^2 = |(D - C_0)/D|^2, the squared relative error of the actual against the commanded
    velocity."""
    return loop.miss_scaled.abs2() / loop.D_scaled.abs2()
