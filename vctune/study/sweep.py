"""Run a sweep: hand points to the workers, a bounded number at a time, and write their rows to the file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass, field
from math import inf, isfinite
from typing import Any

from vctune.design.verdict.judge import Status
from vctune.document.records.rows_json import RowRecord
from vctune.document.schema.validation import dotted
from vctune.document.study_file import Study
from vctune.document.text.errors import InputError
from vctune.model.problem import Problem
from vctune.study.executors import WorkerPool
from vctune.study.row import row_without_design, solve_point
from vctune.study.rows import FAILED, Rows, constraints_key, invalid_key, key_of
from vctune.study.study_table import Values, points

INVALID = "invalid"  # Status of a point whose values do not form a valid problem
DIED = "its worker died, and so did the one that tried it again, alone"

# Type of a function that receives the results so far: the points by status, and the best error
OnDone = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Task:
    """A point to solve: the key of its row (`rows.key_of`), the values of the axes, and the problem at the point."""

    key: str
    values: Values
    problem: Problem


@dataclass(slots=True)
class _Sweep:
    """The state of a sweep."""

    study: Study  # arguments of `sweep`
    rows: Rows
    pool: WorkerPool
    on_done: OnDone
    time_limit: float
    statuses: Counter[str] = field(default_factory=Counter)
    best: float = inf  # least error of a certified point
    infeasible: dict[str, dict[str, Any]] = field(default_factory=dict)
    pending: dict[Future[dict[str, Any]], Task] = field(default_factory=dict)  # points at the workers
    retries: list[Task] = field(default_factory=list)


def sweep(
    study: Study, rows: Rows, pool: WorkerPool, on_done: OnDone = lambda known: None, time_limit: float = inf
) -> list[str]:
    """Solve every point of a study that has no row yet. Return the key of each point's row, in the study's order."""
    state, keys = _Sweep(study, rows, pool, on_done, time_limit), []
    for values in points(study):
        problem, faults = study.at(values)
        if problem is None:
            key = invalid_key(study.posed(values))
            if key not in rows:
                reason = "; ".join(f"{dotted(fault.path)}: {fault.message}" for fault in faults)
                rows.append(_row(study, key, values, row_without_design(INVALID, reason)))
            _tell(state, {"status": INVALID})
        else:
            key = key_of(problem)
            _submit(state, Task(key, values, problem))
        keys.append(key)
    _collect(state, 0)
    return keys


def _row(study: Study, key: str, values: Values, content: dict[str, Any]) -> dict[str, Any]:
    point = {axis.key: value if isfinite(value) else str(value) for axis, value in zip(study.axes, values, strict=True)}
    return RowRecord(key=key, point=point, **content).model_dump(exclude_unset=True)


def _submit(state: _Sweep, task: Task) -> None:
    """Hand a point to the workers, unless the point has a row or a worker is already solving it."""
    if task.key in state.rows or any(task.key == other.key for other in state.pending.values()):
        _tell(state, next(state.rows.read([task.key]), {}) if task.key in state.rows else {})
        return
    _collect(state, state.pool.max_pending - 1)
    if (known := state.infeasible.get(constraints_key(task.problem))) is not None:
        _finish(state, task, {**known, "seconds": 0.0})
        return
    try:
        state.pending[state.pool.executor.submit(solve_point, task.problem, state.time_limit)] = task
    except state.pool.worker_died:
        state.retries.append(task)


def _collect(state: _Sweep, most: int) -> None:
    """Collect finished points until at most the given number is pending. If the worker of a point died, try the point
    again."""
    while len(state.pending) > most or (state.retries and state.pending):
        for future in wait(state.pending, return_when=FIRST_COMPLETED).done:
            task = state.pending.pop(future)
            content = _content(state.pool, future)
            if content is None:
                state.retries.append(task)
            else:
                _finish(state, task, content)
    while state.retries:
        _try_alone(state, state.retries.pop())


def _try_alone(state: _Sweep, task: Task) -> None:
    """Try a point again without other points. If its worker dies again, the point is certainly the cause."""
    state.pool.renew()
    content = _content(state.pool, state.pool.executor.submit(solve_point, task.problem, state.time_limit))
    _finish(state, task, content or row_without_design(FAILED, DIED))


def _content(pool: WorkerPool, future: Future[dict[str, Any]]) -> dict[str, Any] | None:
    """Wait for a point and return its result; None if its worker died."""
    try:
        return future.result()
    except pool.worker_died:
        return None
    except pool.unreachable as error:
        message = f"the workers are out of reach ({type(error).__name__}); the rows are kept, run again to go on"
        raise InputError.of("executor", "no-workers", message) from None


def _finish(state: _Sweep, task: Task, content: dict[str, Any]) -> None:
    if content["status"] == Status.INFEASIBLE.value:
        state.infeasible[constraints_key(task.problem)] = content
    state.rows.append(_row(state.study, task.key, task.values, content))
    _tell(state, content)


def _tell(state: _Sweep, content: dict[str, Any]) -> None:
    """Count a further point, and report the results so far."""
    state.statuses[content.get("status", "repeated")] += 1
    if content.get("status") == Status.CERTIFIED.value:
        state.best = min(state.best, content["error"])
    counts = sorted(state.statuses.items(), key=lambda each: (-each[1], each[0]))
    known = ", ".join(f"{count} {status}" for status, count in counts)
    state.on_done(known + (f"; best error {state.best:.4g}" if state.best < inf else ""))
