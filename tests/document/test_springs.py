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


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        (ONE + TWO.replace("stiffness = 3e4", ""), 9, "needs frequency_hz, or the stiffness"),
        (ONE + TWO + "frequency_hz = 40.0\n", 11, "leave one of them out"),
        (ONE + TWO.replace("0.08", "0.45"), 10, "with the others, 0.55 kg is not less than device.mass = 0.5 kg"),
        (ONE + TWO.replace("0.08", "-0.08"), 10, "too small"),
        (ONE + 3 * TWO, 15, "at most 3 are modelled"),
        (ONE.replace("[[device.structure]]", "[device.structure_2]"), 5, "behind device.structure, which is not there"),
        (ONE + TWO.replace("[[device.structure]]", "[device.structure_2]"), 9, "write a list, or a table for each"),
        (ONE + TWO + '[uncertainty]\n"structure_2.frequency_hz" = 0.1\n', 13, "no device.structure_2.frequency_hz"),
    ],
)
def test_a_fault_names_its_line(tmp_path, text, line, message):
    with pytest.raises(vctune.InputError) as error:
        posed(tmp_path, HEAD + text)
    assert any(fault.line == line and message in fault.message for fault in error.value.mistakes), error.value


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("", "not proved in any passive hand"),
        ("[stability]\ncriterion = 'passive'\n", "not proved in any passive hand"),
        ("[device.velocity]\nresolution = 1e-6\nfrom = 'difference'\n", "is of an encoder on the motor"),
    ],
)
def test_a_sensor_at_the_handle_is_proved_in_hands(tmp_path, more, said):
    at = "[device.velocity]\nat = 'handle'\n"
    more = more.replace("[device.velocity]\n", at) if "velocity" in more else at + more
    with pytest.raises(vctune.InputError, match=said):
        posed(tmp_path, HEAD + ONE + more)
    with pytest.raises(vctune.InputError, match="behind a spring"):
        posed(tmp_path, HEAD + at)
    for hands in ("[stability]\ncriterion = 'hands'\n", "[environment]\nstiffness = { max = 100.0 }\n"):
        assert posed(tmp_path, HEAD + ONE + at + hands).problem.device.at_handle


def test_any_passive_hand_of_a_display_has_one_spring(tmp_path):
    dual = HEAD.replace("[device]", '[device]\ndisplay = "impedance"')
    with pytest.raises(vctune.InputError, match='criterion = "hands"'):
        posed(tmp_path, dual + ONE + TWO)
    assert posed(tmp_path, dual + ONE + TWO + '[stability]\ncriterion = "hands"\n').problem.hands_met is not None


def test_a_handle_that_doubles_hardly_hold_is_answered(tmp_path):
    path = tmp_path / "tiny.toml"
    path.write_text(HEAD + ONE.replace("0.1", "1e-30") + "[stability]\ncriterion = 'hands'\n")
    problem = vctune.problem(path).problem
    judged = vctune.judge(problem, vctune.Gains(5.0, 0.0), vctune.Coupling(17.0, 0.15, 3.0))
    assert judged.status.value in ("certified", "undecided", "violated")


def test_a_key_out_of_place_has_one_message(tmp_path):
    """The one that mends it: quotes in [uncertainty], and of a servo that it has no such part."""
    unquoted = HEAD + ONE + TWO + "[uncertainty]\nstructure_2.handle_mass = 0.1\n"
    servo = "[device]\nsample_time = 1e-3\n[device.servo]\ndelay = 0.01\n[device.velocity]\nat = 'handle'\n"
    for text, codes in ((unquoted, ["belongs in quotes"]), (servo + ONE, ["no gain of this file", "not modelled"])):
        with pytest.raises(vctune.InputError) as error:
            posed(tmp_path, text)
        said = [fault.message for fault in error.value.mistakes]
        assert len(said) == len(codes) and all(word in one for word, one in zip(codes, said, strict=True)), said
