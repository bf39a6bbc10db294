"""Prove that axes of one servo with laws of their own are stable together, in hands at any angle to them
(model/README.md, section 17)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from vctune.model.numbers.arithmetic import Number
from vctune.proof.box_tests import spans_miss_zero
from vctune.proof.boxes import Values
from vctune.proof.claims.cases import over
from vctune.proof.claims.claim import Question
from vctune.proof.claims.damping import exactly_met
from vctune.proof.claims.delays import DelayPart
from vctune.proof.claims.in_hands import Asked, Tests, decided, ends_of, fixed_of, uncertain_in
from vctune.proof.claims.worlds import whole_impedance
from vctune.proof.outcome import Outcome, Verdict
from vctune.running import boxes_at_most

MOST_BOXES = 20_000  # of a proof; of laws that are far apart it takes some hundred


def prove_together(axes: Sequence[Question]) -> Outcome:
    """Prove that axes, each of which is proved alone, are stable together.

    A pole on the unit circle is a mean of the axes' whole impedances that is 0. If all impedances of all axes are
    positive in one direction, no mean of them is 0.
    """
    first = axes[0]
    servo, box, factor = first.design.device.servo, first.box, first.demands.factor
    if servo is None or servo.radii or any(axis.demands.worlds is None for axis in axes):
        return Outcome(Verdict.UNDECIDED, 0)
    uncertain = uncertain_in(box)

    def tests(part: DelayPart, _: Values) -> Tests:
        parts, fixed = [], []
        for axis in axes:
            exact = exactly_met(axis.demands)
            parts.append(over(partial(whole_impedance, *exact), axis.demands, uncertain, part.delays))
            fixed.append({**fixed_of(axis.design), **exact[0].low.by_key})  # the boxes have no rows of hands

        def together(theta: Number, values: Values) -> list[Any]:
            return [of(theta, {**values, **own}) for of, own in zip(parts, fixed, strict=True)]

        return [(spans_miss_zero(together, {}), None)]

    ends = ends_of(None, box, reserve=factor if factor > 1 else None)
    with boxes_at_most(MOST_BOXES):
        return decided(Asked(first, tests, lambda *_: False), ends)
