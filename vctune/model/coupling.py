"""The virtual coupling's impedance Z_c = b_0 + b_c m_c s/(b_c + m_c s) (model/README.md, section 3, paper eq. 17)."""

from __future__ import annotations

from vctune.model.arithmetic import Number
from vctune.model.pair import Pair
from vctune.model.quantities import Coupling


def coupling_impedance(coupling: Coupling, omega: Number) -> Pair:
    """Return Z_c(j omega), N s/m. A coupling without damping or without mass is its drag alone.

    Parameters
    ----------
    coupling : b_c, m_c and b_0, in numbers of the arithmetic
    omega : rad/s, > 0, or >= 0 if b_c > 0

    Returns
    -------
    Pair
        Of the shape of omega.
    """
    b_c, m_c = coupling.damping, coupling.mass
    reactance = m_c * omega
    quotient = reactance / (b_c * b_c + reactance * reactance)
    return Pair(coupling.drag + b_c * reactance * quotient, b_c * b_c * quotient)
