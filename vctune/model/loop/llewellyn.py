"""State absolute stability (Llewellyn) as a constraint on the coupling (model/README.md, sections 4 and 5; paper eqs.
12, 19)."""

from __future__ import annotations

from vctune.model.loop.loop import LoopResponse
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.pair import Pair, im_conj_product, re_conj_product


def moduli(loop: LoopResponse, ops: Arithmetic) -> Number:
    """Return |C||D|, the first term of `llewellyn_demand`."""
    C, D = loop.C_scaled, loop.D_scaled
    return ops.modulus(C.re, C.im) * ops.modulus(D.re, D.im)


def modulus_excess(loop: LoopResponse, ops: Arithmetic) -> Number:
    """Return (|q| - Re q) |D|^2 = |C||D| - Re(C conj D), (N s/m)^2, without cancellation."""
    product = moduli(loop, ops)
    P = re_conj_product(loop.C_scaled, loop.D_scaled)
    return ops.where_positive(
        P,
        lambda: loop.im_C_conj_D_scaled * loop.im_C_conj_D_scaled / (product + P),
        lambda: (product - P) / loop.scale2,
    )


def llewellyn_excess(loop: LoopResponse, ops: Arithmetic) -> Number:
    """Return 2 (Re(N conj D) + Re Z_h |N|^2) R, (N s/m)^2. Without an operator it equals `modulus_excess`."""
    excess = modulus_excess(loop, ops)
    return excess if loop.operator_relief is None else excess - loop.operator_relief


def required_resistance(loop: LoopResponse, ops: Arithmetic) -> Number:
    """Return R, the least feasible Re Z_c (model/README.md, section 4)."""
    return llewellyn_excess(loop, ops) / (2 * loop.resistance)


def passive_alone(loop: LoopResponse, Z_c: Pair) -> tuple[Number, Number]:
    """Return |Z_c|^2 r and Re(Z_c D conj C) times the loop's scale^2. Their sum is positive where the handle is passive
    with nothing behind the coupling (model/README.md, section 18)."""
    C, D = loop.C_scaled, loop.D_scaled
    driven = Z_c.re * re_conj_product(C, D) + Z_c.im * im_conj_product(C, D)
    return Z_c.abs2() * loop.resistance * loop.scale2, driven
