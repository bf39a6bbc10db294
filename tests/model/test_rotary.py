"""A rotary device: the numbers of the linear one to the last bit, and no word or unit of it."""

from __future__ import annotations

import json
import re
from dataclasses import astuple
from pathlib import Path

import pytest
from command import run
from conftest import ROOT

from vctune import solve
from vctune.api.explaining import explain
from vctune.design.search.theorems import impossible
from vctune.design.verdict.design_record import claim_records, design_record
from vctune.design.verdict.judge import judge
from vctune.document.reading import parse_problem, problem_file
from vctune.document.schema.statement import statement
from vctune.document.text.errors import InputError
from vctune.document.text.toml_writing import toml_text
from vctune.model.hands import Hand
from vctune.model.numbers.units import LINEAR, QUANTITIES, ROTARY
from vctune.model.problem import HUMAN_HANDS

FILE = Path("device.toml")
LINES = {"linear": "", "rotary": 'units = "rotary"\n'}
DEVICE = "mass = 0.4\ndamping = 2.0\nsample_time = 1e-3\n"
HANDS = """[operator]
mass = { min = 0.0, max = 0.5 }
damping = { min = 0.0, max = 30.0 }
stiffness = { min = 0.0, max = 3000.0 }
"""
FIXED = """[gains]
velocity = 229.82653
position = 1e5
[coupling]
damping = 155.77534
mass = 0.055018916
drag = 1.3311415
[stability]
criterion = "hands"
"""
PARTS = """[device.force_sensor]
bandwidth_hz = 500.0
[device.structure]
handle_mass = 0.1
frequency_hz = 120.0
damping_ratio = 0.02
"""
PASSIVE = """[operator]
mass = 0.05
damping = 1.0
[stability]
criterion = "passive"
[[experiment]]
name = "spring"
environment = { stiffness = 200.0 }
operator = { to = 0.002, speed = 0.05, damping = 2.0, stiffness = 1000.0, cycles = 1 }
friction = { coulomb = 0.1, stribeck_velocity = 0.005, stiffness = 1e5 }
baseline = { kp = 2000.0, kd = 50.0, mass = 0.5, damping = 5.0 }
"""
PLANE = """[coupling]
damping = 150.0
mass = 0.5
drag = 1.0
[stability]
criterion = "passive"
"""
STUDY = """problem = "parts.toml"
[axes]
"device.damping" = [2.0, 3.0]
"operator.mass" = [0.05]
"""
BACK = {ROTARY.of(quantity): LINEAR.of(quantity) for quantity in QUANTITIES} | {
    "An inertia": "A mass",
    "an inertia": "a mass",
    "inertia": "mass",
    "torque": "force",
    "position_rad": "position_m",
    "velocity_rad_per_s": "velocity_m_per_s",
    "torque_n_m": "force_n",
    "command_n_m": "command_n",
}
LINEAR_UNITS = re.compile(
    r"\bkg\b(?! m2)|\bN s/m|\bN/m\b|(?<!\w)m/s\b|\bmm\b|m/\(N s\)|(?<=[\d\],] )N\b(?! m\b| =)|"
    r"(?<=\d )m\b|(?<=[,\[] )m(?=[],.:;])"
)
WORDS = re.compile(r"(?<![\w.\"])(?:mass|masses|force|forces)(?![\w\"=]| =| /)\b", re.IGNORECASE)


def stated(device: str, rest: str, units: str) -> str:
    return f'name = "device"\n[device]\n{LINES[units]}{device}{rest}'


def as_linear(text: str) -> str:
    """Return what is said of a rotary device in the words and units of a linear one, blanks and digests apart."""
    names = "|".join(re.escape(word) for word in sorted(BACK, key=len, reverse=True))
    text = re.sub(rf"(?<!\w)({names})(?!\w)", lambda found: BACK[found[0]], text)
    return re.sub(r"[0-9a-f]{64}", "", re.sub(r"[\s#*]+", " ", text)).strip()


def made(units, place):
    (place / "hands.toml").write_text(stated(DEVICE, HANDS + FIXED, units))
    (place / "parts.toml").write_text(stated(DEVICE, PARTS + PASSIVE, units))
    (place / "plane.toml").write_text(stated(DEVICE, PLANE, units))
    (place / "study.toml").write_text(STUDY)
    return place


@pytest.fixture(scope="module")
def said(tmp_path_factory):
    """What every command prints and writes, by the units of its problem."""
    return {units: printed(made(units, tmp_path_factory.mktemp(units))) for units in LINES}


def printed(folder):
    commands = {
        "solve": ("solve", "parts.toml", "--out", "r"),
        "hands": ("solve", "hands.toml", "--out", "h"),
        "check": ("check", "hands.toml"),
        "simulate": ("simulate", "parts.toml", "r/device/gains.toml", "--out", "s"),
        "compare": ("compare", "h/device/design.json", "r/device/design.json"),
        "sweep": ("sweep", "study.toml", "--executor", "serial", "--out", "w"),
        "region": ("region", "plane.toml", "--resolution", "0.125", "--out", "g"),
        "export": ("export", "hands.toml", "--out", "c"),
    }
    if "rotary" in (folder / "parts.toml").read_text():  # whose pages are looked at
        reports = {name: ("report", f"{name}/device/design.json", "--out", f"{name}-page") for name in "rh"}
        commands |= {f"report of {name}": command for name, command in reports.items()}
    texts = {}
    for name, command in commands.items():
        done = run(*command, cwd=folder)
        assert done.returncode in (0, 1), done.stderr
        texts[name] = done.stdout + done.stderr
    written = sorted(path for path in folder.rglob("*") if path.parent != folder and path.is_file())
    texts |= {str(path.relative_to(folder)): path.read_text() for path in written if path.suffix != ".npz"}
    return texts


def plain(name: str, text: str) -> str:
    """Return a text without the problem's own, code, and what sets a page."""
    text = re.sub(r'"text": "[^\n]*|<pre>.*?</pre>|<style>.*?</style>|<script.*?</script>', "", text, flags=re.DOTALL)
    if name.endswith((".c", ".h")):
        return "\n".join(re.findall(r"/\*.*?\*/", text, re.DOTALL))
    if name.endswith((".html", ".svg")):  # a unit is set with thin spaces and powers
        symbols = re.sub(r"<i>(\w+)</i><sub>(\w+)</sub>", r"\1_\2", text)  # m_c is no metre
        words = re.sub(r"<path.*?>|<[^>]*>", " ", symbols, flags=re.DOTALL)
        return re.sub(r"\s+", " ", words).replace("²", "2")
    return text


def test_nothing_is_said_in_units_of_a_linear_device(said):
    for name, text in said["rotary"].items():
        words = plain(name, text)
        assert (found := LINEAR_UNITS.search(words)) is None, (name, words[found.start() - 80 :][:120])
        if not name.endswith((".json", ".toml", ".c", ".h", ".jsonl")):
            found = WORDS.search(words)
            assert found is None, (name, words[found.start() - 80 :][:120])


def test_the_same_is_said_in_other_words(said):
    """But for figures, pages and the parts of them that differ, all that is said of either is the same."""
    others = {name: text for name, text in said["linear"].items() if not name.endswith((".svg", ".html"))}
    assert any(name.endswith("design.json") for name in others) and any(name.endswith(".csv") for name in others)
    for name, text in others.items():
        assert as_linear(compared(name, said["rotary"][name])) == as_linear(compared(name, text)), name


def compared(name: str, text: str) -> str:
    """Return a text without what says which units it is in, and how long it took."""
    if name.endswith(".json"):
        record = json.loads(text)
        return json.dumps({key: value for key, value in record.items() if key not in ("problem", "solver")})
    unlike = re.compile(r'units = |"seconds|SI units|is a torque|kg, N and m|differs .*device.units|device.units +-')
    return "\n".join(line for line in text.splitlines() if not unlike.search(line))


def test_a_refusal_is_the_same_in_other_words():
    """Where a design fails, in which hand, and what it grows with."""
    shown = {}
    for units in LINES:
        poor = FIXED.replace("155.77534", "15.0")
        problem = parse_problem(stated(DEVICE, HANDS + poor, units), "p", "p")
        judgement = judge(problem, *problem.fixed_design)
        records = claim_records(problem, judgement)
        rows = [row for record in records for row in record.rows(problem.units)]
        shown[units] = "\n".join([*(f"{row.value} {row.unit}" for row in rows), *judgement.open_claims])
    assert "N m/rad" in shown["rotary"]
    assert LINEAR_UNITS.search(shown["rotary"]) is None
    assert as_linear(shown["rotary"]) == as_linear(shown["linear"])


def test_the_units_are_there(said):
    text = said["rotary"]
    assert re.search(r"inertia m_c +[\d.]+ +kg m2", text["solve"])
    assert "in every hand of 0 to 0.5 kg m2, 0 to 30 N m s/rad, 0 to 3000 N m/rad" in text["hands"]
    assert "device.damping [N m s/rad],operator.mass [kg m2]" in text["w/study/table.csv"]
    assert json.loads(text["r/device/design.json"])["problem"]["units"] == "rotary"
    for unit in ("N m s/rad", "kg m²", "N m/rad", "turns about one axis"):
        assert unit in text["r-page/report.html"].replace("\u202f", " ")
    assert "rad/s" in text["c/device/firmware/vctune_controller.h"]


@pytest.mark.parametrize("norm", ["rms", "peak"])
def test_a_design_is_the_same_to_the_last_bit(norm):
    found = {}
    rest = f'[transparency]\nnorm = "{norm}"\n[stability]\ncriterion = "passive"\n'
    for units in LINES:
        file = problem_file(stated(DEVICE, rest, units), FILE)
        record = design_record(file, solve(file))
        del record["problem"], record["solver"]
        found[units] = record
    assert found["rotary"] == found["linear"]


def test_the_digest_tells_them_apart():
    passive = '[stability]\ncriterion = "passive"\n'
    linear, rotary = (problem_file(stated(DEVICE, passive, units), FILE) for units in LINES)
    assert linear.sha256 != rotary.sha256
    again = problem_file(stated('units = "linear"\n' + DEVICE, passive, "linear"), FILE)
    assert again.sha256 == linear.sha256
    assert problem_file(toml_text(statement(rotary.problem)), FILE).sha256 == rotary.sha256


IMPOSSIBLE = [
    "[stability]\ncriterion = 'passive'\nband_hz = [0.0, 100.0]\n[gains]\nvelocity = 100.0\nposition = 1e3\n",
    "[stability]\ncriterion = 'passive'\nband_hz = [0.0, 100.0]\n[gains]\nvelocity = 100.0\nposition = 0.0\n"
    "[coupling]\nmass = 1e-3\ndamping = 5.0\n",
    "[stability]\ncriterion = 'passive'\nband_hz = [0.0, 100.0]\n[gains]\nposition = 1e5\nvelocity = 10.0\n",
    "[stability]\ncriterion = 'hands'\n[coupling]\ndrag = 0.0\n[gains]\nposition = { min = 1.0, max = 10.0 }\n",
]


@pytest.mark.parametrize("rest", IMPOSSIBLE)
def test_what_is_impossible_is_said_in_its_units(rest):
    reasons = {}
    for units in LINES:
        found = impossible(parse_problem(stated(DEVICE, HANDS.replace("min = 0.0", "min = 0") + rest, units), "p", "p"))
        assert found is not None
        reasons[units] = found.reason
    assert reasons["rotary"] != reasons["linear"] == as_linear(reasons["rotary"])


def refused(text: str) -> str:
    with pytest.raises(InputError) as error:
        parse_problem(text, "device.toml", "device")
    return str(error.value)


def test_what_has_no_default_is_asked_for():
    """The hands' numbers at r metres are those of a linear device times r^2."""
    message = refused(stated(DEVICE, "", "rotary"))
    assert "mass = { min = 0, max = 0.5 r^2 }" in message and "stiffness = { min = 0, max = 3000 r^2 }" in message
    parse_problem(stated(DEVICE, HANDS, "rotary"), "device.toml", "device")
    part = HANDS.replace("{ min = 0.0, max = 30.0 }", "2.0")
    assert "damping = { min = 0, max = 30 r^2 }" in refused(stated(DEVICE, part, "rotary"))
    parse_problem(stated(DEVICE, '[stability]\ncriterion = "passive"\n', "rotary"), "device.toml", "device")
    display = stated('display = "impedance"\n' + DEVICE, "", "rotary")
    assert parse_problem(display, "device.toml", "device").any_hand
    assert "r^2" in refused(display + '[stability]\ncriterion = "hands"\n')


def test_the_guide_s_own_example_is_one():
    guide = (ROOT / "vctune/document/README.md").read_text()
    blocks = re.findall(r"```toml\n(.*?)```", guide, re.DOTALL)
    (text,) = (block for block in blocks if "rotary" in block and "servo" not in block)
    problem = parse_problem(text, "device.toml", "device")
    assert problem.device.units == "rotary"
    r = 0.05
    most = HUMAN_HANDS.high
    expected = Hand(most.mass * r * r, most.damping * r * r, most.stiffness * r * r)
    assert astuple(problem.hands.high) == pytest.approx(astuple(expected))


def test_an_experiment_states_what_has_a_length_in_it():
    """Every default of an experiment whose unit is another for a rotary device is asked for, and no other."""
    passive = '[stability]\ncriterion = "passive"\n[[experiment]]\nname = "a"\nfriction = { coulomb = 1.0 }\n'
    parse_problem(stated(DEVICE, passive, "linear"), "device.toml", "device")
    message = refused(stated(DEVICE, passive, "rotary"))
    asked = set(re.findall(r"experiment\[0\]\.(\w+\.\w+): is missing", message))
    assert asked == {
        *("operator.to", "operator.speed", "operator.damping", "operator.stiffness"),
        *("friction.stribeck_velocity", "friction.stiffness"),
    }


@pytest.mark.parametrize(("called", "key"), [("inertia", "mass"), ("moment_of_inertia", "mass")])
def test_the_inertia_is_called_mass(called, key):
    message = refused(stated(DEVICE.replace("mass", called), HANDS, "rotary"))
    assert f"device.{called}: unknown key; of a rotary device too it is called {key}" in message
    assert "device.mass: is missing; it is required: Moving inertia, kg m2." in message


def test_a_handle_as_heavy_as_the_device_is_refused_in_its_unit():
    heavy = "[device.structure]\nhandle_mass = 0.5\nfrequency_hz = 100.0\ndamping_ratio = 0.1\n" + HANDS
    assert "0.5 kg m2 is not less than device.mass = 0.4 kg m2" in refused(stated(DEVICE, heavy, "rotary"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("A mass and a force.", "An inertia and a torque."),
        ("masses, forces", "inertias, torques"),
        ("device.mass, force_sensor, Of a massless thing", "device.mass, force_sensor, Of a massless thing"),
        ("|1 - A H/N|, N encirclements, m s + b", "|1 - A H/N|, N encirclements, m s + b"),
    ],
)
def test_words(text, said):
    assert ROTARY.translated(text) == said


def test_a_key_is_explained_in_both_units():
    (mass,), clocks = (explain(key).entries for key in ("device.mass", "device.sample_time"))
    assert "kg." in mass.text and mass.text.endswith("Unit for a rotary device: kg m2.")
    assert len(clocks) == 2, "of a mechanism and of a servo"
    assert not any("rotary" in clock.text for clock in clocks)
