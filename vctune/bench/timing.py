"""Time on a machine that others use too: processor time, the middle of repeats, ratios within pairs."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median
from time import process_time
from typing import TypeVar

Made = TypeVar("Made")


@dataclass(frozen=True, slots=True)
class Pace:
    """How two pieces of work compare when they take turns.

    Attributes
    ----------
    first, second : median processor time of each, s
    ratio : median of second/first over the pairs
    """

    first: float
    second: float
    ratio: float


def machine() -> str:
    """Return what this machine is, in a line."""
    model = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo") as file:
            named = [line.partition(":")[2].strip() for line in file if line.startswith("model name")]
    except OSError:
        named = []
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    busy = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    system = f"{platform.system()} {platform.machine()}, Python {platform.python_version()}"
    return f"{named[0] if named else model}, {cores} cores, {system}{busy}"


def timed(work: Callable[[], Made], repeats: int = 1) -> tuple[Made, float]:
    """Return what the work makes and the median processor time that it takes, s."""
    seconds = []
    for _ in range(repeats):
        began = process_time()
        made = work()
        seconds.append(process_time() - began)
    return made, median(seconds)


def paired(first: Callable[[], object], second: Callable[[], object], pairs: int) -> Pace:
    """Let two pieces of work take turns, each once unmeasured before."""
    first()
    second()
    times = []
    for turn in range(pairs):
        order = (first, second) if turn % 2 == 0 else (second, first)
        took = {work: timed(work)[1] for work in order}
        times.append((took[first], took[second]))
    ratio = median(b / max(a, 1e-9) for a, b in times)
    return Pace(median(a for a, _ in times), median(b for _, b in times), ratio)


def slope(sizes: list[float], costs: list[float]) -> float:
    """Return the exponent p of cost ~ size^p by least squares on logarithmic axes."""
    import numpy as np

    return float(np.polyfit(np.log(sizes), np.log(costs), 1)[0])
