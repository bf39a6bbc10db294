"""Sort the cases into fast ones and those of CI alone (tests/ci.txt), by what they reach and how long they take.

    pytest -n 2 --dist loadfile -m "not slow" -vv --durations=0 \
        --cov=vctune --cov-context=test --cov-report= > cases.log
    python tests/tiers.py .coverage cases.log

Fast are the cases of a few milliseconds, those of the oracles, and a cover of the others: the cheapest that reach
nearly every line. The lines that no other fast case reaches, which the tool prints, are a case's reason to be fast.
"""

from __future__ import annotations

import re
import sys
from collections import Counter, defaultdict
from pathlib import Path

from coverage import CoverageData

FILE = Path(__file__).parent / "ci.txt"
CHEAP = 0.02
"""Seconds of a case that is fast whatever it reaches."""
SHARE = 0.975
"""Of the lines that any case reaches."""
ORACLES = (
    "tests/analysis/", "tests/model/", "tests/proof/test_core.py", "tests/proof/test_enclosures.py",
    "tests/test_answers.py", "tests/test_claims.py", "tests/test_golden.py", "tests/test_numbers.py",
)  # fmt: skip
"""What these see is more than the lines that they reach."""
CALLED = re.compile(r"^([0-9.]+)s (?:call|setup) +(tests/\S+::.+?)\s*$", re.MULTILINE)

Lines = set[tuple[str, int]]


def read(data: str, log: str) -> tuple[dict[str, Lines], Counter[str]]:
    """Return the lines and the seconds of each case."""
    seconds: Counter[str] = Counter()
    for taken, case in CALLED.findall(Path(log).read_text()):
        seconds[case] += float(taken)
    found = CoverageData(data)
    found.read()
    lines: dict[str, Lines] = defaultdict(set)
    for path in found.measured_files():
        for number, contexts in found.contexts_by_lineno(path).items():
            for context in contexts:
                lines[context.rpartition("|")[0]].add((path, number))
    return {case: lines[case] for case in seconds}, seconds


def alone(case: str, lines: dict[str, Lines], fast: set[str]) -> int:
    """Return how many lines no other fast case reaches."""
    return len(lines[case].difference(*(lines[other] for other in fast if other != case)))


def cover(lines: dict[str, Lines], seconds: Counter[str], fast: set[str]) -> set[str]:
    """Return cases that reach nearly every line that those already fast do not: each next one the line's cheapest."""
    wanted = set().union(*lines.values())
    left = wanted.difference(*(lines[case] for case in fast))
    may_miss = (1 - SHARE) * len(wanted)
    chosen: set[str] = set()
    others = set(lines) - fast
    while len(left) > may_miss:
        best = max(others, key=lambda case: len(lines[case] & left) / seconds[case])
        if not lines[best] & left:
            break
        left -= lines[best]
        others.remove(best)
        chosen.add(best)
    for case in sorted(chosen, key=lambda case: -seconds[case]):
        if not alone(case, lines, fast | chosen):
            chosen.remove(case)
    return chosen


def by_function(cases: set[str], every: set[str]) -> list[str]:
    """Return the names of the cases, or of their function where all its cases are among them."""
    functions = defaultdict(set)
    for case in every:
        functions[case.partition("[")[0]].add(case)
    whole = {function for function, own in functions.items() if own <= cases}
    return sorted(whole | {case for case in cases if case.partition("[")[0] not in whole})


def main(data: str, log: str) -> None:
    lines, seconds = read(data, log)
    fast = {case for case in lines if seconds[case] < CHEAP or case.startswith(ORACLES)}
    chosen = cover(lines, seconds, fast)
    fast |= chosen
    for case in sorted(chosen, key=lambda case: -seconds[case]):
        print(f"{seconds[case]:6.2f} s  {alone(case, lines, fast):4} lines  {case}")  # noqa: T201
    total = sum(seconds[case] for case in fast)
    print(f"{len(fast)} of {len(lines)} cases are fast: {total:.0f} of {seconds.total():.0f} s")  # noqa: T201
    FILE.write_text("\n".join(by_function(set(lines) - fast, set(lines))) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
