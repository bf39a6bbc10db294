"""Measure how long an answer takes for random devices with uncertain parameters, under the default criterion."""

from __future__ import annotations

from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations
from math import nan
from statistics import median, quantiles
from time import process_time
from typing import Any

import numpy as np

from vctune.bench.benchmark import Measured, Tick
from vctune.bench.timing import patience
from vctune.design.solve import solve
from vctune.document.reading import pose
from vctune.model.problem import Problem
from vctune.report.figures.benchmark_figures import Panel, Series
from vctune.study.executors import available_cores, worker_pool

QUICK, FULL = 7, 300  # Number of devices of a quick run and of a full one
PATIENCE = 60.0  # Processor time, s, after which the benchmark records a device as late
LATE = "late"
MAX_HALF_WIDTH = 0.9  # Greatest relative half-width of a parameter
NUMBERS = "mass", "damping", "delay"  # Parameters that may be uncertain
# The seven combinations of one to three uncertain parameters
COMBINATIONS = tuple(some for count in (1, 2, 3) for some in combinations(NUMBERS, count))


@dataclass(frozen=True, slots=True)
class Row:
    """The result for one device."""

    number: int  # index of the device in the series
    mass: float  # nominal parameters of the device, SI units
    damping: float
    sample_time: float
    delay: float
    uncertain: str  # the uncertain parameters with their relative half-widths, in words
    status: str  # a value of `Status`, or "late" if there is no answer within `PATIENCE`
    seconds: float  # processor time of the solve, s
    error: float  # greatest error of the design at the vertices of the box; nan if there is no design


def measure(quick: bool, seed: int, tick: Tick) -> Measured:
    """Solve random uncertain devices."""
    count, rows = QUICK if quick else FULL, list[Row]()
    with worker_pool("processes", available_cores()) as pool:
        for future in [pool.executor.submit(solved, seed, number) for number in range(count)]:
            rows.append(future.result())
            tick(f"{len(rows)} of {count} devices")
    return Measured(
        "Uncertain devices under the default criterion",
        "The time of each device, by its status.",
        rows,
        facts(rows),
        panels(rows),
    )


def drawn(seed: int, number: int) -> tuple[dict[str, Any], Problem]:
    """Return the device with a given index in the series of a seed, as a document and as a problem."""
    rng = np.random.default_rng((seed, number))

    def between(low: float, high: float) -> float:
        return float(f"{np.exp(rng.uniform(np.log(low), np.log(high))):.4g}")

    T = between(2e-4, 4e-3)
    device = {"mass": between(0.05, 5.0), "damping": between(0.05, 10.0), "sample_time": T}
    device["delay"] = float(f"{T * between(0.1, 5.0):.4g}")
    uncertain_numbers = COMBINATIONS[number % len(COMBINATIONS)]
    document = {"device": device, "uncertainty": {key: between(0.02, MAX_HALF_WIDTH) for key in uncertain_numbers}}
    problem, faults = pose(document, f"device {number}")
    assert problem is not None, faults
    return document, problem


def solved(seed: int, number: int) -> Row:
    """Solve a device."""
    document, problem = drawn(seed, number)
    uncertain = ", ".join(f"{key} {width:g}" for key, width in document["uncertainty"].items())
    status, error, began = LATE, nan, process_time()
    with suppress(TimeoutError), patience(PATIENCE):
        solution = solve(problem)
        status, error = solution.status.value, nan if solution.judgement is None else solution.judgement.error
    seconds = process_time() - began
    return Row(number, **document["device"], uncertain=uncertain, status=status, seconds=seconds, error=error)


def facts(rows: list[Row]) -> list[str]:
    """Return findings on the devices' results and times."""
    counts = Counter(row.status for row in rows)
    shares = ", ".join(f"{status} {count} ({count / len(rows):.1%})" for status, count in counts.most_common())
    times, slowest = sorted(row.seconds for row in rows), max(rows, key=lambda row: row.seconds)
    slowest_twentieth = quantiles(times, n=20, method="inclusive")[-1]
    return [
        f"{len(rows)} devices, each with one to three uncertain numbers within {MAX_HALF_WIDTH:g} of themselves: "
        f"{shares}; late means no answer within {PATIENCE:g} s.",
        f"Processor time: median {median(times):.2f} s, 95 % within {slowest_twentieth:.1f} s, "
        f"longest {slowest.seconds:.1f} s (device {slowest.number}, uncertain {slowest.uncertain}).",
    ]


def panels(rows: list[Row]) -> list[Panel]:
    """Draw the times of each status in descending order."""
    series = []
    for status in dict.fromkeys(row.status for row in rows):
        times = sorted((row.seconds for row in rows if row.status == status), reverse=True)
        series.append(Series(status, [float(k) for k in range(1, len(times) + 1)], times))
    return [Panel("time of each device", "rank", "processor time, s", series)]
