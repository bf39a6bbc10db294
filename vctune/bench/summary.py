"""The summary that README shows, from nothing but the CSV files of results/bench/ and the commands that made them."""

from __future__ import annotations

from collections import Counter
from math import inf
from pathlib import Path

from vctune.bench.files import NAMES, PAGE, command_of, read_csv
from vctune.bench.sampling import EXCHANGE, FIXED
from vctune.bench.scaling import EXPECTED
from vctune.bench.solvers import CLOSE, OURS
from vctune.bench.timing import slope
from vctune.design.judge import Status

Cells = dict[str, str]


def summary(folder: Path) -> str:
    """Return README's tables of a folder of benchmarks.

    Raises
    ------
    OSError
        If a CSV file is not there.
    """
    sampling, solvers, stress, scaling, scene = (read_csv(folder / f"{name}.csv") for name in NAMES)
    page = (folder / PAGE).read_text()
    lines = [
        f"`{command_of(page, 'solvers')}`:",
        "",
        *_solvers(solvers),
        "",
        "| command | what it finds |",
        "|---|---|",
    ]
    lines += [
        f"| `{command_of(page, name)}` | {text} |"
        for name, text in (
            ("sampling", _sampling(sampling)),
            ("stress", _stress(stress)),
            ("scaling", _scaling(scaling)),
            ("scene", _scene(scene)),
        )
    ]
    return "\n".join(lines) + "\n"


def _solvers(rows: list[Cells]) -> list[str]:
    count = len({row["problem"] for row in rows})
    lines = [
        f"| solver, {count} problem{'s' if count > 1 else ''} | proved, error within {CLOSE:.1%} of the best "
        "| proved at all | unstable loops | processor time, s | worst gap of a proved answer | worst violation |",
        "|---|---|---|---|---|---|---|",
    ]
    scored = []
    for solver in dict.fromkeys(row["solver"] for row in rows):
        own = [row for row in rows if row["solver"] == solver]
        proved = [row for row in own if row["verdict"] == Status.CERTIFIED]
        close = sum(float(row["gap"]) <= CLOSE for row in proved)
        seconds = sum(float(row["seconds"]) for row in own)
        unstable = sum(row["stable"] == "no" for row in own)
        gap = f"{max(float(row['gap']) for row in proved):.1e}" if proved else ""
        violation = max(float(row["violation"]) for row in own)
        told = f"{violation:.1e}" if violation < inf else "Re G_hh < 0"
        name = f"**{solver}**" if solver == OURS else solver
        cells = (name, close, len(proved), unstable, f"{seconds:.2f}", gap, told)
        scored.append((-close, seconds, "| " + " | ".join(map(str, cells)) + " |"))
    return lines + [line for *_, line in sorted(scored)]


def _sampling(rows: list[Cells]) -> str:
    fixed = [row for row in rows if row["method"] == FIXED and row["succeeded"] == "yes"]
    refuted = sum(row["verdict"] == Status.VIOLATED for row in fixed)
    exchanged = [row for row in rows if row["method"] == EXCHANGE]
    proved = sum(row["verdict"] == Status.CERTIFIED for row in exchanged)
    largest = max(int(row["frequencies"]) for row in fixed)
    return (
        f'IPOPT "succeeds" on {len(fixed)} fixed grids of 8 to {largest} frequencies, and {refuted} of these answers '
        f"are refuted; the exchange's are proved on {proved} of {len(exchanged)} problems"
    )


def _stress(rows: list[Cells]) -> str:
    counts = Counter(row["status"] for row in rows)
    shares = ", ".join(f"{count / len(rows):.2%} {status}" for status, count in counts.most_common())
    wrong = sum(row["wrong"] != "" for row in rows)
    error = max(float(row["float_error"] or 0) for row in rows)
    return (
        f"{len(rows)} devices over ten decades: {shares}; {wrong} wrong verdicts, {counts['failed']} failures; float "
        f"formulas within {error:.1e} of 50 digits"
    )


def _scaling(rows: list[Cells]) -> str:
    found = []
    for axis in EXPECTED:
        own = [row for row in rows if row["axis"] == axis]
        exponent = slope([float(row["size"]) for row in own], [float(row["seconds"]) for row in own])
        found.append(f"{axis} {exponent:.2f}")
    return f"cost grows with the power: {', '.join(found)}"


def _scene(rows: list[Cells]) -> str:
    same = sum(row["same_as_without"] == "yes" for row in rows)
    return f"{same} of {len(rows)} builds have exactly the size of one that was never told of the part that is absent"
