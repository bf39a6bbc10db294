"""The sentence of a page on whether the damping of the hand may change."""

from __future__ import annotations

from vctune.document.records.design_json import DesignRecord
from vctune.model.problem import Problem
from vctune.report.typography import quantity

ASK = "stability.changing = “damping” requests a longer proof."


def changing_lines(record: DesignRecord, problem: Problem) -> list[str]:
    """Return a sentence on whether the damping of the hand may change."""
    if problem.hands_met is None or problem.changing_hands is not None or record.status != "certified":
        return []
    found = record.changing
    if found is None:
        can = problem.worlds is None and not problem.device.kind.inverse
        return ["vctune did not examine hands that change while they hold the handle" + (f"; {ASK}" if can else ".")]
    if found.verdict != "proved":
        return [f"vctune did not prove that the damping of the hand may change at every sample; {ASK}"]
    least = found.within.low.mass
    heavy = f", for M ≥ {quantity(least, problem.units.mass)}" if least else ""
    return [
        f"In addition, the damping of the hand may change at every sample{heavy}. Mass and stiffness do not change. "
        "The storage function that proves it is in design.json."
    ]
