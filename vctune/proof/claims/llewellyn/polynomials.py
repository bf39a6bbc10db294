"""Llewellyn's conditions for hold "lag" without delay, as polynomials with rational coefficients."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from fractions import Fraction
from itertools import pairwise
from math import inf, isinf, nextafter

from flint import arb, fmpq, fmpq_poly

from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.loop.device_response import DeviceResponse, DriveResponse
from vctune.model.loop.loop import loop_response
from vctune.model.numbers.pair import re_conj_product
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.enclosures.arb_balls import BALLS
from vctune.proof.engine.interval import Outcome, Verdict


@dataclass(frozen=True, slots=True)
class Conditions:
    """The conditions as polynomials in omega. A condition holds where its polynomial is positive."""

    linear: fmpq_poly  # A, the left-hand side of the condition
    squared: fmpq_poly  # A^2 - factor^2 B
    roots: list[arb]  # frequencies where `squared` changes its sign or touches 0, rad/s, > 0, in ascending order

    def met(self, omega: float) -> bool:
        """Return whether the conditions hold strictly at a frequency, rad/s."""
        point = _rational(omega)
        return bool(self.squared(point) > 0 and self.linear(point) > 0)


def is_rational(device: Device) -> bool:
    """Return whether a device's conditions are polynomials: whether it is ideal, with hold "lag" and no delay."""
    return device.ideal and device.hold == "lag" and device.delay == 0


def conditions(design: Design, factor: float) -> Conditions:
    """Return Llewellyn's conditions as polynomials in omega, with rational coefficients."""
    # omega is the polynomial "omega", so the model's own formulas return the polynomials of the conditions
    omega, f = fmpq_poly([0, 1]), _rational(factor)
    device = design.device.converted(_rational)
    half = device.sample_time / 2
    clearing = 1 + half * half * omega * omega
    cleared = device.converted(lambda x: x * clearing)
    gains = Gains(_rational(design.gains.velocity), _rational(design.gains.position))
    operator = None if cleared.operator is None else cleared.operator.damping
    drive = DriveResponse(fmpq_poly([1]), half)
    loop = loop_response(DeviceResponse(omega, cleared.mass, cleared.damping, drive, operator=operator), gains, BALLS)
    above, below = _coupling_resistance(design.series, omega)
    eased = re_conj_product(loop.C_scaled, loop.D_scaled)
    eased = eased if loop.operator_relief is None else eased + loop.operator_relief * loop.scale2
    linear = 2 * loop.resistance * clearing * loop.scale2 * above + f * below * eased
    squared = linear * linear - f * f * below * below * loop.C_scaled.abs2() * loop.D_scaled.abs2()
    roots = [root.real for root, _ in squared.complex_roots() if root.imag == 0 and root.real > 0]
    return Conditions(linear, squared, sorted(roots, key=lambda root: float(root.mid())))


def _coupling_resistance(coupling: Coupling, omega: fmpq_poly) -> tuple[fmpq_poly, fmpq_poly]:
    """Return the numerator and the denominator of Re Z_c as polynomials in omega."""
    if coupling.rigid:
        return fmpq_poly([_rational(coupling.drag)]), fmpq_poly([1])
    b_c, m_c, b_0 = map(_rational, astuple(coupling))
    reactance2 = m_c * m_c * omega * omega
    below = b_c * b_c + reactance2
    return b_0 * below + b_c * reactance2, below


def prove(conditions: Conditions, low: float, high: float) -> Outcome:
    """Prove the conditions on (low, high) exactly."""
    inside = [root for root in conditions.roots if not (root < low or root > high)]
    edges = [low, *(float(root.mid()) for root in inside), high]
    for left, right in pairwise(edges):
        between = _between(left, right)
        if not conditions.met(between):
            return Outcome(Verdict.REFUTED, len(edges) - 1, between)
    touching = Verdict.UNDECIDED if inside else Verdict.PROVED
    return Outcome(touching, len(edges) - 1, edges[1] if inside else None)


def widest(conditions: Conditions, low: float, high: float) -> tuple[float, float]:
    """Return the widest band around a proved band on which the conditions hold."""
    below = [nextafter(float(root.upper()), inf) for root in conditions.roots if root < low]
    above = [nextafter(float(root.lower()), 0.0) for root in conditions.roots if root > high]
    return max(below, default=0.0), min(above, default=inf)


def _between(low: float, high: float) -> float:
    if isinf(high):
        return 2 * low if low > 0 else 1.0
    return (low + high) / 2


def _rational(decimal: float) -> fmpq:
    value = Fraction(repr(float(decimal)))
    return fmpq(value.numerator, value.denominator)
