"""Examine whether the damping of the hand may change, for designs whose problem does not require the claim."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vctune.design.prepared import problems_beside
from vctune.design.result import Solved
from vctune.design.verdict.judge import Status
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.storage.changing import examine_changing
from vctune.running import OutOfTimeError

EXAMINED = "the proof of changing hands"  # Name of a stage that a time limit may cut short


@np.errstate(all="ignore")
def with_changing(solved: Solved) -> Solved:
    """Return a result that also states whether the damping of the hand may change, if the design is certified in
    hands."""
    problem, judgement = solved.problem, solved.judgement
    hands, stated = problem.hands_met, problem.uncertainty or problem.worlds or problem.changing_hands
    if judgement is None or judgement.status is not Status.CERTIFIED or hands is None or stated is not None:
        return solved
    if problem.device.kind.inverse:
        return solved
    try:
        design = Design(problem.device, judgement.gains, judgement.coupling)
        beside = [other.device for other in problems_beside(problem)]
        return replace(solved, changing=examine_changing(design, hands, beside))
    except OutOfTimeError:
        return replace(solved, cut=(*solved.cut, EXAMINED))
