"""Tutorials run: their commands print what the page shows, within two minutes.

`VCTUNE_REFRESH=1 pytest -m slow tests/release/test_tutorials.py` writes what they print today.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command import without_progress
from conftest import ROOT
from test_readme import NUMBER

from vctune import solve

TUTORIALS = sorted((ROOT / "docs/tutorials").glob("*.md"))
LONGEST = 120.0
"""Processor time of a tutorial, s."""
COMMAND = re.compile(r"^\$ (.*(?:\n> .*)*)\n?", re.MULTILINE)
"""A command begins with "$ ", and its further lines with "> "."""
COMPILED = re.compile(r"^\$ make ", re.MULTILINE)


def stem(path):
    return path.stem


def printed_today(text, folder):
    """Return a tutorial with what its commands print when all its blocks run one after the other in a folder."""
    search = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    surroundings = os.environ | {"PATH": search, "COLUMNS": "120"}

    def printed(*command):
        done = subprocess.run(
            command, cwd=folder, env=surroundings, text=True, check=False, stdout=-1, stderr=subprocess.STDOUT
        )
        assert done.returncode == 0, done.stdout
        return "".join(f"{line.rstrip()}\n" for line in without_progress(done.stdout).splitlines())

    def run(block):
        if block[1] == "python":
            printed(sys.executable, "-c", block[2])
            return block[0]
        commands = {command: command.replace("\n> ", "\n") for command in COMMAND.findall(block[2])}
        made = "".join(f"$ {command}\n{printed('bash', '-c', source)}" for command, source in commands.items())
        return f"```console\n{made}```\n"

    return re.sub(r"^```(console|python)\n(.*?)^```\n", run, text, flags=re.MULTILINE | re.DOTALL)


@pytest.mark.slow
@pytest.mark.parametrize("tutorial", TUTORIALS, ids=stem)
def test_a_tutorial_prints_what_it_shows(tutorial, tmp_path):
    shown = tutorial.read_text("utf-8")
    if COMPILED.search(shown) and not (shutil.which("make") and shutil.which("cc")):
        pytest.skip("needs make and a C compiler")
    before, began = os.times(), time.monotonic()
    today = printed_today(shown, tmp_path)
    after = os.times()
    if "VCTUNE_REFRESH" in os.environ:
        tutorial.write_text(today, encoding="utf-8")
    worked = after.children_user + after.children_system - before.children_user - before.children_system
    assert 0.1 < worked < LONGEST, f"{worked} s of processor time in {time.monotonic() - began} s"
    for here, there in zip(lines(shown), lines(today), strict=True):
        assert NUMBER.sub("#", here).split() == NUMBER.sub("#", there).split()
        assert [float(x) for x in NUMBER.findall(here)] == pytest.approx(
            [float(x) for x in NUMBER.findall(there)], rel=0.1 if "boxes" in here else 1e-2
        )


def lines(text: str) -> list[str]:
    """Return the lines of a tutorial, without digests and without which kicks keep a device moving: the last digit of
    a machine decides where a limit cycle begins."""
    text = re.sub(r"\d+ of \d+ kicks\s+keep\s.*?(?=;|\s\[)|after\s+\d+ of \d+ kicks", "kicks", text, flags=re.DOTALL)
    return re.sub(r"sha256 [0-9a-f]{64}", "sha256", text).splitlines()


@pytest.mark.slow
def test_live_gains_show_the_error_of_the_design_and_prove_what_the_sliders_say():
    done = subprocess.run(
        [sys.executable, "live_gains.py"], cwd=ROOT / "problems", capture_output=True, text=True, check=True
    )
    shown = re.findall(r"error ([\d.]+), least ratio ([\d.]+)", done.stdout)
    solved = solve(ROOT / "problems/friction-wheel-hands.toml").judgement
    assert [float(each) for each in shown[0]] == pytest.approx([solved.error, solved.min_ratio], rel=1e-3)
    assert float(shown[1][1]) < 1.05 and "refuted" in done.stdout
