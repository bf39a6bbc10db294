"""Llewellyn's absolute stability as a demand on the coupling (DESIGN 1.4 and 1.5, paper eqs. 12 and 19)."""

from __future__ import annotations

from vctune.model.arithmetic import Arithmetic, Number
from vctune.model.loop import LoopResponse
from vctune.model.pair import Pair, re_conj_product


def modulus_excess(loop: LoopResponse, ops: Arithmetic) -> Number:
    """Return (|q| - Re q) |D|^2 = |C||D| - Re(C conj D), (N s/m)^2, without cancellation.

    With P = Re(C conj D) and Q = Im(C conj D) = Im(C conj Z_d) it is Q^2/(|C||D| + P) wherever P > 0 (DESIGN 1.5).
    """
    product = ops.sqrt(loop.C.abs2() * loop.D.abs2())
    P = re_conj_product(loop.C, loop.D)
    return ops.where_positive(
        P,
        lambda: loop.turn * loop.turn / (product + P),
        lambda: (product - P) / loop.scale2,
    )


def required_resistance(loop: LoopResponse, ops: Arithmetic) -> Number:
    """Return R = (|q| - Re q)/(2 Re G_hh), the least admissible Re Z_c, N s/m (DESIGN 1.4).

    Negative where Re G_hh < 0: no coupling is admissible there.
    """
    return modulus_excess(loop, ops) / (2 * loop.re_D)


def rollett_factor(loop: LoopResponse, Z_c: Pair, ops: Arithmetic) -> Number:
    """Return Rollett's K = (2 Re p11 Re p22 - Re p12 p21)/|p12 p21|, at least 1 where ratio is (DESIGN 1.4).

    With p12 p21 = -q and everything times |D|^2.
    """
    product = ops.sqrt(loop.C.abs2() * loop.D.abs2()) / loop.scale2
    return (2 * loop.re_D * Z_c.re + re_conj_product(loop.C, loop.D) / loop.scale2) / product
