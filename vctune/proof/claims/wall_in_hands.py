"""Prove the coupling of an impedance display as a wall in every hand of a box: no pole reaches the unit circle."""

from __future__ import annotations

from dataclasses import replace
from math import isnan, nextafter

import numpy as np

from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.hands import Hand, Hands, PlacesInHands
from vctune.proof.box_tests import misses_zero
from vctune.proof.boxes import Cells, Values, over_hands, with_row
from vctune.proof.claims.cases import COUPLING_SHARE, over
from vctune.proof.claims.claim import Claim, Outcomes, Question
from vctune.proof.claims.covered import Covered, Place, of_design
from vctune.proof.claims.delays import DelayPart
from vctune.proof.claims.hands import band, few, prove_cells
from vctune.proof.claims.in_hands import Asked, Tests, devices_of, ends_of, no_pole_crosses, uncertain_in
from vctune.proof.claims.poles import hand_curve, hand_turns, unstable
from vctune.proof.enclosures.intervals import Flags
from vctune.proof.outcome import Outcome, Verdict


def _prove(question: Question, _known: Outcomes) -> Outcome:
    """Prove the coupling as a wall in every hand of a box: no pole reaches the unit circle from within."""
    design, demands, box = question.design, question.demands, question.box
    if design.gains.closed:  # K_v would damp beside the wall, whatever its share
        return Outcome(Verdict.UNDECIDED, 0)
    uncertain = uncertain_in(box)
    for device, hand, (theta, _) in question.suspects(design, demands, devices_of(question)):
        if _unstable(replace(design, device=device), demands, hand):
            return Outcome(Verdict.REFUTED, 0, theta / device.sample_time, device if uncertain else None, hand)

    def tests(part: DelayPart, fixed: Values) -> Tests:
        return [(misses_zero(over(hand_curve, demands, uncertain, part.delays), fixed), None)]

    def fails(design: Design, hand: Hand | None, _theta: float, share: float) -> bool:
        return hand is not None and _unstable(design, demands, hand, share)

    ends = ends_of(demands.hands, box, reserve=demands.factor if demands.factor > 1 else None)
    return no_pole_crosses(Asked(question, tests, fails, apart=True), ends)


def _unstable(design: Design, demands: Demands, hand: Hand, share: float = 1.0) -> bool:
    """Return whether the loop certainly has a pole outside the unit circle, in a hand with a share of the wall."""
    demands = replace(demands, hands=Hands(hand, hand), factor=demands.factor * share)
    number = float(hand_turns(of_design(design, demands)).number[0])
    return not isnan(number) and number != 0


def _hold(cells: Covered) -> Flags:
    """Return the cells of whose walls none, times any number from 1 to the factor, is unstable in a hand of the box."""
    demands, proved = cells.demands, np.zeros(cells.owners, bool)
    test, least = misses_zero(over(hand_curve, demands), {}), nextafter(1 / demands.factor, 0.0)
    for some in few(np.flatnonzero(hand_turns(cells.centres()).number == 0)):
        assert demands.hands is not None
        each = Cells(cells.low[:, some], cells.high[:, some])
        share = (least if demands.factor > 1 else 1.0), 1.0
        boxes = with_row(over_hands(each, demands.hands, band()), COUPLING_SHARE, *share)
        proved[some] = prove_cells(test, boxes, len(some))
    return proved


def _lost(cells: Covered, places: Place) -> Flags:
    """Return the cells throughout which the wall is unstable, each in the hand of its place."""
    if not isinstance(places, PlacesInHands):
        return np.zeros(cells.owners, bool)
    own = np.array([*places.hands.by_key.values()], float)
    low, high = np.vstack((cells.low, own)), np.vstack((cells.high, own))
    return unstable(hand_turns(replace(cells, names=(*cells.names, *places.hands.by_key), low=low, high=high)))


WALL_IN_HANDS = Claim(
    id="wall_in_hands",
    sentence="stable in every hand against a wall of 1 to safety_factor times the coupling",
    quantity="in_hand",
    margin=hand_curve,
    witness="a frequency up to Nyquist and a hand of `[operator]`",
    label="the wall in every hand of the box",
    explain=(
        "The coupling of an impedance display ends in a rigid world, so that it is a wall that is always in "
        "contact. The device is stable in each hand of `[operator]`. The claim is about the exact sampled "
        "loop of linear hands: it does not cover a contact that is made and broken, nor dry friction."
    ),
    when='for an impedance display with the criterion "hands", if `environment.stiffness = inf`',
    asked=lambda demands, _: demands.hands is not None and demands.rigid,
    prove=_prove,
    cells=_hold,
    lost=_lost,
)
