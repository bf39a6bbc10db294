"""Run a sweep: hand points to the workers, a bounded number at a time, and write their rows to the file."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import asdict, dataclass, field
from math import inf, isfinite
from time import perf_counter
from typing import Any

from vctune.design.judging.judge import Status
from vctune.design.judging.said import open_claims
from vctune.design.records.felt import felt_record
from vctune.design.records.rest import chatter_columns
from vctune.design.records.shake import shake_columns
from vctune.design.result import Solved
from vctune.design.solve import solve
from vctune.design.variables import keys_for, point
from vctune.document.schema.validation import dotted
from vctune.document.study_file import Study
from vctune.document.text.errors import InputError
from vctune.model.problem import Problem
from vctune.running import time_limit as limited
from vctune.study.executors import WorkerPool
from vctune.study.row_record import COLUMN_OF_KEY, FROM_VERDICT, QUANTITY_OF_COLUMN, RowRecord
from vctune.study.rows import FAILED, PointRow, StudyRows, constraints_key, invalid_key, key_of
from vctune.study.study_table import AxisValues, points

# Only one thread at a time solves, because the threads of a process share solvers
_ONE_AT_A_TIME = threading.Lock()


def solve_point(problem: Problem, time_limit: float = inf) -> dict[str, Any]:
    """Solve a point and return the values of its row, the last of which is the duration in seconds."""
    with _ONE_AT_A_TIME, limited(time_limit):
        began = perf_counter()
        try:
            solved = solve(problem)
            content = row_of(solved)
            if solved.cut:
                reasons = [content["reason"]] if content["reason"] else []
                content |= {"reason": "; ".join([*reasons, *(note.line for note in solved.cut_short)])}
                content |= {"status": Status.UNDECIDED.value, "time_limit": time_limit}
        except Exception as error:  # an error in vctune becomes this point's row and does not end the run
            content = row_without_design(FAILED, f"internal error: {type(error).__name__}: {error}")
        return {**content, "seconds": round(perf_counter() - began, 6)}


def row_without_design(status: str, reason: str) -> dict[str, Any]:
    """Return the row of a point without a design."""
    return {"status": status, "idle": False, "reason": reason, **dict.fromkeys(QUANTITY_OF_COLUMN)}


def row_of(solved: Solved) -> dict[str, Any]:
    """Return the row of a solved problem, without its key, its point and its duration."""
    problem, judgement, measured = solved.problem, solved.judgement, solved.problem.transparency
    low, high = measured.band.hz
    yardstick = {"yardstick_low_hz": low, "yardstick_high_hz": high}
    yardstick |= {"reference_impedance": measured.reference_impedance}
    if judgement is None:
        reason = solved.infeasibility.reason if solved.infeasibility else ""
        return {**row_without_design(solved.status.value, reason), **yardstick}
    terms, design = asdict(judgement.transparency), point(judgement.gains, judgement.coupling)
    numbers = {name if name == "error" else f"{name}_term": number for name, number in terms.items()}
    numbers |= {COLUMN_OF_KEY[key]: number for key, number in zip(keys_for(problem), design, strict=True)}
    numbers |= {name: mark.value(judgement) for name, mark in FROM_VERDICT.items()}
    numbers |= {"stability_high_hz": problem.stability.band.hz[1]} if problem.passive else {}
    return {
        "status": solved.status.value,
        "idle": judgement.idle,
        "reason": "; ".join(open_claims(judgement)) or None,
        **dict.fromkeys(QUANTITY_OF_COLUMN),
        **{name: number if number is not None and isfinite(number) else None for name, number in numbers.items()},
        **felt_record(problem.device, judgement.gains, judgement.coupling).model_dump(),
        **chatter_columns(problem, judgement).model_dump(),
        **shake_columns(problem, judgement).model_dump(),
        **yardstick,
    }


INVALID = "invalid"  # Status of a point whose values do not form a valid problem
DIED = "its worker died, and so did the one that tried it again, alone"

# Type of a function that receives the results so far: the points by status, and the best error
OnDone = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class _Task:
    """A point to solve: the key of its row (`rows.key_of`), the values of the axes, and the problem at the point."""

    key: str
    values: AxisValues
    problem: Problem


@dataclass(slots=True)
class _Sweep:
    """The state of a sweep."""

    study: Study  # arguments of `sweep`
    rows: StudyRows
    pool: WorkerPool
    on_done: OnDone
    time_limit: float
    statuses: Counter[str] = field(default_factory=Counter)
    # whether the best certified point buzzes, which counts first, and its error
    best: tuple[bool, float] = (True, inf)
    infeasible: dict[str, PointRow] = field(default_factory=dict)  # results that hold for all weights of the error
    pending: dict[Future[PointRow], _Task] = field(default_factory=dict)  # points at the workers
    retries: list[_Task] = field(default_factory=list)  # points whose worker died


def sweep(
    study: Study, rows: StudyRows, pool: WorkerPool, on_done: OnDone = lambda known: None, time_limit: float = inf
) -> list[str]:
    """Solve every point of a study that has no row yet. Return the key of each point's row, in the study's order."""
    state, keys = _Sweep(study, rows, pool, on_done, time_limit), []
    for values in points(study):
        problem, faults = study.at(values)
        key = invalid_key(study.posed(values)) if problem is None else key_of(problem)
        keys.append(key)
        if key in rows.known:
            _tell(state, rows.known[key])
        elif problem is None:
            reason = "; ".join(f"{dotted(fault.path)}: {fault.message}" for fault in faults)
            _finish(state, key, values, row_without_design(INVALID, reason))
        elif any(key == task.key for task in state.pending.values()):
            _tell(state, {"status": "repeated"})
        else:
            _submit(state, _Task(key, values, problem))
    _collect(state, 0)
    return keys


def _submit(state: _Sweep, task: _Task) -> None:
    """Hand a point to the workers, unless its result is known."""
    _collect(state, state.pool.max_pending - 1)
    if (known := state.infeasible.get(constraints_key(task.problem))) is not None:
        _finish(state, task.key, task.values, {**known, "seconds": 0.0})
        return
    try:
        state.pending[state.pool.executor.submit(solve_point, task.problem, state.time_limit)] = task
    except state.pool.worker_died:
        state.retries.append(task)


def _collect(state: _Sweep, most: int) -> None:
    """Collect finished points until at most the given number is pending. Try points whose worker died again, each
    alone: if its worker dies again, the point is certainly the cause."""
    while len(state.pending) > most or (state.retries and state.pending):
        for future in wait(state.pending, return_when=FIRST_COMPLETED).done:
            _solved(state, state.pending.pop(future), future)
    while state.retries:
        task = state.retries.pop()
        state.pool.renew()
        future = state.pool.executor.submit(solve_point, task.problem, state.time_limit)
        _solved(state, task, future, row_without_design(FAILED, DIED))


def _solved(state: _Sweep, task: _Task, future: Future[PointRow], died: PointRow | None = None) -> None:
    """Wait for a point and write its row. If its worker dies, the row is the given one, or the point is tried again."""
    content = died
    try:
        content = future.result()
    except state.pool.worker_died:
        if died is None:
            state.retries.append(task)
    except state.pool.unreachable as error:
        message = f"the workers are out of reach ({type(error).__name__}); the rows are kept, run again to go on"
        raise InputError.of("executor", "no-workers", message) from None
    if content is not None:
        if content["status"] == Status.INFEASIBLE.value:
            state.infeasible[constraints_key(task.problem)] = content
        _finish(state, task.key, task.values, content)


def _finish(state: _Sweep, key: str, values: AxisValues, content: PointRow) -> None:
    """Write the row of a point."""
    axes = zip(state.study.axes, values, strict=True)
    point = {axis.key: value if isfinite(value) else str(value) for axis, value in axes}
    state.rows.append(RowRecord(key=key, point=point, **content).model_dump(exclude_unset=True))
    _tell(state, content)


def _tell(state: _Sweep, content: PointRow) -> None:
    """Count a further point, and report the results so far."""
    state.statuses[content["status"]] += 1
    if content["status"] == Status.CERTIFIED.value:
        buzzes = (content.get("kicks_moving") or 0) > 0
        state.best = min(state.best, (buzzes, content["error"]))
    counts = sorted(state.statuses.items(), key=lambda each: (-each[1], each[0]))
    known = ", ".join(f"{count} {status}" for status, count in counts)
    buzzes, error = state.best
    best = f"; best error {error:.4g}{', buzzes' if buzzes else ''}"
    state.on_done(known + (best if error < inf else ""))
