"""Prove the claims of a certificate throughout many cells of designs at once, or that no design of a cell meets them
(proof/README.md, section 8)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from vctune.model.gains import Gains
from vctune.model.hands import Hands, PlacesInHands
from vctune.model.problem import Demands
from vctune.proof.boxes import Cells, Integers, over_each
from vctune.proof.claims.array_claims import claims_of
from vctune.proof.claims.cells_in_hands import hold_in_hands
from vctune.proof.claims.envelope import envelope
from vctune.proof.claims.loop_claims import (
    CELL,
    Covered,
    Turns,
    conditions,
    hand_turns,
    held,
    model_turns,
    of_cells,
    sampled_turns,
    sensitivity,
)
from vctune.proof.claims.margins_of_claims import outwards
from vctune.proof.claims.registry import ClaimId, claims_asked
from vctune.proof.enclosures.intervals import Flags, Floats
from vctune.proof.prover import Margin, lower_bound_over, positive, prove

# Identifiers of the claims that this module can prove for cells
OF_CELLS: tuple[ClaimId, ...] = (
    "passive", "sensitivity", "stable_model", "stable", "any_hand", "hands", "wall_in_any_hand"
)  # fmt: skip
GUARD = 1e-14  # Bound on the relative rounding error of a cell's requirement on b_c: 90 u with u = 2^-53
ROUNDING_OF_BOUNDS = 1e-9  # Rounding allowance: two intervals of b_c must be this far apart to exclude each other


def proved_cells(demands: Demands, cells: Cells) -> Flags:
    """Return the cells throughout which all constraints are proved (proof/README.md, section 8)."""
    proved = np.zeros(len(cells), bool)
    known = set(claims_asked(demands)) <= set(OF_CELLS) and demands.worlds is None
    for at in by_integrator(cells) if known else ():
        proved[at] = _proved(demands, of_cells(demands, cells.subset(at)))
    return proved


def by_integrator(cells: Cells) -> list[Integers]:
    """Return the indices of the cells with K_p > 0, and of the cells with K_p = 0, where the law has no integrator."""
    # row 1 is K_p in `KEYS` and in `SPRING_KEYS`
    parts = np.flatnonzero(cells.high[1] > 0), np.flatnonzero(cells.high[1] == 0)
    return [at for at in parts if len(at)]


def _proved(demands: Demands, cells: Covered) -> Flags:
    """Prove one claim after another, each for the cells in which all earlier claims are proved."""
    steps: list[Callable[[Covered], Flags]] = []
    if demands.passive:
        steps.append(lambda part: conditions(part, *outwards(demands.band)).proved)
    if demands.device.kind.own_loop:
        steps += [lambda part: sensitivity(part).proved, _stable]
    if demands.any_hand:
        steps.append(_hold_before_wall if demands.rigid else _hold_in_any_hand)
    if demands.hands is not None:
        steps.append(_hold_in_hands)
    if demands.factor > 1 and demands.device.coupling_may_drive:
        less = replace(demands, factor=1.0)
        steps.append(lambda part: _proved(less, replace(part, demands=less)))
    left = np.arange(cells.owners)
    for step in steps:
        left = left[step(cells.subset(left))] if len(left) else left
    proved = np.zeros(cells.owners, bool)
    proved[left] = True
    return proved


def _stable(cells: Covered) -> Flags:
    """Return the cells in which the sampled loops and, for passive hands, the frequency models are stable."""
    return np.all([found.number == 0 for found in pole_turns(cells)], axis=0)


def pole_turns(cells: Covered, *, in_hand: bool = False) -> list[Turns]:
    """Count the unstable poles of each loop and model that must be stable, and with `in_hand` those in a hand."""
    counted = (model_turns, sampled_turns) if cells.demands.passive else (sampled_turns,)
    found = [count(loop) for loop in cells.loops() for count in counted]
    return [*found, hand_turns(cells)] if in_hand and cells.demands.hands is not None else found


def _hold_in_any_hand(cells: Covered) -> Flags:
    """Prove the constraint for any passive hand on an impedance display."""
    if cells.demands.device.least_damping == 0:
        return np.zeros(cells.owners, bool)
    margin, size = (positive(each, {}) for each in cells.claims.any_hand)
    if _have_the_same_gains(cells):  # equal gains have equal `size`
        one = cells.subset(np.zeros(1, np.intp))
        return held(one, CELL, [(size, one.around_circle())]).proved & _above_envelope(cells, None)
    around = cells.around_circle()
    return held(cells, cells.effort(), [(size, around), (margin, around)]).proved


def _hold_before_wall(cells: Covered) -> Flags:
    """Prove the couplings as walls in any passive hand."""
    if cells.demands.device.least_damping == 0:
        return np.zeros(cells.owners, bool)
    return held(cells, cells.effort(), [(positive(cells.claims.before_wall, {}), cells.around_circle())]).proved


def _hold_in_hands(cells: Covered) -> Flags:
    """Prove the constraint in every hand."""
    demands, proved = cells.demands, np.zeros(cells.owners, bool)
    left = np.flatnonzero(hand_turns(cells.centres()).number == 0)
    part = cells.subset(left)
    same = _have_the_same_gains(cells)
    proved[left] = _above_envelope(part, demands.hands) if same else hold_in_hands(demands, Cells(part.low, part.high))
    return proved


def _have_the_same_gains(cells: Covered) -> bool:
    """Return whether all cells have the same gains and differ only in the coupling."""
    # rows 0 and 1 are the gains
    return cells.extended and not np.ptp((cells.low[:2], cells.high[:2]), axis=(0, 2)).any()


def _above_envelope(cells: Covered, hands: Hands | None) -> Flags:
    """Return the cells whose coupling exceeds a bound of R in all hands. The bound is proved once for all cells."""
    required = envelope(cells.demands.device, hands, Gains(*map(float, cells.low[:2, 0])))
    boxes = required.over(Cells(cells.low, cells.high))
    halved = (True, False, False, *[True] * len(cells.names))
    test = positive(cells.claims.above_bound, {})
    return prove(test, boxes, cells.owners, CELL, halved=halved, only_whole=True).proved


@dataclass(frozen=True, slots=True)
class Places:
    """The places where a constraint may fail throughout a cell, for n cells; None for constraints that the problem does
    not have."""

    theta_S: Floats  # angles omega T for |S|, rad, shape (n,)
    omega: Floats | None = None  # frequencies in the band of Llewellyn's conditions, rad/s, shape (any number, n)
    theta: Floats | None = None  # angles for any passive hand on an impedance display, rad, shape (any number, n)
    in_hands: PlacesInHands | None = None  # angles, each with a hand, shape (any number, n); the most critical first

    def subset(self, at: Integers) -> Places:
        """Return the places of some of the cells."""
        omega, theta = (None if of is None else of[:, at] for of in (self.omega, self.theta))
        return Places(self.theta_S[at], omega, theta, None if self.in_hands is None else self.in_hands[:, at])


def refuted(demands: Demands, cells: Cells, places: Places) -> Flags:
    """Return the cells in which no design meets all constraints."""
    fails = np.zeros(len(cells), bool)
    for at in by_integrator(cells):
        claims, part, there = claims_of(demands), cells.subset(at), places.subset(at)
        asked: list[tuple[Margin, Floats | PlacesInHands]] = [(claims.sensitivity, there.theta_S)]
        if there.omega is not None:
            asked += [(claims.conditions, there.omega[0]), (claims.resistance, there.omega[0])]
        if there.theta is not None:
            asked.append((claims.before_wall if demands.rigid else claims.any_hand[0], there.theta[0]))
        if there.in_hands is not None:
            asked.append((claims.in_hand, there.in_hands[0]))
        lost = np.any([negative_at(margin, part, place) for margin, place in asked], axis=0)
        left = np.flatnonzero(~lost)
        found = pole_turns(of_cells(demands, part.subset(left)), in_hand=True)
        lost[left] = np.any([np.isfinite(each.number) & (each.number != 0) for each in found], axis=0)
        fails[at] = lost
    return fails


def negative_at(margin: Margin, cells: Cells, at: Floats | PlacesInHands) -> Flags:
    """Return the cells throughout which a margin is negative. Each cell has its own place."""
    return np.asarray(lower_bound_at(lambda omega, values: -margin(omega, values), cells, at) > 0)


def lower_bound_at(margin: Margin, cells: Cells, at: Floats | PlacesInHands) -> Floats:
    """Return a lower bound of a margin over each cell. Each cell has its own place."""
    return lower_bound_over(margin, over_each(cells, at), {})


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
