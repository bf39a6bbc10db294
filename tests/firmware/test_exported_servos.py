"""`vctune export` of a servo: a force in, a velocity or a position out; what is proved is what is compiled."""

from __future__ import annotations

import math
import re
import shutil

import numpy as np
import pytest
from compilers import by_each_compiler, done, has, period, warned
from conftest import mostly_slow
from kinds import servo
from test_export import replayed
from test_servos import ARM, CONTACT, WALKER, decades

from vctune import export, write_export
from vctune.document.text.toml import toml_text
from vctune.firmware.vectors import default_experiments
from vctune.model.gains import Coupling
from vctune.simulation.controller import coupling_coefficients, coupling_of

EXPERIMENTS = [
    {
        "name": "wall",
        "environment": {"mass": 0.1, "damping": 3.0, "stiffness": 5000.0, "zero": 0.004, "wall": True},
        "operator": {"to": 0.01, "speed": 0.04, "cycles": 1, "mass": 0.1},
        "sensors": {"force_noise": 0.01},
    },
    {
        "name": "lossless",
        "environment": {"mass": 0.05, "stiffness": 200.0, "rule": "trapezoid"},
        "operator": {"from": 0.001, "to": 0.01, "speed": 0.05, "cycles": 1},
    },
    {"name": "free motion", "operator": {"to": 0.01, "speed": 0.1, "cycles": 1, "motion": "sine"}},
]
SERVOS = {"velocity": CONTACT, "position": WALKER}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Folders of exported C by command and precision, each made once."""
    found = {}

    def folder(command="velocity", precision="double"):
        if (command, precision) not in found:
            place = tmp_path_factory.mktemp(command)
            (place / "servo.toml").write_text(toml_text(SERVOS[command] | {"experiment": EXPERIMENTS}))
            found[command, precision] = write_export(export(place / "servo.toml", precision=precision), place / "out")
        return found[command, precision]

    return folder


@pytest.mark.parametrize("precision", ["double", pytest.param("single", marks=pytest.mark.slow)])
@by_each_compiler
def test_it_compiles_without_a_warning(made, name, precision, tmp_path):
    for command in SERVOS:
        folder = made(command, precision)
        assert warned(name, folder, tmp_path) == "", command


def test_the_caller_is_told_to_filter_and_to_pull(tmp_path):
    device = ARM["device"] | {
        "servo": ARM["device"]["servo"] | {"stiffness": 20.0},
        "force_sensor": {"filter_coefficient": 0.5},
    }
    for stated, expected in ((ARM["device"], False), (device, True)):
        (tmp_path / "servo.toml").write_text(toml_text(ARM | {"device": stated}))
        header = export(tmp_path / "servo.toml", unproved=True).files["vctune_controller.h"]
        told = re.sub(r"\s+(\* )?", " ", header)
        assert ("the caller filters the samples of the force with a = 0.5" in told) == expected
        assert ("adds the force of a spring of 20.0 N/m on the servo's position" in told) == expected


@has("cppcheck")
def test_cppcheck_has_nothing_to_say(made):
    options = ["--std=c99", "--enable=warning,style,performance,portability", "--error-exitcode=1", "-q"]
    folder = made("position")
    found = done("cppcheck", *options, f"-DVCTUNE_TIMER_PERIOD_NS={period(folder)}", ".", cwd=folder)
    assert (found.returncode, found.stdout + found.stderr) == (0, "")


@has("make", "gcc")
@pytest.mark.parametrize(
    "compiler", [pytest.param("gcc", marks=has("gcc")), pytest.param("clang", marks=[has("clang"), pytest.mark.slow])]
)
@pytest.mark.parametrize("command", SERVOS)
def test_double_precision_replays_to_the_last_bit(made, command, compiler, tmp_path):
    shutil.copytree(made(command), tmp_path / "c")
    found = done("make", "-s", "check", f"CC={compiler}", cwd=tmp_path / "c")
    assert found.returncode == 0, found.stdout + found.stderr
    assert found.stdout.count(" greatest difference 0 ulp  ok") == 3


@has("make", "gcc")
@pytest.mark.slow
@pytest.mark.parametrize("command", SERVOS)
def test_single_precision_replays_within_the_bound_that_it_states(made, command, tmp_path):
    shutil.copytree(made(command, "single"), tmp_path / "c")
    found = done("make", "-s", "check", cwd=tmp_path / "c")
    assert found.returncode == 0, found.stdout + found.stderr
    stated = float((tmp_path / "c/replay.c").read_text().split("#define VCTUNE_ALLOWED ")[1].split()[0])
    lines = found.stdout.splitlines()
    assert max(float(line.split("difference ")[1].split()[0]) for line in lines) == pytest.approx(stated / 2, rel=0.02)
    unit = {"velocity": "m/s", "position": "m"}[command]
    assert all(line.endswith(f" {unit}  ok") for line in lines)


@has("make", "gcc")
@pytest.mark.parametrize("constant", mostly_slow(["COUPLING_STEP", "COUPLING_DECAY", "RESISTANCE"], ["RESISTANCE"]))
def test_a_constant_that_was_changed_in_its_last_digit_fails_the_check(made, constant, tmp_path):
    shutil.copytree(made(), tmp_path / "c")
    header = tmp_path / "c/vctune_controller.h"
    text = header.read_text()
    number = text.split(f"#define VCTUNE_{constant} (")[1].split(")")[0]
    header.write_text(text.replace(f"({number})", f"({float(np.nextafter(float(number), np.inf))!r})"))
    found = done("make", "-s", "check", cwd=tmp_path / "c")
    assert found.returncode != 0 and "FAILED" in found.stdout


@pytest.mark.parametrize("command", SERVOS)
def test_every_file_speaks_of_the_servo(made, command):
    """Of what it follows, late by how much; not of a mass, a motor, a gain or a limit, which it has not."""
    folder = made(command)
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
    hand = EXPERIMENTS[1]["operator"] | {"damping": 2.0, "stiffness": 100.0}
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


@pytest.mark.slow
@has("make", "gcc")
@pytest.mark.parametrize("seed", range(20))
def test_random_servos_replay_to_the_last_bit(seed, tmp_path):
    rng = np.random.default_rng(seed)
    size = {"damping": decades(rng, 0, 4), "mass": decades(rng, -2, 1), "drag": decades(rng, 1, 3)}
    environments = [
        {"mass": rng.uniform(0, 1), "stiffness": decades(rng, 2, 5), "zero": 0.005, "wall": True},
        {"mass": rng.uniform(0, 1), "damping": rng.uniform(0, 20), "stiffness": decades(rng, 0, 3)},
        {"mass": rng.uniform(0.01, 1), "stiffness": decades(rng, 0, 3), "rule": "trapezoid"},
    ]
    experiments = [
        {
            "name": f"random {number}",
            "environment": environment,
            "operator": {"to": 0.01, "cycles": 1, "mass": rng.uniform(0, 0.3), "stiffness": 100.0},
            "sensors": {"force_noise": 0.01},
        }
        for number, environment in enumerate(environments)
    ]
    tables = {"device": servo(rng), "coupling": size, "experiment": experiments}
    replayed(tables, tmp_path)


def test_a_rigid_coupling_is_found_again_in_its_coefficients():
    """Mass and drag alone: the step of the trapezoidal rule is 2 m/T, and nothing of its force decays."""
    rigid = Coupling(math.inf, 4.0, 90.0)
    found = coupling_coefficients(rigid, 2e-3)
    assert found == {"coupling_step": 4000.0, "coupling_decay": -1.0, "resistance": 4090.0}
    assert coupling_of(found, 2e-3) == rigid
