"""Whole answers stay: every number, word and curve of drawn problems, of designs, regions, sweeps, logs and runs.

`VCTUNE_REFRESH=1 pytest tests/golden/test_records.py` records them again and says what changed; look at each change
before it is kept.
"""

from __future__ import annotations

import json
import os

import pytest
from conftest import ROOT, mostly_slow
from records import ANSWERS, QUICK, differences, plain

FILE = ROOT / "tests/golden/records.json"
RECORDS = json.loads(FILE.read_text())
NEAR, SEARCHED = 1e-4, 3e-3
"""Relative differences that say nothing, of a stated design and of one that was searched for: its error has a flat
minimum."""


FAST = [f"design: {kind} {seeds[0]}" for kind, seeds in QUICK.items()]
FAST += [
    f"problem: {name}" for name in ("friction-wheel", "knob", "wall", "friction-wheel-hands", "keemink", "late-arm")
]
FAST += ["region: friction-wheel", "region: paddle", "text: springs", "text: flexible display", "text: whole axis"]
FAST += ["log: 2", "servo log: 0", "bound: wheel", "loop", "sweep: damping", "simulation: friction-wheel"]
"""One answer of each kind."""


@pytest.mark.parametrize("name", mostly_slow(ANSWERS, FAST))
def test_an_answer_is_what_it_was(name):
    then, now = RECORDS.get(name), plain(ANSWERS[name]())
    if os.environ.get("VCTUNE_REFRESH"):
        RECORDS[name] = now
        lines = (f"{json.dumps(each)}: {json.dumps(RECORDS[each])}" for each in ANSWERS if each in RECORDS)
        FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n")
    near = SEARCHED if name.startswith(("problem", "region", "sweep", "text")) else NEAR
    assert [*differences(then, now, near)] == []
