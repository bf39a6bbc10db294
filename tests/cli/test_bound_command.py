"""`vctune bound` as its users meet it: exit codes, bounds that are cut short, files whole or not at all."""

from __future__ import annotations

import json
import re
import shutil
import signal
from itertools import count

import pytest
from command import run, strict, strike
from conftest import DEVICE, ROOT

from vctune import running
from vctune.design.records.design import read_design
from vctune.document.text.errors import InputError
from vctune.exit_codes import ExitCode

WHEEL = ROOT / "problems/friction-wheel.toml"


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    """A solved problem: its folder, problem.toml and design.json in it."""
    folder = tmp_path_factory.mktemp("bound")
    shutil.copy(WHEEL, folder / "problem.toml")
    assert run("solve", "problem.toml", "--quiet", "--out", "o", cwd=folder).returncode == ExitCode.OK
    return folder


@pytest.fixture
def folder(solved, tmp_path):
    shutil.copytree(solved, tmp_path, dirs_exist_ok=True)
    return tmp_path


def optimality(path) -> dict:
    return read_design(path).to_json()["optimality"]


def test_a_gap_is_proved_and_shown(folder):
    done = run("bound", "problem.toml", "o/friction-wheel/design.json", "--gap", "0.02", "--json", cwd=folder)
    assert (done.returncode, done.stderr) == (ExitCode.OK, "")
    found = optimality(folder / "o/friction-wheel/design.json")
    assert strict(done.stdout)["optimality"] == found
    assert found["verdict"] == "proved" and 0 < found["gap"] <= 0.02
    page = (folder / "o/friction-wheel/report.html").read_text()
    assert "No other design lowers the error by more than" in page


@pytest.mark.slow
def test_a_time_limit_leaves_the_bound_reached(folder, monkeypatch):
    """The clock counts how often it is asked, so that a limit ends the search at the same place on every machine."""
    design = folder / "o/friction-wheel/design.json"
    command = ("bound", "problem.toml", str(design), "--time-limit")
    assert run(*command, "0", cwd=folder).returncode == ExitCode.UNDECIDED
    assert read_design(design).to_json()["optimality"] is None, "a search without time proves nothing"
    monkeypatch.setattr(running, "perf_counter", map(float, count()).__next__)
    assert run(*command, "400", "--gap", "0.0001", cwd=folder).returncode == ExitCode.UNDECIDED
    found = optimality(design)
    assert found["verdict"] == "open" and found["boxes"] > 0
    monkeypatch.undo()
    assert run(*command, "60", "--gap", "0.01", cwd=folder).returncode == ExitCode.OK


def test_ctrl_c_leaves_the_bound_reached(folder, monkeypatch):
    """A signal in the twentieth round of a search that takes hundreds."""
    design, asked = folder / "o/friction-wheel/design.json", strike(monkeypatch, 20, signal.SIGINT)
    done = run("bound", "problem.toml", design, "--gap", "0.0001", cwd=folder)
    assert (done.returncode, done.stderr) == (ExitCode.UNDECIDED, "")
    assert optimality(design)["lower_bound"] > 0 and next(asked) == 21
    assert not [path for path in design.parent.iterdir() if path.name.startswith(".")]


def test_input_that_cannot_be_bounded(folder):
    design = folder / "o/friction-wheel/design.json"
    (folder / "other.toml").write_text((folder / "problem.toml").read_text().replace("100.0]", "99.0]"))
    assert "of another version" in refused("bound", "other.toml", str(design), cwd=folder)
    poor = re.sub("(?m)^damping = .*", "damping = 1.0", design.with_name("gains.toml").read_text())
    (folder / "poor.toml").write_text(poor)
    (record,) = json.loads(run("check", "problem.toml", "poor.toml", "--json", cwd=folder).stdout)
    (folder / "poor.json").write_text(json.dumps(record))
    assert "is not proved to meet the demands" in refused("bound", "problem.toml", "poor.json", cwd=folder)


def refused(*arguments, cwd) -> str:
    done = run(*arguments, cwd=cwd)
    assert (done.returncode, done.stdout) == (ExitCode.BAD_INPUT, "")
    assert "Traceback" not in done.stderr
    return done.stderr


@pytest.mark.slow
def test_infeasible_and_undecided(tmp_path):
    done = run("bound", ROOT / "problems/infeasible.toml", "--json", cwd=tmp_path)
    record = strict(done.stdout)
    assert (done.returncode, record["status"], record["proved"]) == (ExitCode.FAILED, "infeasible", True)
    theorem = tmp_path / "theorem.toml"
    theorem.write_text(
        DEVICE.replace("damping = 2.0", "damping = 0.0") + 'hold = "lag"\n[stability]\nband_hz = [0.0, inf]\n'
    )
    done = run("bound", theorem, "--json", "--time-limit", "0", cwd=tmp_path)
    record = strict(done.stdout)
    assert (done.returncode, record["status"], record["proved"]) == (ExitCode.FAILED, "infeasible", True)


def test_solve_proves_a_gap(tmp_path):
    done = run("solve", WHEEL, "--prove-gap", "0.05", cwd=tmp_path)
    assert done.returncode == ExitCode.OK
    assert "lower bound" in done.stdout
    assert optimality(tmp_path / "results/friction-wheel/design.json")["verdict"] == "proved"


@pytest.fixture(scope="module")
def bounded(solved, tmp_path_factory):
    """The text of a design.json with a bound."""
    folder = tmp_path_factory.mktemp("bounded")
    shutil.copytree(solved, folder, dirs_exist_ok=True)
    design = folder / "o/friction-wheel/design.json"
    assert run("bound", "problem.toml", design, "--gap", "0.1", cwd=folder).returncode == ExitCode.OK
    return design.read_text()


@pytest.mark.parametrize("change", [{"verdict": "perhaps"}, {"boxes": -0.5}, {"lower_bound": "low"}])
def test_a_damaged_optimality_is_refused(bounded, tmp_path, change):
    design, record = tmp_path / "design.json", json.loads(bounded)
    design.write_text(json.dumps({**record, "optimality": {**record["optimality"], **change}}))
    with pytest.raises(InputError, match="optimality"):
        read_design(design)
