"""Choose the number of a refuted design to change: an edited one, or the one that leaves the least error.

This module neither solves nor judges: the caller passes the functions (`RepairTest`).
"""

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

MOST_DRAG = 10.0
"""Greatest drag that is tried, in units of the reference impedance; alone it causes an error of about ten. Half and
twice this drag omit, or add, designs that nobody wants to feel."""


def repair_of(change: ParameterChange, new: float, design: Judgement) -> Repair:
    """Return a change of a number as a repair.

    Parameters
    ----------
    change : change of the number
    new : its new value
    design : the certified design that it leads to
    """
    error = design.transparency.error
    return Repair(change.key, change.old, new, change.meaning, change.line(new), change.size(new), error)


def edits(problem: Problem, judgement: Judgement, solved: Mapping[str, float]) -> list[ParameterChange]:
    """Return the changes that take single numbers back to a solved design, whose numbers are their limits.

    Parameters
    ----------
    problem : problem of the design
    judgement : judgement of the numbers as they are
    solved : the numbers of the solved design by their keys; may be empty
    """
    given = design_numbers(judgement.kind, judgement.gains, judgement.coupling)
    return [change_of_gain(problem, key, given[key], new) for key, new in solved.items() if new != given[key]]


def undone(pasted: dict[str, Any], changed: Sequence[ParameterChange], test: RepairTest) -> list[Repair]:
    """Return the edits that, undone one at a time, give a certified design, the least error first.

    Parameters
    ----------
    pasted : the problem's document with the numbers as they are
    changed : the edited numbers
    test : test of changed problems
    """
    found = []
    for change in changed:
        design = _verified(change.applied(pasted, change.limit), test)
        found += [repair_of(change, change.limit, design)] if design is not None else []
    return sorted(found, key=lambda repair: repair.rank)


def undone_together(pasted: dict[str, Any], changed: Sequence[ParameterChange], test: RepairTest) -> bool:
    """Return whether undoing all edits leads to a certified design.

    Parameters
    ----------
    pasted, changed, test : see `undone`
    """
    document = reduce(lambda document, change: change.applied(document, change.limit), changed, pasted)
    return _verified(document, test) is not None


def solved_numbers(stated: dict[str, Any], judgement: Judgement, test: RepairTest) -> dict[str, float]:
    """Return the numbers of a problem's solution by their keys; empty if there is none.

    Parameters
    ----------
    stated : the problem's document; its fixed numbers become free
    judgement : judgement of a design
    test : test of a problem with free numbers
    """
    problem = _with_free(stated, judgement, *design_numbers(judgement.kind, judgement.gains, judgement.coupling))
    design = test.verify(problem) if problem is not None and not problem.bounds.fixed else None
    return design_numbers(design.kind, design.gains, design.coupling) if design is not None else {}


def best_values(stated: dict[str, Any], judgement: Judgement, test: RepairTest) -> Iterator[Repair]:
    """Yield for each number of a design its value with the least error while the others stay.

    The search solves the problem with that number alone free, in the range that the file states or in the default
    range. If the first estimate rejects all numbers, the search tries all of them nevertheless.

    Parameters
    ----------
    stated : the problem's document
    judgement : judgement of the design
    test : test of problems with one free number

    Raises
    ------
    OutOfTimeError
        If the time limit ends the search.
    """
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
    """Return a problem whose design is fixed except for one number, including a drag that is 0 by default."""
    problem = _with_free(stated, judgement, key)
    if problem is None or key != "coupling.drag" or not problem.bounds.fixed:
        return problem
    wide = Range(0.0, MOST_DRAG * problem.transparency.reference_impedance)
    return replace(problem, bounds=replace(problem.bounds, drag=wide))


def _with_free(stated: dict[str, Any], judgement: Judgement, *keys: str) -> Problem | None:
    """Return a problem whose design is fixed except for some numbers; None if this contradicts another key."""
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
