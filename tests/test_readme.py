"""README tells the truth: what it shows is what its commands print today."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest
from conftest import ROOT
from readme import NUMBER, generated

README = (ROOT / "README.md").read_text()


def test_console_sessions_and_reference():
    """Words equal, numbers to 0.1 %; counts of boxes depend on the last digits and are not compared."""
    shown, made = README.splitlines(), generated(README).splitlines()
    assert len(made) == len(shown)
    for here, there in zip(shown, made, strict=True):
        if "boxes" in here:
            continue
        assert NUMBER.sub("#", here).split() == NUMBER.sub("#", there).split()
        assert [float(x) for x in NUMBER.findall(here)] == pytest.approx(
            [float(x) for x in NUMBER.findall(there)], rel=1e-3
        )


def test_library_example():
    example = re.search(r"```python\n(.*?)```", README, re.DOTALL)[1]
    done = subprocess.run([sys.executable, "-c", example], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("certified Gains(velocity=")
