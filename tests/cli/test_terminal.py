"""A design as a terminal shows it: in its order, on narrow screens, without colour, with links; and what comes next."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import DEVICE, ROOT

from vctune import compare
from vctune.api.argument_ranges import STDIN
from vctune.api.experiments import measured_rows, simulation_of
from vctune.cli.printing.design_table import print_design, print_lines
from vctune.cli.printing.next_steps import after_bound, after_design
from vctune.cli.printing.side_by_side import print_comparison, print_simulation
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


# what compares, sweeps and simulates


@pytest.fixture
def terminal(capsys, monkeypatch):
    """Return what a function prints on a terminal of some columns without colour."""

    def shown(columns, what):
        for name, value in {"COLUMNS": str(columns), "FORCE_COLOR": "1", "TERM": "xterm", "NO_COLOR": "1"}.items():
            monkeypatch.setenv(name, value)
        what()
        out = capsys.readouterr().out
        assert not COLOUR.search(out)
        return plain(out).splitlines()

    return shown


NAMES = "friction-wheel-hands", "desktop"


@pytest.mark.parametrize("columns", [60, 140])
def test_a_comparison_fits_the_terminal_and_ends_with_the_better_design(terminal, columns):
    paths = [ROOT / f"results/{name}/design.json" for name in NAMES]
    found = compare(*paths)
    lines = terminal(columns, lambda: print_comparison(found))
    assert lines[-1] == f"next: vctune export {paths[1]}"  # on either yardstick
    assert max(map(len, lines[:-1])) <= columns or columns == 140
    for side in (found.a, found.b):
        assert side.status in " ".join(lines)
    for value in found.design:
        for each in (value.a, value.b):
            if isinstance(each, float):
                assert any(f"{each:.{value.digits}g}" in line for line in lines), value.label


@pytest.mark.parametrize("columns", [60, 140])
def test_a_simulation_fits_the_terminal_and_keeps_every_cell(terminal, columns, tmp_path):
    simulation = simulation_of(json.loads((ROOT / "results/friction-wheel/simulation.json").read_text()))
    lines = terminal(columns, lambda: print_simulation(simulation, tmp_path))
    assert max(map(len, lines[:-1])) <= columns or columns == 140
    text = " ".join(lines)
    assert all(cell in text for row in measured_rows(simulation) for cell in row)
    (tmp_path / "simulation.svg").touch()
    assert (
        terminal(columns, lambda: print_simulation(simulation, tmp_path))[-1] == f"next: open {tmp_path}/simulation.svg"
    )


def test_lines_of_a_region_break_at_words_and_say_what_is_next(terminal, capsys, monkeypatch):
    lines, folder = (
        ["of the plane gains.velocity by gains.position, looked at as far as time allowed"],
        Path("results/w"),
    )
    shown = terminal(60, lambda: print_lines(lines, folder, ["open results/w/region.svg"]))
    assert max(map(len, shown)) <= 60 and " ".join(shown[:-2]) == lines[0]
    assert shown[-2:] == ["written to results/w", "next: open results/w/region.svg"]
    monkeypatch.delenv("FORCE_COLOR")
    print_lines(lines, folder, ["open results/w/region.svg"])
    assert capsys.readouterr().out == f"{lines[0]}; written to results/w\n"
