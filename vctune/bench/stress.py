"""Solve thousands of random devices over ten decades, and check every verdict with independent arithmetic."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass, replace
from itertools import product
from statistics import median
from time import process_time
from typing import Any

import numpy as np

from vctune.analysis.demands import sampled_span
from vctune.bench.benchmark import Measured, Panel, Series, Tick
from vctune.bench.evaluator import case_of, cases, sensitivity, stability_ratio, stable, violation
from vctune.design.judging.judge import Judgement, Status
from vctune.design.solve import solve
from vctune.document.reading import problem_at
from vctune.model.problem import Problem, Range
from vctune.study.executors import available_cores, worker_pool

QUICK, FULL = 40, 3000  # Number of devices of a quick run and of a full one
MOST_DELAY = 150.0  # Greatest delay of a device, in samples
PATIENCE = 20.0  # Processor time, s, after which the benchmark records a device as failed
BELOW_NYQUIST = 1e-3  # Least frequency of the grids for |S|, as a share of the Nyquist frequency
FAILED = "failed"
# Number of values of each gain, of values of b_c, and of frequencies of the scan that looks for a design
SCAN_GAINS, SCAN_DAMPING, SCAN_FREQUENCIES = 28, 48, 120
LEAST_SHARE = 1e-9  # Least scanned value above 0 of a variable that may be 0, as a share of its upper bound
SLOWEST = 8  # Number of the slowest devices that the findings name


def device(seed: int, number: int) -> tuple[dict[str, Any], Problem]:
    """Return the device with a given index in the series of a seed, as a document and as a problem."""
    rng = np.random.default_rng((seed, number))
    for _ in range(100):
        document = _document(rng)
        problem, _ = problem_at(document, f"device {number}")
        if problem is not None:
            return document, problem
    raise AssertionError("no random document makes a problem")


def _document(rng: np.random.Generator) -> dict[str, Any]:
    def decades(low: float, high: float) -> float:
        return float(f"{10 ** rng.uniform(low, high):.6g}")

    def chance(share: float) -> bool:
        return bool(rng.random() < share)

    mass, T = decades(-5, 5), decades(-8, 2)
    found: dict[str, Any] = {"mass": mass, "damping": 0.0 if chance(0.1) else mass / T * decades(-8, 2)}
    found |= {"sample_time": T, "hold": "lag" if chance(1 / 3) else "zoh"}
    if chance(0.5):
        found["delay"] = T * min(decades(-8, 2.2), MOST_DELAY)
    document: dict[str, Any] = {"device": found, "stability": {"criterion": "passive"}}
    tau = T / 2 + found.get("delay", 0.0)
    impedance = mass / tau + found["damping"]
    gains: dict[str, Any] = {}
    for name, unit in (("velocity", impedance), ("position", impedance / tau)):
        if chance(0.3):
            low = 0.0 if name == "position" and chance(0.5) else unit * decades(-8, 0)
            gains[name] = {"min": low, "max": max(low, 1e-8 * unit) * decades(0.05, 9)}
    if gains:
        document["gains"] = gains
    if chance(0.4):
        low = min(0.5 / T, 1 / tau) * decades(-9, -1)
        high = min(low * decades(0.05, 9), 0.3 / T)
        document["transparency"] = {"band_hz": [low, high]}
        document["stability"]["band_hz"] = [low * decades(-1, 0), min(high * decades(0, 1), 0.5 / T)]
    if chance(0.2):
        document.setdefault("transparency", {})["norm"] = "peak"
    if chance(0.2):
        document["stability"]["max_sensitivity"] = 1 + decades(-1, 1)
    if chance(0.1):
        document["coupling"] = {"drag": {"min": 0.0, "max": impedance * decades(-4, 2)}}
    return document


@dataclass(frozen=True, slots=True)
class StressRow:
    """The result for one device."""

    number: int  # index of the device in the series
    status: str
    seconds: float  # processor time of the solve, s
    wrong: str  # contradiction between the verdict and the independent evaluation; "" if there is none
    reason: str  # remark on a device that is neither certified nor infeasible, or whose verdict is wrong; else ""
    device: str  # problem of such a device, as JSON; else ""


def measure(quick: bool, seed: int, tick: Tick) -> Measured:
    """Solve and check random devices."""
    count, rows = QUICK if quick else FULL, list[StressRow]()
    with worker_pool("processes", available_cores()) as pool:
        for future in [pool.executor.submit(examined, seed, number) for number in range(count)]:
            rows.append(future.result())
            tick(f"{len(rows)} of {count} devices")
    series = []
    for status in dict.fromkeys(row.status for row in rows):
        times = sorted((row.seconds for row in rows if row.status == status), reverse=True)
        series.append(Series(status, [float(k) for k in range(1, len(times) + 1)], times))
    read = "The picture shows the time of each device by its status, the slowest first."
    panel = Panel("time of each device", "rank", "processor time, s", series)
    return Measured("Devices over ten decades", read, rows, findings(rows), [panel])


def examined(seed: int, number: int) -> StressRow:
    """Solve a device and check the result."""
    document, problem = device(seed, number)
    said, began, wrong = json.dumps(document), process_time(), ""
    try:
        solved = solve(problem)
    except Exception as error:  # a failure becomes a row, because the benchmark looks for failures
        return StressRow(number, FAILED, process_time() - began, "", f"{type(error).__name__}: {error}", said)
    seconds, judgement, status = process_time() - began, solved.judgement, solved.status.value
    if seconds > PATIENCE or (judgement is not None and not np.isfinite(judgement.transparency.error)):
        return StressRow(number, FAILED, seconds, "", "too slow, or the error is no number", said)
    if judgement is not None:
        wrong = contradiction(problem, judgement)
    elif status == "infeasible" and (found := feasible_design(problem)) is not None:
        wrong = f"an independent scan finds {found}"
    if status in ("certified", "infeasible") and not wrong:
        return StressRow(number, status, seconds, "", "", "")
    return StressRow(number, status, seconds, wrong, solved.infeasibility.reason if solved.infeasibility else "", said)


def contradiction(problem: Problem, judgement: Judgement) -> str:
    """Return what the independent evaluator finds against a certified design; "" if there is nothing."""
    if judgement.status is not Status.CERTIFIED:
        return ""
    case = case_of(problem.device, judgement.gains, judgement.coupling)
    missed = violation(problem, case, [judgement.worst, judgement.worst_sensitivity])
    faults = [f"a constraint is violated by {missed:.2g}"] if missed > 0 else []
    return "; ".join([*faults, *([] if stable(case) else ["a pole of the sampled loop lies outside the unit circle"])])


def feasible_design(problem: Problem) -> str | None:
    """Search gains and couplings with the independent evaluator for a design that meets all constraints."""
    bounds, stability = problem.bounds, problem.stability
    omega = np.geomspace(*sampled_span(problem), SCAN_FREQUENCIES)
    upto = np.geomspace(BELOW_NYQUIST * problem.nyquist, problem.nyquist, SCAN_FREQUENCIES)
    b_c = np.array(_log_spaced(bounds.damping, SCAN_DAMPING))
    for K_v, K_p in product(_log_spaced(bounds.velocity, SCAN_GAINS), _log_spaced(bounds.position, SCAN_GAINS)):
        loop = cases(problem.device, (K_v, K_p, 1.0, bounds.mass.max, bounds.drag.max))
        if sensitivity(loop, upto).max() > stability.max_sensitivity:
            continue
        enough = (stability_ratio(replace(loop, b_c=b_c), omega) >= stability.safety_factor).all(axis=1)
        design = replace(loop, b_c=float(b_c[np.argmax(enough)]))
        # the scan evaluates few frequencies, `violation` many
        if enough.any() and stable(loop) and violation(problem, design) == 0:
            return f"{design}"
    return None


def _log_spaced(bounds: Range, count: int) -> list[float]:
    """Return `count` log-spaced values over a range, including its ends, and also 0 if the range begins there."""
    if bounds.fixed:
        return [bounds.min]
    inner = np.geomspace(bounds.min or LEAST_SHARE * bounds.max, bounds.max, count).tolist()
    return [bounds.min, *inner[bounds.min > 0 : -1], bounds.max]


def findings(rows: list[StressRow]) -> list[str]:
    """Return the findings: the results of the devices, and wrong verdicts."""
    counts = Counter(row.status for row in rows)
    shares = ", ".join(f"{status} {count} ({count / len(rows):.2%})" for status, count in counts.most_common())
    wrong = [f"; device {row.number}: {row.wrong}" for row in rows if row.wrong]
    failed = [f"; device {row.number}: {row.reason}" for row in rows if row.status == FAILED]
    slowest = sorted(rows, key=lambda row: -row.seconds)[:SLOWEST]
    named = ", ".join(f"device {row.number} ({row.status}, {row.seconds:.2f} s)" for row in slowest)
    return [
        f"{len(rows)} devices: {shares}.",
        f"Wrong verdicts: {len(wrong)}{''.join(wrong[:3])}.",
        f"Failed (an exception, an error that is no number, or more than {PATIENCE:g} s): {len(failed)}"
        f"{''.join(failed)}.",
        f"Processor time: median {median(row.seconds for row in rows):.3f} s; slowest: {named}.",
    ]
