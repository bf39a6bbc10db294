"""What is probably meant: decimal commas, units behind numbers, times in finer units, names of devices on Windows."""

from __future__ import annotations

import pytest
from command import run, strict
from conftest import DEVICE, FIXED, for_passive_hands

from vctune.document.doubts import doubts
from vctune.document.reading import parse_problem, read_problem
from vctune.document.text.errors import InputError
from vctune.exit_codes import ExitCode

GOOD = for_passive_hands(DEVICE + FIXED.format(160.0))


SERVO = "[device]\nsample_time = 1e-3\n{}[device.servo]\ndelay = 0.01\nbandwidth_hz = {}\n{}"


@pytest.mark.parametrize(
    ("key", "why"), [("mass", "follows the command alone"), ("damping", "alone"), ("delay", 'is "servo.delay"')]
)
def test_a_servo_has_no_numbers_of_a_mechanism_to_be_uncertain(key, why):
    """They would be taken for those of the servo, and nothing would be proved of what is uncertain."""
    text = SERVO.format("", 20.0, f"[uncertainty]\n{key} = 0.1\n")
    with pytest.raises(InputError, match=rf"arm.toml:7: uncertainty.{key}: means nothing with.*{why}; leave it out"):
        parse_problem(text, "arm.toml", "arm")


def test_a_servo_that_nothing_touches_is_refused():
    """Any coupling is stable then, and the best of them has nothing left that could be proved positive at rest."""
    nothing = "[operator]\n" + "".join(
        f"{key} = {{ min = 0.0, max = 0.0 }}\n" for key in ("mass", "damping", "stiffness")
    )
    with pytest.raises(InputError, match=r"arm.toml:6: operator: no hand of it pushes"):
        parse_problem(SERVO.format("", 20.0, nothing), "arm.toml", "arm")
    parse_problem(SERVO.format("", 20.0, "stiffness = 50.0\n" + nothing), "arm.toml", "arm")


def test_a_number_of_uncertainty_in_another_table_is_sent_to_its_table():
    text = GOOD.replace("[gains]", '"actuator.bandwidth_hz" = 0.1\n[gains]')
    with pytest.raises(InputError, match=r"it belongs in \[uncertainty\]"):
        parse_problem(text, "x", "x")


def test_a_band_with_decimal_commas():
    with pytest.raises(InputError, match=r"are these decimal points\? Write \[0\.5, 30\.0\]"):
        parse_problem(GOOD.replace("[gains]", "[transparency]\nband_hz = [0,5, 30,0]\n[gains]"), "x", "x")


@pytest.mark.parametrize(
    ("written", "meant"), [("250.0", "microseconds? Then write 0.00025"), ("0.25", "milliseconds? Then write 0.00025")]
)
def test_a_sample_time_that_no_hand_would_bear(written, meant):
    (doubt,) = doubts(parse_problem(DEVICE.replace("1e-3", written), "x", "x"))
    assert doubt.code == "warn-sample-time" and meant in doubt.text
    assert not list(doubts(parse_problem(DEVICE.replace("1e-3", "5e-2"), "x", "x")))


@pytest.mark.parametrize(("written", "meant"), [("300", "microseconds? Then write 0.0003"), ("0.9", "milliseconds?")])
def test_a_delay_in_a_finer_unit(written, meant):
    with pytest.raises(InputError, match="at most 200 are supported; is it in ") as refused:
        parse_problem(DEVICE + f"delay = {written}\n", "x", "x")
    assert meant in str(refused.value)


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


def test_a_mass_in_grams_and_a_log_in_the_place_of_a_problem_are_told(tmp_path):
    (doubt,) = doubts(parse_problem(DEVICE.replace("0.4", "250"), "x", "x"))
    assert (doubt.code, "Then write 0.25" in doubt.text) == ("warn-mass", True)
    (tmp_path / "log.csv").write_text("time_s,position_m\n0,0\n")
    with pytest.raises(InputError, match=r"`vctune identify .*log\.csv` makes a problem file"):
        read_problem(tmp_path / "log.csv")
