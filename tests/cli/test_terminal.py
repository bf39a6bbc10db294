"""A design as a terminal shows it: in its order, on narrow screens, without colour, with links; and what comes next."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import DEVICE, ROOT

from vctune.api.argument_ranges import STDIN
from vctune.cli.printing.design_table import print_design
from vctune.cli.printing.next_steps import after_bound, after_design
from vctune.document.records.design_file import read_design
from vctune.document.records.design_json import RepairRecord
from vctune.exit_codes import ExitCode

FOLDER = ROOT / "results/friction-wheel-hands"
LINK = re.compile(r"\x1b\]8;[^;]*;([^\x1b]*)\x1b\\")
COLOUR = re.compile(r"\x1b\[[\d;]*\b(?:3[1-7]|9[1-7])[\d;]*m")
PROBLEM = Path("wheel.toml")


@pytest.fixture(scope="module")
def record():
    return read_design(FOLDER / "design.json")


@pytest.fixture
def shown(record, capsys, monkeypatch):
    def show(columns=None, *, verbose=False, **environment):
        for name in ("NO_COLOR", "FORCE_COLOR", "COLUMNS", "TTY_COMPATIBLE"):
            monkeypatch.delenv(name, raising=False)
        if columns:
            environment |= {"COLUMNS": str(columns), "FORCE_COLOR": "1", "TERM": "xterm"}
        for name, value in environment.items():
            monkeypatch.setenv(name, value)
        print_design(record, FOLDER, after_design(record, FOLDER, PROBLEM), verbose=verbose)
        return capsys.readouterr().out

    return show


def plain(text):
    return re.sub(r"\x1b\[[\d;]*m", "", LINK.sub("", text))


@pytest.mark.parametrize("columns", [None, 60, 100])
def test_what_is_proved_comes_first_then_the_design_then_what_limits_it(shown, record, columns):
    text = " ".join(plain(shown(columns)).split())
    parts = ["certified", record.promise, "velocity K_v", "coupling", "limited by", "transparency", "warning", "next:"]
    places = [text.index(part) for part in parts]
    assert places == sorted(places)
    assert record.limits == ["Re Z_c >= safety_factor R in a hand at 74.37 and 412.6 Hz"]
    assert all(f"{number:.8g}" in text for number in (record.gains.velocity, record.coupling.mass))


@pytest.mark.parametrize("columns", [60, 72, 100, 140])
def test_lines_fit_the_terminal(shown, columns):
    lines = plain(shown(columns)).splitlines()
    paths = lines.index(next(line for line in lines if line.startswith("written to")))
    assert max(map(len, lines[:paths])) <= columns
    assert not any(line.endswith((" hand o", "…")) for line in lines)


def test_a_terminal_without_colour_has_none(shown):
    assert COLOUR.search(shown(60)) and not COLOUR.search(shown(60, NO_COLOR="1"))
    assert "\x1b" not in shown()


def test_paths_are_links_where_there_is_a_terminal(shown, monkeypatch):
    assert not LINK.search(shown(80))  # as in a notebook, which asks for colours alone
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    assert [link for link in LINK.findall(shown(80)) if link] == [
        FOLDER.as_uri(),
        *([(FOLDER / "report.html").as_uri()] if (FOLDER / "report.html").exists() else []),
    ]


def test_what_was_left_out_is_printed_where_it_is_asked_for(shown, record):
    assert record.left_out
    assert "left out" not in shown() and all(f"left out: {line}" in shown(verbose=True) for line in record.left_out)


def test_what_comes_next(record, tmp_path):
    export, check = f"vctune export {tmp_path}/design.json", f"in CI vctune check wheel.toml {tmp_path}/gains.toml"
    assert after_design(record, tmp_path, PROBLEM) == [f"vctune report {tmp_path}/design.json", export, check]
    (tmp_path / "report.html").write_text("")
    assert after_design(record, tmp_path, STDIN) == [f"open {tmp_path}/report.html", export]
    cure = RepairRecord(key="a.b", old=1.0, new=2.0, change="more", needs="a.b = 2.0", size=0.5, error=0.4)
    failed = record.model_copy(update={"status": "infeasible", "repairs": [cure]})
    assert after_design(failed, tmp_path, PROBLEM)[0] == "write a.b = 2.0 into wheel.toml and solve again"
    assert after_bound(record, tmp_path / "design.json", PROBLEM) == after_design(record, tmp_path, PROBLEM)


@pytest.mark.parametrize(("option", "without"), [("--resume", ""), ("--restart", "without --restart ")])
def test_an_interrupted_sweep_says_how_it_goes_on(tmp_path, option, without):
    (tmp_path / "device.toml").write_text(DEVICE)
    (tmp_path / "study.toml").write_text('problem = "device.toml"\n[axes]\n"device.mass" = [0.4, 0.5]\n')
    interrupted = (
        "import signal, vctune.api.studies as s\n"
        "s.run = lambda *given, **named: signal.raise_signal(signal.SIGINT)\n"
        "from vctune.cli import run; run()"
    )
    command = [sys.executable, "-c", interrupted, "sweep", "study.toml", option, "--executor", "serial"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (ExitCode.INTERRUPTED, "")
    assert done.stderr.splitlines()[-1] == f"interrupted; running it again {without}resumes"
