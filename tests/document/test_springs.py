"""Springs between motor and handle: a list of tables, or a table for each."""

import pytest

import vctune
from vctune.document import reading

HEAD = "[device]\nmass = 0.5\ndamping = 2.0\nsample_time = 1e-3\n"
ONE = "[[device.structure]]\nhandle_mass = 0.1\nfrequency_hz = 90.0\ndamping_ratio = 0.02\n"
TWO = "[[device.structure]]\nhandle_mass = 0.08\nstiffness = 3e4\n"


def posed(tmp_path, text):
    path = tmp_path / "springs.toml"
    path.write_text(text)
    return reading.read_problem(path)


def test_a_list_is_a_table_for_each(tmp_path):
    listed = posed(tmp_path, HEAD + ONE + TWO).problem.device
    named = HEAD + ONE.replace("[[device.structure]]", "[device.structure]")
    assert listed == posed(tmp_path, named + TWO.replace("[[device.structure]]", "[device.structure_2]")).problem.device
    assert [mode.handle_mass for mode in listed.modes] == [0.1, 0.08]
    assert listed.motor_mass == pytest.approx(0.32)


def test_a_sensor_at_the_handle_is_proved_in_hands(tmp_path):
    at = "[device.velocity]\nat = 'handle'\n"
    for hands in ("[stability]\ncriterion = 'hands'\n", "[environment]\nstiffness = { max = 100.0 }\n"):
        assert posed(tmp_path, HEAD + ONE + at + hands).problem.device.at_handle


def test_a_display_in_hands_may_have_two_springs(tmp_path):
    dual = HEAD.replace("[device]", '[device]\ndisplay = "impedance"')
    assert posed(tmp_path, dual + ONE + TWO + '[stability]\ncriterion = "hands"\n').problem.hands_met is not None


def test_a_handle_that_doubles_hardly_hold_is_answered(tmp_path):
    path = tmp_path / "tiny.toml"
    path.write_text(HEAD + ONE.replace("0.1", "1e-30") + "[stability]\ncriterion = 'hands'\n")
    problem = vctune.problem(path).problem
    judged = vctune.judge(problem, vctune.Gains(5.0, 0.0), vctune.Coupling(17.0, 0.15, 3.0))
    assert judged.status.value in ("certified", "undecided", "violated")
