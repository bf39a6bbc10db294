"""Whatever signal arrives between any two file operations, the files that are left are of one run."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tomllib
from datetime import datetime

import pytest
from command import process, run
from conftest import DEVICE, FIXED, for_passive_hands

from vctune.document.text.errors import printable
from vctune.document.text.output_files import folder_name, today, write_together
from vctune.exit_codes import ExitCode

EVERYWHERE = """
import os, shutil, signal, sys
from pathlib import Path

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
    try:
        TASK
    except SystemExit as end:
        return end.code
    return 0

sys.addaudithook(strike)
PREPARE
task(root / "warm")
signal.signal(signal.SIGINT, signal.default_int_handler)
for k in range(1, 200):
    child = os.fork()
    if not child:
        left = k
        code = task(root / str(k))
        (root / "whole").write_text(str(k)) if left else None
        os._exit(code)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
    if (root / "whole").exists():
        break
"""
"""Run a task, then in forks whose k-th sends itself a signal before its k-th file operation, until one ends before."""

ONLY_FILES = (
    """
from vctune.document.text.output_files import write_together
""",
    """
write_together({Path("a"): "new", Path("b"): "new", Path("c"): "new"}, [Path("d"), Path("none")])
""",
)
COMMAND = """
import vctune.cli, vctune.design.advice.repair, vctune.design.solve
import vctune.report.page, vctune.report.templates, vctune.simulation.two_runs
from vctune.document.reading import read_problem

def once(module, name, *arguments):
    made = getattr(module, name)(*arguments)
    setattr(module, name, lambda *given, **options: made)
    return made

file = read_problem(root / "before/device.toml")
judged = once(vctune.design.solve, "solve", file.problem).judgement
if judged and file.problem.experiments:
    once(vctune.simulation.two_runs, "simulate", file.problem, judged.gains, judged.coupling,
         file.problem.experiments[0])
Shown = vctune.report.templates.Shown
FIGURES = ("llewellyn", "nyquist", "transparency", "impedance")
def named(name, problem): return Shown(name, "", "", "", problem.sha256)
vctune.report.page.design_figures = lambda _problem, record, *_: [named(name, record.problem) for name in FIGURES]
vctune.report.page.simulation_figure = lambda simulation: named("simulation", simulation.problem)
vctune.report.page.svg = vctune.report.templates.svg = lambda digest, name: f"<svg>{digest}</svg>"
"""
"""What takes its time is done once, and a figure says of which problem it is."""
EXPERIMENT = (
    '\n[[experiment]]\nname = "x"\nenvironment = { stiffness = 200.0 }\noperator = { to = 0.005, cycles = 1 }\n'
)


def ended(tmp_path, script, number):
    """Return the exit codes and the folders of all the forks."""
    prepare, task = script
    text = EVERYWHERE.replace("PREPARE", prepare).replace("TASK", task.strip())
    command = [sys.executable, "-W", "ignore", "-c", text, str(tmp_path), str(int(number))]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    codes = [int(line) for line in done.stdout.split("\n") if re.fullmatch(r"-?\d+", line)]
    assert (tmp_path / "whole").exists(), done.stderr
    return [(code, tmp_path / str(k)) for k, code in enumerate(codes, 1)]


def visible(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if not path.name.startswith(".")}


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_files_of_one_run(tmp_path, number):
    (tmp_path / "before").mkdir()
    for name in ("a", "b", "c", "d"):
        (tmp_path / "before" / name).write_text("old")
    ends = ended(tmp_path, ONLY_FILES, number)
    assert len(ends) > 10
    for _, folder in ends[:-1]:
        left = visible(folder)
        assert "a" in left and len(set(left.values())) == 1
    assert visible(ends[-1][1]) == {"a": b"new", "b": b"new", "c": b"new"}


def digests(folder):
    """Return of which problem each file of a design says that it is, without its simulation."""
    texts = {
        name: content.decode()
        for name, content in visible(folder).items()
        if not name.endswith(".npz") and not name.startswith("simulation.")
    }
    found = {name: re.search(r"[0-9a-f]{64}", text)[0] for name, text in texts.items()}
    assert "design.json" in found
    if "gains.toml" in texts:
        assert tomllib.loads(texts["gains.toml"])["gains"] == json.loads(texts["design.json"])["gains"]
    return found


@pytest.fixture(scope="module")
def earlier(tmp_path_factory):
    """A problem, its design, simulation and report; each figure says of which problem it is."""
    place = tmp_path_factory.mktemp("earlier")
    (place / "device.toml").write_text(for_passive_hands(DEVICE + FIXED.format(160.0) + EXPERIMENT))
    for command in ("solve", "simulate"):
        assert run(command, "device.toml", cwd=place, report=True).returncode == ExitCode.OK
    folder = place / "results/device"
    (folder / "traces.npz").write_bytes(b"old")
    for path in folder.glob("*.svg"):
        path.write_text(json.loads((folder / "design.json").read_text())["problem"]["sha256"])
    return place


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "number"),
    [("solve --quiet", signal.SIGKILL), ("simulate", signal.SIGKILL), ("solve --quiet", signal.SIGTERM)],
)
def test_a_design_and_what_shows_it_are_of_one_run(earlier, tmp_path, command, number):
    before = shutil.copytree(earlier, tmp_path / "before")
    old, text = digests(before / "results/device"), (before / "device.toml").read_text()
    (before / "device.toml").write_text(text.replace("velocity = 150.0", "velocity = 149.0"))
    task = f"sys.argv = {['vctune', *command.split(), 'device.toml']}; vctune.cli.run()"
    ends = ended(tmp_path, (COMMAND, task), number)
    kinds = set()
    for code, folder in ends:
        left = digests(folder / "results/device")
        hidden = [path.name for path in (folder / "results/device").glob(".*")]
        is_old = left["design.json"] == old["design.json"]
        assert len(set(left.values())) == 1, left
        if "report.html" in left:
            assert left.keys() == old.keys()
        if number != signal.SIGKILL:
            assert code in (ExitCode.OK, ExitCode.INTERRUPTED) and not hidden
        kinds.add((is_old, "report.html" in left))
    assert ends[-1][0] == ExitCode.OK
    if command == "simulate":  # it leaves an earlier design and its page as they are
        assert kinds == {(True, True)}
    elif number == signal.SIGKILL:
        assert kinds == {(True, True), (True, False), (False, False), (False, True)}


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


@pytest.mark.parametrize(
    "design", [FIXED.format(160.0), pytest.param("", marks=pytest.mark.slow)], ids=["fixed", "free"]
)
def test_solving_again_changes_no_byte(tmp_path, design):
    (tmp_path / "device.toml").write_text(for_passive_hands(DEVICE + design))
    written = []
    for way in (process, run):
        done = way("solve", "device.toml", "--json", cwd=tmp_path, report=True)
        written.append(visible(tmp_path / "results/device"))
        assert done.stdout.encode() == written[-1]["design.json"]
    assert written[0] == written[1] and len(written[0]) == 7
    assert b"seconds" not in written[0]["design.json"]


def test_a_place_that_is_a_folder_leaves_everything(tmp_path):
    (tmp_path / "a").write_text("old")
    (tmp_path / "b").mkdir()
    with pytest.raises(Exception, match=r"b: cannot be written: Is a directory"):
        write_together({tmp_path / "a": "new"}, [tmp_path / "b"])
    assert (tmp_path / "a").read_text() == "old"
    assert len(os.listdir(tmp_path)) == 2


@pytest.mark.parametrize(
    "char", ["\u202e", "\u2066", "\u200f", "\u2028", "\x1b", "\x9b", "\x7f", "\ufeff", "\U000e0041"]
)
def test_what_does_not_print_reaches_neither_terminal_nor_folder(tmp_path, char):
    assert char not in printable(f"a{char}b") and char not in folder_name(f"a{char}b")
    assert printable("Größe 大 'x'") == "Größe 大 'x'"


def test_names_are_shown_escaped(tmp_path):
    (tmp_path / "device.toml").write_text(for_passive_hands('name = "a\\u202eb"\n' + DEVICE + FIXED.format(160.0)))
    done = run("solve", "device.toml", cwd=tmp_path)
    assert "\u202e" not in done.stdout + done.stderr and "a\\u202eb" in done.stdout
    assert os.listdir(tmp_path / "results") == ["a_b"]


@pytest.mark.parametrize("name", ["CON", "con", "aux.toml", "NUL .x", "COM1", "lpt9"])
def test_devices_of_windows_are_no_folders(name):
    assert folder_name(name) == f"_{name}"
    assert folder_name("console") == "console"


def test_the_day_is_that_of_the_builds_clock_where_there_is_one(monkeypatch):
    """And of no other form: what is no number is not believed."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86399")
    assert today() == "1970-01-01"
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    assert today() == "1970-01-02"
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "soon")
    assert datetime.fromisoformat(today()) > datetime(2020, 1, 1)
