"""Compute the distance of a design from the ideal G_hh = 0, G_he = 1, Z_c = 0 (model/README.md, section 8, paper eq.
21)."""

from __future__ import annotations

from functools import cache
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vctune.model.display import Display
from vctune.model.fields import Key, NotNegative, record
from vctune.model.loop.device_response import DeviceResponse
from vctune.model.loop.loop import Affine, G_hh_abs2, LoopConstants, LoopResponse, tracking_abs2
from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.pair import Pair

PANEL_NODES = 8  # Number of Gauss-Legendre nodes on a panel; the rule is exact for polynomials of degree 15


@record
class Terms:
    """Weights of the three terms of the error; a weight of 0 removes the term."""

    # A program also states the terms themselves, or their squares, in this form

    admittance: Annotated[NotNegative, Key("Weight of Z_0 |G_hh|, or of |1/G_hh|/Z_0 for an impedance display.")] = 1.0
    tracking: Annotated[NotNegative, Key("Weight of |1 - G_he|, or of |1 - A H/N| for an impedance display.")] = 1.0
    coupling: Annotated[NotNegative, Key("Weight of |Z_c|/Z_0, or of Z_0 |1/Z_c| for an impedance display.")] = 1.0


TermName = Literal["admittance", "tracking", "coupling"]
TERMS: tuple[TermName, ...] = ("admittance", "tracking", "coupling")


class LoopTerms(NamedTuple):
    """The squares of the two terms that do not contain the coupling, |G_hh| and |1 - G_he|, with Z_0 = 1."""

    admittance: Number
    tracking: Number


def loop_terms(loop: LoopResponse, at: DeviceResponse, kind: Display) -> LoopTerms:
    """Return the squares of the error's two terms that depend on the loop alone."""
    if not kind.inverse:
        return LoopTerms(G_hh_abs2(loop), tracking_abs2(loop))
    N = loop.numerator or Pair(1, 0)
    missed = Pair(N.re - at.drive.re, N.im + at.omega * at.drive.lag)
    return LoopTerms(1 / G_hh_abs2(loop), missed.abs2() / N.abs2())


class Quotient(NamedTuple):
    """A quotient of two numbers that are affine in the gains."""

    above: Affine
    below: Affine


def quotient_terms(at: LoopConstants, kind: Display) -> tuple[Quotient, Quotient]:
    """Return the quotients whose squared moduli are the two terms of `loop_terms`."""
    if not kind.inverse:
        return Quotient(at.numerator, at.D), Quotient(at.miss, at.D)
    N, D, drive = (Affine(each.constant, each.velocity, None) for each in (at.numerator, at.D, at.controller))
    assert N.constant is not None and drive.velocity is not None
    missed = Affine(N.constant + drive.velocity.scaled(-1), N.velocity, None)
    return Quotient(D, N), Quotient(missed, N)


def squared_terms(of_loop: LoopTerms, coupling: Pair, reference: float) -> Terms:
    """Return the squares of the error's three dimensionless terms (model/README.md, section 8)."""
    square = reference**2
    return Terms(of_loop.admittance * square, of_loop.tracking, coupling.abs2() / square)


@cache
def _panel() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the Gauss-Legendre nodes and weights on [-1, 1], from the eigenvalues of the Jacobi matrix."""
    k = np.arange(1.0, PANEL_NODES)
    nodes, vectors = np.linalg.eigh(np.diag(k / np.sqrt(4 * k * k - 1), -1))
    return nodes, 2 * vectors[0] ** 2


def log_quadrature(omega_min: float, omega_max: float, panels: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the nodes and weights of an average over log frequency, 1/ln(w2/w1) * integral dw/w."""
    nodes, weights = _panel()
    starts = np.arange(panels)[:, None]
    position = ((starts + (nodes + 1) / 2) / panels).ravel()
    return omega_min * (omega_max / omega_min) ** position, np.tile(weights / (2 * panels), panels)
