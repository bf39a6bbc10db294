"""Measure times on a shared machine: the median processor time of several runs."""

from __future__ import annotations

import os
import platform
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from statistics import median
from time import process_time
from types import FrameType
from typing import TypeVar

Made = TypeVar("Made")


def machine() -> str:
    """Return a one-line description of this machine."""
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
    """Return the result of the work and its median processor time, s."""
    seconds = []
    for _ in range(repeats):
        began = process_time()
        made = work()
        seconds.append(process_time() - began)
    return made, median(seconds)


@contextmanager
def patience(seconds: float) -> Iterator[None]:
    """Raise TimeoutError in the block after a given processor time."""

    def give_up(_signal: int, _frame: FrameType | None) -> None:
        raise TimeoutError(f"no answer within {seconds:g} s")

    before = signal.signal(signal.SIGPROF, give_up)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
