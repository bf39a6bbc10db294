"""Evaluate the velocity loop of a non-ideal device at a frequency (model/README.md, sections 12 and 13)."""

from __future__ import annotations

from dataclasses import dataclass

from vctune.model.gains import Gains
from vctune.model.loop.affine import loop_constants
from vctune.model.loop.device_response import DeviceResponse, Spring
from vctune.model.loop.filters import FilterResponse
from vctune.model.loop.impedances import Impedance, LoopResponse, controller_impedance
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.pair import Pair, im_conj_product, re_conj_product


@dataclass(frozen=True, slots=True)
class _Scale:
    """The factor by which the code multiplies the loop's impedances (see `LoopResponse`)."""

    factor: Number | None  # omega with an integrator, 1 without
    omega_over_factor: Number | None  # omega divided by the factor

    def up(self, x: Number) -> Number:
        """Return x times the scale."""
        return x if self.factor is None else x * self.factor

    def across(self, x: Number) -> Number:
        """Return x times omega, divided by the scale."""
        return x if self.omega_over_factor is None else x * self.omega_over_factor


@dataclass(frozen=True, slots=True)
class _Turned:
    """Im(C conj D) times the scale, as flat + omega slope; flat is None if the number vanishes like omega."""

    flat: Number | None
    slope: Number

    def at(self, omega: Number) -> Number:
        """Return the number at a frequency."""
        return omega * self.slope if self.flat is None else self.flat + omega * self.slope

    def times(self, factor: Number) -> _Turned:
        """Return the number times a real factor."""
        return _Turned(None if self.flat is None else self.flat * factor, self.slope * factor)


@dataclass(frozen=True, slots=True)
class _Handle:
    """The effect of a spring between motor and handle on the loop."""

    D: Pair  # D and D - C_0, scaled
    miss: Pair
    turned: _Turned  # Im(C_0 conj D), scaled
    numerator: Pair  # N
    im_numerator: Number  # Im N / omega
    resistance: Number  # Re(N conj D)


def loop_with_parts(at: DeviceResponse, gains: Gains, ops: Arithmetic) -> LoopResponse:
    """Evaluate the velocity loop of a device that is not ideal (model/README.md, section 12)."""
    omega, integral = at.omega, not ops.is_zero(gains.position)
    scale = _Scale(omega, None) if integral else _Scale(None, omega)
    C_0 = controller_impedance(at, gains, at.drive.re, at.drive.lag, integral=integral)
    Z_1 = Pair(scale.up(at.damping), scale.up(at.mass * omega))
    C_f, miss = C_0, Z_1
    if at.estimate is not None:
        C_f, miss = _estimated(at, gains, at.estimate, Z_1, scale, integral=integral)
    W = Impedance(at.damping + C_f.re, Z_1 + C_f.scaled)
    turned, D, resistance = _turned(at, gains, C_0, scale, ops), W.scaled, W.re
    numerator, im_numerator = None, 0
    if at.spring is not None:
        handle = _on_spring(at.spring, omega, scale, C_0, W, miss, turned)
        D, miss, turned, resistance = handle.D, handle.miss, handle.turned, handle.resistance
        numerator, im_numerator = handle.numerator, handle.im_numerator
    C = C_0
    if at.sensor is not None:
        kept, late = at.sensor.re, at.sensor.lag * re_conj_product(C_0.scaled, D)
        turned = turned.times(kept)
        if integral:
            turned = _Turned(-late if turned.flat is None else turned.flat - late, turned.slope)
        else:
            turned = _Turned(turned.flat, turned.slope - late)
        re = C_0.re * kept + at.sensor.lag * scale.across(C_0.scaled.im)
        C = Impedance(re, Pair(kept, -(omega * at.sensor.lag)) * C_0.scaled)
    operator_relief = None
    if at.operator is not None:
        met, size2 = C.re, 1
        if numerator is not None:
            met, size2 = met * numerator.re + im_numerator * scale.across(C.scaled.im), numerator.abs2()
        resistance, operator_relief = resistance + at.operator * size2, 2 * at.operator * met
    return LoopResponse(
        C_scaled=C.scaled,
        D_scaled=D,
        miss_scaled=miss,
        numerator=numerator,
        scale2=1 if scale.factor is None else omega * omega,
        im_C_conj_D_scaled=turned.at(omega),
        im_slope=turned.slope if turned.flat is None else None,
        resistance=resistance,
        operator_relief=operator_relief,
    )


def perturbed_loop(at: DeviceResponse, x: Pair, gains: Gains) -> LoopResponse:
    """Return the loop of a device whose mechanism's response is multiplied by x, at omega > 0."""
    known, inverse = loop_constants(at), Pair(x.re, -x.im).scaled(1 / x.abs2())
    idle, numerator = known.D.constant, known.numerator.constant
    assert idle is not None and numerator is not None
    if at.spring is not None:
        numerator = numerator + x * known.numerator.driven(gains)
    moved = inverse * idle
    C, D, miss = known.C.closed(gains), moved + known.D.driven(gains), moved + known.miss.driven(gains)
    told = known.controller.closed(gains)
    # Im(F_s C_0 conj(C_0 + miss)): |C_0|^2 is real, so its term contains only the imaginary part of F_s
    im = im_conj_product(C, miss)
    if at.sensor is not None:
        im = im - at.omega * at.sensor.lag * told.abs2()
    resistance, operator_relief = re_conj_product(numerator, D), None
    if at.operator is not None:
        resistance = resistance + at.operator * numerator.abs2()
        operator_relief = 2 * at.operator * re_conj_product(C, numerator)
    return LoopResponse(
        C_scaled=C,
        D_scaled=D,
        miss_scaled=miss,
        numerator=None if at.spring is None else numerator,
        scale2=1,
        im_C_conj_D_scaled=im,
        im_slope=None,
        resistance=resistance,
        operator_relief=operator_relief,
    )


def _estimated(
    at: DeviceResponse, gains: Gains, F: FilterResponse, Z_1: Pair, scale: _Scale, *, integral: bool
) -> tuple[Impedance, Pair]:
    """Return C_f and Z_1 + C_f - C_0 = Z_1 - K_v A H (1 - F), both scaled."""
    omega, drive = at.omega, at.drive
    omega2 = omega * omega
    re, lag = drive.re * F.re - omega2 * (drive.lag * F.lag), drive.lag * F.re + drive.re * F.lag
    C_f = controller_impedance(at, gains, re, lag, integral=integral)
    lost = Pair(
        omega2 * (drive.re * F.loss + drive.lag * F.lag),
        omega * (drive.re * F.lag - omega2 * (drive.lag * F.loss)),
    ).scaled(-gains.velocity)
    return C_f, Z_1 + Pair(scale.up(lost.re), scale.up(lost.im))


def _turned(at: DeviceResponse, gains: Gains, C_0: Impedance, scale: _Scale, ops: Arithmetic) -> _Turned:
    """Return Im(C_0 conj W), scaled."""
    integral = scale.factor is not None
    slope = -(at.mass * C_0.re)
    if at.estimate is not None:
        lost, lagging = gains.velocity * at.estimate.lag, at.omega * at.drive.lag
        if integral:
            lost = lost + gains.position * at.estimate.loss
        slope = slope + gains.velocity * (at.drive.re * at.drive.re + lagging * lagging) * lost
    if not integral:
        return _Turned(None, slope - at.damping * (gains.velocity * at.drive.lag))
    return _Turned(None if ops.is_zero(at.damping) else at.damping * C_0.scaled.im, scale.up(slope))


def _on_spring(
    spring: Spring, omega: Number, scale: _Scale, C_0: Impedance, W: Impedance, miss: Pair, turned: _Turned
) -> _Handle:
    """Add the handle on its spring to the motor's part W."""
    flexed = Pair(omega * spring.y_c, spring.y_k)  # y/omega
    numerator = Pair(scale.across(flexed.re), scale.across(flexed.im)) * W.scaled
    numerator = Pair(1 + numerator.re, numerator.im)
    Z_2 = Pair(0 if spring.damping is None else spring.damping, omega * spring.mass)
    scaled_Z_2 = Pair(scale.up(Z_2.re), scale.up(Z_2.im))
    y_Z_2, met = Pair(omega * flexed.re, omega * flexed.im) * Z_2, re_conj_product(C_0.scaled, W.scaled)
    bent = turned.times(1 + y_Z_2.re)
    slope = bent.slope - scale.up(spring.mass * C_0.re) - scale.across(met * (flexed.re * spring.mass))
    flat, resistance = bent.flat, W.re + spring.y_c * scale.across(scale.across(W.scaled.abs2()))
    if spring.damping is not None:
        pulled = spring.damping * (C_0.scaled.im - scale.across(met * spring.y_k))
        flat = pulled if flat is None else flat + pulled
        resistance = resistance + spring.damping * numerator.abs2()
    return _Handle(
        D=W.scaled + scaled_Z_2 * numerator,
        miss=miss + scaled_Z_2 + y_Z_2 * W.scaled,
        turned=_Turned(flat, slope),
        numerator=numerator,
        im_numerator=scale.across(spring.y_c * W.scaled.im) + spring.y_k * W.re,
        resistance=resistance,
    )
