"""README tells the truth: its first command prints what it shows."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest
from conftest import ROOT

README = (ROOT / "README.md").read_text()
NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")


def test_output_of_the_first_command(tmp_path):
    shown = re.search(r"```text\n(.*?)```", README, re.DOTALL)[1].splitlines()
    done = subprocess.run(
        [sys.executable, "-m", "vctune", "solve", ROOT / "problems/friction-wheel.toml", "--out", "results"],
        cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip
    printed = [line.rstrip() for line in done.stdout.splitlines()]
    assert len(printed) == len(shown)
    for here, there in zip(shown, printed, strict=True):
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
