"""Find gains for which no coupling damping b_c works: the intervals required at different frequencies are disjoint."""

from __future__ import annotations

import numpy as np

from vctune.model.hand_arrays import PlacesInHands
from vctune.model.problem import Demands
from vctune.proof.boxes import Cells
from vctune.proof.claims.array_claims import claims_of
from vctune.proof.claims.encirclements import by_integrator
from vctune.proof.claims.many_designs import Places, lower_bound_at
from vctune.proof.enclosures.intervals import Flags, Floats
from vctune.proof.prover import Margin

GUARD = 1e-14  # Bound on the relative rounding error of a cell's requirement on b_c: 90 u with u = 2^-53
ROUNDING_OF_BOUNDS = 1e-9  # Rounding allowance: two intervals of b_c must be this far apart to exclude each other


def admissible_damping(resistance: Floats, reactance: Floats) -> tuple[Floats, Floats]:
    """Return the least and the greatest coupling damping b with b M^2/(b^2 + M^2) >= r."""
    r, M = np.maximum(resistance, 0.0), reactance
    root = np.sqrt(np.maximum((M - 2 * r) * (M + 2 * r), 0.0))
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        least, most = 2 * r * M / (M + root), M * (M + root) / (2 * r)
    none = 2 * r > M
    return np.where(none, np.inf, np.where(r > 0, least, 0.0)), np.where(none, 0.0, np.where(r > 0, most, np.inf))


def no_damping(demands: Demands, cells: Cells, places: Places) -> Flags:
    """Return the cells in which no b_c between the cell's edges meets the constraints on Re Z_c."""
    # rows in the order of `KEYS`: 2 is b_c, 3 is m_c, 4 is b_0
    least, most = cells.low[2].copy(), cells.high[2].copy()
    heaviest = cells.high[3] * (1 + GUARD)
    claims, asked = claims_of(demands), list[tuple[Margin, Floats | PlacesInHands, Floats]]()
    if places.omega is not None:
        asked += [(claims.required, omega, omega) for omega in places.omega]
    if places.in_hands is not None:
        rate = 2 / demands.device.sample_time
        each = (places.in_hands[k] for k in range(places.in_hands.at.shape[0]))
        asked += [(claims.required_in_hands, place, rate * np.tan(place.at / 2)) for place in each]
    for among in by_integrator(cells):
        part = cells.subset(among)
        for required, at, omega in asked:
            bound = np.nan_to_num(lower_bound_at(required, part, at[..., among]), nan=0.0)
            needed = (demands.factor * bound - part.high[4] * (1 + GUARD)) * (1 - GUARD)
            low, high = admissible_damping(needed, heaviest[among] * omega[among])
            least[among], most[among] = np.maximum(least[among], low), np.minimum(most[among], high)
    return least * (1 - ROUNDING_OF_BOUNDS) > most * (1 + ROUNDING_OF_BOUNDS)
