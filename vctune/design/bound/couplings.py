"""Couplings of a box of designs: the least elements that offer a resistance, and their least share in the error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, log

import numpy as np

from vctune.design.bound.quadratics import B_0, GUARD, TAU_C, Quotient, concatenated, quadratic
from vctune.model.device import Device
from vctune.model.problem import Problem, Range
from vctune.model.sampled.impedance_display import spring_forms
from vctune.proof.boxes import Cells
from vctune.proof.enclosures.intervals import ENCLOSURES, Enclosure, Flags, Floats, decimal, stacked


@dataclass(frozen=True, slots=True)
class LeastCoupling:
    """Lower bounds on the elements of the couplings in each box, as arrays of shape (boxes,)."""

    first: Floats  # the least b_c and m_c; for an impedance display the least 1/k_c and 1/b_c
    second: Floats
    none: Flags  # flags of the boxes whose conditions permit no coupling


@dataclass(frozen=True, slots=True)
class SeriesCouplings:
    """The couplings of an admittance display, b_0 + b_c x j/(1 + x j) with x = omega tau_c."""

    problem: Problem  # problem in SI units
    omega: Floats | None  # frequencies of the error, rad/s; None for the mean over the band

    @property
    def ranges(self) -> tuple[Range, Range]:
        """Bounds of b_c, N s/m, and of m_c, kg."""
        return self.problem.bounds.damping, self.problem.bounds.mass

    @staticmethod
    def ratio(boxes: Cells) -> tuple[Floats, Floats]:
        """Return the least and the greatest tau_c, the ratio of the second element to the first."""
        return boxes.low[TAU_C], boxes.high[TAU_C]

    def felt(self, least: LeastCoupling, boxes: Cells) -> Floats:
        """Return a lower bound of the weighted |Z_c|^2 = b_0^2 + 2 b_0 b_c s + b_c^2 s, or of its mean over the
        band."""
        b_c, m_c, b_0 = (each[:, None] for each in (least.first, least.second, boxes.low[B_0]))
        shortest, longest = (edge[TAU_C][:, None] for edge in (boxes.low, boxes.high))
        light, heavy = self._transmitted(shortest), self._transmitted(longest)
        coupled = 2 * b_0 * b_c * light + np.fmax(np.square(b_c) * light, np.square(m_c / longest) * heavy)
        wanted = self.problem.transparency
        return np.asarray((wanted.weights.coupling / wanted.reference_impedance) ** 2 * (b_0 * b_0 + coupled))

    def _transmitted(self, tau_c: Floats) -> Floats:
        """Return x^2/(1 + x^2), which is |Z_c/b_c|^2 and Re Z_c/b_c without drag, or its mean over log frequency."""
        if self.omega is not None:
            x2 = np.square(self.omega * tau_c)
            return np.asarray(x2 / (1 + x2))
        low, high = self.problem.transparency.band.min, self.problem.transparency.band.max
        rise = (high - low) * (high + low) * np.square(tau_c) / (1 + np.square(low * tau_c))
        return np.asarray(np.log1p(rise) / (2 * log(high / low)) * (1 - GUARD * high / (high - low)))


@dataclass(frozen=True, slots=True)
class SpringDampers:
    """The couplings of an impedance display, b_c F in parallel with k_c T/(1 - z^-1)."""

    problem: Problem  # problem in SI units
    compliance: Quotient  # weighted |1/Z_c|^2 as a function of b_c and k_c
    devices: int | None  # number of devices, whose intervals follow one another; None if `compliance` is at frequencies

    @property
    def ranges(self) -> tuple[Range, Range]:
        """Bounds of 1/k_c, m/N, and of 1/b_c, m/(N s)."""
        bounds = self.problem.bounds
        ends = ((1 / end if end > 0 else inf for end in (of.max, of.min)) for of in (bounds.stiffness, bounds.damping))
        stiffness, damping = (Range(*each) for each in ends)
        return stiffness, damping

    @staticmethod
    def ratio(boxes: Cells) -> tuple[Floats, Floats]:
        """Return the least and the greatest k_c/b_c; inf if b_c is 0."""
        with np.errstate(divide="ignore"):
            return 1 / boxes.high[TAU_C], 1 / boxes.low[TAU_C]

    def felt(self, least: LeastCoupling, boxes: Cells) -> Floats:
        """Return a lower bound of the weighted |1/Z_c|^2."""
        k_c, b_c = 1 / least.first, 1 / least.second
        most = np.stack((b_c, np.fmin(k_c, b_c / boxes.low[TAU_C]))) * (1 + 4 * GUARD)
        found = self.compliance.of_bounds(Cells(0 * most, most))
        return found if self.devices is None else found.reshape(len(boxes), self.devices, -1).sum(axis=2)


@dataclass(frozen=True, slots=True)
class SeriesOffer:
    """The resistance Re Z_c at omega. In the sampled loop omega is (2/T) tan(theta/2)."""

    omega: Floats  # frequencies, rad/s

    def least_elements(self, boxes: Cells) -> tuple[Floats, Floats]:
        """Return the least b_c = 1 + 1/x^2, at the greatest tau_c, and the least m_c = tau_c + 1/(omega^2 tau_c), for a
        resistance of 1 without drag."""
        shortest, longest = (edge[TAU_C][:, None] for edge in (boxes.low, boxes.high))
        nearest = np.clip(1 / self.omega, shortest, longest)
        return 1 + 1 / np.square(self.omega * longest), nearest + 1 / (np.square(self.omega) * nearest)


@dataclass(frozen=True, slots=True)
class SpringOffer:
    """Re(1/Z_c)/s^2 of spring-dampers at some angles theta, with s = sin(theta/2) and tau = b_c/k_c."""

    stiff: Quotient  # the 1/k_c and the 1/b_c for which Re(1/Z_c)/s^2 = 1, as functions of boxes of tau
    damped: Quotient
    best_time_constant: Floats  # tau with the least 1/k_c, s, shape (places,)

    def least_elements(self, boxes: Cells) -> tuple[Floats, Floats]:
        """Return the least 1/k_c and 1/b_c for which Re(1/Z_c)/s^2 = 1; inf if Re(1/Z_c)/s^2 is positive nowhere in the
        box."""
        low, high = boxes.low[TAU_C], boxes.high[TAU_C]
        of_tau = Cells(np.stack((low, 0 * low)), np.stack((high, 0 * high)))
        nearest = np.clip(self.best_time_constant, low[:, None], high[:, None])
        offered = self.stiff.below.greatest(of_tau) > 0
        stiff = self.stiff.least(of_tau, (nearest, 0 * nearest))
        damped = self.damped.least(of_tau, (high[:, None] + 0 * nearest, 0 * nearest))
        return np.where(offered, stiff, inf), np.where(offered, damped, inf)


Couplings = SeriesCouplings | SpringDampers
Offer = SeriesOffer | SpringOffer


def elements_for(required: Floats, offer: Offer, boxes: Cells) -> tuple[Floats, Floats]:
    """Return the least first and second element with which couplings can have a required resistance, at each place."""
    needed = np.maximum(required - boxes.high[B_0][:, None], 0.0)
    first, second = (np.where(needed > 0, needed * each, 0.0) for each in offer.least_elements(boxes))
    return first, second


def offer_of(devices: Sequence[Device], angles: Sequence[Floats]) -> Offer:
    """Return the resistance of the couplings in the sampled loop, at angles of several devices."""
    pairs = list(zip(devices, angles, strict=True))
    if not devices[0].kind.inverse:
        return SeriesOffer(np.concatenate([np.tan(theta / 2) * (2 / device.sample_time) for device, theta in pairs]))
    each = []
    for device, theta in pairs:
        (a_1, a_0), (b_2, b_1, b_0) = spring_forms(device.converted(decimal), Enclosure(theta), ENCLOSURES)
        above, stiff, damped = [b_0, b_1, 0, b_2, 0, 0], [a_0, a_1, 0, 0, 0, 0], [0, a_0, 0, a_1, 0, 0]
        each.append(stacked([*above, *stiff, *damped]))
    of = concatenated(each)
    mid = of.mid
    with np.errstate(all="ignore"):  # the slope of the quotient is 0 where c_2 tau^2 + 2 c_1 tau - c_0 = 0
        c_0, c_1, c_2 = mid[7] * mid[0] - mid[6] * mid[1], mid[6] * mid[3], mid[7] * mid[3]
        root = c_1 + np.sqrt(np.maximum(c_1 * c_1 + c_2 * c_0, 0.0))
        best = np.where(c_0 > 0, c_0 / root, 0.0)
    needed, stiffness, damping = (quadratic(of[k : k + 6]) for k in (0, 6, 12))
    return SpringOffer(Quotient(needed, stiffness), Quotient(needed, damping), best)
