"""The command line as its users meet it: exit codes, strict JSON, files whole or not at all."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import tomllib
from itertools import permutations, product
from pathlib import Path

import pytest
from command import on_a_full_disk, process, run, started, strict, wait_for_work, wait_until
from conftest import DEVICE, FIXED, ROOT, for_passive_hands, mostly_slow

from vctune.cli.runner import Run, worst
from vctune.design.advice import repair as repairing
from vctune.exit_codes import ExitCode
from vctune.running import time_limit


@pytest.fixture
def device(tmp_path) -> Path:
    path = tmp_path / "device.toml"
    path.write_text(for_passive_hands(DEVICE))
    return path


def test_solve_writes_its_files_and_prints_a_table(device, tmp_path):
    done = run("solve", device, cwd=tmp_path, report=True)
    assert done.returncode == ExitCode.OK
    assert done.stderr == ""
    folder = tmp_path / "results" / "device"
    written = {path.name for path in folder.iterdir()}
    assert {"gains.toml", "design.json", "report.html", "llewellyn.svg", "nyquist.svg"} <= written
    for part in ("certified", "velocity K_v", "N s/m", "phase margin", "limited by", "next: open"):
        assert part in done.stdout
    (band,) = (line for line in done.stdout.splitlines() if line.lstrip().startswith("band "))
    assert band.endswith("Hz; outside it nothing is claimed of the ratio")
    design, gains = strict((folder / "design.json").read_text()), tomllib.loads((folder / "gains.toml").read_text())
    assert gains["gains"] == design["gains"]
    assert gains["coupling"] == design["coupling"]
    assert gains["design"]["sha256"] == design["problem"]["sha256"]
    assert gains["design"]["verdict"] == "proved"


def test_json_is_the_file_and_nothing_else(device, tmp_path):
    done = run("solve", device, "--json", "--out", "o", cwd=tmp_path)
    assert strict(done.stdout) == strict((tmp_path / "o/device/design.json").read_text())
    design = strict(done.stdout)
    assert design["schema"] == "vctune/design/1"
    assert list(design)[:5] == ["schema", "problem", "status", "reason", "gains"]


def test_pasted_gains_are_certified_again(device, tmp_path):
    run("solve", device, "--quiet", "--out", "o", cwd=tmp_path)
    pasted = (tmp_path / "o/device/gains.toml").read_text().split("[design]")[0] + for_passive_hands(DEVICE)
    fixed = tmp_path / "fixed.toml"
    fixed.write_text(pasted)
    first = strict((tmp_path / "o/device/design.json").read_text())
    again = strict(run("solve", fixed, "--json", "--out", "o", cwd=tmp_path).stdout)
    assert again["status"] == "certified"
    assert again["gains"] == first["gains"]
    assert again["transparency"] == first["transparency"]


@pytest.mark.advice
def test_infeasible(tmp_path, monkeypatch):
    monkeypatch.setattr(repairing, "parameter_changes", lambda *given: [])
    done = run("solve", ROOT / "problems/infeasible.toml", "--json", cwd=tmp_path)
    assert done.returncode == ExitCode.FAILED
    design = strict(done.stdout)
    assert (design["status"], design["gains"], design["coupling"]) == ("infeasible", None, None)
    assert "of the required R at 100 Hz" in design["reason"]
    assert not (tmp_path / "results/infeasible/gains.toml").exists()


def test_violated_and_quiet(tmp_path):
    path = tmp_path / "fixed.toml"
    path.write_text(for_passive_hands(DEVICE + FIXED.format(1.0)))
    done = run("solve", path, "--quiet", cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (ExitCode.FAILED, "", "")


def test_file_size_limit_leaves_the_old_design(device, tmp_path):
    """As on a full disk: the operating system refuses to write on."""
    run("solve", device, cwd=tmp_path)
    design = tmp_path / "results/device/design.json"
    before = design.read_text()
    done = on_a_full_disk(100, "solve", device, "--no-report", cwd=tmp_path)
    assert done.returncode == ExitCode.BAD_INPUT
    assert "cannot be written" in done.stderr
    assert design.read_text() == before
    assert sorted(path.name for path in design.parent.iterdir()) == ["design.json", "gains.toml"]


@pytest.mark.parametrize(
    "number, seconds",
    [
        *((signal.SIGINT, s) for s in (0.0, 0.15)),
        (signal.SIGTERM, 0.0),
        *(pytest.param(signal.SIGINT, s, marks=pytest.mark.slow) for s in (0.03, 0.06, 0.1, 0.2, 0.3)),
    ],
)
def test_an_interrupt(tmp_path, number, seconds):
    """Interrupted anywhere, also inside IPOPT: 130, no traceback, nothing half-written."""
    running = started("solve", ROOT / "problems/extremes/seven-decades.toml", cwd=tmp_path)
    wait_until((tmp_path / "results").exists)
    wait_for_work(running, seconds)
    running.send_signal(number)
    out, err = running.communicate(timeout=60)
    left = sorted(path.name for path in tmp_path.rglob("*") if path.is_file())
    if running.returncode == ExitCode.OK:
        assert "report.html" in left
    else:
        assert running.returncode == ExitCode.INTERRUPTED
        assert out == "" or ("certified" in out and "gains.toml" in left)  # printed before its advice and its page
        assert "Traceback" not in err
        assert [name for name in left if name in ("design.json", "gains.toml")] in ([], ["design.json", "gains.toml"])
        assert not any(name.startswith(".") for name in left)


def test_a_handler_of_another_language_does_not_break_a_deferred_interrupt(monkeypatch):
    from vctune.interrupt import interrupt_deferred

    install = signal.signal
    monkeypatch.setattr(signal, "signal", lambda number, handler: install(number, handler) and None)
    with interrupt_deferred():
        pass
    monkeypatch.undo()
    assert signal.signal(signal.SIGINT, signal.default_int_handler) is signal.SIG_DFL


LOSES_AN_INTERRUPT = """
import signal, sys, weakref
from vctune.design.nlp import nlp
class Collected: pass
def losing(*given, solve=nlp.minimised):
    collected = Collected()
    weak = weakref.ref(collected, lambda _: signal.raise_signal(signal.SIGINT))
    del collected  # CPython drops the KeyboardInterrupt that the callback raises
    print("went on", file=sys.stderr)
    return solve(*given)
nlp.minimised = losing
sys.argv = ["vctune", "solve", *sys.argv[1:]]
import vctune.cli
vctune.cli.run()
"""


def test_an_interrupt_that_cpython_drops_ends_the_command_before_it_writes(device, tmp_path):
    command = [sys.executable, "-c", LOSES_AN_INTERRUPT, str(device), "--out", str(tmp_path / "results")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path, timeout=120)
    assert (done.returncode, done.stdout) == (ExitCode.INTERRUPTED, "")
    assert done.stderr.split() == ["went", "on", "interrupted"]
    assert not list(tmp_path.rglob("*.json")) and not list(tmp_path.rglob("*.html"))


def test_internal_errors_are_said_without_a_traceback(device, tmp_path, monkeypatch):
    monkeypatch.setattr("vctune.document.reading.resolve", lambda *given: 1 / 0)
    done = run("solve", device, cwd=tmp_path)
    assert done.returncode == ExitCode.INTERNAL
    assert "internal error" in done.stderr and "Traceback" not in done.stderr


def test_version_names_everything_that_determines_a_result(tmp_path):
    done = run("--version", cwd=tmp_path)
    assert done.returncode == 0
    for name in ("vctune", "casadi", "ipopt", "numpy"):
        assert re.search(rf"^{name} \d+\.\d+", done.stdout, re.MULTILINE)


def test_help_names_commands_and_exit_codes(tmp_path):
    text = run("--help", cwd=tmp_path).stdout
    assert "solve" in text and "schema" in text and "130 interrupted" in " ".join(text.split())


def test_colour_only_for_terminals_and_never_with_no_color(device, tmp_path):
    assert "\x1b[" not in run("solve", device, cwd=tmp_path).stdout
    assert "\x1b[3" not in process("solve", device, cwd=tmp_path, FORCE_COLOR="1", NO_COLOR="1").stdout


@pytest.mark.slow
def test_old_gains_are_removed_when_there_is_no_design(device, tmp_path):
    run("solve", device, cwd=tmp_path)
    device.write_text(for_passive_hands(DEVICE + "[gains]\nvelocity = { min = 2000.0, max = 3000.0 }\n"))
    done = run("solve", device, "--quiet", cwd=tmp_path)
    assert done.returncode == ExitCode.FAILED
    assert [path.name for path in (tmp_path / "results/device").iterdir()] == ["design.json"]


@pytest.fixture
def reported(device, tmp_path) -> Path:
    """The folder of the device's design, with the report of an earlier one and something of the user's."""
    folder = tmp_path / "results/device"
    folder.mkdir(parents=True)
    for name in ("report.html", "llewellyn.svg", "mine.png"):
        (folder / name).write_text(f"earlier {name}")
    return folder


def test_no_report_leaves_no_stale_report(device, reported, tmp_path):
    """The earlier report and the files of its figures are removed; what is not vctune's stays."""
    assert run("solve", device, "--quiet", cwd=tmp_path).stderr == ""
    kept = ["design.json", "gains.toml", "mine.png"]
    assert sorted(path.name for path in reported.iterdir()) == kept


def test_a_report_for_which_no_time_is_left_is_told_how_to_draw(tmp_path, capsys):
    with time_limit(0.0):
        assert Run("solve", "text", False).report({}, tmp_path, lambda stage: None) is False
    assert f"no time to draw the report; `vctune report {tmp_path}/design.json` draws it" in capsys.readouterr().err


def test_a_place_that_is_taken_is_said(device, reported, tmp_path):
    (reported / "nyquist.svg").mkdir()
    done = run("solve", device, "--quiet", cwd=tmp_path)
    assert done.returncode == ExitCode.BAD_INPUT
    assert "nyquist.svg: cannot be written" in done.stderr
    assert (reported / "report.html").read_text() == "earlier report.html"


COMMANDS = ["schema", "solve device.toml --no-report", "solve device.toml --no-report --json", "--version", "--help"]
LEFT = list(product(["| true", ">&-", "2>&-"], COMMANDS))


@pytest.mark.parametrize("left", mostly_slow(LEFT, [("| true", "schema"), (">&-", COMMANDS[1])]), ids=" ".join)
def test_readers_may_leave(device, tmp_path, left):
    plumbing, command = left
    shell = f"{sys.executable} -m vctune {command} {plumbing}; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", shell], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == ExitCode.OK
    assert done.stderr == ""


def test_any_locale(tmp_path):
    path = tmp_path / "n.toml"
    path.write_text(for_passive_hands('name = "名前 é"\n' + DEVICE), encoding="utf-8")
    for env in ({"PYTHONIOENCODING": "ascii"}, {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}):
        done = process("solve", path, cwd=tmp_path, **env)
        assert done.returncode in (ExitCode.OK, ExitCode.BAD_INPUT)
        assert "Traceback" not in done.stderr and "internal" not in done.stderr


def test_several_problems_are_solved_each_into_its_folder(tmp_path):
    text = for_passive_hands(DEVICE)
    (tmp_path / "good.toml").write_text(text)
    (tmp_path / "bad.toml").write_text(text + FIXED.format(1.0))
    done = run("solve", "good.toml", "bad.toml", "--json", cwd=tmp_path)
    assert done.returncode == ExitCode.FAILED
    assert [each["problem"]["name"] for each in strict(done.stdout)] == ["good", "bad"]
    assert all((tmp_path / f"results/{name}/design.json").exists() for name in ("good", "bad"))
    alone = run("solve", "good.toml", "--json", cwd=tmp_path)
    assert alone.returncode == ExitCode.OK and strict(alone.stdout)["problem"]["name"] == "good"


@pytest.mark.parametrize("codes", [codes for n in (1, 2, 3, 4) for codes in permutations((0, 1, 2, 3), n)])
def test_the_worst_of_several_codes(codes: tuple[int, ...]) -> None:
    """Bad input, else failed, else undecided, else 0, whatever the order."""
    assert worst(codes) == next(code for code in (2, 1, 3, 0) if code in codes)
