"""Shared fixtures. Hypothesis runs the same examples every time, so that a red test is red for everyone."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable
from datetime import date
from itertools import groupby
from math import ceil
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
"""Before NumPy is imported: two threads on one core wait for each other a hundred times as long as they work."""
settings.register_profile("reproducible", derandomize=True, deadline=None, print_blob=False)
settings.load_profile("reproducible")

DRAWS = int(os.environ.get("VCTUNE_DRAWS", "2"))
"""How many slow cases of a test run, and how many draws a slow test makes: few here, `WHOLE` or more at night."""
WHOLE = 25
DAY = int(os.environ.setdefault("VCTUNE_DAY", str(date.today().toordinal())))
"""Which slow cases run; handed to the workers, so that midnight does not part them."""
ROOT = Path(__file__).parent.parent
DEVICE = "[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 1e-3\n"
FIXED = "[gains]\nvelocity = 150.0\nposition = 6000.0\n[coupling]\ndamping = {}\nmass = 0.37\n"
"""A device, and gains for it that are certified with a coupling damping of 160 and violated with 80."""
PROBLEM_FILES = sorted(
    path for path in (ROOT / "problems").rglob("*.toml") if path.parent != ROOT / "problems" / "studies"
)


def for_passive_hands(text: str) -> str:
    """Return a problem file's text with the criterion "passive" in the place of the default."""
    table, asked = "[stability]\n", "[stability]\ncriterion = 'passive'\n"
    if "criterion" in text:
        return text
    return text.replace(table, asked) if table in text else text + asked


def mostly_slow(cases: Iterable[Any], fast: Collection[Any]) -> list[Any]:
    """Return the cases of a test, all but a few of them slow."""
    return [case if case in fast else pytest.param(case, marks=pytest.mark.slow) for case in cases]


def drawn(many: int) -> int:
    """Return how many of many draws a slow test makes."""
    return min(many, ceil(many * DRAWS / WHOLE))


WHOLLY = {
    "test_answers.py": "kind", "test_claims.py": "kind", "test_core.py": "kind", "test_golden.py": "name",
    "test_tutorials.py": "tutorial",
}  # fmt: skip
"""Files whose slow cases all run, by the parameter that tells them apart."""


def every_case_of(item: pytest.Item) -> bool:
    """Return whether no case of a test is left out."""
    params = getattr(item, "callspec", None)
    return params is not None and WHOLLY.get(item.path.name) in params.params and "number" not in params.params


CI_ALONE = frozenset((ROOT / "tests/ci.txt").read_text().splitlines())
"""Cases that do not run every time, or functions all of whose cases do not; made by tiers.py."""


@pytest.hookimpl(tryfirst=True)  # before the marks decide
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark the cases of CI alone; leave out all but `DRAWS` slow cases of a test, other ones each day, and none of
    `every_case_of`."""
    for item in items:
        if {item.nodeid, item.nodeid.partition("[")[0]} & CI_ALONE:
            item.add_marker("ci")
    if DRAWS >= WHOLE:
        return
    left_out = []
    for _, group in groupby(items, key=lambda item: item.nodeid.partition("[")[0]):
        slow = [item for item in group if item.get_closest_marker("slow") and not every_case_of(item)]
        kept = {(DAY + k * len(slow) // DRAWS) % len(slow) for k in range(DRAWS)} if slow else set()
        left_out += [item for number, item in enumerate(slow) if number not in kept]
    config.hook.pytest_deselected(items=left_out)
    gone = set(map(id, left_out))
    items[:] = [item for item in items if id(item) not in gone]


ADVISED = pytest.StashKey[bool]()


@pytest.fixture(scope="session", autouse=True)
def quiet(request):
    """Let vctune look for repairs, relaxations and prices only in tests with the mark `advice`."""
    from vctune.api import solving
    from vctune.design.advice import repair
    from vctune.design.ros import admittance_check

    def where_asked(advise, nothing):
        def found(*arguments, **options):
            asked = request.config.stash[ADVISED]
            return advise(*arguments, **options) if asked else nothing(*arguments)

        return found

    searched = where_asked(repair.find_repairs, lambda *_: repair.Found())
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(repair, "find_repairs", searched)
        patched.setattr(admittance_check, "find_repairs", searched)
        patched.setattr(
            solving, "with_relaxations", where_asked(solving.with_relaxations, lambda _, solved, __: solved)
        )
        patched.setattr(solving, "with_prices", where_asked(solving.with_prices, lambda solved: solved))
        yield


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    item.config.stash[ADVISED] = item.get_closest_marker("advice") is not None


@pytest.fixture(scope="session")
def problems() -> Path:
    return ROOT / "problems"


@pytest.fixture
def folder(tmp_path):
    """One good, one violated, one unreadable and one free problem."""
    (tmp_path / "good.toml").write_text(for_passive_hands(DEVICE + FIXED.format(160.0)))
    (tmp_path / "poor.toml").write_text(for_passive_hands(DEVICE + FIXED.format(80.0)))
    (tmp_path / "bad.toml").write_text(DEVICE + "dampin = 1.0\n")
    (tmp_path / "free.toml").write_text(for_passive_hands(DEVICE))
    return tmp_path
