"""Tutorials are notebooks that run: their commands print what the page shows, within two minutes."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import time

import pytest
from conftest import ROOT
from notebooks import as_notebook
from test_readme import NUMBER

TUTORIALS = sorted((ROOT / "docs/tutorials").glob("*.md"))
LONGEST = 120.0
"""Processor time of a tutorial, s."""
HURRIED = re.compile(
    r"; (?:so would|no change of one number passes).*|^ *warning: .*\[warn-repairs-cut-short\]$\n", re.MULTILINE
)
"""What else would pass depends on how much of it is found in half a minute."""
COMPILED = re.compile(r"^\$ make ", re.MULTILINE)


def stem(path):
    return path.stem


@pytest.mark.parametrize("tutorial", TUTORIALS, ids=stem)
def test_each_command_is_a_cell_and_no_output_is(tutorial):
    text = tutorial.read_text("utf-8")
    cells = json.loads(as_notebook(text))["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    commands = re.findall(r"^\$ (.*)", text, re.MULTILINE)
    assert [cell.splitlines()[1] for cell in code if cell.startswith("%%bash\n")] == commands
    assert len(code) == len(commands) + text.count("```python\n")
    assert not any(cell["outputs"] for cell in cells if cell["cell_type"] == "code")


def test_a_command_of_several_lines_is_one_cell():
    (cell,) = json.loads(as_notebook("```console\n$ cat <<'END'\n> a $ b\n> END\na $ b\n```\n"))["cells"]
    assert cell["source"] == "%%bash\ncat <<'END'\na $ b\nEND"


@pytest.mark.slow
@pytest.mark.parametrize("tutorial", TUTORIALS, ids=stem)
def test_a_tutorial_prints_what_it_shows(tutorial, tmp_path):
    shown = tutorial.read_text("utf-8")
    if COMPILED.search(shown) and not (shutil.which("make") and shutil.which("cc")):
        pytest.skip("needs make and a C compiler")
    copy = tmp_path / tutorial.name
    copy.write_text(shown, encoding="utf-8")
    before, began = os.times(), time.monotonic()
    done = subprocess.run(
        [sys.executable, ROOT / "docs/notebooks.py", copy], capture_output=True, text=True, check=False
    )
    after = os.times()
    assert done.returncode == 0, done.stderr
    worked = after.children_user + after.children_system - before.children_user - before.children_system
    assert 0.1 < worked < LONGEST, f"{worked} s of processor time in {time.monotonic() - began} s"
    for here, there in zip(lines(shown), lines(copy.read_text("utf-8")), strict=True):
        assert NUMBER.sub("#", here).split() == NUMBER.sub("#", there).split()
        assert [float(x) for x in NUMBER.findall(here)] == pytest.approx(
            [float(x) for x in NUMBER.findall(there)], rel=0.1 if "boxes" in here else 1e-2
        )


def lines(text: str) -> list[str]:
    """Return the lines of a tutorial, without digests."""
    return re.sub(r"sha256 [0-9a-f]{64}", "sha256", HURRIED.sub("", text)).splitlines()
