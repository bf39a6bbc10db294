"""Solve thousands of devices over ten decades, and check every verdict with independent arithmetic."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass, replace
from itertools import product
from math import inf, nan, pi
from statistics import median
from time import process_time

import numpy as np

from vctune.analysis import demands
from vctune.bench.benchmark import Measured, Tick
from vctune.bench.devices import device
from vctune.bench.evaluator import case_of, cases, sensitivity, spectral_radius, stability_ratio, violation
from vctune.bench.peers import need
from vctune.bench.timing import patience
from vctune.design.solve import solve
from vctune.design.verdict.judge import Judgement
from vctune.model.problem import Problem, Range
from vctune.report.benchmark_figure import Panel, Series
from vctune.study.executors import available_cores, worker_pool

QUICK, FULL = 40, 3000  # Number of devices of a quick run and of a full one
PATIENCE = 20.0  # Processor time, s, after which the benchmark records a device as failed
# Number of frequencies, log-spaced over each band, at which the benchmark checks a design with 50 digits
FREQUENCIES = 40
BELOW_NYQUIST = 1e-3  # Least frequency of the grids for |S|, as a share of the Nyquist frequency
FAILED = "failed"
# Number of values of each gain, of values of b_c, and of frequencies of the scan that looks for a design
SCAN_GAINS, SCAN_DAMPING, SCAN_FREQUENCIES = 28, 48, 120
INSIDE_CIRCLE = 1 - 1e-9  # Spectral radius below which the scan regards a loop as stable
# Least relative error in the picture, which also represents an error of 0 on the logarithmic axis
LEAST_DRAWN_ERROR = 1e-17
LEAST_SHARE = 1e-9  # Least scanned value above 0 of a variable that may be 0, as a share of its upper bound
SLOWEST = 8  # Number of the slowest devices that the findings name


@dataclass(frozen=True, slots=True)
class Row:
    """The result for one device."""

    number: int  # index of the device in the series
    status: str
    seconds: float  # processor time of the solve, s
    wrong: str  # contradiction between the verdict and the independent evaluation; "" if there is none
    float_error: float
    reason: str  # remark on a device that is neither certified nor infeasible, or whose verdict is wrong; else ""
    device: str  # problem of such a device, as JSON; else ""


def measure(quick: bool, seed: int, tick: Tick) -> Measured:
    """Solve and check random devices."""
    need("mpmath")
    count = QUICK if quick else FULL
    rows = []
    with worker_pool("processes", available_cores()) as pool:
        for future in [pool.executor.submit(examined, seed, number) for number in range(count)]:
            rows.append(future.result())
            tick(f"{len(rows)} of {count} devices")
    return Measured(
        "Devices over ten decades",
        "The left panel shows the time of each device, by its status. The right panel shows the largest relative error "
        "of the double precision formulas at the frequencies that were checked with 50 digits.",
        rows,
        findings(rows),
        panels_of(rows),
    )


def examined(seed: int, number: int) -> Row:
    """Solve a device and check the result."""
    document, problem = device(seed, number)
    device_text, began = json.dumps(document), process_time()
    try:
        with patience(PATIENCE):
            solved = solve(problem)
    except Exception as error:  # a failure becomes a row, because the benchmark looks for failures
        return Row(number, FAILED, process_time() - began, "", nan, f"{type(error).__name__}: {error}", device_text)
    seconds, judgement = process_time() - began, solved.judgement
    reason = solved.infeasibility.reason if solved.infeasibility else ""
    wrong, float_error = "", nan
    if judgement is not None:
        if not np.isfinite(judgement.transparency.error):
            return Row(number, FAILED, seconds, "", nan, "the error is no number", device_text)
        wrong, float_error = contradiction(problem, judgement)
    elif solved.status.value == "infeasible":
        design_found = feasible_design(problem)
        wrong = "" if design_found is None else f"an independent scan finds {design_found}"
    if solved.status.value in ("certified", "infeasible") and not wrong:
        reason = device_text = ""
    return Row(number, solved.status.value, seconds, wrong, float_error, reason, device_text)


def contradiction(problem: Problem, judgement: Judgement) -> tuple[str, float]:
    """Check a design with 50 digits."""
    from vctune.bench import digits

    case = case_of(problem.device, judgement.gains, judgement.coupling)
    safety_factor, faults = problem.stability.safety_factor, []
    stability_grid = [*np.geomspace(*demands.sampled_span(problem), FREQUENCIES), judgement.worst]
    sensitivity_grid = [
        *np.geomspace(BELOW_NYQUIST * problem.nyquist, problem.nyquist, FREQUENCIES),
        judgement.worst_sensitivity,
    ]
    largest = 0.0
    for omega in (w for w in {*map(float, stability_grid), *map(float, sensitivity_grid)} if 0 < w < inf):
        exact = digits.exact(case, omega)
        doubles = _in_double_precision(problem, judgement, omega)
        defined = omega in stability_grid and exact.resistance > 0
        with_50_digits = exact.admittance, exact.tracking, exact.coupling, exact.ratio if defined else 0
        pairs = zip(doubles, with_50_digits, strict=True)
        comparable = [(double, exactly) for double, exactly in pairs if exactly and np.isfinite(double)]
        largest = max([largest, *(float(abs(double - exactly) / abs(exactly)) for double, exactly in comparable)])
        if omega in stability_grid and not (exact.resistance > 0 and exact.ratio >= safety_factor):
            faults.append(f"Re Z_c/R is {float(exact.ratio):.9g} at {omega / (2 * pi):.6g} Hz")
        if omega in sensitivity_grid and omega <= problem.nyquist:
            S = digits.sensitivity(case, omega)
            if problem.stability.max_sensitivity < S:
                faults.append(f"|S| is {float(S):.9g} at {omega / (2 * pi):.6g} Hz")
    if not digits.stable(case):
        faults.append("a pole of the sampled loop lies outside the unit circle")
    return "; ".join(faults) if judgement.status.value == "certified" else "", largest


def _in_double_precision(problem: Problem, judgement: Judgement, omega: float) -> tuple[float, float, float, float]:
    """Return |G_hh| [m/(N s)], |1 - G_he|, |Z_c| [N s/m] and Re Z_c/R from the model's formulas in double precision."""
    at, Z_0 = np.array([omega]), problem.transparency.reference_impedance
    terms = demands.error_terms(problem, judgement.gains, judgement.coupling, at)
    admittance, tracking, coupling = (float(np.sqrt(x[0])) for x in (terms.admittance, terms.tracking, terms.coupling))
    ratio = demands.stability_ratio(problem.device, judgement.gains, judgement.coupling, at)
    return admittance / Z_0, tracking, coupling * Z_0, float(ratio[0])


def feasible_design(problem: Problem) -> str | None:
    """Search gains and couplings with the independent evaluator. Return a design that meets all constraints, as
    text."""
    bounds, stability = problem.bounds, problem.stability
    omega = np.geomspace(*demands.sampled_span(problem), SCAN_FREQUENCIES)
    sensitivity_grid = np.geomspace(BELOW_NYQUIST * problem.nyquist, problem.nyquist, SCAN_FREQUENCIES)
    b_c = np.array(_log_spaced(bounds.damping, SCAN_DAMPING))
    for K_v, K_p in product(_log_spaced(bounds.velocity, SCAN_GAINS), _log_spaced(bounds.position, SCAN_GAINS)):
        loop = cases(problem.device, (K_v, K_p, 1.0, bounds.mass.max, bounds.drag.max))
        if sensitivity(loop, sensitivity_grid).max() > stability.max_sensitivity:
            continue
        stable_enough = (stability_ratio(replace(loop, b_c=b_c), omega) >= stability.safety_factor).all(axis=1)
        if stable_enough.any() and spectral_radius(loop) < INSIDE_CIRCLE:
            design = replace(loop, b_c=float(b_c[np.argmax(stable_enough)]))
            if violation(problem, design) == 0:  # the scan evaluates few frequencies; this check evaluates many
                return f"{design}"
    return None


def _log_spaced(bounds: Range, count: int) -> list[float]:
    """Return `count` log-spaced values over a range, including its ends, and also 0 if the range begins there."""
    if bounds.fixed:
        return [bounds.min]
    if bounds.min > 0:
        inner = np.geomspace(bounds.min, bounds.max, count)
        return [bounds.min, *(float(x) for x in inner[1:-1]), bounds.max]
    return [0.0, *(float(x) for x in np.geomspace(LEAST_SHARE * bounds.max, bounds.max, count))]


def findings(rows: list[Row]) -> list[str]:
    """Return the findings: the results of the devices, and wrong verdicts."""
    counts = Counter(row.status for row in rows)
    shares = ", ".join(f"{status} {count} ({count / len(rows):.2%})" for status, count in counts.most_common())
    wrong = [row for row in rows if row.wrong]
    with_error = [row for row in rows if not np.isnan(row.float_error)]
    worst = max(with_error, key=lambda row: row.float_error, default=None)
    sentences = [
        f"{len(rows)} devices: {shares}.",
        f"Wrong verdicts: {len(wrong)}" + "".join(f"; device {row.number}: {row.wrong}" for row in wrong[:3]) + ".",
        f"Failed (tracebacks, numbers that are not finite, no answer within {PATIENCE:g} s): {counts[FAILED]}"
        + "".join(f"; device {row.number}: {row.reason}" for row in rows if row.status == FAILED)
        + ".",
    ]
    if worst is not None:
        sentences.append(
            f"Largest relative error of the float formulas against 50 digits: {worst.float_error:.2g} (device "
            f"{worst.number}); median of the devices' largest {median(row.float_error for row in with_error):.2g}."
        )
    slowest = sorted(rows, key=lambda row: -row.seconds)[:SLOWEST]
    slowest_text = ", ".join(f"device {row.number} ({row.status}, {row.seconds:.2f} s)" for row in slowest)
    return [*sentences, f"Processor time: median {median(row.seconds for row in rows):.3f} s; slowest: {slowest_text}."]


def panels_of(rows: list[Row]) -> list[Panel]:
    """Draw the times and the errors of the float formulas, each in descending order."""
    series = []
    for status in dict.fromkeys(row.status for row in rows):
        times = sorted((row.seconds for row in rows if row.status == status), reverse=True)
        series.append(Series(status, [float(k) for k in range(1, len(times) + 1)], times))
    errors = sorted((max(row.float_error, LEAST_DRAWN_ERROR) for row in rows if row.float_error >= 0), reverse=True)
    ranks = [float(k) for k in range(1, len(errors) + 1)]
    return [
        Panel("time of each device", "rank", "processor time, s", series),
        Panel("float formulas", "rank", "largest relative error", [Series("devices with a design", ranks, errors)]),
    ]
