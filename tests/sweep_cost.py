"""Measures what a sweep costs. `python tests/sweep_cost.py` prints it and writes results/sweep-cost.csv and .svg.

`curve` or `pairs` as an argument measures only that. Other work on the machine shows in every number.

The friction wheel over damping and band, 10,000 points with two workers: seconds and memory against points. Then pairs
of short sweeps with one worker and with two, one after the other, for the parallel efficiency.
"""

from __future__ import annotations

import os
import statistics
import sys
import tempfile
from pathlib import Path
from time import perf_counter

from matplotlib.figure import Figure

from vctune.document.study_file import read_study
from vctune.report.figures.with_matplotlib import svg
from vctune.study.executors import worker_pool
from vctune.study.rows import open_rows
from vctune.study.sweep import sweep

ROOT = Path(__file__).parent.parent
STUDY = f"""
problem = "{ROOT / "problems/friction-wheel.toml"}"
[axes]
"device.damping" = {{ log = [0.1, 10.0], n = %d }}
"stability.band_hz[1]" = {{ log = [50.0, 200.0], n = %d }}
"""
SIDE, PAIRS = 100, 5
SHORT = 16
WARM = 0.2
"""Share of a short sweep that is left out of its rate: workers start and compile."""


def timed(side: int, jobs: int, watch=lambda: None) -> list[tuple]:
    """Sweep side x side points; return the seconds since the start and what `watch` says, a point at a time."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cost.toml"
        path.write_text(STUDY % (side, side))
        plan, ticks, began = read_study(path), [], perf_counter()
        with worker_pool("processes", jobs) as pool, open_rows(Path(folder) / "rows", plan, restart=False) as rows:
            sweep(plan, rows, pool, lambda: ticks.append((perf_counter() - began, watch())))
            assert len(rows.places) == side * side
        return ticks


def rate(ticks: list[tuple]) -> float:
    first = int(WARM * len(ticks))
    return (len(ticks) - 1 - first) / (ticks[-1][0] - ticks[first][0])


def megabytes() -> tuple[float, float]:
    """Return the resident memory of this process and of the greatest of its workers."""
    children = {}
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            pages = int((entry / "statm").read_text().split()[1])
        except OSError:
            continue
        children.setdefault(parent, []).append((int(entry.name), pages * os.sysconf("SC_PAGE_SIZE") / 1e6))
    mine = next(size for family in children.values() for pid, size in family if pid == os.getpid())
    workers = [size for pid, _ in children.get(os.getpid(), []) for _, size in children.get(pid, [])]
    return mine, max(workers, default=0.0)


def curve(side: int) -> list[tuple[int, float, float, float]]:
    """Return points, seconds and megabytes at 1, 2, 5, 10, ... points."""
    wanted = {n for decade in range(5) for n in (10**decade, 2 * 10**decade, 5 * 10**decade)} | {side * side}
    count = iter(range(1, side * side + 1))
    ticks = timed(side, 2, lambda: megabytes() if next(count) in wanted else None)
    return [(n, seconds, *sizes) for n, (seconds, sizes) in enumerate(ticks, 1) if sizes]


def draw(rows: list[tuple[int, float, float, float]], folder: Path) -> None:
    points, seconds, parent, worker = zip(*rows, strict=True)
    figure = Figure(figsize=(8, 3.6), layout="constrained")
    time, memory = figure.subplots(1, 2)
    time.loglog(points, seconds, "o-")
    time.set(xlabel="points", ylabel="seconds since the start", title="friction wheel, --jobs 2")
    memory.semilogx(points, worker, "o-", label="greatest worker")
    memory.semilogx(points, parent, "s-", label="parent")
    memory.set(xlabel="points", ylabel="resident memory, MB", ylim=(0, 200))
    memory.legend()
    (folder / "sweep-cost.svg").write_text(svg(figure, "sweep-cost"))


def measure_curve() -> None:
    """Print the cost of a long sweep and write it to results/."""
    rows, folder = curve(SIDE), ROOT / "results"
    lines = ["points,seconds,parent_mb,worker_mb", *(f"{n},{s:.3f},{p:.1f},{w:.1f}" for n, s, p, w in rows)]
    (folder / "sweep-cost.csv").write_text("\n".join(lines) + "\n")
    draw(rows, folder)
    print(*lines, sep="\n")


def measure_pairs() -> None:
    """Print the rates with one worker and with two, in pairs, and the median efficiency."""
    pairs = []
    for number in range(PAIRS):
        rates = {jobs: rate(timed(SHORT, jobs)) for jobs in ((1, 2) if number % 2 else (2, 1))}
        pairs.append(rates)
        load = os.getloadavg()[0]
        print(f"jobs 1: {rates[1]:.1f}/s, jobs 2: {rates[2]:.1f}/s, ratio {rates[2] / rates[1]:.2f}, load {load:.1f}")
    one, two = (statistics.median(pair[jobs] for pair in pairs) for jobs in (1, 2))
    ratio = statistics.median(pair[2] / pair[1] for pair in pairs)
    print(f"median: jobs 1 {one:.1f}/s, jobs 2 {two:.1f}/s, efficiency {ratio / 2:.0%}")


if __name__ == "__main__":
    for part in sys.argv[1:] or ("curve", "pairs"):
        {"curve": measure_curve, "pairs": measure_pairs}[part]()
