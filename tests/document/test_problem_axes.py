"""Several axes of a problem file: what each states, and where what is wrong with it stands."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from vctune.document.problem_axes import axes_file
from vctune.document.reading import parse_problem
from vctune.document.text.errors import InputError

SHARED = """name = "arm"
[device]
sample_time = 2e-3
[device.servo]
delay = 0.032
bandwidth_hz = 20.0
[operator]
mass = { min = 0.0, max = 2.0 }
stiffness = { min = 0.0, max = 1000.0 }
"""
AXES = """[[axis]]
name = "x"
[[axis]]
name = "y"
[[axis]]
name = "z"
operator.stiffness.max = 400.0
device.servo = { delay = 0.01 }
[[axis]]
name = "rx"
operator = { mass = { min = 0.0, max = 0.01 }, damping = { min = 0.0, max = 0.1 }, stiffness.max = 20.0 }
[axis.device]
units = "rotary"
"""


def read(text):
    return axes_file(text, Path("arm.toml"))


def test_an_axis_is_the_problem_of_the_merged_tables():
    """Dotted or nested, key by key; a range that is stated as a whole, or a number, replaces what was there."""
    found = read(SHARED + AXES)
    x, y, z, rx = found.axes
    assert found.name == "arm" and [axis.name for axis in found.axes] == ["x", "y", "z", "rx"]
    assert [axis.file.problem.name for axis in found.axes] == ["arm x", "arm y", "arm z", "arm rx"]
    assert [axis.line for axis in found.axes] == [11, 13, 15, 19]
    assert x.file.sha256 == y.file.sha256 != z.file.sha256
    assert z.file.problem.hands.high.stiffness == 400.0 and z.file.problem.hands.high.mass == 2.0
    servo = z.file.problem.device.servo
    assert (servo.delay, servo.bandwidth_hz) == (0.01, 20.0)
    assert rx.file.problem.device.units == "rotary" and rx.file.problem.hands.high.stiffness == 20.0
    alone = SHARED.replace("max = 1000.0", "max = 400.0").replace("0.032", "0.01")
    assert replace(parse_problem(alone, "z", "z"), name="arm z") == z.file.problem
    assert parse_problem(z.file.text, "z", "z") == z.file.problem


def test_a_file_without_axes_has_none():
    assert read(SHARED) is None


@pytest.mark.parametrize(
    "was, now, complaint",
    [
        ("max = 400.0", 'max = "stiff"', 'arm.toml:16: axis[2].operator.stiffness.max: "stiff" is not a number'),
        ("operator.stiffness.max", "operatr.stiffness.max", "arm.toml:16: axis[2].operatr: unknown key"),
        ('"rotary"', '"round"', "arm.toml:22: axis[3].device.units: "),
        ('name = "y"', 'name = "X"', "arm.toml:13: axis[1].name: 'X' is the name of axis[0] too"),
        ('name = "y"', "", "arm.toml:12: axis[1].name: is missing"),
        ('name = "y"', 'name = "../y"', 'arm.toml:13: axis[1].name: "../y" is no name'),
        ('name = "y"', 'name = "y"\nexperiment = []', "arm.toml:14: axis[1].experiment: is of the file"),
        ("delay = 0.032", 'delay = "late"', 'arm.toml:5: device.servo.delay: "late" is not a number'),
    ],
)
def test_what_is_wrong_is_said_once_where_it_stands(was, now, complaint):
    text = SHARED + AXES
    assert was in text
    with pytest.raises(InputError) as caught:
        read(text.replace(was, now, 1))
    assert [line for line in str(caught.value).splitlines() if line.startswith(complaint)] == [str(caught.value)]


def test_what_an_axis_makes_wrong_of_the_files_own_tables_names_it():
    with pytest.raises(InputError, match=r"^arm.toml:5: device.servo.delay: of axis y: 0.032 s is 3200 sample times"):
        read(SHARED + '[[axis]]\nname = "x"\n[[axis]]\nname = "y"\ndevice.sample_time = 1e-5\n')


def test_a_problem_of_several_axes_is_none():
    with pytest.raises(InputError, match=r"arm.toml:10: axis: makes several problems of one file"):
        parse_problem(SHARED + AXES, "arm.toml", "arm")


@pytest.mark.parametrize("axis", ["axis = 3\n", "axis = []\n", 'axis = ["x"]\n'])
def test_axes_are_tables(axis):
    with pytest.raises(InputError, match=r"arm.toml:1: axis: is no list of tables; write \[\[axis\]\]"):
        read(axis + SHARED)
