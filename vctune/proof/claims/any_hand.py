"""Prove an impedance display stable in any passive hand, with every passive environment or with its coupling as a wall
(model/README.md, section 15)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from math import pi

import numpy as np

from vctune.model.device import Device
from vctune.model.gains import SpringDamper
from vctune.model.numbers.arithmetic import Number
from vctune.model.sampled.any_hand import AnyHand, any_hand
from vctune.model.sampled.impedance_display import Required
from vctune.proof.box_tests import positive
from vctune.proof.boxes import Values, with_row
from vctune.proof.claims.cases import COUPLING_SHARE, Case, over
from vctune.proof.claims.claim import Claim, Outcomes, Question
from vctune.proof.claims.covered import CELL, Covered, held, in_rad_per_s, negative
from vctune.proof.claims.delays import DelayPart, Ends
from vctune.proof.claims.envelope import above_envelope, have_the_same_gains
from vctune.proof.claims.in_hands import (
    NEAR_ENDS,
    Asked,
    Tests,
    and_without_reserve,
    and_without_reserve_in_cells,
    certainly,
    decided,
    ends_of,
    uncertain_in,
)
from vctune.proof.enclosures.intervals import Flags
from vctune.proof.outcome import Outcome, Verdict
from vctune.proof.prover import prove


def any_hand_margin(case: Case, theta: Number) -> Number:
    """Return |F|^2 (Re 1/Z_c - factor R) for any passive hand on an impedance display (model/README.md, section 15)."""
    return case.room(required_in_any_hand(case, theta), theta)


def any_hand_size(case: Case, theta: Number) -> Number:
    """Return |F|^2 in the worst passive hand, which must be positive as well."""
    return required_in_any_hand(case, theta).size


def any_hand_before_wall(case: Case, theta: Number) -> Number:
    """Return a margin for a share of factor times the coupling as a wall in any passive hand (model/README.md,
    section 15)."""
    wall, share = case.design.coupling, case.factor * case.share
    assert isinstance(wall, SpringDamper)
    along, size2 = _any_hand(case, theta).before_wall(wall, case.design.device.sample_time, theta, case.ops)
    return 1 + share * (along + share * size2)


def required_in_any_hand(case: Case, theta: Number) -> Required:
    """Return the least feasible Re 1/Z_c in any passive hand on an impedance display."""
    return _any_hand(case, theta).required(case.design.gains)


def _any_hand(case: Case, theta: Number) -> AnyHand:
    delays = case.delays
    return any_hand(case.design.device, delays.loop, theta, case.ops, fractional=delays.loop_fractional)


def _prove_any_hand(question: Question) -> Outcome:
    """Prove Re 1/Z_c > factor R of an impedance display in any passive hand."""
    asked = [any_hand_margin, any_hand_size] if question.design.gains.velocity > 0 else [any_hand_margin]
    return and_without_reserve(_decided(question, asked), _prove_any_hand, question)


def _prove_wall(question: Question, _known: Outcomes) -> Outcome:
    """Prove the coupling as a wall in any passive hand."""
    if question.design.gains.closed:  # K_v would damp beside the wall, whatever its share
        return Outcome(Verdict.UNDECIDED, 0)
    rows: Ends = {}
    if question.design.device.structure is not None:  # else a weaker wall is stable if this one is
        rows[COUPLING_SHARE] = np.zeros(1), np.ones(1)
    return _decided(question, [any_hand_before_wall], rows)


def _decided(
    question: Question,
    margins: Sequence[Callable[[Case, Number], Number]],
    rows: Ends | None = None,
) -> Outcome:
    """Prove that margins are positive in any passive hand; where the first is negative, the claim is refuted.

    Without damping of the motor, its responses in all of them have no bound: at no frequency if the device is rigid,
    else at rest.
    """
    design, device, fails = question.design, question.design.device, certainly(question, margins[0])
    if device.structure is None and device.least_damping == 0:
        return Outcome(Verdict.REFUTED, 0, pi / device.sample_time)
    if _unbounded(device):
        theta = next((pi * off for off in NEAR_ENDS if fails(design, None, pi * off, 1.0)), None)
        verdict = Verdict.UNDECIDED if theta is None else Verdict.REFUTED
        return in_rad_per_s(Outcome(verdict, 0, theta or pi * NEAR_ENDS[-1]), device)

    def tests(part: DelayPart, fixed: Values) -> Tests:
        each = (over(margin, question.demands, uncertain_in(question.box), part.delays) for margin in margins)
        return [(positive(margin, fixed), None) for margin in each]

    return decided(Asked(question, tests, fails), ends_of(None, question.box) | (rows or {}))


def _unbounded(device: Device) -> bool:
    """Return whether nothing bounds the response in all passive hands: the motor has no damping."""
    return (device.damping if device.structure is not None else device.least_damping) == 0


def _hold_in_any_hand(cells: Covered) -> Flags:
    """Return the cells in which the constraint is proved in any passive hand."""
    if _unbounded(cells.demands.device):
        return np.zeros(cells.owners, bool)
    margin, size = (positive(cells.margin(each), {}) for each in (any_hand_margin, any_hand_size))
    if have_the_same_gains(cells):  # equal gains have equal `size`
        one = cells.subset(np.zeros(1, np.intp))
        bounded = held(one, CELL, [(size, one.around_circle())]).proved
        return bounded & above_envelope(cells, None, required_in_any_hand)
    around = cells.around_circle()
    return held(cells, cells.effort(), [(size, around), (margin, around)]).proved


def _walls_hold(cells: Covered) -> Flags:
    """Return the cells whose couplings are proved as walls in any passive hand."""
    device = cells.demands.device
    if _unbounded(device):
        return np.zeros(cells.owners, bool)
    test, around = positive(cells.margin(any_hand_before_wall), {}), cells.around_circle()
    if device.structure is not None:
        around = with_row(around, COUPLING_SHARE, 0.0, 1.0)
    return prove(test, around, cells.owners, cells.effort()).proved


ANY_HAND = Claim(
    id="any_hand",
    sentence=("stable in {passive} with every passive environment, Re 1/Z_c >= safety_factor R up to Nyquist"),
    quantity="in_hand",
    margin=any_hand_margin,
    witness="a frequency up to Nyquist",
    label="any passive hand, at every frequency",
    explain=(
        "An impedance display is stable in any passive hand with every environment that is passive as it "
        "runs. If `operator.damping.min` is above 0, every hand must have at least this damping: the proof "
        "counts on it, and the device may be unstable in other hands and when nobody holds it. The claim is "
        "about the exact sampled loop, including aliasing."
    ),
    when='for an impedance display with the criterion "passive" or "both", unless the environment is rigid',
    asked=lambda demands, _: demands.any_hand and not demands.rigid,
    prove=lambda question, _: _prove_any_hand(question),
    cells=partial(and_without_reserve_in_cells, _hold_in_any_hand),
    lost=negative(any_hand_margin),
)


WALL_IN_ANY_HAND = Claim(
    id="wall_in_any_hand",
    sentence="stable in {passive} against a wall of 1 to safety_factor times the coupling",
    quantity="in_hand",
    margin=any_hand_before_wall,
    witness="a frequency up to Nyquist",
    label="the wall in any passive hand",
    explain=(
        "The coupling of an impedance display ends in a rigid world, so that it is a wall that is always in "
        "contact. The device is stable in any passive hand: the condition of Colgate and Schenkel, exact with "
        "delays, filters and actuator. Dry friction at a rigid handle is part of such a hand. If "
        "`operator.damping.min` is above 0, every hand must have at least this damping: the proof counts on it."
    ),
    when='for an impedance display with the criterion "passive" or "both", if `environment.stiffness = inf`',
    asked=lambda demands, _: demands.any_hand and demands.rigid,
    prove=_prove_wall,
    cells=_walls_hold,
    lost=negative(any_hand_before_wall),
)
