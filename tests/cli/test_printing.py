"""What commands print beside designs: the table of an identification, and a command that runs at each save."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command import run

from vctune import InputError
from vctune.cli.printing import watch

T, MASS, DAMPING = 1e-3, 0.4, 2.0


def test_the_table_of_an_identification_shows_the_numbers_of_its_record(tmp_path):
    """A mass with damping under a held force, sampled exactly; every interval contains the truth."""
    rng = np.random.default_rng(5)
    time = T * np.arange(4000)
    force = np.convolve(rng.normal(size=4029), np.ones(30) / 8, "valid")
    kept = np.exp(-DAMPING / MASS * T)
    v, x = np.zeros(time.size), np.zeros(time.size)
    for k, push in enumerate(force[:-1]):
        ends = push / DAMPING
        v[k + 1] = ends + (v[k] - ends) * kept
        x[k + 1] = x[k] + ends * T + (v[k] - ends) * (1 - kept) * MASS / DAMPING
    measured = 1e-6 * np.round(1e6 * x)
    rows = "\n".join(f"{t:.6f},{p:.9f},{u:.9g}" for t, p, u in zip(time, measured, force, strict=True))
    (tmp_path / "log.csv").write_text(f"time_s,position_m,command_N\n{rows}\n")
    done = run("identify", "log.csv", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    record = json.loads(next(tmp_path.rglob("identification.json")).read_text())
    numbers = {number["key"]: number for number in record["numbers"]}
    for key, truth in (("mass", MASS), ("damping", DAMPING)):
        said = next(line for line in done.stdout.splitlines() if line.strip().startswith(key)).split()
        assert [float(cell) for cell in said[1:4]] == pytest.approx(
            [numbers[key][name] for name in ("value", "low", "high")], rel=1e-4
        )
        assert float(said[2]) <= truth <= float(said[3])


def test_a_command_runs_at_each_save_and_a_mistake_does_not_end_it(tmp_path, monkeypatch, capsys):
    path, runs = tmp_path / "device.toml", []
    path.write_text("first")

    def command():
        runs.append(path.read_text())
        if len(runs) == 2:
            raise InputError.of(str(path), "unknown-key", "a mistake")
        if len(runs) == 3:
            raise KeyboardInterrupt

    waits = []

    def saved_at_the_second_look(_):
        waits.append(len(runs))
        if waits.count(len(runs)) == 2:
            path.write_text("saved" * (1 + len(runs)))

    monkeypatch.setattr(watch.time, "sleep", saved_at_the_second_look)
    with pytest.raises(KeyboardInterrupt):
        watch.on_every_save(path, command)
    assert runs == ["first", "saved" * 2, "saved" * 3]
    assert "a mistake" in capsys.readouterr().err
