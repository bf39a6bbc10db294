"""Prove Llewellyn's conditions on the band, for any passive hand, and the handle's passivity with nothing behind it."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import inf, nextafter

import numpy as np

from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import coupling_impedance
from vctune.model.loop.device_response import device_response
from vctune.model.loop.llewellyn import llewellyn_excess, moduli, passive_alone, required_resistance
from vctune.model.loop.loop import LoopResponse, loop_constants, loop_response
from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.pair import re_conj_product
from vctune.proof.box_tests import beside_zero, positive, sufficient
from vctune.proof.boxes import Boxes
from vctune.proof.claims.cases import Case, exact_case
from vctune.proof.claims.claim import Claim, Outcomes, Question
from vctune.proof.claims.covered import Covered, Held, held, negative, of_design, outcome_of
from vctune.proof.enclosures.intervals import Enclosure, Flags, surely_negative
from vctune.proof.halving import Effort
from vctune.proof.outcome import Outcome, Verdict

TRIES = 400  # Number of frequencies, each a fourth of the last, tried where the proof fails at the band's low end


def conditions_margin(case: Case, omega: Number) -> Number:
    """Return 2 r (Re Z_c - factor R) at omega > 0, where r is the loop's resistance (model/README.md, section 4), or,
    with nothing behind the coupling, the margin of the handle's passivity with Z_c / factor."""
    loop, offered = _loop(case, omega), coupling_impedance(case.design.series, omega)
    if case.demands.alone:
        held, driven = passive_alone(loop, offered)
        return held + case.factor * driven
    return 2 * loop.resistance * offered.re - case.factor * llewellyn_excess(loop, case.ops)


def clamped_margin(case: Case, omega: Number) -> Number:
    """Return |N|^2 - r^2 |N - N_0|^2 at omega > 0. Where it is positive, N is not 0 for any response within the
    disc."""
    numerator = loop_constants(device_response(case.design.device.modelled, omega, case.ops)).numerator
    N, driven = numerator.closed(case.design.gains).abs2(), numerator.driven(case.design.gains)
    radius = case.radius(omega)
    return N if driven is None else N - radius * radius * driven.abs2()


def low_margin(case: Case, omega: Number) -> Number:
    """Return a margin that is regular at omega = 0. Where it is positive, `conditions_margin` is positive
    (proof/README.md, section 5)."""
    device, coupling, factor, ops = case.design.device, case.design.series, case.factor, case.ops
    loop = _loop(case, omega)
    weight = moduli(loop, ops) + re_conj_product(loop.C_scaled, loop.D_scaled)
    im = loop.im_C_conj_D_scaled
    if device.operator is not None and not ops.is_zero(device.operator.damping):
        eased = 2 * loop.resistance * coupling.drag + factor * loop.operator_relief
        return eased * weight - factor * (im * im)
    if not ops.is_zero(coupling.drag):
        return 2 * loop.resistance * coupling.drag * weight - factor * (im * im)
    if loop.im_slope is None:
        return -weight
    b_c, m_c, reactance = coupling.damping, coupling.mass, coupling.mass * omega
    slope = b_c * (m_c * m_c) / (b_c * b_c + reactance * reactance)
    return 2 * loop.resistance * slope * weight - factor * (loop.im_slope * loop.im_slope)


def high_margin(case: Case, v: Number) -> Number:
    """Return `conditions_margin` at omega = 1/v, for an ideal device with hold "lag" and no delay
    (model/README.md, section 6)."""
    device, gains, coupling, factor = case.design.device, case.design.gains, case.design.series, case.factor
    assert device.ideal, "beyond Nyquist only an ideal device has a model"
    half = device.sample_time / 2
    decay = 1 / (v * v + half * half)
    re_C_over_v = (gains.velocity - gains.position * half) * decay * v
    omega_im_C = -((gains.velocity * half + gains.position * (v * v)) * decay)
    re_C = re_C_over_v * v
    re_D = device.damping + re_C
    im_D_v, re_D_v = device.mass + omega_im_C * (v * v), re_D * v
    product = (re_C_over_v * re_C_over_v + omega_im_C * omega_im_C) * (re_D_v * re_D_v + im_D_v * im_D_v)
    excess = case.ops.sqrt(product) - (re_C * re_D + omega_im_C * im_D_v)
    re_Z_c = coupling.drag
    if not coupling.rigid:
        mass2, damping_v = coupling.mass * coupling.mass, coupling.damping * v
        re_Z_c = re_Z_c + coupling.damping * mass2 / (damping_v * damping_v + mass2)
    if device.operator is None:
        return 2 * re_D * re_Z_c - factor * excess
    b_h = device.operator.damping
    return 2 * (re_D + b_h) * re_Z_c + factor * (2 * b_h * re_C - excess)


def resistance_apart(device: Device) -> bool:
    """Return whether the loop's resistance needs a proof of its own, besides `conditions_margin`."""
    return device.operator is not None and not device.ideal


def resistance_margin(case: Case, omega: Number) -> Number:
    """Return the loop's resistance in the hand of the least operator; without an operator it is |D|^2 Re G_hh."""
    return _loop(case, omega).resistance


def required_margin(case: Case, omega: Number) -> Number:
    """Return the least feasible Re Z_c, N s/m, where the loop's resistance is positive."""
    return required_resistance(_loop(case, omega), case.ops)


def _loop(case: Case, omega: Number) -> LoopResponse:
    return loop_response(device_response(case.design.device, omega, case.ops), case.design.gains, case.ops)


def outwards(band: tuple[float, float]) -> tuple[float, float]:
    """Return a band in rad/s, each edge moved outwards by four floats, more than the rounding error of 2 pi f."""
    low, high = band
    for _ in range(4):
        low, high = nextafter(low, 0.0), nextafter(high, inf)
    return low, high


def inwards(band: tuple[float, float]) -> tuple[float, float]:
    """Return a band in rad/s that lies within the intended band for any rounding of 2 pi f."""
    low, high = band
    for _ in range(4):
        low, high = nextafter(low, inf), nextafter(high, 0.0)
    return low, high


def conditions(covered: Covered, low: float, high: float) -> Held:
    """Prove Re G_hh > 0 and Re Z_c >= factor R on a band, in the hand of the least operator."""
    effort, beyond = covered.effort(), max(1 / covered.demands.device.sample_time, low)
    found = _conditions(covered, covered.over(low, beyond if high == inf else high), effort)
    if high == inf:  # as a function of 1/omega
        test = positive(covered.margin(high_margin), covered.fixed)
        above = held(covered, effort, [(test, covered.over(0.0, 1 / beyond))])
        above.point[0] = 1 / np.maximum(above.point[0], 1e-300)
        point = np.where(found.proved, above.point, found.point)
        found = Held(found.proved & above.proved, point, found.boxes + above.boxes)
    return found


def _conditions(covered: Covered, band: Boxes, effort: Effort) -> Held:
    """Prove the conditions on the boxes of a band."""
    fixed, near_zero = covered.fixed, sufficient(covered.margin(low_margin), covered.fixed)
    asked = []
    if covered.box is not None and covered.box.nominal.unmodelled is not None:
        asked += [lambda case, omega: 1 - case.radius(omega), clamped_margin]
    if resistance_apart(covered.demands.device):
        asked.append(resistance_margin)
    parts = [(beside_zero(near_zero, positive(covered.margin(conditions_margin), fixed)), band)]
    parts += [(positive(covered.margin(margin), fixed), band) for margin in asked]
    return held(covered, effort, parts)


def _prove(question: Question, _known: Outcomes) -> Outcome:
    """Prove Llewellyn's conditions on the band for every device of the box."""
    design, demands, box = question.design, question.demands, question.covered
    low, high = outwards(demands.band)
    if not design.gains.closed and (box is None or box.nominal.unmodelled is None):
        return _without_loop(design, demands, low)
    covered = of_design(design, demands, box)
    failure = partial(_conditions_fail, design, demands)
    return outcome_of(covered, conditions(covered, low, high), failure)


def _without_loop(design: Design, demands: Demands, low: float) -> Outcome:
    """Return the outcome of the conditions without feedback, where R = 0: the damping must be positive, and Re Z_c if
    environments are behind it."""
    coupling = design.series
    resistive = demands.alone or coupling.drag > 0 or (0 < coupling.damping < inf and coupling.mass > 0)
    holds = design.device.least_damping > 0 and resistive
    return Outcome(Verdict.PROVED, 1) if holds else Outcome(Verdict.UNDECIDED, 1, low)


def _conditions_fail(design: Design, demands: Demands, device: Device, omega: float) -> float | None:
    """Return where the conditions certainly fail: at a frequency or towards an endless end of the band; else None."""
    there = exact_case(replace(design, device=device), demands)

    def fails(omega: float) -> bool:
        if surely_negative(conditions_margin(there, Enclosure(omega))):
            return True
        return resistance_apart(device) and surely_negative(resistance_margin(there, Enclosure(omega)))

    (low, high), tried = demands.band, [omega]
    if low == 0 and omega < 1 / device.sample_time:
        tried += [min(high, 1.0) * 0.25**k for k in range(TRIES)]
    if high == inf and omega > 1 / device.sample_time:
        tried += [max(low, 1.0) * 4.0**k for k in range(TRIES)]
    return next((each for each in tried if each > 0 and fails(each)), None)


def _holds(cells: Covered) -> Flags:
    return conditions(cells, *outwards(cells.demands.band)).proved


PASSIVE = Claim(
    id="passive",
    sentence="Re G_hh > 0 and Re Z_c >= safety_factor R on the band",
    quantity="ratio",
    margin=conditions_margin,
    witness="a frequency of the stability band",
    label="any passive hand, on the band",
    explain=(
        "Llewellyn's conditions hold in the frequency model, which has no aliasing. At every frequency of the "
        "stability band the device is stable in any passive hand with every passive environment. If "
        "`operator.mass.min` or `operator.damping.min` is above 0, every hand must contain them: the proof "
        "counts on them. Outside the band such a hand can make it oscillate."
    ),
    when='for an admittance display with the criterion "passive" or "both", unless `[environment]` is nothing',
    asked=lambda demands, _: demands.passive and not demands.alone,
    prove=_prove,
    cells=_holds,
    lost=negative(conditions_margin, resistance_margin),
    required=required_margin,
)


ALONE = Claim(
    id="alone",
    sentence="Re G_hh > 0, and the handle passive with nothing behind Z_c / safety_factor, on the band",
    quantity="ratio",
    margin=conditions_margin,
    witness="a frequency of the stability band",
    label="any passive hand with nothing behind, on the band",
    explain=(
        "The impedance that a hand meets has a positive real part at every frequency of the stability band, in "
        "the frequency model, which has no aliasing: no passive hand can make the free handle oscillate there. "
        "With a proportional velocity loop the least mass is near K_v m/(K_v + b)."
    ),
    when='for an admittance display with the criterion "passive" or "both", if `[environment]` is nothing',
    asked=lambda demands, _: demands.alone,
    prove=_prove,
)
