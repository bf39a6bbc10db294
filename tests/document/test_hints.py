"""What is probably meant: decimal commas, units behind numbers, times in finer units, names of devices on Windows."""

from __future__ import annotations

import pytest
from command import run, strict
from conftest import DEVICE, FIXED, for_passive_hands
from hypothesis import given
from hypothesis import strategies as st

from vctune.document.reading import parse_problem
from vctune.document.schema.plausibility import doubts
from vctune.document.text.errors import InputError
from vctune.document.text.hints import hint_on_line, number_meant
from vctune.exit_codes import ExitCode

GOOD = for_passive_hands(DEVICE + FIXED.format(160.0))
SAID = {
    "mass = 0,05": "Write 0.05",
    "mass = 0,05 kg  # of the handle": "write 0.05 alone",
    "mass = 0.05 kg": "write 0.05 alone: the file is in SI units",
    "mass = 50 g": "write 0.05 alone: the file is in kg",
    "sample_time = 250 us": "write 0.00025 alone: the file is in s",
    "sample_time = 0.25ms": "write 0.00025 alone: the file is in s",
    "mass = 1.5e1 kg m^2": "write 1.5e1 alone",
    "mass = 120 g cm2": "write 1.2e-05 alone: the file is in kg m2",
    "zero = 90 deg": "write 1.57079632679 alone: the file is in rad",
}


@pytest.mark.parametrize("line", SAID)
def test_a_number_that_is_none_is_told_what_it_was_to_be(line):
    with pytest.raises(InputError) as refused:
        parse_problem(f"[device]\n{line}\n", "x.toml", "x")
    (mistake,) = refused.value.mistakes
    assert (mistake.code, mistake.line) == ("not-toml", 2) and SAID[line] in mistake.message
    quoted = line.partition(" = ")[2].partition("  #")[0]
    assert SAID[line].lower() in number_meant(quoted).lower()


@pytest.mark.parametrize(
    "line", ["mass = much", "mass =", "[device", "mass = 1,2,3", "# 0,05", 'name = "1,5', "a = [1,"]
)
def test_what_is_no_number_is_told_nothing_of_numbers(line):
    assert hint_on_line(line) == ""


SERVO = "[device]\nsample_time = 1e-3\n{}[device.servo]\ndelay = 0.01\nbandwidth_hz = {}\n{}"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (SERVO.format("foo = 1\n", 20.0, ""), "unknown key; known here: units, sample_time, servo, force_sensor"),
        (
            SERVO.format("", 20.0, "hold = 1\n"),
            "unknown key; known here: command, delay, bandwidth_hz, order, stiffness",
        ),
        (SERVO.format("", 1e9, ""), "1e+09 Hz is above 1e+06 Hz, where it does nothing; lower it"),
    ],
)
def test_a_servo_is_told_of_its_own_keys(text, said):
    with pytest.raises(InputError) as refused:
        parse_problem(text, "arm.toml", "arm")
    assert [mistake.message for mistake in refused.value.mistakes] == [said]


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


def test_a_rotary_servo_is_not_sent_to_a_criterion_that_it_has_not():
    text = SERVO.format('units = "rotary"\n', 20.0, "")
    with pytest.raises(InputError, match=r"r metres from the axis \[contradiction\]$"):
        parse_problem(text, "arm.toml", "arm")


def test_a_number_of_uncertainty_in_another_table_is_sent_to_its_table():
    text = GOOD.replace("[gains]", '"actuator.bandwidth_hz" = 0.1\n[gains]')
    with pytest.raises(InputError, match=r"it belongs in \[uncertainty\]"):
        parse_problem(text, "x", "x")


@given(st.text(max_size=30))
def test_no_line_is_too_odd_for_a_hint(line):
    assert isinstance(hint_on_line(line), str) and isinstance(number_meant(line), str)


@given(st.integers(0, 10**6), st.text("0123456789", min_size=1, max_size=6))
def test_what_is_to_be_written_is_the_number_with_a_point(whole, decimals):
    assert number_meant(f"{whole},{decimals}").endswith(f"Write {whole}.{decimals}")
    assert f"write {whole}.{decimals} alone" in number_meant(f"{whole},{decimals} N s/m")


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


def test_an_unknown_key_of_a_servos_table_lists_keys_that_a_servo_has():
    text = "[device]\nsample_time = 2e-3\nservo = { delay = 0.01, bandwidth_hz = 20.0 }\n[uncertainty]\nfoo = 0.1\n"
    with pytest.raises(InputError) as refused:
        parse_problem(text, "arm.toml", "arm")
    assert "known here: servo.delay, servo.bandwidth_hz, unmodelled, objective" in str(refused.value)
