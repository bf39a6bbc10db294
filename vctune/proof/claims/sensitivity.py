"""Prove |S| of the sampled velocity loop below its limit, and the loop stable for every response in a disc around the
modelled one."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

from vctune.model.device import Device
from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.pair import im_conj_product
from vctune.model.numbers.units import KEYS
from vctune.model.sampled.velocity_loop import ReturnDifference, difference_slope, return_difference
from vctune.proof.box_tests import beside_zero, positive, sufficient
from vctune.proof.claims.cases import Case, exact_case, over
from vctune.proof.claims.claim import Claim, Outcomes, Question
from vctune.proof.claims.covered import DESIGN, Covered, Held, held, in_rad_per_s, negative, of_design, outcome_of
from vctune.proof.enclosures.intervals import Enclosure, surely_negative
from vctune.proof.outcome import Outcome, Verdict


def sensitivity_margin(case: Case, theta: Number) -> Number:
    """Return limit^2 |F|^2 - |F_0|^2 of the sampled loop. It is positive where |S| = |F_0/F| < limit."""
    parts, limit = difference(case, theta), case.max_sensitivity
    return limit * limit * parts.closed(case.design.gains).abs2() - parts.open.abs2()


def sensitivity_sufficient_margin(case: Case, theta: Number) -> Number:
    """Return (limit Im(F conj P) - |F_0||P|)/theta. Where it is positive, |S| < limit for all K_p."""
    across, product2 = across_position(case, theta)
    return case.max_sensitivity * across - case.ops.sqrt(product2)


def unmodelled_margin(case: Case, theta: Number) -> Number:
    """Return |F|^2 - r^2 |F - F_0|^2. It is positive where |1 - S| r < 1 (model/README.md, section 13)."""
    parts, gains = difference(case, theta), case.design.gains
    radius = case.radius(theta / case.design.device.sample_time)
    loop = parts.velocity.scaled(gains.velocity) + parts.position.scaled(gains.position)
    return (parts.open + loop).abs2() - radius * radius * loop.abs2()


def across_position(case: Case, theta: Number) -> tuple[Number, Number]:
    """Return Im(F conj P)/theta and |F_0|^2 |P|^2/theta^2 with P = dF/dK_p. Neither depends on K_p."""
    plant, ops = case.let_go(), case.ops
    velocity_loop = return_difference(plant, theta, ops, position=False)
    P, slope = return_difference(plant, theta, ops, position=True).position, difference_slope(theta, ops)
    F = velocity_loop.closed(case.design.gains) * slope
    return im_conj_product(F, P), (velocity_loop.open * slope).abs2() * P.abs2()


def difference(case: Case, theta: Number) -> ReturnDifference:
    position = not case.ops.is_zero(case.design.gains.position)
    return return_difference(case.let_go(), theta, case.ops, position=position)


def sensitivity(covered: Covered) -> Held:
    """Prove |S| < max_sensitivity of the sampled loop at every frequency."""

    def one_of(case: Case, theta: Number) -> tuple[Number, Number]:
        return sensitivity_margin(case, theta), sensitivity_sufficient_margin(case, theta)

    test = positive(covered.margin(sensitivity_margin), covered.fixed)
    if KEYS[1] in covered.names:
        test = beside_zero(sufficient(covered.margin(one_of), covered.fixed), test)
    return held(covered, covered.effort(), [(test, covered.around_circle())])


def _prove(question: Question, _known: Outcomes) -> Outcome:
    """Prove |S| < max_sensitivity of the sampled loop for every device of the box."""
    design, demands, _ = question.modelled
    covered = of_design(*question.modelled)

    def failure(device: Device, theta: float) -> float | None:
        there = exact_case(replace(design, device=device), demands)
        return theta if surely_negative(sensitivity_margin(there, Enclosure(theta))) else None

    return in_rad_per_s(outcome_of(covered, sensitivity(covered), failure), design.device)


def _prove_unmodelled(question: Question, known: Outcomes) -> Outcome:
    """Prove |1 - S| r < 1 of the sampled loop for every device, where r is the radius of the unmodelled dynamics."""
    design, box, demands = question.design, question.box, question.demands
    assert box is not None and box.nominal.unmodelled is not None
    radii, bounded = box.nominal.unmodelled.radii, known[SENSITIVITY.id].verdict is Verdict.PROVED
    greatest, limit = (Fraction(str(x)) for x in (max(radius for _, radius in radii), demands.max_sensitivity))
    if bounded and greatest * (1 + limit) < 1:
        return Outcome(Verdict.PROVED, 1)
    covered, with_disc = of_design(design, demands, box.modelled), replace(demands, device=box.nominal)

    def failure(device: Device, theta: float) -> float | None:
        there = exact_case(replace(design, device=device), with_disc)
        return theta if surely_negative(unmodelled_margin(there, Enclosure(theta))) else None

    margin = over(unmodelled_margin, with_disc, box.modelled.uncertain)
    found = held(covered, DESIGN, [(positive(margin, covered.fixed), covered.around_circle())])
    return in_rad_per_s(outcome_of(covered, found, failure), design.device)


SENSITIVITY = Claim(
    id="sensitivity",
    sentence="|S| <= max_sensitivity of the sampled loop up to Nyquist",
    quantity="sensitivity",
    margin=sensitivity_margin,
    witness="a frequency up to Nyquist",
    label="sensitivity of the velocity loop",
    explain=(
        "The Nyquist curve of the velocity loop stays at least 1/max_sensitivity away from -1. If the loop "
        "changes by less than this distance, the device remains stable when nobody holds it."
    ),
    when="for every device but a servo, whose coupling is not a wall",
    asked=lambda demands, _: demands.device.kind.own_loop and not demands.rigid,
    prove=_prove,
    cells=lambda cells: sensitivity(cells).proved,
    lost=negative(sensitivity_margin),
)


UNMODELLED = Claim(
    id="unmodelled",
    sentence="|1 - S| r < 1 of the sampled loop up to Nyquist, r the radius of the unmodelled dynamics",
    quantity="unmodelled",
    margin=unmodelled_margin,
    witness="a frequency up to Nyquist",
    label="unmodelled dynamics",
    explain=(
        "By the small-gain theorem, no sampled response of the mechanism within the radius of "
        "`uncertainty.unmodelled` around the modelled one makes the velocity loop unstable."
    ),
    when="for every device but a servo, if the file states `uncertainty.unmodelled`",
    asked=lambda demands, box: box is not None and box.nominal.unmodelled is not None and demands.device.kind.own_loop,
    prove=_prove_unmodelled,
)
