"""Numbers in the comments of problem files are what vctune finds."""

from __future__ import annotations

import tomllib
from typing import Any

import pytest
from conftest import ROOT

import vctune

PASSIVE = {"stability.criterion": "passive"}
BANDS = {"transparency.band_hz": [0.5, 30.0], "stability.band_hz": [0.5, 100.0]}
"""Those of friction-wheel.toml."""
STATED: dict[str, list[tuple[str, str, dict[str, Any]]]] = {
    "flexible-handle": [
        ("flexible-handle", "0.873", {}),
        ("flexible-handle", "0.981", PASSIVE),
        ("flexible-handle", "1.280", {"device.structure": None}),
        ("friction-wheel", "0.913", {}),
    ],
    "cobot-wrist-real": [
        ("cobot-wrist-real", "0.915", {}),
        ("cobot-wrist-real", "0.360", {"device.force_sensor.delay": 2e-3}),
    ],
    "friction-wheel-real": [
        ("friction-wheel-real", "2.81", BANDS),
        ("friction-wheel", "0.913", {}),
    ],
}
"""For each file the numbers of its comments: the file that gives the error, the number, and changes by dotted key."""


@pytest.mark.slow
@pytest.mark.parametrize("name", STATED)
def test_the_errors_in_a_comment_are_those_of_the_designs(name: str) -> None:
    text = (ROOT / f"problems/{name}.toml").read_text()
    comment = " ".join(line for line in text.splitlines() if line.startswith("#"))
    for source, number, changes in STATED[name]:
        assert number in comment
        tables = tomllib.loads((ROOT / f"problems/{source}.toml").read_text())
        for key, value in changes.items():
            *path, last = key.split(".")
            table = tables
            for step in path:
                table = table.setdefault(step, {})
            table.pop(last) if value is None else table.__setitem__(last, value)
        found = vctune.solve(tables)
        assert found.status.value == "certified"
        assert f"{found.judgement.transparency.error:.{len(number.partition('.')[2])}f}" == number


@pytest.mark.slow
def test_the_least_ratio_in_a_comment_is_that_of_the_design() -> None:
    text = (ROOT / "problems/fixed-gains.toml").read_text()
    assert "Its least ratio is 1.03:" in text
    assert f"{vctune.solve(tomllib.loads(text)).judgement.min_ratio:.2f}" == "1.03"
