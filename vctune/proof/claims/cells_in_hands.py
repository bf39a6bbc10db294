"""Prove the constraint in every hand of a box for many cells of gains, also near theta = 0, where the margin
vanishes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from math import nextafter

import numpy as np

from vctune.model.hands import HAND
from vctune.model.numbers.units import KEYS
from vctune.model.problem import Demands
from vctune.proof.box_tests import Margin, beside_zero, either, misses_zero, positive, sufficient
from vctune.proof.boxes import FREQUENCY, HALF_TURN, Boxes, Cells, Integers, band_of, first_boxes, joined, over_hands
from vctune.proof.claims.cases import COUPLING_SHARE, over
from vctune.proof.claims.loop_claims import BAND_RATIO
from vctune.proof.claims.margins_of_claims import (
    RHO_SHARES,
    hand_curve,
    hand_margin,
    limp_hand_margin,
    margin_in_spring,
)
from vctune.proof.enclosures.intervals import Enclosure, Flags, Floats
from vctune.proof.halving import Effort
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


def hold_in_hands(demands: Demands, cells: Cells) -> Flags:
    """Return the cells in which every design meets the constraint and has no pole on the unit circle, in every hand."""
    limp = _next_to_rest(demands, cells)
    proved = np.zeros(len(cells), bool)
    for some in _few(np.flatnonzero(~limp)):
        proved[some] = _proved_everywhere(demands, cells.subset(some))
    for some in _few(np.flatnonzero(limp)):
        proved[some] = _proved_apart(demands, cells.subset(some))
    return proved


def walls_hold_in_hands(demands: Demands, cells: Cells) -> Flags:
    """Return the cells of whose walls none, times any number from 1 to the factor, has a pole on the unit circle in a
    hand of the box."""
    test, proved = misses_zero(over(hand_curve, demands), {}), np.zeros(len(cells), bool)
    least = nextafter(1 / demands.factor, 0.0) if demands.factor > 1 else 1.0
    for some in _few(np.arange(len(cells))):
        assert demands.hands is not None
        boxes = with_row(over_hands(cells.subset(some), demands.hands, _band()), COUPLING_SHARE, least, 1.0)
        proved[some] = _prove(test, boxes, len(some))
    return proved


def with_row(boxes: Boxes, name: str, low: float, high: float) -> Boxes:
    """Return boxes with a row added whose range is the same in all."""
    one = np.ones((1, len(boxes)))
    ends = np.vstack((boxes.low, low * one)), np.vstack((boxes.high, high * one))
    return first_boxes((*boxes.names, name), *ends, boxes.owner, boxes.whole_samples)


def _senses_force_in_a_loop(demands: Demands) -> bool:
    return demands.device.kind.senses_force and demands.device.kind.own_loop


def _few(at: Integers) -> Iterator[Integers]:
    return (at[i : i + CELLS_AT_ONCE] for i in range(0, len(at), CELLS_AT_ONCE))


def _next_to_rest(demands: Demands, cells: Cells) -> Flags:
    """Return the cells with a K_p so small that the margin in a hand without stiffness nearly vanishes at theta = 0."""
    assert demands.hands is not None
    if not _senses_force_in_a_loop(demands) or demands.hands.low.stiffness > 0:
        return np.zeros(len(cells), bool)
    return np.asarray(cells.low[1] <= NEAR_REST * _stiffness_of(demands, _band()[1][0]))


def _stiffness_of(demands: Demands, theta: float) -> float:
    """Return the stiffness, N/m, that contributes as much as an angle to rho, the factor with which the margin
    vanishes."""
    return theta * demands.device.mass / demands.device.sample_time**2


def _band() -> tuple[Floats, Floats]:
    low, high = band_of(FIRST * HALF_TURN, HALF_TURN, BAND_RATIO)
    return np.append(0.0, low), np.append(low[:1], high)


def _proved_everywhere(demands: Demands, cells: Cells) -> Flags:
    assert demands.hands is not None
    boxes = over_hands(cells, demands.hands, _band())
    # the margin of a servo is linear in the hand: halving the hands takes long for wide cells, and decides little more
    linear = demands.device.servo is not None and demands.device.unmodelled is None
    return _prove(_in_hand(demands), boxes, len(cells), whole_hands=linear)


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
    hands, (first, others) = demands.hands, _parted(_band())
    assert hands is not None
    stiffness = min(hands.high.stiffness, _stiffness_of(demands, first[1][0]))
    softer = replace(hands, high=replace(hands.high, stiffness=stiffness))
    proved = _prove(
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
    proved[left] = _prove(_in_hand(demands), boxes, len(part))
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


def _prove(test: Test, boxes: Boxes, owners: int, *, whole_hands: bool = False) -> Flags:
    halved = [not whole_hands or name not in HAND for name in boxes.names]
    return prove(test, boxes, owners, EFFORT, halved=halved, only_whole=True).proved
