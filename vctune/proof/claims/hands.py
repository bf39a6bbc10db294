"""Prove Re Z_c > factor R in every hand of a box, with every passive environment: for a design, and for cells of
designs, also near theta = 0, where the margin vanishes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from vctune.model.demands import Demands
from vctune.model.hands import HAND
from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.pair import EvenOdd
from vctune.model.numbers.units import KEYS
from vctune.model.sampled.hand_loop import loop_in_hand, required_in_hand, required_in_limp_hand
from vctune.model.sampled.impedance_display import Required
from vctune.model.sampled.plant_in_hand import plants_in_spring
from vctune.proof.box_tests import Margin, beside_zero, either, positive, sufficient
from vctune.proof.boxes import (
    FREQUENCY,
    HALF_TURN,
    Boxes,
    Cells,
    Integers,
    Values,
    band_of,
    first_boxes,
    joined,
    over_hands,
)
from vctune.proof.claims.cases import Case, over
from vctune.proof.claims.claim import Claim, Question
from vctune.proof.claims.covered import BAND_RATIO, Covered, Place, negative
from vctune.proof.claims.delays import DelayPart
from vctune.proof.claims.envelope import above_envelope, have_the_same_gains
from vctune.proof.claims.in_hands import (
    ON_AXES,
    RHO_SHARES,
    Asked,
    Tests,
    and_without_reserve,
    and_without_reserve_in_cells,
    certainly,
    ends_of,
    limp,
    next_to_rest,
    no_pole_crosses,
    tested_with,
    uncertain_in,
)
from vctune.proof.claims.poles import hand_turns, unstable
from vctune.proof.enclosures.intervals import Enclosure, Flags, Floats
from vctune.proof.halving import Effort
from vctune.proof.outcome import Outcome, Verdict
from vctune.proof.prover import Test, narrowed, prove

EFFORT = Effort(max_halvings=80, max_boxes=30_000, few=0)
CELLS_AT_ONCE = 128  # Number of cells that the prover treats together, so that their boxes fit into memory
# Width of the first interval of angles, as a share of the band: with a wider one, the mass of the hand alone fills
# most boxes of the proof near theta = 0
FIRST = 1e-4
# Greatest K_p T^2/m, as a share of the first interval, for which the prover treats a cell separately near theta = 0
NEAR_REST = 1.0
ROUNDING = 1e-9  # Allowance for the rounding of a share's limits, relative to them
COUPLING_MASS = "coupling.mass"


def hand_margin(case: Case, theta: Number) -> Number:
    """Return |F|^2 (Re Z_c - factor R) in a hand (model/README.md, section 14)."""
    return case.room(required_in_hands(case, theta), theta)


def margin_in_spring(case: Case, theta: Number) -> tuple[Number, Number]:
    """Return two margins; where both are positive, `hand_margin` is for a spring of any stiffness.

    It is a quadratic in the stiffness, whose discriminant and whose square term decide (model/README.md, section 14).
    """
    gains, plants = case.design.gains, plants_in_spring(case.design.device, case.hand, case.delays, case.ops)
    soft, stiff = (loop_in_hand(replace(plant, delays=case.delays), theta, case.ops) for plant in plants)
    F, P = soft.closed(gains), soft.numerator(gains)
    F_1, P_1 = stiff.closed(gains) + F.scaled(-1), stiff.numerator(gains) + P.scaled(-1)
    # from the stiffness with the least |F|, where F is across F_1 and nothing is left of the resonance
    square, size = F.square, F_1.abs2()
    across = (F_1.even * F.odd - F_1.odd * F.even) / size
    F_0 = EvenOdd(-(square * (across * F_1.odd)), across * F_1.even, square)
    P_0 = P + P_1.scaled(-((F.even * F_1.even + square * (F.odd * F_1.odd)) / size))

    def term(size: Number, *pairs: tuple[EvenOdd, EvenOdd]) -> Number:
        lost = [-0.5 * (p.odd * f.even - p.even * f.odd) for p, f in pairs]
        return case.room(Required(sum(lost[1:], start=lost[0]), size), theta)

    bent, linear = term(size, (P_1, F_1)), term(0 * size, (P_0, F_1), (P_1, F_0))
    return 4 * (bent * term(square * (across * across * size), (P_0, F_0))) - linear * linear, bent


def limp_hand_margin(case: Case, theta: Number) -> Number:
    """Return `hand_margin` divided by rho^2, for theta near 0, a hand without stiffness and K_p = 0."""
    plant, rest = next_to_rest(case, theta)
    required = required_in_limp_hand(plant, case.design.gains.velocity, theta, rest, case.ops)
    return case.room(required, theta)


def required_in_hands(case: Case, theta: Number) -> Required:
    """Return the least feasible Re Z_c in a hand, N s/m."""
    return required_in_hand(loop_in_hand(case.held(), theta, case.ops), case.design.gains)


def _prove(question: Question) -> Outcome:
    """Prove Re Z_c > factor R in every hand of a box, on every device of a box."""
    design, demands = question.design, question.demands
    assert demands.hands is not None
    kind, uncertain = design.device.kind, uncertain_in(question.box)
    if kind.senses_force and kind.own_loop and not design.gains.closed and design.series.drag == 0:
        return Outcome(Verdict.UNDECIDED, 0, 0.0)  # nothing opposes a drift of the coupling's mass

    def tests(part: DelayPart, fixed: Values) -> Tests:
        test = tested_with(question, part, fixed, hand_margin, limp_hand_margin)
        if not kind.own_loop:
            return [(test, None)]
        return [(test, either(test, over(margin_in_spring, demands, uncertain, part.delays), fixed))]

    # the requirement of a servo is convex in the hand
    corners = None if kind.own_loop else demands.hands.corners
    ends = ends_of(demands.hands, question.box, corners, at_rest=limp(demands, integral=design.gains.position > 0))
    found = no_pole_crosses(Asked(question, tests, certainly(question, hand_margin), apart=True), ends)
    return and_without_reserve(found, _prove, question)


def _holds(cells: Covered) -> Flags:
    """Return the cells in which the constraint is proved in every hand."""
    demands, proved = cells.demands, np.zeros(cells.owners, bool)
    left = np.flatnonzero(hand_turns(cells.centres()).number == 0)
    part = cells.subset(left)
    if have_the_same_gains(cells):
        proved[left] = above_envelope(part, demands.hands, required_in_hands)
    else:
        proved[left] = _hold_in_hands(demands, Cells(part.low, part.high))
    return proved


def _hold_in_hands(demands: Demands, cells: Cells) -> Flags:
    """Return the cells in which every design meets the constraint and has no pole on the unit circle, in every hand."""
    limp = _next_to_rest(demands, cells)
    proved = np.zeros(len(cells), bool)
    for some in few(np.flatnonzero(~limp)):
        proved[some] = _proved_everywhere(demands, cells.subset(some))
    for some in few(np.flatnonzero(limp)):
        proved[some] = _proved_apart(demands, cells.subset(some))
    return proved


def few(at: Integers) -> Iterator[Integers]:
    return (at[i : i + CELLS_AT_ONCE] for i in range(0, len(at), CELLS_AT_ONCE))


def _next_to_rest(demands: Demands, cells: Cells) -> Flags:
    """Return the cells with a K_p so small that the margin in a hand without stiffness nearly vanishes at theta = 0."""
    assert demands.hands is not None
    kind = demands.device.kind
    if not (kind.senses_force and kind.own_loop) or demands.hands.low.stiffness > 0:
        return np.zeros(len(cells), bool)
    return np.asarray(cells.low[1] <= NEAR_REST * _stiffness_of(demands, band()[1][0]))


def _stiffness_of(demands: Demands, theta: float) -> float:
    """Return the stiffness, N/m, that contributes as much as an angle to rho, the factor with which the margin
    vanishes."""
    return theta * demands.device.mass / demands.device.sample_time**2


def band() -> tuple[Floats, Floats]:
    low, high = band_of(FIRST * HALF_TURN, HALF_TURN, BAND_RATIO)
    return np.append(0.0, low), np.append(low[:1], high)


def _proved_everywhere(demands: Demands, cells: Cells) -> Flags:
    assert demands.hands is not None
    boxes = over_hands(cells, demands.hands, band())
    # the margin of a servo is linear in the hand: halving the hands takes long for wide cells, and decides little more
    linear = demands.device.servo is not None and demands.device.unmodelled is None
    return prove_cells(_in_hand(demands), boxes, len(cells), whole_hands=linear)


def _in_hand(demands: Demands) -> Test:
    """Return the test that a margin in a hand is positive. Near theta = 0 it uses only the coupling's drag."""
    margin = over(hand_margin, demands)
    test = positive(margin, {})
    if not demands.device.kind.inverse:
        test = beside_zero(sufficient(_by_drag(margin), {}), test)
    return _or_every_stiffness(demands, test)


def _or_every_stiffness(demands: Demands, test: Test) -> Test:
    """Return a test that also proves boxes away from theta = 0 for every stiffness at once."""
    return either(test, over(margin_in_spring, demands), {}) if demands.device.kind.own_loop else test


def _by_drag(margin: Margin) -> Margin:
    """Return the margin with only the drag of the coupling, a lower bound of the margin with the whole coupling."""
    return lambda theta, v: margin(theta, {**v, COUPLING_MASS: Enclosure(0.0)})


def _proved_apart(demands: Demands, cells: Cells) -> Flags:
    """Prove the constraint with the margin divided by rho^2 near theta = 0, and with the margin itself elsewhere."""
    hands, (first, others) = demands.hands, _parted(band())
    assert hands is not None
    stiffness = min(hands.high.stiffness, _stiffness_of(demands, first[1][0]))
    softer = replace(hands, high=replace(hands.high, stiffness=stiffness))
    proved = prove_cells(
        narrowed(positive(_by_drag(over(limp_hand_margin, demands)), {}), partial(_with_possible_shares, demands)),
        _with_shares(over_hands(cells, softer, first)),
        len(cells),
    )
    left = np.flatnonzero(proved)
    part = cells.subset(left)
    boxes = over_hands(part, hands, others)
    if stiffness < hands.high.stiffness:
        stiffer = replace(hands, low=replace(hands.low, stiffness=stiffness))
        boxes = joined(boxes, over_hands(part, stiffer, first))
    proved[left] = prove_cells(_in_hand(demands), boxes, len(part))
    return proved


def _parted(band: tuple[Floats, Floats]) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    """Return the first interval of a band, and the other intervals."""
    low, high = band
    return (low[:1], high[:1]), (low[1:], high[1:])


def _with_shares(boxes: Boxes) -> Boxes:
    """Return boxes of hands and cells with the rows of `RHO_SHARES` added, each with its full range."""
    there = [boxes.high[boxes.names.index(key)].max(initial=0.0) > 0 for key in (KEYS[1], HAND[2])]
    rows = np.repeat(np.array(there, float)[:, None], len(boxes), axis=1)
    low, high = np.vstack((boxes.low, np.zeros_like(rows))), np.vstack((boxes.high, rows))
    return first_boxes((*boxes.names, *RHO_SHARES), low, high, boxes.owner, boxes.whole_samples)


def _with_possible_shares(demands: Demands, boxes: Boxes) -> tuple[Boxes, Flags]:
    """Return boxes narrowed to the shares that the theta, stiffness and K_p in them may have, and which have none."""
    unit = _stiffness_of(demands, 1.0)
    low, high = (dict(zip(boxes.names, edge, strict=True)) for edge in (boxes.low.copy(), boxes.high.copy()))
    # the terms of rho in N/m: K_p, the hand's stiffness and 2 sin(theta/2)
    law, grip = ((low[key], high[key]) for key in (KEYS[1], HAND[2]))
    turned = tuple(2 * np.sin(edge[FREQUENCY] / 2) * unit for edge in (low, high))
    rest = turned[0] + grip[0], turned[1] + grip[1]
    for share, (least, most), others in zip(RHO_SHARES, (law, grip), (rest, turned), strict=True):
        # 0/0 limits nothing
        low[share] = np.fmax(low[share], least / (least + others[1]) * (1 - ROUNDING))
        high[share] = np.fmin(high[share], most / (most + others[0]) * (1 + ROUNDING))
    least, most = np.stack(list(low.values())), np.stack(list(high.values()))
    return replace(boxes, low=least, high=most), np.any(least > most, axis=0)


def prove_cells(test: Test, boxes: Boxes, owners: int, effort: Effort = EFFORT, *, whole_hands: bool = False) -> Flags:
    """Return the owners of which all boxes are proved."""
    halved = [not whole_hands or name not in HAND for name in boxes.names]
    return prove(test, boxes, owners, effort, halved=halved, only_whole=True).proved


def _required(case: Case, theta: Number) -> Number:
    found = required_in_hands(case, theta)
    return found.lost / found.size


def _lost(cells: Covered, places: Place) -> Flags:
    """Return the cells throughout which the constraint fails at a place, or the loop is unstable in the middle hand."""
    found = negative(hand_margin)(cells, places)
    left = np.flatnonzero(~found)
    found[left] = unstable(hand_turns(cells.subset(left)))
    return found


HANDS = Claim(
    id="hands",
    sentence=("stable in every hand with every passive environment, Re {couples} >= safety_factor R up to Nyquist"),
    quantity="in_hand",
    margin=hand_margin,
    witness="a frequency up to Nyquist and a hand of `[operator]`",
    label="every hand of the box",
    explain=(
        "A hand of `[operator]` is a mass, a damper and a spring, each within its range. In each such hand "
        "the device is stable with every environment that is passive as it runs. The claim is about the exact "
        "sampled loop, including aliasing. It does not cover a hand outside these ranges." + ON_AXES
    ),
    when='with the criterion "hands", or "both" for an admittance display, without `[environment]`',
    asked=lambda demands, _: demands.hands is not None and demands.worlds is None and not demands.rigid,
    prove=lambda question, _: _prove(question),
    cells=partial(and_without_reserve_in_cells, _holds),
    lost=_lost,
    required=_required,
)
