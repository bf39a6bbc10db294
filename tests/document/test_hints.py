"""What is probably meant: decimal commas, units behind numbers, times in finer units, names of devices on Windows."""

from __future__ import annotations

from typing import get_args

import pytest
from command import run, strict
from conftest import DEVICE, FIXED, for_passive_hands

from vctune.document.doubts import doubts
from vctune.document.reading import parse_problem
from vctune.document.text.errors import Code
from vctune.exit_codes import ExitCode

GOOD = for_passive_hands(DEVICE + FIXED.format(160.0))


def test_a_servo_that_only_its_own_spring_touches_is_accepted():
    servo = "[device]\nsample_time = 1e-3\nservo = { delay = 0.01, bandwidth_hz = 20.0, stiffness = 50.0 }\n"
    nothing = "[operator]\nmass.max = 0.0\ndamping.max = 0.0\nstiffness.max = 0.0\n"
    assert parse_problem(servo + nothing, "arm.toml", "arm").device.servo.stiffness == 50.0


@pytest.mark.parametrize("name", ["CON", "aux", "nul.txt", "com1"])
def test_a_name_that_windows_keeps(tmp_path, name):
    (tmp_path / "x.toml").write_text(f'name = "{name}"\n{GOOD}')
    done = run("solve", "x.toml", "--json", cwd=tmp_path)
    assert done.returncode == ExitCode.OK and (tmp_path / f"results/_{name}/design.json").exists()
    (said,) = (warning for warning in strict(done.stdout)["warnings"] if warning.endswith("[warn-name]"))
    assert said in done.stderr and f"the folder is _{name}" in said
    assert run("solve", "x.toml", "--strict", cwd=tmp_path).returncode == ExitCode.FAILED


def test_what_is_usual_is_in_no_doubt(tmp_path):
    (tmp_path / "console.toml").write_text(GOOD)
    done = run("check", "console.toml", "--json", cwd=tmp_path)
    assert strict(done.stdout)[0]["warnings"] == [] and done.stderr == ""


HELD = DEVICE + FIXED.format(160.0)
DESKTOP = '[device]\ndisplay = "impedance"\nmass = 0.06\ndamping = 0.1\nsample_time = 1e-3\n'
ROTARY = DEVICE.replace("[device]\n", '[device]\nunits = "rotary"\n')
ARM = "[device]\nsample_time = 2e-3\n[device.servo]\ndelay = 0.03\n"
SERVED = ARM + "bandwidth_hz = 20.0\n[environment]\nstiffness = { max = 3000.0 }\n"
GRIP = "[operator]\nstiffness = { min = 0.0, max = 1e3 }\ndamping = 1.0\nmass = 1.0\n"
BOX = "[environment]\nmass = { min = 0.1, max = 5.0 }\nstiffness = { max = 2000.0 }\n"
WALLS = BOX.replace("min = 0.1", "min = 0.0") + "walls = true\n"
SPRINGS = WALLS.replace("walls = true\n", "")
TOOL = SPRINGS + "damping = { min = 1.0 }\n"
AT_WALL = "stiffness = 9.0, wall = true"
MOVES = '[[experiment]]\nname = "one"\nenvironment = { stiffness = 9.0 }\n'


def rendering(box: str, environment: str) -> str:
    """Return a problem with a box of environments and an experiment."""
    return f'{HELD}{box}[[experiment]]\nname = "one"\nenvironment = {{ {environment} }}\n'


DOUBTS = {
    "a sample of 0.1 s": ("warn-sample-time", HELD.replace("1e-3", "0.1"), HELD.replace("1e-3", "0.09"), "is 0.1 s"),
    "samples in ms": ("warn-sample-time", HELD.replace("1e-3", "0.5"), HELD, "milliseconds? Then write 0.0005"),
    "samples in us": ("warn-sample-time", HELD.replace("1e-3", "500.0"), HELD, "microseconds? Then write 0.0005"),
    "50 g": ("warn-mass", HELD.replace("0.4", "50.0"), HELD.replace("0.4", "49.9"), "Then write 0.05"),
    "5 kg in g": ("warn-mass", HELD.replace("0.4", "5000.0"), HELD.replace("0.4", "5001.0"), "Then write 5"),
    "a linear mass": ("warn-mass", DEVICE.replace("0.4", "60.0"), (ROTARY + GRIP).replace("0.4", "60.0"), "in grams"),
    "a tool in grams": (
        "warn-mass", HELD + "[tool]\nmass = 2000.0\n", HELD + "[tool]\nmass = 2.0\n", "tool.mass is 2000 kg",
    ),
    "a grip of 1e6": (
        "warn-stiffness", HELD + GRIP.replace("1e3", "1e6"), HELD + GRIP.replace("1e3", "9.9e5"),
        "is 1e+06 N/m; is it in N/m",
    ),
    "a rotary grip": (
        "warn-stiffness", ROTARY + GRIP.replace("1e3", "2e6"), ROTARY + GRIP, "is 2e+06 N m/rad; is it in N m/rad",
    ),
    "a latency without a bandwidth": (
        "warn-latency", ARM, ARM + "bandwidth_hz = 20.0\n", "latency of 30 ms is divided into delay and lag",
    ),
    "a real table": (
        "warn-table", SERVED.replace("3000.0", "3001.0"), SERVED, "write operator.stiffness.max = 3001",
    ),
    "a reserved name": ("warn-name", f'name = "con"\n{HELD}', f'name = "cone"\n{HELD}', "the folder is _con"),
    "moves before a rigid world": (
        "warn-environment",
        DESKTOP + "[environment]\nstiffness = inf\n" + MOVES, DESKTOP + MOVES, "an environment that moves",
    ),
}  # fmt: skip
"""Each doubt: its code, a file that gives it, the nearest one that gives none, and words of it."""
ENVIRONMENTS = {
    "a wall among springs": (SPRINGS, "stiffness = 9.0, wall = true", "stiffness = 9.0", "a wall that comes"),
    "a damped wall": (WALLS, AT_WALL + ", damping = 1.0", AT_WALL, "a wall with a damper"),
    "a damper, no wall": (WALLS, AT_WALL + ", damping = 1.0", "damping = 1.0, stiffness = 9.0", "a wall with a damper"),
    "a late force": (WALLS, "stiffness = 9.0, late = 1", "stiffness = 9.0, late = 0", "a force 1 samples late"),
    "a mass by backward Euler": (BOX, "mass = 1.0, rule = 'backward'", "mass = 1.0", "a mass by backward Euler"),
    "a mass by explicit Euler": (BOX, "mass = 1.0, rule = 'explicit'", "mass = 1.0", "a mass by explicit Euler"),
    "a spring ahead": (WALLS, "stiffness = 9.0, rule = 'explicit'", "stiffness = 9.0", "a spring by explicit Euler"),
    "a mass below the box": (BOX, "mass = 0.09", "mass = 0.1", "a mass of 0.09 kg"),
    "a mass above the box": (BOX, "mass = 5.1", "mass = 5.0", "a mass of 5.1 kg"),
    "a damper below the box": (TOOL, "damping = 0.9", "damping = 1.0", "a damping of 0.9 N s/m"),
    "a spring above the box": (WALLS, "stiffness = 2001.0", "stiffness = 2000.0", "a stiffness of 2001 N/m"),
}  # fmt: skip
"""A box, an environment of an experiment that is in doubt with it, the nearest that is not, and words of the doubt."""
DOUBTS |= {
    name: ("warn-environment", rendering(box, doubted), rendering(box, sound), words)
    for name, (box, doubted, sound, words) in ENVIRONMENTS.items()
}


@pytest.mark.parametrize("name", DOUBTS)
def test_each_doubt_is_given_where_it_is_due_and_not_beside_it(name: str) -> None:
    code, doubted, sound, words = DOUBTS[name]
    (found,) = doubts(parse_problem(doubted, "x", "x"))
    assert found.code == code and words in found.text
    assert list(doubts(parse_problem(sound, "x", "x"))) == []


def test_no_doubt_about_a_problem_is_without_its_smallest_file() -> None:
    """Doubts are the codes of `vctune explain` that begin with warn- and that neither a design nor a log gives."""
    of_designs = {
        "warn-acceleration",
        "warn-band-edge",
        "warn-bound",
        "warn-buzzes",
        "warn-idle",
        "warn-limp",
        "warn-margin",
        "warn-rings",
    }
    of_logs = {"warn-gain", "warn-residual", "warn-yields"}
    every = {code for code in get_args(Code) if code.startswith("warn-")}
    assert every == {code for code, *_ in DOUBTS.values()} | of_designs | of_logs


def test_each_experiment_has_its_own_doubt() -> None:
    """And each doubt its experiment's name and the place of its key."""
    second = '[[experiment]]\nname = "two"\nenvironment = { stiffness = 9.0, late = 2 }\n'
    third = '[[experiment]]\nname = "three"\nenvironment = { stiffness = 3000.0 }\n'
    found = list(doubts(parse_problem(rendering(WALLS, "stiffness = 9.0") + second + third, "x", "x")))
    assert [note.path for note in found] == [
        ("experiment", 1, "environment", "late"),
        ("experiment", 2, "environment", "stiffness"),
    ]
    assert "'two'" in found[0].text and "'three'" in found[1].text
