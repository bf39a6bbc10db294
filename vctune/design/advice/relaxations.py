"""Find what a certified design of little use costs: the same problem with one demand or bound relaxed, solved again."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from vctune.analysis.demands import transparency_error
from vctune.design.judging.judge import Judgement, Status
from vctune.design.result import Relaxation, Solved
from vctune.design.solve import solve
from vctune.design.variables import touched
from vctune.document.reading import ProblemFile, problem_at
from vctune.document.schema.validation import KeyPath
from vctune.document.text import toml
from vctune.document.text.toml import number_at, placed
from vctune.model.problem import Problem
from vctune.running import OutOfTimeError, time_limit

RELAXATIONS = "the relaxations"  # Name of a stage that a time limit may cut short
MOST_SECONDS = 10.0  # of the solution of one relaxed problem
WIDER = 10.0  # Factor by which the bound of a range is moved
WORTH = 0.95  # Greatest error of a relaxed design worth telling, over that of the design

Progress = Callable[[str], None]


def is_of_little_use(judgement: Judgement) -> bool:
    """Return whether a certified design holds no static force or hardly uses its velocity loop."""
    return judgement.status is Status.CERTIFIED and (judgement.idle or judgement.limp)


def with_relaxations(file: ProblemFile, solved: Solved, progress: Progress = lambda stage: None) -> Solved:
    """Return the result of a problem, if its design is of little use with the relaxations after which the error, on the
    same yardstick, is less and the design is of more use, the best first."""
    judgement, problem = solved.judgement, solved.problem
    if judgement is None or problem.bounds.fixed or not is_of_little_use(judgement):
        return solved
    document = toml.parse(file.text, problem.name)
    relaxations = list[Relaxation]()
    try:
        for needs, relaxed in _relaxed(document, problem, judgement):
            progress(f"relaxing: {needs}")
            with time_limit(MOST_SECONDS):
                other = solve(relaxed, exhaustive=False).judgement
            if other is None or other.status is not Status.CERTIFIED:
                continue
            error = transparency_error(problem, other.gains, other.coupling).error
            if error < WORTH * judgement.error and not is_of_little_use(other):
                relaxations.append(Relaxation(needs=needs, error=error, instead_of=judgement.error))
    except OutOfTimeError:
        solved = replace(solved, cut=(*solved.cut, RELAXATIONS))
    return replace(solved, relaxations=sorted(relaxations, key=lambda relaxation: relaxation.error))


def _relaxed(document: dict[str, Any], problem: Problem, judgement: Judgement) -> Iterator[tuple[str, Problem]]:
    """Yield the lines of a problem file that relax a demand or a bound, with the problem that has this line."""
    changes = list[tuple[str, KeyPath, Any]]()
    if problem.stability.criterion in ("passive", "both"):
        changes.append(('stability.criterion = "hands"', ("stability", "criterion"), "hands"))
    for key, side in touched(problem, judgement.gains, judgement.coupling):
        table, name = key.split(".")
        end = "max" if side == "upper" else "min"
        if number_at(document, table, name, end) is not None:
            bounds = getattr(problem.bounds, name)
            wider = bounds.max * WIDER if side == "upper" else bounds.min / WIDER
            changes.append((f"{key}.{end} = {wider:g}", (table, name, end), wider))
    drag = problem.bounds.drag
    if drag.fixed and drag.min == 0 and problem.device.kind.own_loop and not problem.device.kind.inverse:
        most = problem.transparency.reference_impedance
        needs = f"coupling.drag = {{ min = 0.0, max = {most:.3g} }}"
        changes.append((needs, ("coupling", "drag"), {"min": 0.0, "max": float(f"{most:.3g}")}))
    for needs, path, value in changes:
        relaxed, _ = problem_at(placed(document, ((path, value),)), "")
        if relaxed is not None:
            yield needs, relaxed
