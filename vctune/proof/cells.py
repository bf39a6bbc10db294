"""Prove the claims of a certificate throughout many cells of designs at once, or that no design of a cell meets them
(proof/README.md, section 8)."""

from __future__ import annotations

from itertools import product

import numpy as np

from vctune.model.demands import Demands
from vctune.model.hands import PlacesInHands
from vctune.model.worlds import PlacesInWorlds
from vctune.proof.box_tests import Margin, lower_bound_over
from vctune.proof.boxes import Cells, Integers, over_each
from vctune.proof.claims.cases import over
from vctune.proof.claims.claim import ClaimId
from vctune.proof.claims.covered import of_cells
from vctune.proof.claims.registry import claims_asked
from vctune.proof.enclosures.intervals import Flags, Floats

GUARD = 1e-14  # Bound on the relative rounding error of a cell's requirement on b_c: 90 u with u = 2^-53
ROUNDING_OF_BOUNDS = 1e-9  # Rounding allowance: two intervals of b_c must be this far apart to exclude each other


# For each claim, places of n cells where it seems hardest to meet, each of shape (n,), the most critical first
Places = dict[ClaimId, list[Floats | PlacesInHands | PlacesInWorlds]]


def proved_cells(demands: Demands, cells: Cells) -> Flags:
    """Return the cells throughout which all claims are proved (proof/README.md, section 8), each only where the claims
    before it are."""
    asked, proved = claims_asked(demands), np.zeros(len(cells), bool)
    for at in by_integrator(cells):
        covered, left = of_cells(demands, cells.subset(at)), np.arange(len(at))
        for claim in asked:
            left = left[claim.cells(covered.subset(left))] if claim.cells is not None and len(left) else left[:0]
        proved[at[left]] = True
    return proved


def by_integrator(cells: Cells) -> list[Integers]:
    """Return the indices of the cells with K_p > 0, and of the cells with K_p = 0, where the law has no integrator."""
    # row 1 is K_p in `KEYS` and in `SPRING_KEYS`
    parts = np.flatnonzero(cells.high[1] > 0), np.flatnonzero(cells.high[1] == 0)
    return [at for at in parts if len(at)]


def refuted(demands: Demands, cells: Cells, places: Places) -> Flags:
    """Return the cells in which no design meets all claims."""
    fails = np.zeros(len(cells), bool)
    for at, claim in product(by_integrator(cells), claims_asked(demands)):
        left = at[~fails[at]]
        if claim.lost is not None and len(left):
            there = places[claim.id][0][left] if claim.id in places else None
            fails[left] = claim.lost(of_cells(demands, cells.subset(left)), there)
    return fails


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
    asked, rate = list[tuple[Margin, Floats | PlacesInHands, Floats]](), 2 / demands.device.sample_time
    for claim in claims_asked(demands):
        if claim.required is not None:
            required = over(claim.required, demands)
            for place in places[claim.id]:
                assert not isinstance(place, PlacesInWorlds)
                omega = rate * np.tan(place.at / 2) if isinstance(place, PlacesInHands) else place
                asked.append((required, place, omega))
    for among in by_integrator(cells):
        part = cells.subset(among)
        for required, at, omega in asked:
            bound = np.nan_to_num(lower_bound_over(required, over_each(part, at[among]), {}), nan=0.0)
            needed = (demands.factor * bound - part.high[4] * (1 + GUARD)) * (1 - GUARD)
            low, high = admissible_damping(needed, heaviest[among] * omega[among])
            least[among], most[among] = np.maximum(least[among], low), np.minimum(most[among], high)
    return least * (1 - ROUNDING_OF_BOUNDS) > most * (1 + ROUNDING_OF_BOUNDS)
