"""Find changes of one value of a refuted design: undo an edit, or use the value with the least error.

This module does not solve or judge problems itself; the caller passes functions for that (`RepairTest`).
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
"""Greatest drag of a repair, in units of the reference impedance. This drag alone causes an error of about ten. With
half or twice this limit, vctune only omits or adds designs whose error no user would accept."""


def repair_of(change: ParameterChange, new: float, design: Judgement) -> Repair:
    """Return a change of a value as a repair.

    Parameters
    ----------
    change : change of the value
    new : the new value
    design : the certified design after the change
    """
    error = design.transparency.error
    return Repair(change.key, change.old, new, change.meaning, change.line(new), change.size(new), error)


def edits(problem: Problem, judgement: Judgement, solved: Mapping[str, float]) -> list[ParameterChange]:
    """Return one change for each variable that differs from the solved design, with the solved value as its limit.

    Parameters
    ----------
    problem : problem of the design
    judgement : judgement of the present values
    solved : the variables of the solved design under their keys; may be empty
    """
    given = design_numbers(judgement.kind, judgement.gains, judgement.coupling)
    return [change_of_gain(problem, key, given[key], new) for key, new in solved.items() if new != given[key]]


def undone(pasted: dict[str, Any], changed: Sequence[ParameterChange], test: RepairTest) -> list[Repair]:
    """Undo one edit at a time; return each reversal that gives a certified design, the least error first.

    Parameters
    ----------
    pasted : the problem's document with the present variables of the design
    changed : the edited values, with the values before the edits as limits
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
    """Return the variables of the best design of a problem under their keys; empty if there is none.

    Parameters
    ----------
    stated : the problem's document; the variables of the design that it fixes become free
    judgement : judgement of a design
    test : test of a problem with free variables
    """
    problem = _with_free(stated, judgement, *design_numbers(judgement.kind, judgement.gains, judgement.coupling))
    design = test.verify(problem) if problem is not None and not problem.bounds.fixed else None
    return design_numbers(design.kind, design.gains, design.coupling) if design is not None else {}


def best_values(stated: dict[str, Any], judgement: Judgement, test: RepairTest) -> Iterator[Repair]:
    """Yield for each variable of a design the value with the least error, with the other variables unchanged.

    The function solves the problem with only this variable free, in the range of the file or in the default range. The
    function first tries the variables for which a quick estimate finds a design. If none of these gives a repair, it
    tries the others.

    Parameters
    ----------
    stated : the problem's document
    judgement : judgement of the design
    test : test of problems with one free variable

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
    """Return a problem in which one variable of the design is free and the others are fixed.

    If the variable is the drag and the file states no range for it, the range ends at `MOST_DRAG`.
    """
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
