"""The loop of a sweep: points out to the workers, rows back into the file, a bounded number of them under way."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

from vctune.document.errors import InputError, Mistake
from vctune.document.study import Study
from vctune.document.validation import dotted
from vctune.model.problem import Problem
from vctune.study.executors import Crew
from vctune.study.outcome import nothing, work
from vctune.study.points import Values, points
from vctune.study.rows import FAILED, Rows, invalid_key, key_of

INVALID = "invalid"
"""Status of a point at which the numbers make no problem."""
DIED = "its worker died, and so did the one that tried it again, alone"

Tick = Callable[[], None]


@dataclass(frozen=True, slots=True)
class Task:
    """A point to solve."""

    key: str
    values: Values
    problem: Problem


@dataclass(slots=True)
class _Sweep:
    """Where a sweep stands.

    Attributes
    ----------
    pending : points that workers have
    suspects : points whose worker died, or one that shared its pool
    """

    study: Study
    rows: Rows
    crew: Crew
    tick: Tick
    pending: dict[Future[dict[str, Any]], Task] = field(default_factory=dict)
    suspects: list[Task] = field(default_factory=list)


def sweep(study: Study, rows: Rows, crew: Crew, tick: Tick = lambda: None) -> list[str]:
    """Solve every point of a study that has no row yet; return the key of each point's row, in the study's order.

    Parameters
    ----------
    study : what to solve
    rows : what is there, and where to put the rest
    crew : workers
    tick : called once a point

    Raises
    ------
    InputError
        If the file of rows cannot grow or all workers are out of reach; finished points stay finished.
    """
    state, keys = _Sweep(study, rows, crew, tick), []
    for values in points(study):
        problem, faults = study.at(values)
        if problem is None:
            key = invalid_key(study.posed(values))
            if key not in rows:
                reason = "; ".join(f"{dotted(path)}: {message}" for path, message in faults)
                rows.append(_row(study, key, values, nothing(INVALID, reason)))
            tick()
        else:
            key = key_of(problem)
            _hand_out(state, Task(key, values, problem))
        keys.append(key)
    _settle(state, 0)
    return keys


def _row(study: Study, key: str, values: Values, content: dict[str, Any]) -> dict[str, Any]:
    point = {axis.key: value if isfinite(value) else str(value) for axis, value in zip(study.axes, values, strict=True)}
    return {"key": key, "point": point, **content}


def _hand_out(state: _Sweep, task: Task) -> None:
    """Give a point to the workers unless it has a row or is under way."""
    if task.key in state.rows or any(task.key == other.key for other in state.pending.values()):
        state.tick()
        return
    _settle(state, state.crew.ahead - 1)
    try:
        state.pending[state.crew.executor.submit(work, task.problem)] = task
    except state.crew.lost:
        state.suspects.append(task)


def _settle(state: _Sweep, most: int) -> None:
    """Collect finished points until at most so many are under way; those that lost their worker are tried again."""
    while len(state.pending) > most or (state.suspects and state.pending):
        for future in wait(state.pending, return_when=FIRST_COMPLETED).done:
            task = state.pending.pop(future)
            content = _content(state.crew, future)
            if content is None:
                state.suspects.append(task)
            else:
                _finish(state, task, content)
    while state.suspects:
        _try_alone(state, state.suspects.pop())


def _try_alone(state: _Sweep, task: Task) -> None:
    """Try a point again with nothing else under way, so that a second death is its own doing."""
    state.crew.renew()
    content = _content(state.crew, state.crew.executor.submit(work, task.problem))
    _finish(state, task, content or nothing(FAILED, DIED))


def _content(crew: Crew, future: Future[dict[str, Any]]) -> dict[str, Any] | None:
    """Wait for a point and return what came of it, None if its worker died."""
    try:
        return future.result()
    except crew.lost:
        return None
    except crew.gone as error:
        message = f"the workers are out of reach ({type(error).__name__}); the rows are kept, run again to go on"
        raise InputError("--executor", [Mistake("", message)]) from None


def _finish(state: _Sweep, task: Task, content: dict[str, Any]) -> None:
    state.rows.append(_row(state.study, task.key, task.values, content))
    state.tick()
