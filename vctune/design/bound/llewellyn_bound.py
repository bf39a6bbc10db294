"""Bound Llewellyn's conditions at some frequencies over boxes of gains (design/bound/README.md, section 1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vctune.design.bound.couplings import SeriesOffer, elements_for
from vctune.design.bound.design_boxes import DesignBoxes
from vctune.design.bound.quadratic_coefficients import Coefficients, loop_at, mapped, quadratic, repeated
from vctune.design.bound.quadratics import GUARD, Quadratic, lower, upper
from vctune.model.device import Device
from vctune.model.loop.device_response import device_response
from vctune.model.loop.loop import LoopConstants
from vctune.model.numbers.pair import im_conj_product, re_conj_product
from vctune.proof.enclosures.intervals import ENCLOSURES, Enclosure, Flags, Floats, decimal


@dataclass(frozen=True, slots=True)
class LlewellynConditions:
    """Llewellyn's conditions at some frequencies of several devices, one device after another."""

    offer: SeriesOffer  # resistance of the couplings at these frequencies
    D2: Quadratic  # |D|^2, |C|^2, Re(C conj D) and the loop's resistance, rounded up
    C2: Quadratic
    P: Quadratic
    resistance: Quadratic
    operator_relief: Quadratic | None  # 2 b_h Re(C conj N), rounded up; None without an operator
    D2_low: Quadratic  # |D|^2 and |C|^2, rounded down
    C2_low: Quadratic
    im_low: Quadratic  # Im(C conj D), rounded down and rounded up
    im_high: Quadratic

    def least_elements(self, boxes: DesignBoxes, factor: float) -> tuple[Floats, Floats, Flags]:
        """Return the least elements of the coupling at each frequency, and the boxes that permit no coupling."""
        R, none = self.least_required(boxes)
        return *elements_for(factor * R, self.offer, boxes), none

    def least_required(self, boxes: DesignBoxes) -> tuple[Floats, Flags]:
        """Return a lower bound of R, at least 0, shape (boxes, frequencies), and the boxes that permit no coupling."""
        im = np.maximum(np.maximum(self.im_low.least(boxes), -self.im_high.greatest(boxes)), 0.0) * (1 - GUARD)
        resistance, P = self.resistance.greatest(boxes), self.P.greatest(boxes)
        weight = np.sqrt(self.C2.greatest(boxes) * self.D2.greatest(boxes)) * (1 + GUARD) + P
        least = np.maximum(self.C2_low.least(boxes), 0.0) * np.maximum(self.D2_low.least(boxes), 0.0)
        excess = np.fmax(np.where(im > 0, im * im / weight, 0.0), np.sqrt(least) * (1 - GUARD) - P)
        if self.operator_relief is not None:
            relief = self.operator_relief.greatest(boxes)
            excess = excess - relief - GUARD * np.abs(relief)
        R = excess / (2 * resistance) * (1 - 10 * GUARD)
        return np.fmax(R, 0.0), np.asarray((resistance <= 0).any(axis=1))


def llewellyn_conditions(devices: Sequence[Device], omega: Floats) -> LlewellynConditions:
    """Return Llewellyn's conditions at some frequencies, for each of several devices (model/README.md, section 4)."""
    return _conditions(repeated(devices, len(omega)), np.tile(omega, len(devices)))


def _conditions(device: Device, omega: Floats) -> LlewellynConditions:
    at, crossed = loop_at(device, omega), device.velocity is not None
    C2, D2 = (quadratic(re_conj_product, part, part, crossed=crossed) for part in (at.C, at.D))
    im = quadratic(im_conj_product, at.C, at.D, crossed=crossed)
    if device.ideal:  # C conj C is real, so the square terms are only rounding errors
        im = im[0], im[1], None, None
    return LlewellynConditions(
        SeriesOffer(omega),
        upper(D2),
        upper(C2),
        upper(quadratic(re_conj_product, at.C, at.D, crossed=crossed)),
        upper(_resistance(device, at, omega, crossed=crossed)),
        _relief(device, at, crossed=crossed),
        lower(D2),
        lower(C2),
        lower(im),
        upper(im),
    )


def _resistance(device: Device, at: LoopConstants, omega: Floats, *, crossed: bool) -> Coefficients:
    """Return the coefficients of the loop's resistance, Re W + Re y |W|^2 + b_h |N|^2."""
    W, exact = at.motor, device.converted(decimal)
    assert W.constant is not None and W.velocity is not None and W.position is not None
    constant, square, cross = 0 * Enclosure(omega) + W.constant.re, None, None
    linear = W.velocity.re, W.position.re
    spring = device_response(exact.bare, Enclosure(omega), ENCLOSURES).spring
    added = [] if spring is None else [(Enclosure(omega) * Enclosure(omega) * spring.y_c, W)]
    if exact.operator is not None:
        if spring is None:
            constant = constant + exact.operator.damping
        else:
            added.append((exact.operator.damping, at.numerator))
    for factor, part in added:
        more, linears, squares, crosses = quadratic(re_conj_product, part, part, crossed=crossed)
        assert linears is not None and squares is not None
        constant, linear = constant + factor * more, (linear[0] + factor * linears[0], linear[1] + factor * linears[1])
        more_square = factor * squares[0], factor * squares[1]
        square = more_square if square is None else (square[0] + more_square[0], square[1] + more_square[1])
        if crosses is not None:
            cross = factor * crosses if cross is None else cross + factor * crosses
    return constant, linear, square, cross


def _relief(device: Device, at: LoopConstants, *, crossed: bool) -> Quadratic | None:
    """Return 2 b_h Re(C conj N), rounded up; None without an operator."""
    if device.operator is None:
        return None
    b_h = decimal(device.operator.damping)
    relief = quadratic(re_conj_product, at.C, at.numerator, crossed=crossed)
    return upper(mapped(relief, lambda x: b_h * x), 2)
