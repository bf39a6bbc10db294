"""Gains for which no coupling damping b_c will do: what different frequencies ask of it excludes each other.

Re Z_c - b_0 = b M^2/(b^2 + M^2) with M = omega m_c is at least r for b between M (M -+ sqrt(M^2 - 4 r^2))/(2 r), and
for none where r > M/2. It grows with m_c and with b_0: their greatest values decide.
"""

from __future__ import annotations

import numpy as np

from vctune.proof.array_claims import Demands, claims_of
from vctune.proof.array_intervals import Flags, Floats
from vctune.proof.boxes import Cells
from vctune.proof.many_designs import by_integrator, lower_bound_at

GUARD = 1e-14
"""Covers the rounding of what a cell asks of b_c, relative: 90 units of u = 2^-53.

factor R - b_0 may cancel: the product is off by u factor R, and the raised b_0 and the lowered difference together give
away `GUARD` (b_0 + (factor R - b_0)), 90 times as much. M - 2 r is exact where it cancels (Sterbenz 1974), the rest is
a dozen operations on positive numbers; `ROUNDING_OF_BOUNDS` covers them 1e5 times. Half and twice it decide alike.
"""
ROUNDING_OF_BOUNDS = 1e-9
"""By how much more than rounding two demands on b_c have to exclude each other. Half and twice it decide alike, but
where the interval between them is as narrow."""


def admissible_damping(resistance: Floats, reactance: Floats) -> tuple[Floats, Floats]:
    """Return the least and the greatest b_c with b M^2/(b^2 + M^2) >= r; (inf, 0) where there is none.

    Parameters
    ----------
    resistance : r, N s/m; where it is not positive every b_c will do
    reactance : M = omega m_c, N s/m
    """
    r, M = np.maximum(resistance, 0.0), reactance
    root = np.sqrt(np.maximum((M - 2 * r) * (M + 2 * r), 0.0))
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        least, most = 2 * r * M / (M + root), M * (M + root) / (2 * r)
    none = 2 * r > M
    return np.where(none, np.inf, least), np.where(none, 0.0, np.where(r > 0, most, np.inf))


def no_damping(demands: Demands, cells: Cells, omega: Floats) -> Flags:
    """Return the cells in which no b_c between the cell's own edges meets Llewellyn's conditions.

    Parameters
    ----------
    demands : what is to be met
    cells : as for `prove`; all of the b_c's edges count, and the upper ones of m_c and b_0
    omega : rad/s, frequencies of the band, shape (any number, number of cells)
    """
    least, most = cells.low[2].copy(), cells.high[2].copy()
    heaviest = cells.high[3] * (1 + GUARD)
    claims = claims_of(demands)
    for at in by_integrator(cells):
        part = cells.subset(at)
        for frequency in omega:
            bound = np.nan_to_num(lower_bound_at(claims.required, part, frequency[at]), nan=0.0)
            needed = (demands.factor * bound - part.high[4] * (1 + GUARD)) * (1 - GUARD)
            low, high = admissible_damping(needed, heaviest[at] * frequency[at])
            least[at], most[at] = np.maximum(least[at], low), np.minimum(most[at], high)
    return least * (1 - ROUNDING_OF_BOUNDS) > most * (1 + ROUNDING_OF_BOUNDS)
