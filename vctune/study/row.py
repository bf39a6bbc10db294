"""Make the row of a solved point. Every number in a row is finite or null."""

from __future__ import annotations

import threading
from dataclasses import asdict
from math import inf, isfinite, pi
from time import perf_counter
from typing import Any

from vctune.design.result import Solved
from vctune.design.solve import solve
from vctune.design.variables import keys_for, point
from vctune.design.verdict.design_record import felt_record
from vctune.design.verdict.judge import Status
from vctune.document.records.rows_json import COLUMN_OF_KEY, QUANTITY_OF_COLUMN
from vctune.model.problem import Problem
from vctune.running import time_limit as limited
from vctune.study.rows import FAILED

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
    numbers |= {"min_ratio": judgement.min_ratio, "worst_hz": judgement.worst / (2 * pi)}
    numbers |= {"peak_sensitivity": judgement.peak_sensitivity}
    numbers |= {"stability_high_hz": problem.stability.band.hz[1]} if problem.passive else {}
    return {
        "status": solved.status.value,
        "idle": judgement.idle,
        "reason": "; ".join(judgement.open_claims) or None,
        **dict.fromkeys(QUANTITY_OF_COLUMN),
        **{name: number if isfinite(number) else None for name, number in numbers.items()},
        **felt_record(problem.device, judgement.gains, judgement.coupling).model_dump(),
        **yardstick,
    }
