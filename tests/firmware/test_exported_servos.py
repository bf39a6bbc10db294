"""`vctune export` of a servo: a force in, a velocity or a position out; `test_export.py` replays it."""

from __future__ import annotations

import math
import re

import pytest
from test_export import CONTACT, SERVOS
from test_servos import ARM

from vctune import export, write_export
from vctune.firmware.vectors import default_experiments
from vctune.model.gains import Coupling
from vctune.simulation.controller import coupling_coefficients, coupling_of


def test_its_filter_and_its_spring_are_in_the_code():
    device = ARM["device"] | {
        "servo": ARM["device"]["servo"] | {"stiffness": 20.0},
        "force_sensor": {"filter_coefficient": 0.5},
    }
    files = export(ARM | {"device": device}, unproved=True).files
    assert "#define VCTUNE_FORCE_FILTER_0_NOW (0.5)" in files["vctune_controller.h"]
    assert "- VCTUNE_OWN_STIFFNESS * (measurement->position - state->own_zero)" in files["vctune_controller.c"]
    assert "FILTER" not in export(ARM, unproved=True).files["vctune_controller.h"]


@pytest.mark.parametrize("command", SERVOS)
def test_every_file_speaks_of_the_servo(command, tmp_path):
    """Of what it follows, late by how much; not of a mass, a motor, a gain or a limit, which it has not."""
    (tmp_path / "servo.toml").write_text(SERVOS[command])
    folder = write_export(export(tmp_path / "servo.toml"), tmp_path / "out")
    texts = {path.name: path.read_text() for path in folder.iterdir() if path.name != "vectors.csv"}
    for name, text in texts.items():
        words = " ".join(
            re.sub("<svg.*</svg>", "", text, flags=re.DOTALL).replace("\n *", " ").replace("\n#", " ").split()
        )
        assert f"Assumed: a servo that follows the commanded {command}," in words, name
        for absent in ("linear device", "1.0 kg", "motor", "VELOCITY_GAIN", "position_gain", "K_v", "K_p", "friction"):
            assert absent not in words.replace("f_c, N", ""), (name, absent)
    header = texts["vctune_controller.h"]
    assert f"vctune_real {command};" in header and "vctune_real limit" not in header
    unit = {"velocity": "m_per_s", "position": "m"}[command]
    assert (folder / "vectors.csv").read_text().splitlines()[0].endswith(f",command_{unit}")


def test_a_rotary_servo_is_told_in_its_units():
    device = ARM["device"] | {"units": "rotary"}
    hand = {"from": 0.001, "to": 0.01, "speed": 0.05, "cycles": 1, "damping": 2.0, "stiffness": 100.0}
    files = export(ARM | {"device": device, "experiment": [{"name": "turned", "operator": hand}]}).files
    text = files["vctune_controller.h"]
    assert "vctune_real velocity;          /* u, rad/s: for the servo */" in text
    assert "vctune_real force; /* f_s, N m: torque of the hand" in text
    assert files["vectors.csv"].startswith("experiment,position_rad,velocity_rad_per_s,torque_n_m,command_rad_per_s\n")


def test_what_is_replayed_without_experiments_is_as_stiff_as_its_hands():
    for tables in (ARM, CONTACT):
        problem = export(tables).file.problem
        for experiment in default_experiments(problem):
            assert experiment.operator.stiffness == problem.hands.high.stiffness
            assert experiment.limit is None


def test_a_rigid_coupling_is_found_again_in_its_coefficients():
    """Mass and drag alone: the step of the trapezoidal rule is 2 m/T, and nothing of its force decays."""
    rigid = Coupling(math.inf, 4.0, 90.0)
    found = coupling_coefficients(rigid, 2e-3)
    assert found == {"coupling_step": 4000.0, "coupling_decay": -1.0, "resistance": 4090.0}
    assert coupling_of(found, 2e-3) == rigid
