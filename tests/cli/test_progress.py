"""Long work off a terminal tells its stage on stderr now and then, and what is proved is told before its advice."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest
from conftest import DEVICE

SLOWLY = """
import sys
from vctune.cli import main, runner
runner.BETWEEN = 0.0
sys.exit(main.execute())
"""
"""The command, whose lines of progress are not far apart."""


@pytest.mark.advice
def test_stages_are_lines_on_stderr_and_the_design_stands_before_its_prices(tmp_path):
    (tmp_path / "device.toml").write_text(DEVICE)
    command = [sys.executable, "-u", "-c", SLOWLY, "solve", "device.toml"]
    done = subprocess.run(command, cwd=tmp_path, text=True, stdout=-1, stderr=subprocess.STDOUT, check=True)
    stages = [line for line in done.stdout.splitlines() if re.match(r"vctune solve device.toml: ", line)]
    assert any("scanning" in line for line in stages) and any("drawing the report" in line for line in stages)
    assert done.stdout.index("device: certified") < done.stdout.index("pricing the device")
    quiet = subprocess.run([*command, "--quiet"], cwd=tmp_path, text=True, capture_output=True, check=True)
    assert not quiet.stderr
