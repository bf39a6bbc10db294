"""Tell what a servo's design would win if the division of its latency into delay and lag were measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import exp, log

import numpy as np

from vctune.analysis.extrema import last_to_hold
from vctune.analysis.multiples import ratio_in_these
from vctune.design.advice.repair import hands_of
from vctune.design.judging.judge import Judgement, Status
from vctune.design.result import Solved
from vctune.document.text.errors import Note
from vctune.model.device import Device
from vctune.model.gains import Coupling
from vctune.running import OutOfTimeError, check_time

DIVISION = "the worth of a known latency"  # Name of a stage that a time limit may cut short
LEAST_DRAG = 1e-3  # Least drag that is tried, over that of the design
HALVINGS = 10
WORTH = 0.97  # Greatest drag worth telling, over that of the design

Progress = Callable[[str], None]


def with_known_division(solved: Solved, progress: Progress = lambda stage: None) -> Solved:
    """Return the result of a servo of which only the latency is known with a note on the drag that each division of the
    latency alone would need."""
    judgement, problem = solved.judgement, solved.problem
    if judgement is None or judgement.status is not Status.CERTIFIED or not problem.device.divided:
        return solved
    coupling = judgement.coupling
    if problem.bounds.drag.fixed or not isinstance(coupling, Coupling):
        return solved
    progress("dividing the latency")
    try:
        devices = dict.fromkeys(case.device for case in judgement.posed.hand_cases)
        drags = [_least_drag(judgement, coupling, device) for device in devices]
    except OutOfTimeError:
        return replace(solved, cut=(*solved.cut, DIVISION))
    least, most = min(drags), max(drags)
    if least > WORTH * coupling.drag:
        return solved
    unit = problem.units.damping
    said = (
        f"with the division of the latency known, which `vctune identify --servo` measures, a drag of {least:.3g} to "
        f"{most:.3g} {unit} would do with this mass instead of {coupling.drag:.3g} (estimated)"
    )
    return replace(solved, notes=[*solved.notes, Note("warn-latency", said)])


@np.errstate(all="ignore")
def _least_drag(judgement: Judgement, coupling: Coupling, device: Device) -> float:
    """Return the least drag, up to that of the design, with which one division of the latency keeps the safety
    factor."""
    problem = judgement.posed.problem
    hands = list(dict.fromkeys([*problem.hands.corners, problem.hands.middle, *hands_of(judgement)]))
    drag = float(coupling.drag)

    def holds(log_drag: float) -> bool:
        check_time()
        lighter = replace(coupling, drag=exp(log_drag))
        ratio = ratio_in_these(device, hands, judgement.gains, lighter, problem.worlds)
        return ratio >= problem.stability.safety_factor

    lowest = log(drag * LEAST_DRAG)
    return exp(lowest) if holds(lowest) else exp(last_to_hold(holds, log(drag), lowest, HALVINGS))
