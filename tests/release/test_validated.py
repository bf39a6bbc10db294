"""docs/validated.md: its commands print what it shows, and its table has what they print beside what others published.

`VCTUNE_REFRESH=1 pytest -m slow tests/release/test_validated.py` writes what they print today.
"""

from __future__ import annotations

import os
import re
import shutil
from math import cos, inf, pi, tau

import numpy as np
import pytest
from conftest import ROOT
from scipy.optimize import brentq
from test_readme import NUMBER
from test_tutorials import lines, printed_today

PAGE = ROOT / "docs/validated.md"
SHOWN = PAGE.read_text("utf-8")
ROWS = [row.strip("| ").split(" | ") for row in re.findall(r"^\|.*\|$", SHOWN, re.MULTILINE)[2:]]
RECORDED = re.compile(r"^## .*\n(?:(?!^## ).*\n)*.*VCTUNE_DATA.*\n(?:(?!^## ).*\n)*", re.MULTILINE)
"""A section whose commands need the recordings."""


def test_most_results_are_within_a_part_in_a_thousand():
    """All but the gains that do not oscillate, where the difference is explained, and what was measured."""
    assert len(ROWS) == 12
    for what, published, ours, _ in ROWS:
        theirs, found = (float(NUMBER.search(cell)[0]) for cell in (published, ours))
        tolerance = 5e-3 if "measured" in published else 1.2e-3
        assert "not oscillate" in what or found == pytest.approx(theirs, rel=tolerance, abs=1e-12), what


def test_what_was_published_follows_from_its_formula():
    """Each formula by hand, and the rule of Paine and Sentis by its own search."""
    K = {
        "a passive wall]": 2 * (1.0 - 0.3) / 1e-3,
        "wall that is late": 1.0 / (0.5e-3 + 2e-3),
        "an encoder]": min(2 * 0.04 / 1e-4, 2 * 0.5 / 1e-3),
        "without a hand": (1.5 + 3.0) / (0.5e-3 + 2e-3),
        "all mass": 10.0 * 100.0 / (100.0 + 5.0),
        "late velocity loop": 2 * cos(2 * pi / 5),
        "do not oscillate": 360.0 * stiffest(360.0, 2200.0, 1e-3, 50.0) ** 2,
    }
    for what, expected in K.items():
        (row,) = (row for row in ROWS if what in row[0])
        assert float(NUMBER.search(row[1])[0]) == pytest.approx(expected, rel=2e-4), what


def stiffest(mass: float, damping: float, delay: float, filter_hz: float) -> float:
    """Return the greatest natural frequency of a critically damped spring and damper, rad/s, that leaves 50 degrees."""
    s = 1j * np.geomspace(0.1, 1e4, 100_001)

    def spare(w: float) -> float:
        damper = (2 * mass * w - damping) * s / (1 + s / (tau * filter_hz))
        L = np.exp(-delay * s) * (mass * w**2 + damper) / (mass * s**2 + damping * s)
        angle = np.degrees(np.unwrap(np.angle(L)))
        crossings = np.flatnonzero((abs(L[:-1]) > 1) & (abs(L[1:]) <= 1))
        return min(180 + angle[crossings], default=inf) - 50

    return float(brentq(spare, 20.0, 300.0))


@pytest.mark.slow
def test_the_page_shows_what_its_commands_print(tmp_path):
    shutil.copytree(ROOT / "problems", tmp_path / "problems")
    tested = SHOWN if "VCTUNE_DATA" in os.environ else RECORDED.sub("", SHOWN)
    today = printed_today(tested, tmp_path)
    if "VCTUNE_REFRESH" in os.environ:
        PAGE.write_text(today, encoding="utf-8")
    for here, there in zip(lines(tested), lines(today), strict=True):
        assert NUMBER.sub("#", here).split() == NUMBER.sub("#", there).split()
        # which halves of a log differ most is of the machine, in the third digit
        assert [float(x) for x in NUMBER.findall(here)] == pytest.approx(
            [float(x) for x in NUMBER.findall(there)], rel=1e-2
        )


def test_the_table_has_the_numbers_of_its_sections():
    """To the digits of the table; the gain margin of the late loop is a ratio in decibels."""
    sections = re.split(r"^## ", SHOWN, flags=re.MULTILINE)[1:]
    printed = " ".join(
        block for section in sections for block in re.findall(r"```console\n(.*?)```", section, re.DOTALL)
    )
    numbers = [float(x) for x in NUMBER.findall(printed)]
    numbers += [0.1 * 10 ** (float(x) / 20) for x in re.findall(r"gain margin +([\d.]+)", printed)]
    for what, _, ours, _ in ROWS:
        found = NUMBER.search(ours)[0]
        assert any(x == pytest.approx(float(found), rel=5e-4, abs=1e-12) for x in numbers), what
