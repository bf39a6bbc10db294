"""README's examples still run, and print what it shows."""

from __future__ import annotations

import io
import os
import re
import shutil
import subprocess
import sys
from contextlib import chdir, redirect_stdout
from pathlib import Path

import pytest
from command import without_progress
from conftest import ROOT

README = (ROOT / "README.md").read_text()
NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")


def printed(block: str, folder: Path) -> list[str]:
    """Run the commands of a console block and return them with what they print."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    env = {**os.environ, "PATH": path, "COLUMNS": "100"}
    lines = []
    for command in re.findall(r"^\$ (.*)", block, re.MULTILINE):
        done = subprocess.run(
            ["bash", "-c", command], cwd=folder, env=env, check=False, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        lines += [f"$ {command}", *(line.rstrip() for line in without_progress(done.stdout).splitlines())]
    return lines


@pytest.mark.slow
def test_console_sessions(tmp_path):
    """Words equal, numbers to 0.1 %; counts of boxes, which depend on the last digits, to a tenth."""
    shutil.copytree(ROOT / "problems", tmp_path / "problems")
    for block in re.findall(r"```console\n(.*?)```", README, re.DOTALL):
        for here, there in zip(block.splitlines(), printed(block, tmp_path), strict=True):
            assert NUMBER.sub("#", here).split() == NUMBER.sub("#", there).split()
            assert [float(x) for x in NUMBER.findall(here)] == pytest.approx(
                [float(x) for x in NUMBER.findall(there)], rel=0.1 if "boxes" in here else 1e-3
            )


def test_library_example():
    example = re.search(r"```python\n(.*?)```", README, re.DOTALL)[1]
    with chdir(ROOT), redirect_stdout(io.StringIO()) as said:
        exec(example, {})
    assert said.getvalue().startswith("certified Gains(velocity=")
