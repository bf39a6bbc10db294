"""Whole answers stay: every number, word and curve of drawn problems, of designs, regions, sweeps, logs and runs.

`VCTUNE_REFRESH=1 pytest tests/golden/test_records.py` records them again and says what changed; look at each change
before it is kept.
"""

from __future__ import annotations

import json
import os

import pytest
from conftest import ROOT, mostly_slow
from records import ANSWERS, differences, plain

FILE = ROOT / "tests/golden/records.json"
RECORDS = json.loads(FILE.read_text())
SEARCHED = 2e-3
"""Relative difference of the numbers of a design that was searched for: its error has a flat minimum."""


SLOW = {
    "text: sections", "text: weak motor", "text: nothing behind", "problem: ../tests/reference/worlds/world-tools",
}  # fmt: skip
"""Answers that take more than five seconds and say little that others do not."""


@pytest.mark.parametrize("name", mostly_slow(ANSWERS, ANSWERS.keys() - SLOW))
def test_an_answer_is_what_it_was(name):
    then, now = RECORDS.get(name), plain(ANSWERS[name]())
    if os.environ.get("VCTUNE_REFRESH"):
        RECORDS[name] = now
        lines = (f"{json.dumps(each)}: {json.dumps(RECORDS[each])}" for each in ANSWERS if each in RECORDS)
        FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n")
    near = SEARCHED if name.startswith(("problem", "region", "sweep")) else 1e-5
    assert [*differences(then, now, near)] == []
