"""What the commands promise besides designs: exit codes, a resumed sweep, the exported firmware, repairs, logs."""

from __future__ import annotations

import json
import shutil
import subprocess
from math import exp, pi

import numpy as np
import pytest
from command import run
from conftest import ROOT

import vctune

PROBLEMS, GAINS = ROOT / "problems", ROOT / "tests/gains"
WHEEL = "[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 1e-3\n"
FIXED = "[gains]\nvelocity = 120.0\nposition = 3000.0\n[coupling]\ndamping = 40.0\nmass = 0.3\ndrag = {}\n"
PASSIVE = '[stability]\ncriterion = "passive"\nband_hz = [1.0, 60.0]\n'


def test_each_verdict_has_its_exit_code(tmp_path):
    for name, drag in (("good", 20.0), ("bad", 2.0)):
        (tmp_path / f"{name}.toml").write_text(WHEEL + FIXED.format(drag) + PASSIVE)
    (tmp_path / "broken.toml").write_text(WHEEL.replace("0.4", "-0.4"))
    codes = {
        name: run("check", f"{name}.toml", cwd=tmp_path).returncode for name in ("good", "bad", "broken", "missing")
    }
    assert codes == {"good": 0, "bad": 1, "broken": 2, "missing": 2}
    assert run("solve", PROBLEMS / "infeasible.toml", cwd=tmp_path).returncode == 1
    assert run("solve", "good.toml", "--time-limit", "0", cwd=tmp_path).returncode == 3
    (tmp_path / "free.toml").write_text(WHEEL)
    assert run("solve", "free.toml", "--time-limit", "0", cwd=tmp_path).returncode == 3


WEAK = WHEEL + "[gains]\nvelocity = { min = 1.0, max = 2.0 }\nposition = 5000.0\n"
FEW = "[environment]\nmass = { min = 0.05, max = 5.0 }\nstiffness = { max = 2000.0 }\n"


@pytest.mark.slow
@pytest.mark.parametrize(("text", "status"), [(WEAK, "infeasible"), (WEAK + FEW, "undecided")])
def test_a_problem_without_a_design_is_infeasible_only_where_that_is_proved(tmp_path, text, status):
    """Every box of designs is excluded before all environments; before some of them the bound is not looked for."""
    (tmp_path / "weak.toml").write_text(text)
    assert [row["status"] for row in vctune.sweep(tmp_path / "weak.toml", {"device.damping": [2.0]}).table.rows()] == [
        status
    ]


def test_a_sweep_continues_where_it_ended(tmp_path):
    study = f'problem = "{PROBLEMS / "friction-wheel.toml"}"\n[axes]\n"device.damping" = [1.0, 2.0, 3.0, 4.0]\n'
    (tmp_path / "study.toml").write_text(study)
    command = ("sweep", "study.toml", "--executor", "serial", "--quiet")
    assert run(*command, cwd=tmp_path).returncode == 0
    rows = tmp_path / "results/study/rows.jsonl"
    lines, table = rows.read_text().splitlines(), (rows.parent / "table.csv").read_text()
    keys = [json.loads(line).get("key") for line in lines]
    rows.write_text("\n".join(lines[:2]) + "\n" + lines[2][:40])  # ended in the middle of a row
    assert run(*command, cwd=tmp_path).returncode == 0
    seconds = table.splitlines()[0].split(",").index("seconds") if "seconds" in table.splitlines()[0] else None
    again = (rows.parent / "table.csv").read_text()

    def kept(text):
        return [[cell for k, cell in enumerate(line.split(",")) if k != seconds] for line in text.splitlines()]

    assert kept(again) == kept(table) and len(kept(again)) == 5
    assert sorted(keys[1:]) == sorted(json.loads(line)["key"] for line in rows.read_text().splitlines()[1:])


@pytest.mark.skipif(not all(map(shutil.which, ("gcc", "make"))), reason="without a compiler")
@pytest.mark.parametrize("precision", ["double", pytest.param("single", marks=pytest.mark.slow)])
def test_the_firmware_replays_to_the_last_bit(tmp_path, precision):
    found = run(
        "export", PROBLEMS / "friction-wheel.toml", GAINS / "friction-wheel.toml", "--precision", precision,
        cwd=tmp_path,
    )  # fmt: skip
    assert found.returncode == 0, found.stderr
    (folder,) = tmp_path.glob("results/*/firmware")
    done = subprocess.run(["make", "-s", "check"], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


DISC = "[uncertainty]\nunmodelled = [[60.0, 0.01], [100.0, 2.0]]\n"
"""Above the band so great that it is missed by a loop whose other demands are easily met."""


@pytest.mark.advice
@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        pytest.param((PROBLEMS / "infeasible.toml").read_text(), marks=pytest.mark.slow, id="without a design"),
        pytest.param(WHEEL + DISC + FIXED.format(2.0) + PASSIVE, id="fixed gains"),
    ],
)
def test_every_repair_passes(tmp_path, text):
    """Each one alone, written into the problem that it repairs."""
    (tmp_path / "refuted.toml").write_text(text)
    repairs = vctune.solve(tmp_path / "refuted.toml").repairs
    assert repairs
    document = vctune.read_problem(tmp_path / "refuted.toml").document
    for repair in repairs:
        *tables, key = repair.key.split(".")
        changed = json.loads(json.dumps(document))
        place = changed
        for name in tables:
            place = place.setdefault(name, {})
        name, _, end = key.partition("[")
        if end:
            place[name][int(end[0])] = repair.new
        else:
            place[name] = repair.new
        assert vctune.solve(changed).status == "certified", repair


@pytest.mark.slow
def test_the_delay_of_a_log_is_from_the_command_to_the_motion(tmp_path):
    """3 ms of delay and 2 ms of lag between the command and the force, both logged; the mass is .8 kg."""
    T, fine, count = 1e-3, 20, 8000
    rng = np.random.default_rng(5)
    frequencies = np.fft.rfftfreq(count, T)
    command = np.fft.irfft(np.fft.rfft(rng.normal(size=count)) * (frequencies > 0.3) / (1 + (frequencies / 6) ** 2))
    command *= 4 / command.std()
    position, velocity, force, kept = 0.0, 0.0, 0.0, np.empty((count, 2))
    late, share = round(3e-3 / T * fine), 1 - exp(-T / fine / 2e-3)
    for k in range(count * fine):
        if k % fine == 0:
            kept[k // fine] = position, force
        force += share * ((command[(k - late) // fine] if k >= late else 0.0) - force)
        velocity += T / fine * (force - 2.0 * velocity) / 0.8
        position += T / fine * velocity
    rows = np.column_stack([np.arange(count) * T, np.round(kept[:, 0], 8), command, kept[:, 1]])
    header = "time_s,position_m,command_N,force_N"
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=header, comments="", fmt="%.10g")
    found = vctune.identify(tmp_path / "log.csv").found
    delay, mass, lag = (found.bounded(key) for key in ("delay", "mass", "actuator.bandwidth_hz"))
    assert delay.low <= 3e-3 <= delay.high < 3.3e-3
    assert lag.low <= 1 / (2 * pi * 2e-3) <= lag.high < 1.1 * lag.low
    assert mass.low <= 0.8 <= mass.high < 0.85
    np.savetxt(
        tmp_path / "force.csv", rows[:, [0, 1, 3]], delimiter=",", header="time_s,position_m,force_N", comments=""
    )
    with pytest.raises(vctune.InputError, match=r"device\.delay"):
        vctune.identify(tmp_path / "force.csv")
