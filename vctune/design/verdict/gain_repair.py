"""Find changes of one value of a refuted design: undo an edit, or use the value with the least error."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from typing import Any

from vctune.design.result import Repair
from vctune.design.verdict.judge import Judgement
from vctune.design.verdict.parameter_changes import ParameterChange, change_of_gain
from vctune.design.verdict.trial import RepairTest
from vctune.document.gains_file import design_numbers, design_tables
from vctune.document.reading import pose
from vctune.model.problem import Problem, Range
from vctune.running import check_time

MOST_DRAG = 10.0  # Greatest drag of a repair, in units of the reference impedance


def repair_of(change: ParameterChange, new: float, design: Judgement) -> Repair:
    """Return a change of a value as a repair."""
    error = design.transparency.error
    return Repair(change.key, change.old, new, change.meaning, change.line(new), change.size(new), error)


def edits(problem: Problem, judgement: Judgement, solved: Mapping[str, float]) -> list[ParameterChange]:
    """Return one change for each variable that differs from the solved design, with the solved value as its limit."""
    given = design_numbers(judgement.kind, judgement.gains, judgement.coupling)
    return [change_of_gain(problem, key, given[key], new) for key, new in solved.items() if new != given[key]]


def undone(pasted: dict[str, Any], changed: Sequence[ParameterChange], test: RepairTest) -> list[Repair]:
    """Undo one edit at a time; return each reversal that gives a certified design, the least error first."""
    found = []
    for change in changed:
        design = _verified(change.applied(pasted, change.limit), test)
        found += [repair_of(change, change.limit, design)] if design is not None else []
    return sorted(found, key=lambda repair: repair.rank)


def undone_together(pasted: dict[str, Any], changed: Sequence[ParameterChange], test: RepairTest) -> bool:
    """Return whether undoing all edits leads to a certified design."""
    document = reduce(lambda document, change: change.applied(document, change.limit), changed, pasted)
    return _verified(document, test) is not None


def solved_numbers(stated: dict[str, Any], judgement: Judgement, test: RepairTest) -> dict[str, float]:
    """Return the variables of the best design of a problem under their keys; empty if there is none."""
    problem = _with_free(stated, judgement, *design_numbers(judgement.kind, judgement.gains, judgement.coupling))
    design = test.verify(problem) if problem is not None and not problem.bounds.fixed else None
    return design_numbers(design.kind, design.gains, design.coupling) if design is not None else {}


def best_values(stated: dict[str, Any], judgement: Judgement, test: RepairTest) -> Iterator[Repair]:
    """Yield for each variable of a design the value with the least error, with the other variables unchanged."""
    posed = {key: _with_one_free(stated, judgement, key) for key in judgement.kind.stated}
    free = {key: each for key, each in posed.items() if each is not None and not each.bounds.fixed}
    hopeful = {key: each for key, each in free.items() if test.estimate(each)}
    found = False
    for repair in _solved(hopeful, judgement, test):
        found = True
        yield repair
    if not found:
        yield from _solved({key: each for key, each in free.items() if key not in hopeful}, judgement, test)


def _solved(free: dict[str, Problem], judgement: Judgement, test: RepairTest) -> Iterator[Repair]:
    for key, problem in free.items():
        check_time()
        design = test.verify(problem)
        if design is not None:
            old, new = (design_numbers(each.kind, each.gains, each.coupling)[key] for each in (judgement, design))
            yield repair_of(change_of_gain(problem, key, old, new), new, design)


def _with_one_free(stated: dict[str, Any], judgement: Judgement, key: str) -> Problem | None:
    """Return a problem in which one variable of the design is free and the others are fixed."""
    problem = _with_free(stated, judgement, key)
    if problem is None or key != "coupling.drag" or not problem.bounds.fixed:
        return problem
    wide = Range(0.0, MOST_DRAG * problem.transparency.reference_impedance)
    return replace(problem, bounds=replace(problem.bounds, drag=wide))


def _with_free(stated: dict[str, Any], judgement: Judgement, *keys: str) -> Problem | None:
    """Return a problem in which some variables of the design are free and the others fixed; None if it is not valid."""
    tables: dict[str, dict[str, Any]] = design_tables(judgement.kind, judgement.gains, judgement.coupling)
    for table, name in (key.split(".") for key in keys):
        del tables[table][name]
        bounds = stated.get(table, {}).get(name)
        tables[table] |= {name: bounds} if isinstance(bounds, dict) else {}
    return pose(stated | tables, "")[0]


def _verified(document: dict[str, Any], test: RepairTest) -> Judgement | None:
    check_time()
    problem, _ = pose(document, "")
    return test.verify(problem) if problem is not None else None
