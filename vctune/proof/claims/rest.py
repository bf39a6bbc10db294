"""Prove that the device rests between the steps of its encoder (`vctune.model.rest`)."""

from __future__ import annotations

from math import inf

import numpy as np

from vctune.model.demands import Demands
from vctune.model.numbers.units import KEYS, SPRING_KEYS
from vctune.model.rest import greatest_at_rest, rests
from vctune.proof.claims.claim import Claim
from vctune.proof.enclosures.intervals import Floats
from vctune.proof.outcome import Outcome, Verdict


def _stiffness_over_rest(demands: Demands, numbers: Floats) -> Floats:
    """Return by how much the stiffness that is read in steps exceeds the greatest that rests, for numbers of cells."""
    greatest = greatest_at_rest(demands.device)
    # the rows of cells are `KEYS` or `SPRING_KEYS`
    row = SPRING_KEYS.index("coupling.stiffness") if demands.device.kind.inverse else KEYS.index("gains.position")
    return np.asarray(numbers[row] - (inf if greatest is None else greatest))


RESTS = Claim(
    id="rests",
    sentence="the friction holds the force of one step of the encoder both ways: {spring} q <= 2 f",
    quantity="rest",
    margin=rests,
    witness="none; the claim is about rest",
    label="rest between steps of the encoder",
    explain=(
        "At every constant force of the hand there is a reading of the encoder at which the dry friction "
        "`device.friction` holds the handle: where it has stopped, it stays. The two forces of neighbouring "
        "readings differ by the stiffness times `device.velocity.resolution`, at most twice the friction "
        "(Abbott and Okamura). The claim is exact in the decimals of the file. It does not say that every "
        "motion comes to rest: a damper answers a step of the reading with a force of its own, which the "
        "record states beside it."
    ),
    when="with `stability.rest = true`",
    asked=lambda demands, _: demands.rest,
    prove=lambda question, _: Outcome(Verdict.PROVED if rests(question.design) else Verdict.REFUTED, 1),
    cells=lambda cells: _stiffness_over_rest(cells.demands, cells.high) <= 0,
    lost=lambda cells, _: _stiffness_over_rest(cells.demands, cells.low) > 0,
)
