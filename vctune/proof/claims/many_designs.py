"""Prove the claims of a certificate for many cells at once on arrays. Arb decides the cells that stay open. See
proof/README.md, section 8."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

import numpy as np

from vctune.model.gains import Gains
from vctune.model.hand_arrays import PlacesInHands
from vctune.model.hands import Hands
from vctune.model.problem import Demands
from vctune.proof.boxes import Cells, Integers, over_each
from vctune.proof.claims.array_claims import Claims, claims_of
from vctune.proof.claims.cells_in_hands import hold_in_hands
from vctune.proof.claims.encirclements import by_integrator, encirclements, encirclements_in_hand, turns_in_hand
from vctune.proof.claims.envelope import envelope
from vctune.proof.claims.margins_of_claims import HALF_TURN, outwards, resistance_apart
from vctune.proof.claims.registry import ClaimId, claims_asked
from vctune.proof.enclosures.intervals import Flags, Floats
from vctune.proof.engine.bands import CELL_HALVINGS, MAX_BOXES, cells_over_band
from vctune.proof.prover import Margin, lower_bound_over, positive
from vctune.proof.prover import prove as prove_boxes

# Identifiers of the claims for which `Certified.boxes` counts boxes, in the order of the counts
ON_ARRAYS: tuple[ClaimId, ...] = "passive", "sensitivity", "stable_model", "stable"
# Identifiers of the claims that this module can prove for cells
OF_CELLS: tuple[ClaimId, ...] = *ON_ARRAYS, "any_hand", "hands"


@dataclass(frozen=True, slots=True)
class Certified:
    """The verdicts on many cells."""

    proved: Flags  # whether every design in the cell meets all constraints, shape (n,)
    boxes: Integers  # number of boxes for each claim of `ON_ARRAYS`, shape (4, n)


def prove(demands: Demands, cells: Cells) -> Certified:
    """Prove all constraints throughout each cell (proof/README.md, section 8)."""
    proofs = Certified(np.zeros(len(cells), bool), np.zeros((4, len(cells)), np.intp))
    known = set(claims_asked(demands)) <= set(OF_CELLS) and demands.worlds is None
    for at in by_integrator(cells) if known else ():
        part = _proofs(demands, cells.subset(at))
        proofs.proved[at], proofs.boxes[:, at] = part.proved, part.boxes
    return proofs


def _proofs(demands: Demands, cells: Cells) -> Certified:
    """Prove one claim after another, each for the cells in which all earlier claims are proved."""
    claims = claims_of(demands)

    def conditions_hold(cells: Cells) -> tuple[Flags, Integers]:
        low, high = outwards(demands.band)
        beyond = max(1 / demands.device.sample_time, low)
        test = positive(claims.conditions, {}, claims.conditions_near_zero if low == 0 else None)
        finite = beyond if high == inf else high
        found = cells_over_band(test, cells, low, finite)
        if resistance_apart(demands.device):
            apart = cells_over_band(positive(claims.resistance, {}), cells, low, finite)
            return found.proved & apart.proved, found.boxes + apart.boxes
        if high < inf:
            return found.proved, found.boxes
        above = cells_over_band(positive(claims.conditions_near_infinity, {}), cells, 0.0, 1 / beyond)
        return found.proved & above.proved, found.boxes + above.boxes

    def sensitivity_holds(cells: Cells) -> tuple[Flags, Integers]:
        found = cells_over_band(
            positive(claims.sensitivity, {}, claims.sensitivity_any_position), cells, 0.0, HALF_TURN, in_parts=True
        )
        return found.proved, found.boxes

    def poles_stay(cells: Cells) -> tuple[Flags, Integers]:
        turned = encirclements(demands, cells)
        return (turned.number == 0).all(axis=0), turned.boxes

    steps = ((0, conditions_hold), (1, sensitivity_holds), (slice(2, 4), poles_stay))
    left, boxes = np.arange(len(cells)), np.zeros((4, len(cells)), np.intp)
    own = steps[1:] if demands.device.kind.own_loop else ()
    for rows, holds in steps if demands.passive else own:
        if len(left):
            proved, boxes[rows, left] = holds(cells.subset(left))
            left = left[proved]
    if demands.any_hand and len(left):
        left = left[_holds_in_any_hand(demands, claims, cells.subset(left))]
    if demands.hands is not None and len(left):
        left = left[_holds_in_hands(demands, claims, cells.subset(left))]
    if demands.factor > 1 and demands.device.coupling_may_drive and len(left):
        left = left[_proofs(replace(demands, factor=1.0), cells.subset(left)).proved]
    proved = np.zeros(len(cells), bool)
    proved[left] = True
    return Certified(proved, boxes)


def _holds_in_any_hand(demands: Demands, claims: Claims, cells: Cells) -> Flags:
    """Prove the constraint for any passive hand on an impedance display."""
    if demands.device.least_damping == 0:
        return np.zeros(len(cells), bool)
    margin, size = (positive(each, {}) for each in claims.any_hand)
    if _have_the_same_gains(cells):  # equal gains have equal `size`
        one = cells.subset(np.zeros(1, np.intp))
        return cells_over_band(size, one, 0.0, HALF_TURN).proved & _above_envelope(demands, None, claims, cells)
    return cells_over_band(size, cells, 0.0, HALF_TURN).proved & cells_over_band(margin, cells, 0.0, HALF_TURN).proved


def _holds_in_hands(demands: Demands, claims: Claims, cells: Cells) -> Flags:
    """Prove the constraint in every hand."""
    hands, proved = demands.hands, np.zeros(len(cells), bool)
    assert hands is not None
    left = np.flatnonzero(turns_in_hand(demands, cells.centres()) == 0)
    if _have_the_same_gains(cells):
        proved[left] = _above_envelope(demands, hands, claims, cells.subset(left))
        return proved
    proved[left] = hold_in_hands(demands, cells.subset(left))
    return proved


def _have_the_same_gains(cells: Cells) -> bool:
    """Return whether all cells have the same gains and differ only in the coupling."""
    # rows 0 and 1 are the gains
    return cells.extended and not np.ptp((cells.low[:2], cells.high[:2]), axis=(0, 2)).any()


def _above_envelope(demands: Demands, hands: Hands | None, claims: Claims, cells: Cells) -> Flags:
    """Prove the constraint in every hand of a box, or in every passive hand, for couplings with the same gains."""
    if not len(cells):
        return np.zeros(0, bool)
    required = envelope(demands.device, hands, Gains(*map(float, cells.low[:2, 0])))
    found = prove_boxes(
        positive(claims.above_bound, {}),
        required.over(cells),
        len(cells),
        halved=(True, False, False, *[True] * len(cells.keys)),
        max_halvings=CELL_HALVINGS,
        max_boxes=MAX_BOXES,
        only_whole=True,
        few=0,
    )
    return found.proved


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
        claims, part = claims_of(demands), cells.subset(at)
        lost = negative_at(claims.sensitivity, part, places.theta_S[at])
        if places.omega is not None:
            lost |= negative_at(claims.conditions, part, places.omega[0, at])
            lost |= negative_at(claims.resistance, part, places.omega[0, at])
        if places.theta is not None:
            lost |= negative_at(claims.any_hand[0], part, places.theta[0, at])
        if places.in_hands is not None:
            lost |= negative_at(claims.in_hand, part, places.in_hands[0, at])
        left = np.flatnonzero(~lost)
        number = encirclements(demands, part.subset(left)).number
        lost[left] = (np.isfinite(number) & (number != 0)).any(axis=0)
        if demands.hands is not None:
            left = np.flatnonzero(~lost)
            number, _ = encirclements_in_hand(demands, part.subset(left))
            lost[left] = np.isfinite(number) & (number != 0)
        fails[at] = lost
    return fails


def negative_at(margin: Margin, cells: Cells, at: Floats | PlacesInHands) -> Flags:
    """Return the cells throughout which a margin is negative. Each cell has its own place."""
    return np.asarray(lower_bound_at(lambda omega, values: -margin(omega, values), cells, at) > 0)


def lower_bound_at(margin: Margin, cells: Cells, at: Floats | PlacesInHands) -> Floats:
    """Return a lower bound of a margin over each cell. Each cell has its own place."""
    return lower_bound_over(margin, over_each(cells, at), {})
