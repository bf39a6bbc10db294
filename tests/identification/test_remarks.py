"""Remarks on what recordings do not show: each is made where its condition holds, and not where it does not."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from identification_logs import Log, driven, encoded, multisine

from vctune import identify
from vctune.model.device import Device
from vctune.model.experiment import Friction

T = 1e-3
DEVICE = Device(0.5, 2.0, T, 7e-4)
FRICTION = Friction(0.05, 0.05, 0.005, 1e5, 200.0)


def codes(columns, folder: Path, text: str = "") -> set[str]:
    """Return the codes of the remarks on a log."""
    return {line.rpartition("[")[2].rstrip("]") for line in identify(*Log(columns, text).write(folder)).record.remarks}


@pytest.fixture(scope="module")
def slow_motion():
    """Four seconds of a motion without a period."""
    time = np.arange(4000) * T
    recorded = driven(DEVICE, FRICTION, 3.0 * np.sin(11 * time + 2 * np.sin(0.7 * time)))
    return {"time_s": time, "position_m": encoded(recorded["position"], 1e-6), "command_N": recorded["motor"]}


@pytest.mark.parametrize(
    ("text", "lag_in_delay"),
    [("", True), ("[device]\ndelay = 7e-4\n", False), ("[device.actuator]\nbandwidth_hz = 200.0\n", False)],
)
def test_a_motion_shows_no_high_frequency_nor_what_of_a_delay_is_a_lag(slow_motion, tmp_path, text, lag_in_delay):
    made = codes(slow_motion, tmp_path, text)
    assert ("remark-actuator-lag" in made) == lag_in_delay
    assert ("remark-slow-motion" in made) != ("remark-highest-line" in made)


@pytest.mark.parametrize(("share", "weak"), [(0.51, True), (0.49, False)])
def test_a_delay_is_weak_if_its_interval_is_wider_than_its_middle(slow_motion, tmp_path, share, weak):
    text = f"[device]\ndelay = 7e-4\ndelay_uncertainty = {share * 7e-4}\n"
    assert ("remark-weak-delay" in codes(slow_motion, tmp_path, text)) == weak


@pytest.mark.slow
def test_a_multisine_shows_nothing_above_its_highest_line(tmp_path):
    lines, period = np.array([4, 7, 12, 20, 33, 50, 70, 90]), 512
    wave = 3.0 * multisine(np.random.default_rng(4), lines, period, 8, T)
    recorded = driven(DEVICE, FRICTION, wave)
    position = encoded(recorded["position"], 1e-6)
    columns = {"time_s": np.arange(wave.size) * T, "position_m": position, "command_N": recorded["motor"]}
    remarks = identify(*Log(columns, "").write(tmp_path)).record.remarks
    (line,) = [line for line in remarks if line.endswith("[remark-highest-line]")]
    (highest,) = re.findall(r"above (\S+) Hz", line)
    assert 0.9 * lines[-1] / (period * T) < float(highest) < 1.1 * lines[-1] / (period * T)
    assert not any("remark-slow-motion" in line for line in remarks)
