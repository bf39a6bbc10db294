"""Problem files: defaults, units, and one bad file per fault, named by the fault."""

from __future__ import annotations

import json
import time
import tomllib
from math import inf, pi, sqrt
from pathlib import Path

import pytest
from conftest import PROBLEM_FILES, ROOT
from hypothesis import given
from hypothesis import strategies as st

from vctune.design.uncertain import device_box
from vctune.document.gains_file import gains_text
from vctune.document.reading import parse_problem, problem_file, read_problem
from vctune.document.schema.problem_schema import json_schema
from vctune.document.text import toml
from vctune.document.text.errors import InputError
from vctune.document.text.output_files import folder_name
from vctune.model.display import ADMITTANCE
from vctune.model.experiment import Environment, Experiment, Friction, MovingHand, Sensors
from vctune.model.gains import Coupling, Gains
from vctune.model.problem import ABSENT, HUMAN_HANDS, Band, Range

SERVO = """
[device]
sample_time = 1e-3
[device.servo]
delay = 1e-3
bandwidth_hz = 15.915494309189533
[device.force_sensor]
bandwidth_hz = 100.0
"""
THREE = "[device]\nmass = {}\ndamping = {}\nsample_time = {}\n"


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"\xff\xfe\x00", "not UTF-8"),
        (b"[" * 90_000, "not valid TOML"),
        (b"x" * 1_000_000, "longer than"),
        (b"\x00" * 1000, "not valid TOML"),
    ],
)
def test_garbage(tmp_path, content, text):
    path = tmp_path / "garbage.toml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=text):
        read_problem(path)


def test_defaults_are_the_documented_formulas():
    problem = parse_problem(THREE.format(0.4, 2.0, 1e-3), "x.toml", "x")
    tau, f = 0.5e-3, sqrt(0.5 * 30.0)
    loop = 0.4 / tau + 2.0
    Z_0 = 0.4 * 2 * pi * f
    assert problem.name == "x"
    assert (problem.device.hold, problem.device.delay) == ("zoh", 0.0)
    assert problem.transparency.band == Band(pytest.approx(2 * pi * 0.5), pytest.approx(2 * pi * 30))
    assert problem.transparency.reference_impedance == pytest.approx(Z_0)
    assert problem.bounds.velocity == Range(pytest.approx(1e-8 * 0.4 / 1e-3), pytest.approx(2 * loop))
    assert problem.bounds.position == Range(0.0, pytest.approx(2 * loop / tau))
    assert problem.bounds.damping == Range(pytest.approx(1e-6 * Z_0), pytest.approx(1e6 * Z_0))
    assert problem.bounds.mass == Range(pytest.approx(1e-6 * 0.4), pytest.approx(1e6 * 0.4))
    assert problem.bounds.drag == Range(0.0, pytest.approx(Z_0))
    assert problem.stability.band == Band(pytest.approx(2 * pi * 0.5), pytest.approx(2 * pi * 100))
    assert (problem.stability.safety_factor, problem.stability.max_sensitivity) == (1.05, 2.0)
    assert (problem.stability.criterion, problem.hands) == ("both", HUMAN_HANDS)


def test_defaults_of_an_impedance_display():
    problem = parse_problem(THREE.format(0.4, 2.0, 1e-3) + 'display = "impedance"\n', "x.toml", "x")
    middle = sqrt(problem.transparency.band.min * problem.transparency.band.max)
    Z_0 = 0.4 * middle
    assert problem.transparency.reference_impedance == pytest.approx(Z_0)
    assert problem.bounds.velocity == Range(0.0, 0.0)
    assert problem.bounds.damping == Range(0.0, pytest.approx(1e6 * Z_0))
    assert problem.bounds.stiffness == Range(pytest.approx(1e-6 * Z_0 * middle), pytest.approx(1e6 * Z_0 * middle))
    assert problem.bounds.position == problem.bounds.mass == problem.bounds.drag == ABSENT
    assert problem.stability.band.max == pytest.approx(2 * pi * 500)


@pytest.mark.parametrize(
    ("operator", "resistance"),
    [
        ("mass = 0.7\ndamping = 30.0\nstiffness = { min = 0, max = 50000 }", 50000 * 11.5e-3),
        ("mass = { min = 0, max = 0.1 }\ndamping = { min = 0, max = 40 }\nstiffness = { min = 0, max = 1 }", 40.0),
        ("mass = { min = 0, max = 2.3 }\ndamping = { min = 0, max = 1 }\nstiffness = { min = 0, max = 1 }", 200.0),
    ],
    ids=["stiffness", "damping", "mass"],
)
def test_defaults_of_a_servo(operator, resistance):
    """The lag is T/2 + delay + 1/w; the force sensor's lag is not a part of it."""
    text = f"[operator]\n{operator}\n" + SERVO
    problem = parse_problem(text, "x.toml", "x")
    tau = 11.5e-3
    assert problem.transparency.reference_impedance == pytest.approx(resistance)
    assert problem.transparency.band == Band(pytest.approx(2 * pi * 0.005 / tau), pytest.approx(2 * pi * 0.1 / tau))
    assert problem.stability.band.max == pytest.approx(2 * pi * 500)
    assert problem.stability.criterion == "hands"
    assert problem.bounds.velocity == problem.bounds.position == ABSENT


def test_an_experiment_needs_but_a_name_and_a_friction_but_its_size():
    text = THREE.format(0.4, 2.0, 1e-3) + '[[experiment]]\nname = "e"\n'
    operator = MovingHand("reciprocate", 0.0, 0.05, 0.01, 3, 0.0, 2.0, 1000.0)
    least = Experiment(
        "e", Environment(0.0, 0.0, 0.0, 0.0, False, "backward"), operator, None, Sensors(0.0, 0.0, 0), None, None
    )
    assert parse_problem(text, "x.toml", "x").experiments == (least,)
    (rubbed,) = parse_problem(text + "friction = { coulomb = 0.3 }\n", "x.toml", "x").experiments
    assert rubbed.friction == Friction(0.3, 0.3, 0.005, None, 0.0)
    (bristled,) = parse_problem(text + "friction = { coulomb = 0.3, stiction = 0.4 }\n", "x.toml", "x").experiments
    assert bristled.friction == Friction(0.3, 0.4, 0.005, 1e5, pytest.approx(sqrt(1e5 * 0.4)))


@given(st.floats(-3, 3), st.floats(-2, 2))
def test_defaults_do_not_depend_on_units(mass_decades, time_decades):
    """A device in other units has the same dimensionless problem."""
    c, t = 10.0**mass_decades, 10.0**time_decades
    here = parse_problem(THREE.format(0.4, 2.0, 1e-3), "x", "x")
    there = parse_problem(THREE.format(0.4 * c * t, 2.0 * c, 1e-3 * t), "x", "x")
    a = here.in_units(here.transparency.reference_impedance, here.device.sample_time)
    b = there.in_units(there.transparency.reference_impedance, there.device.sample_time)
    for name in ("velocity", "position", "damping", "mass"):
        assert getattr(b.bounds, name).max == pytest.approx(getattr(a.bounds, name).max, rel=1e-9)
    assert b.device.mass == pytest.approx(a.device.mass, rel=1e-9)
    assert b.stability.band.max == pytest.approx(a.stability.band.max, rel=1e-9)


def test_bounds_that_meet_are_a_number():
    text = THREE.format(0.4, 2.0, 1e-3)
    a = parse_problem(text + "[gains]\nvelocity = { min = 3.0, max = 3.0 }\n", "x", "x")
    b = parse_problem(text + "[gains]\nvelocity = 3\n", "x", "x")
    assert a.bounds == b.bounds
    assert a.bounds.velocity.fixed


def test_band_may_reach_zero_and_infinity_with_lag():
    text = THREE.format(0.4, 2.0, 1e-3) + 'hold = "lag"\n[stability]\nband_hz = [0.0, inf]\n'
    assert parse_problem(text, "x", "x").stability.band == Band(0.0, inf)


def test_locate_finds_keys_in_every_way_toml_writes_them():
    text = (
        '# [a]\nx = [\n  1,\n  2,\n]\n\n[a]  # b = 1\n# y\n\ny = """\n[c]\nz = 1\n"""\n'
        'b.c = 1\n"d e" = { f = 1, g = 2 }\n[[t]]\nk = 1\n[[t]]\nk = 2\n'
    )
    places = {
        ("x",): 2, ("x", 1): 2, ("a",): 7, ("a", "y"): 10, ("a", "b", "c"): 14, ("a", "d e", "g"): 15,
        ("t", 0, "k"): 17, ("t", 1, "k"): 19,
    }  # fmt: skip
    for path, line in places.items():
        assert toml.Lines(text).locate(path) == line
        assert toml.Lines(text.replace("\n", "\r\n")).locate(path) == line
    assert toml.Lines(text).locate(("c", "z")) is None


def test_schema_file_is_the_schema():
    stored = json.loads((ROOT / "vctune/document/problem.schema.json").read_text())
    assert stored == json_schema()


def test_problems_name_the_schema():
    for path in PROBLEM_FILES:
        first = path.read_text().splitlines()[0]
        assert first.startswith("#:schema ")
        assert (path.parent / first.removeprefix("#:schema ")).resolve() == ROOT / "vctune/document/problem.schema.json"


@pytest.mark.parametrize(
    "name", ["a b", 'quo"te', "<script>", "Größe 大", "tab\t", "back\\slash", "\x7f", "line\nbreak"]
)
def test_gains_file_is_toml_and_fixes_a_problem(name):
    gains, coupling = Gains(279.10689, 1e-05), Coupling(16.0, 1e19, 0.0)
    text = gains_text(ADMITTANCE, gains, coupling, {"problem": name, "sha256": "0"})
    document = tomllib.loads(text)
    assert document["design"]["problem"] == name
    pasted = text[: text.index("[design]")] + THREE.format(0.4, 2.0, 1e-3)
    assert parse_problem(pasted, "x", "x").fixed_design == (gains, coupling)


@pytest.mark.parametrize(
    "name", ["a/b", "..", "../../etc", "a\x00b", "", "C:\\x", "." * 5, "x" * 300, "a\u202eb", "\u2066", "\x1b", "\x9b"]
)
def test_folder_name_is_one_folder(name):
    made = folder_name(name)
    assert Path(made).name == made and made.isprintable() and made and not made.startswith(".")


@pytest.mark.parametrize("name", ["CON", "con", "aux.toml", "NUL .x", "COM1", "lpt9"])
def test_devices_of_windows_are_no_folders(name):
    assert folder_name(name) == f"_{name}" and folder_name("console") == "console"


def test_many_mistakes_are_found_quickly_and_counted():
    text = THREE.format(1.0, 1.0, 1.0) + "".join(f"key{k} = {k}\n" for k in range(3000))
    began = time.perf_counter()
    with pytest.raises(InputError, match="and 2975 more"):
        parse_problem(text, "x", "x")
    assert time.perf_counter() - began < 10


PLAIN = THREE.format(0.4, 2.0, 1e-3)
SAID_OTHERWISE = {
    "comment": "# a remark\n" + PLAIN,
    "blank lines and other decimals": PLAIN.replace("1e-3", "0.0010").replace("\n", "\n\n"),
    "name and description": 'name = "other"\ndescription = "of it"\n' + PLAIN,
    "experiment": PLAIN + '[[experiment]]\nname = "e"\n',
    "order of keys": "[device]\nsample_time = 1e-3\ndamping = 2\nmass = 0.4\n",
    "defaults": PLAIN + 'hold = "zoh"\ndelay = 0.0\n[stability]\nband_hz = [0.5, 100]\nsafety_factor = 1.05\n'
    'max_sensitivity = 2.0\n[transparency]\nband_hz = [0.5, 30.0]\nnorm = "rms"\n[uncertainty]\n[operator]\n',
    "zero with a sign": PLAIN + "delay = -0.0\n",
}
OTHERWISE = {
    "mass": PLAIN.replace("0.4", "0.4000000000000001"),
    "hold": PLAIN + 'hold = "lag"\n',
    "delay": PLAIN + "delay = 1e-12\n",
    "operator": PLAIN + "[operator]\nmass = 1e-9\n",
    "bound": PLAIN + "[gains]\nposition = { min = 0.0, max = 1e5 }\n",
    "fixed": PLAIN + "[coupling]\ndrag = 1e-9\n",
    "edge": PLAIN + "[stability]\nband_hz = [0.5, 99.0]\n",
    "factor": PLAIN + "[stability]\nsafety_factor = 1.06\n",
    "norm": PLAIN + '[transparency]\nnorm = "peak"\n',
    "weight": PLAIN + "[transparency]\nweights = { tracking = 2.0 }\n",
    "uncertainty": PLAIN + "[uncertainty]\nmass = 0.1\n",
    "objective": PLAIN + '[uncertainty]\nmass = 0.1\nobjective = "worst"\n',
}


def test_the_digest_is_of_what_a_problem_means():
    """Other words for the same problem have its digest, another number in it has another."""

    def digests(texts):
        return [problem_file(text, Path("x.toml")).sha256 for text in texts]

    assert set(digests(SAID_OTHERWISE.values())) == set(digests([PLAIN]))
    assert len(set(digests([PLAIN, *OTHERWISE.values()]))) == 1 + len(OTHERWISE)


def test_the_digest_of_an_endless_band_is_of_strict_json():
    text = PLAIN + 'hold = "lag"\n[stability]\nband_hz = [0.5, inf]\n'
    assert problem_file(text, Path("x.toml")).sha256 != problem_file(PLAIN, Path("x.toml")).sha256


def test_a_delay_moves_the_default_band_with_the_loops_lag():
    for delay in (0.0, 5e-4, 3e-3):
        problem = parse_problem(PLAIN + f"delay = {delay!r}\n", "x.toml", "x")
        assert problem.stability.band.max == 2 * pi * min(0.1 / 1e-3, 0.05 / (0.5e-3 + delay))


ARM = SERVO + "[environment]\nmass.max = 0.0\nstiffness.max = 0.0\n"


@pytest.mark.parametrize("table", ["operator", "tool", "environment", "uncertainty"])
def test_a_maximum_alone_is_a_range_from_0(table):
    key = '"force_sensor.delay"' if table == "uncertainty" else "mass"
    text = SERVO + "delay = 1e-3\n"
    alone, both = (f"[{table}]\n{key} = {{ {ends} }}\n" for ends in ("max = 0.01", "min = 0.0, max = 0.01"))
    assert parse_problem(text + alone, "", "x") == parse_problem(text + both, "", "x")


def test_a_range_of_a_device_is_that_of_its_share():
    """0.8 to 1.2 ms is 1 ms and 20 %: the same box, in any units."""
    share, ends = (
        parse_problem(ARM + f'[uncertainty]\n"servo.delay" = {number}\n', "", "x")
        for number in ("0.2", "{ min = 0.8e-3, max = 1.2e-3 }")
    )
    boxes = []
    for problem in (share, ends, ends.in_units(3.0, 7e-3)):
        box = device_box(problem.device, problem.uncertainty)
        boxes.append([box.low.number("servo.delay"), box.high.number("servo.delay")])
    assert boxes[0] == boxes[1] == pytest.approx([7e-3 * end for end in boxes[2]], rel=1e-14)
