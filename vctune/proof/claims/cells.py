"""Prove the claims of a certificate throughout many cells of designs at once, or that no design of a cell meets them
(proof/README.md, section 8)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import inf

import numpy as np

from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.hands import Hand, Hands, PlacesInHands
from vctune.model.numbers.arithmetic import FLOATS, Number
from vctune.model.numbers.units import KEYS, SPRING_KEYS
from vctune.model.problem import Demands
from vctune.model.rest import greatest_at_rest
from vctune.model.sampled.any_hand import any_hand
from vctune.model.sampled.hand_loop import loop_in_hand, required_in_hand, room
from vctune.model.sampled.impedance_display import Required
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.proof.box_tests import Margin, lower_bound_over, positive
from vctune.proof.boxes import (
    FREQUENCY,
    HALF_TURN,
    Boxes,
    Cells,
    Integers,
    band_of,
    first_boxes,
    over_cells,
    over_each,
)
from vctune.proof.claims.cases import COUPLING_SHARE, Case, over, values_of
from vctune.proof.claims.cells_in_hands import hold_in_hands, walls_hold_in_hands, with_row
from vctune.proof.claims.loop_claims import (
    CELL,
    Covered,
    conditions,
    held,
    of_cells,
    sensitivity,
)
from vctune.proof.claims.margins_of_claims import (
    any_hand_before_wall,
    any_hand_margin,
    any_hand_size,
    conditions_margin,
    hand_margin,
    outwards,
    required_in_any_hand,
    required_in_hands,
    required_margin,
    resistance_margin,
    sensitivity_margin,
)
from vctune.proof.claims.poles import Turns, coupling_turns, hand_turns, model_turns, sampled_turns
from vctune.proof.claims.registry import ClaimId, claims_asked
from vctune.proof.enclosures.intervals import Enclosure, Flags, Floats
from vctune.proof.halving import Effort
from vctune.proof.prover import Proofs, prove

# The names of the rows of a straight line that bounds R in all hands
OFFSET, SLOPE = "offset of the bound", "slope of the bound"
PIECE_RATIO = 1.05  # Ratio of the edges of a piece
# Shares of each range of the hands at which the code evaluates R before it proves a piece
TRIED_SHARES = (0.0, 1e-4, 1e-3, 0.01, 0.03, 0.1, 0.2, 0.4, 0.7, 1.0)
WITHIN = 5  # Number of angles of a piece at which the code evaluates R
# Relative amount by which the first attempt raises a piece above the evaluated hands, and factor of this amount from
# one attempt to the next
SLACK, RAISED = 5e-3, 4.0
SMALL = 1e-4  # Share of the greatest bound
ATTEMPTS = 10  # Number of attempts to prove a piece
# Greatest number of halvings of a box of angle and hand, and number of boxes for a piece in the first attempt
MAX_HALVINGS, MAX_BOXES = 40, 250


@dataclass(frozen=True, slots=True)
class Envelope:
    """An upper bound of R in all hands of a box, or in any hand: offset + slope theta on each of n pieces."""

    low: Floats  # edges of the pieces, rad, shape (n,)
    high: Floats
    offset: Floats  # N s/m and N s/(m rad), shape (n,)
    slope: Floats
    boxes: int  # number of boxes of the proof

    def over(self, cells: Cells) -> Boxes:
        """Return a box for every pair of a piece and a cell. Two rows for the bound precede the rows of the cell."""
        boxes, rows = over_cells(cells, (self.low, self.high)), np.tile([self.offset, self.slope], len(cells))
        low, high = (np.vstack((edge[:1], rows, edge[1:])) for edge in (boxes.low, boxes.high))
        return first_boxes((FREQUENCY, OFFSET, SLOPE, *cells.keys), low, high, boxes.owner, boxes.whole_samples)


@lru_cache(maxsize=16)
@np.errstate(all="ignore")
def envelope(device: Device, hands: Hands | None, gains: Gains) -> Envelope:
    """Bound R from above in all hands, by a straight line over each piece of the angle."""
    low, high = band_of(0.0, HALF_TURN, PIECE_RATIO)
    theta = low[:, None] + (high - low)[:, None] * np.linspace(0, 1, WITHIN)
    some = _some_of(hands) if hands is not None else None
    # where R <= 0, also where R is -inf, a coupling may be arbitrarily small: the bound is 0 there
    asked = np.fmax(_required(device, some, gains, theta.ravel()), 0.0).max(axis=0)
    seen = asked.reshape(theta.shape)
    slope = (seen[:, -1] - seen[:, 0]) / (high - low)
    above, scale = (seen - slope[:, None] * theta).max(axis=1), np.maximum(seen.max(axis=1), SMALL * seen.max())
    offset, left, boxes = np.full(len(low), np.inf), np.flatnonzero(np.isfinite(above)), 0
    for attempt in range(ATTEMPTS):
        if not len(left):
            break
        tried = above + RAISED**attempt * SLACK * scale
        pieces = np.stack((low, high, tried, slope))[:, left]
        found = _below_pieces(device, hands, gains, pieces, 2**attempt * MAX_BOXES)
        boxes += int(found.boxes.sum())
        done = left[found.proved]
        offset[done] = tried[done]
        fails = np.flatnonzero(np.isfinite(found.failing[0]))
        if len(fails):
            there = dict(zip(found.names, found.failing[:, fails], strict=True))
            higher, at = left[fails], there[FREQUENCY]
            asked_there = _required(device, Hand.of(there) if hands is not None else None, gains, at)
            above[higher] = np.fmax(above[higher], np.ravel(asked_there) - slope[higher] * at)
        left = left[~found.proved]
    return Envelope(low, high, offset, slope, boxes)


def _some_of(hands: Hands) -> Hand:
    """Return a sample of the hands of a box, with numbers of shape (h, 1)."""
    places = (np.unique(a + (b - a) * np.array(TRIED_SHARES)) for a, b in hands.ranges.values())
    return Hand(*(number.reshape(-1, 1) for number in np.meshgrid(*places, indexing="ij")))


def _required(device: Device, hand: Hand | None, gains: Gains, theta: Floats) -> Floats:
    """Return R at angles of shape (n,): shape (h, n) in hands of shape (h, 1), or shape (1, n) in any hand."""
    delays = delays_of(device)
    if hand is None:
        found = any_hand(device, delays.loop, theta[None], FLOATS, fractional=delays.loop_fractional).required(gains)
        return np.asarray(np.where(found.size > 0, found.lost / found.size, np.inf))
    found = required_in_hand(loop_in_hand(plant_in_hand(device, hand, delays, FLOATS), theta, FLOATS), gains)
    return np.asarray(found.lost / found.size)


def _below_pieces(device: Device, hands: Hands | None, gains: Gains, pieces: Floats, max_boxes: int) -> Proofs:
    """Prove the bound of some pieces, given as rows low, high, offset and slope."""
    n, ends = pieces.shape[1], ({}, {}) if hands is None else (hands.low.by_key, hands.high.by_key)
    low, high = (np.array([*end.values()], float)[:, None] for end in ends)
    names = (FREQUENCY, *ends[0], OFFSET, SLOPE)
    boxes = first_boxes(
        names=names,
        low=np.vstack((pieces[:1], np.tile(low, n), pieces[2:])),
        high=np.vstack((pieces[1:2], np.tile(high, n), pieces[2:])),
        owner=np.arange(n),
        whole_samples=np.zeros(n, np.intp),
    )
    asked = Demands(device, (0.0, inf), 1.0, inf, passive=False, any_hand=hands is None, hands=hands)
    test = positive(over(_below_bound, asked), values_of(gains))
    halved = [name not in (OFFSET, SLOPE) for name in names]
    return prove(test, boxes, n, Effort(MAX_HALVINGS, max_boxes, few=0), halved=halved)


def _required_in_hands(case: Case, theta: Number) -> Number:
    required = required_in_hands(case, theta)
    return required.lost / required.size


def _below_bound(case: Case, theta: Number) -> Number:
    """Return |F|^2 (offset + slope theta - R), positive where R in a hand, or in any, lies below a straight line."""
    required = (required_in_any_hand if case.demands.any_hand else required_in_hands)(case, theta)
    return (case.values[OFFSET] + case.values[SLOPE] * theta) * required.size - required.lost


def _above_bound(case: Case, theta: Number) -> Number:
    """Return the margin by which a coupling exceeds a bound of R in all hands."""
    bound = Required(case.values[OFFSET] + case.values[SLOPE] * theta, Enclosure(1.0))
    return room(case.design.coupling, case.design.device, bound, case.factor, theta, case.ops)


# Identifiers of the claims that this module can prove for cells
OF_CELLS: tuple[ClaimId, ...] = (
    "passive", "sensitivity", "stable_model", "stable", "any_hand", "hands", "wall_in_any_hand", "wall_in_hands",
    "rests",
)  # fmt: skip
GUARD = 1e-14  # Bound on the relative rounding error of a cell's requirement on b_c: 90 u with u = 2^-53
ROUNDING_OF_BOUNDS = 1e-9  # Rounding allowance: two intervals of b_c must be this far apart to exclude each other


def proved_cells(demands: Demands, cells: Cells) -> Flags:
    """Return the cells throughout which all constraints are proved (proof/README.md, section 8)."""
    proved = np.zeros(len(cells), bool)
    known = set(claims_asked(demands)) <= set(OF_CELLS) and demands.worlds is None
    for at in by_integrator(cells) if known else ():
        proved[at] = _proved(demands, of_cells(demands, cells.subset(at)))
    return proved & (_stiffness_over_rest(demands, cells.keys, cells.high) <= 0)


def _stiffness_over_rest(demands: Demands, keys: Sequence[str], numbers: Floats) -> Floats:
    """Return by how much the stiffness that is read in steps exceeds the greatest that rests; -inf without the
    demand."""
    greatest = greatest_at_rest(demands.device) if demands.rest else None
    key = SPRING_KEYS[3] if demands.device.kind.inverse else KEYS[1]
    return numbers[keys.index(key)] - (inf if greatest is None else greatest)


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
    if demands.device.kind.own_loop and not demands.rigid:
        steps += [lambda part: sensitivity(part).proved, _stable]
    if demands.any_hand:
        steps.append(_hold_before_wall if demands.rigid else _hold_in_any_hand)
    if demands.hands is not None:
        steps.append(_hold_in_hands)
    if demands.device.coupling_may_turn and not demands.rigid:
        steps.append(lambda part: coupling_turns(part).number == 0)
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
    device = cells.demands.device
    if (device.damping if device.structure is not None else device.least_damping) == 0:  # nothing bounds a response
        return np.zeros(cells.owners, bool)
    margin, size = (positive(cells.margin(each), {}) for each in (any_hand_margin, any_hand_size))
    if _have_the_same_gains(cells):  # equal gains have equal `size`
        one = cells.subset(np.zeros(1, np.intp))
        return held(one, CELL, [(size, one.around_circle())]).proved & _above_envelope(cells, None)
    around = cells.around_circle()
    return held(cells, cells.effort(), [(size, around), (margin, around)]).proved


def _hold_before_wall(cells: Covered) -> Flags:
    """Prove the couplings as walls in any passive hand."""
    device = cells.demands.device
    if (device.damping if device.structure is not None else device.least_damping) == 0:  # nothing bounds a response
        return np.zeros(cells.owners, bool)
    test, around = positive(cells.margin(any_hand_before_wall), {}), cells.around_circle()
    if device.structure is not None:  # else a weaker wall is stable if this one is: the margin is concave
        around = with_row(around, COUPLING_SHARE, 0.0, 1.0)
    return prove(test, around, cells.owners, cells.effort()).proved


def _hold_in_hands(cells: Covered) -> Flags:
    """Prove the constraint in every hand."""
    demands, proved = cells.demands, np.zeros(cells.owners, bool)
    left = np.flatnonzero(hand_turns(cells.centres()).number == 0)
    part = cells.subset(left)
    if demands.rigid:
        proved[left] = walls_hold_in_hands(demands, Cells(part.low, part.high))
        return proved
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
    test = positive(cells.margin(_above_bound), {})
    return prove(test, boxes, cells.owners, CELL, halved=halved, only_whole=True).proved


@dataclass(frozen=True, slots=True)
class FailingPlaces:
    """The places where a constraint may fail throughout a cell, for n cells; None for constraints that the problem does
    not have."""

    theta_S: Floats  # angles omega T for |S|, rad, shape (n,)
    omega: Floats | None = None  # frequencies in the band of Llewellyn's conditions, rad/s, shape (any number, n)
    theta: Floats | None = None  # angles for any passive hand on an impedance display, rad, shape (any number, n)
    in_hands: PlacesInHands | None = None  # angles, each with a hand, shape (any number, n); the most critical first

    def subset(self, at: Integers) -> FailingPlaces:
        """Return the places of some of the cells."""
        omega, theta = (None if of is None else of[:, at] for of in (self.omega, self.theta))
        return FailingPlaces(self.theta_S[at], omega, theta, None if self.in_hands is None else self.in_hands[:, at])


def refuted(demands: Demands, cells: Cells, places: FailingPlaces) -> Flags:
    """Return the cells in which no design meets all constraints."""
    fails = _stiffness_over_rest(demands, cells.keys, cells.low) > 0
    for at in by_integrator(cells):
        part, there = cells.subset(at), places.subset(at)
        asked: list[tuple[Callable[[Case, Number], Number], Floats | PlacesInHands]]
        asked = [(sensitivity_margin, there.theta_S)]
        if there.omega is not None:
            asked += [(conditions_margin, there.omega[0]), (resistance_margin, there.omega[0])]
        if there.theta is not None:
            asked.append((any_hand_before_wall if demands.rigid else any_hand_margin, there.theta[0]))
        if there.in_hands is not None and not demands.rigid:
            asked.append((hand_margin, there.in_hands[0]))
        lost = np.any([negative_at(over(margin, demands), part, place) for margin, place in asked], axis=0)
        left = np.flatnonzero(~lost)
        some = part.subset(left)
        found = pole_turns(of_cells(demands, some), in_hand=not demands.rigid)
        if demands.rigid and there.in_hands is not None:
            found.append(hand_turns(in_own_hands(demands, some, there.in_hands[0][left].hands)))
        lost[left] = np.any([np.isfinite(each.number) & (each.number != 0) for each in found], axis=0)
        fails[at] |= lost
    return fails


def in_own_hands(demands: Demands, cells: Cells, hands: Hand) -> Covered:
    """Return cells each of which is in one hand of its own, whose numbers have the shape (n,)."""
    own = np.array([*hands.by_key.values()], float)
    low, high = np.vstack((cells.low, own)), np.vstack((cells.high, own))
    return Covered(demands, (*cells.keys, *hands.by_key), low, high, {})


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


def no_damping(demands: Demands, cells: Cells, places: FailingPlaces) -> Flags:
    """Return the cells in which no b_c between the cell's edges meets the constraints on Re Z_c."""
    # rows in the order of `KEYS`: 2 is b_c, 3 is m_c, 4 is b_0
    least, most = cells.low[2].copy(), cells.high[2].copy()
    heaviest = cells.high[3] * (1 + GUARD)
    asked = list[tuple[Margin, Floats | PlacesInHands, Floats]]()
    if places.omega is not None:
        asked += [(over(required_margin, demands), omega, omega) for omega in places.omega]
    if places.in_hands is not None:
        rate = 2 / demands.device.sample_time
        each = (places.in_hands[k] for k in range(places.in_hands.at.shape[0]))
        required = over(_required_in_hands, demands)
        asked += [(required, place, rate * np.tan(place.at / 2)) for place in each]
    for among in by_integrator(cells):
        part = cells.subset(among)
        for required, at, omega in asked:
            bound = np.nan_to_num(lower_bound_at(required, part, at[..., among]), nan=0.0)
            needed = (demands.factor * bound - part.high[4] * (1 + GUARD)) * (1 - GUARD)
            low, high = admissible_damping(needed, heaviest[among] * omega[among])
            least[among], most[among] = np.maximum(least[among], low), np.minimum(most[among], high)
    return least * (1 - ROUNDING_OF_BOUNDS) > most * (1 + ROUNDING_OF_BOUNDS)
