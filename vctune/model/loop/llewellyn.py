"""State absolute stability (Llewellyn) as a constraint on the coupling (model/README.md, sections 4 and 5; paper eqs.
12, 19).

The conditions apply to an admittance display, not to a servo, whose `resistance` is 0.

Let G_hh = N/D and q = C/D (`vctune.model.loop.loop`). With an operator that always contains Z_h, absolute stability
requires

    Re Z_c >= R = (|C||D| - Re(C conj D) - 2 Re Z_h Re(C conj N))/(2 (Re(N conj D) + Re Z_h |N|^2)).

For Z_h = 0 this is condition 3 of model/README.md, section 4. The operator's mass does not appear, because the hand may
have any additional reactance. See model/README.md, section 9.
"""

from __future__ import annotations

from vctune.model.loop.impedances import LoopResponse
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.pair import Pair, re_conj_product


def moduli(loop: LoopResponse, ops: Arithmetic) -> Number:
    """Return |C||D|, the first term of `llewellyn_demand`.

    Parameters
    ----------
    loop : the velocity loop at some frequencies
    ops : arithmetic of its numbers

    Returns
    -------
    Number
        (N s/m)^2 times `scale2`, because both factors contain the scale. The result has the shape of the loop's
        frequencies.
    """
    C, D = loop.C_scaled, loop.D_scaled
    return ops.modulus(C.re, C.im) * ops.modulus(D.re, D.im)


def modulus_excess(loop: LoopResponse, ops: Arithmetic) -> Number:
    """Return (|q| - Re q) |D|^2 = |C||D| - Re(C conj D), (N s/m)^2, without cancellation.

    With P = Re(C conj D) and Q = Im(C conj D), the result is Q^2/(|C||D| + P) wherever P > 0.

    Parameters
    ----------
    loop : the velocity loop at some frequencies
    ops : arithmetic of its numbers

    Returns
    -------
    Number
        Not scaled. The result has the shape of the loop's frequencies.
    """
    product = moduli(loop, ops)
    P = re_conj_product(loop.C_scaled, loop.D_scaled)
    return ops.where_positive(
        P,
        lambda: loop.im_C_conj_D_scaled * loop.im_C_conj_D_scaled / (product + P),
        lambda: (product - P) / loop.scale2,
    )


def llewellyn_demand(loop: LoopResponse, ops: Arithmetic) -> Number:
    """Return 2 (Re(N conj D) + Re Z_h |N|^2) R, (N s/m)^2. Without an operator it equals `modulus_excess`.

    Parameters
    ----------
    loop : the velocity loop at some frequencies
    ops : arithmetic of its numbers

    Returns
    -------
    Number
        Not scaled. The result has the shape of the loop's frequencies.
    """
    excess = modulus_excess(loop, ops)
    return excess if loop.operator_relief is None else excess - loop.operator_relief


def required_resistance(loop: LoopResponse, ops: Arithmetic) -> Number:
    """Return R, the least feasible Re Z_c (model/README.md, section 4).

    Without an operator R = (|q| - Re q)/(2 Re G_hh). No coupling is feasible where the loop's resistance is negative.
    Where the resistance is positive and R <= 0, every passive coupling is feasible.

    Parameters
    ----------
    loop : the velocity loop at some frequencies
    ops : arithmetic of its numbers

    Returns
    -------
    Number
        N s/m. It has the shape of the loop's frequencies; where the resistance is 0, the function divides by 0.
    """
    return llewellyn_demand(loop, ops) / (2 * loop.resistance)


def rollett_factor(loop: LoopResponse, Z_c: Pair, ops: Arithmetic) -> Number:
    """Return Rollett's stability factor K = (2 Re p11 Re p22 - Re p12 p21)/|p12 p21| (model/README.md, section 4).

    The two-port includes the least operator and Z_c. The function multiplies numerator and denominator by |D + Z_h
    N|^2. If the loop's resistance is positive, K >= 1 exactly where Re Z_c >= R.

    Parameters
    ----------
    loop : the velocity loop at some frequencies
    Z_c : the coupling's impedance at the same frequencies, N s/m
    ops : arithmetic of loop and Z_c

    Returns
    -------
    Number
        Dimensionless. It has the shape of the loop's frequencies.
    """
    product = moduli(loop, ops) / loop.scale2
    excess = 2 * loop.resistance * Z_c.re + re_conj_product(loop.C_scaled, loop.D_scaled) / loop.scale2
    return (excess if loop.operator_relief is None else excess + loop.operator_relief) / product
