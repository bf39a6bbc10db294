"""Whatever signal arrives between any two file operations, the files that are left are of one run."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from datetime import datetime

import pytest
from command import process, run
from conftest import DEVICE, FIXED, for_passive_hands

from vctune.document.text.output_files import today
from vctune.exit_codes import ExitCode

EVERYWHERE = """
import os, shutil, signal, sys
from pathlib import Path
from vctune.document.text.output_files import write_together

root, number, left = Path(sys.argv[1]), int(sys.argv[2]), 0

def strike(event, arguments):
    global left
    if left > 0 and event in ("os.rename", "os.remove", "tempfile.mkstemp"):
        left -= 1
        if left == 0:
            os.kill(os.getpid(), number)

def task(folder):
    shutil.copytree(root / "before", folder)
    os.chdir(folder)
    write_together({Path("a"): "new", Path("b"): "new", Path("c"): "new"}, [Path("d"), Path("none")])

sys.addaudithook(strike)
task(root / "warm")
signal.signal(signal.SIGINT, signal.default_int_handler)
for left in range(1, 200):
    child = os.fork()
    if not child:
        folder = root / str(left)
        task(folder)
        (root / "whole").write_text(folder.name) if left else None
        os._exit(0)
    os.waitpid(child, 0)
    if (root / "whole").exists():
        break
"""
"""Write files in forks whose k-th sends itself a signal before its k-th file operation, until one ends before."""


def visible(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if not path.name.startswith(".")}


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_files_of_one_run(tmp_path, number):
    (tmp_path / "before").mkdir()
    for name in ("a", "b", "c", "d"):
        (tmp_path / "before" / name).write_text("old")
    command = [sys.executable, "-W", "ignore", "-c", EVERYWHERE, str(tmp_path), str(int(number))]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert (tmp_path / "whole").exists(), done.stderr
    last = int((tmp_path / "whole").read_text())
    assert last > 10
    for k in range(1, last):
        left = visible(tmp_path / str(k))
        assert "a" in left and len(set(left.values())) == 1
    assert visible(tmp_path / str(last)) == {"a": b"new", "b": b"new", "c": b"new"}


def test_ctrl_c_while_the_report_is_drawn(tmp_path):
    """It ends at once, and no report of an earlier design stays beside the new one."""
    (tmp_path / "device.toml").write_text(for_passive_hands(DEVICE + FIXED.format(160.0)))
    (tmp_path / "results/device").mkdir(parents=True)
    (tmp_path / "results/device/report.html").write_text("earlier")
    interrupted = (
        "import signal, vctune.report.page as r\n"
        "r.design_figures = lambda *design: (signal.raise_signal(signal.SIGINT), print('went on'))\n"
        "from vctune.cli import run; run()"
    )
    command = [sys.executable, "-u", "-c", interrupted, "solve", "device.toml", "--quiet"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr.strip()) == (ExitCode.INTERRUPTED, "interrupted")
    assert done.stdout == ""
    assert set(visible(tmp_path / "results/device")) == {"design.json", "gains.toml"}


def test_solving_again_changes_no_byte(tmp_path):
    (tmp_path / "device.toml").write_text(for_passive_hands(DEVICE + FIXED.format(160.0)))
    written = []
    for way in (process, run):
        done = way("solve", "device.toml", "--json", cwd=tmp_path, report=True)
        written.append(visible(tmp_path / "results/device"))
        assert done.stdout.encode() == written[-1]["design.json"]
    assert written[0] == written[1] and len(written[0]) == 7
    assert b"seconds" not in written[0]["design.json"]


def test_names_are_shown_escaped(tmp_path):
    (tmp_path / "device.toml").write_text(for_passive_hands('name = "a\\u202eb"\n' + DEVICE + FIXED.format(160.0)))
    done = run("solve", "device.toml", cwd=tmp_path)
    assert "\u202e" not in done.stdout + done.stderr and "a\\u202eb" in done.stdout
    assert os.listdir(tmp_path / "results") == ["a_b"]


def test_the_day_is_that_of_the_builds_clock_where_there_is_one(monkeypatch):
    """And of no other form: what is no number is not believed."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86399")
    assert today() == "1970-01-01"
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    assert today() == "1970-01-02"
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "soon")
    assert datetime.fromisoformat(today()) > datetime(2020, 1, 1)
