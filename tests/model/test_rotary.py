"""A rotary device: the numbers of the linear one to the last bit, in units of its own."""

from __future__ import annotations

import re
from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest
from command import run
from conftest import ROOT, mostly_slow

from vctune import solve
from vctune.design.judging.judge import judge
from vctune.design.records.claims import claim_records
from vctune.design.records.design import design_record
from vctune.document.reading import parse_problem, problem_file
from vctune.document.schema.statement import statement
from vctune.document.text.toml import toml_text
from vctune.exit_codes import ExitCode
from vctune.model.hands import Hand
from vctune.model.numbers.units import LINEAR, QUANTITIES, ROTARY, Units, narrowed
from vctune.model.problem import HUMAN_HANDS

FILE = Path("device.toml")
LINES = {"linear": "", "rotary": 'units = "rotary"\n'}
DEVICE = "mass = 0.4\ndamping = 2.0\nsample_time = 1e-3\n"
HANDS = """[operator]
mass = { min = 0.0, max = 0.5 }
damping = { min = 0.0, max = 30.0 }
stiffness = { min = 0.0, max = 3000.0 }
"""
POOR = """[gains]
velocity = 229.82653
position = 1e5
[coupling]
damping = 15.0
mass = 0.055018916
drag = 1.3311415
[stability]
criterion = "hands"
"""


def stated(device: str, rest: str, units: str) -> str:
    return f'name = "device"\n[device]\n{LINES[units]}{device}{rest}'


@pytest.mark.parametrize("norm", ["rms", "peak"])
def test_a_design_is_the_same_to_the_last_bit(norm):
    found = {}
    rest = f'[transparency]\nnorm = "{norm}"\n[stability]\ncriterion = "passive"\n'
    for units in LINES:
        file = problem_file(stated(DEVICE, rest, units), FILE)
        record = design_record(file, solve(file))
        del record["problem"], record["solver"], record["sha256"]
        found[units] = record
    assert found["rotary"] == found["linear"]


def test_the_digest_tells_them_apart():
    passive = '[stability]\ncriterion = "passive"\n'
    linear, rotary = (problem_file(stated(DEVICE, passive, units), FILE) for units in LINES)
    assert linear.sha256 != rotary.sha256
    again = problem_file(stated('units = "linear"\n' + DEVICE, passive, "linear"), FILE)
    assert again.sha256 == linear.sha256
    assert problem_file(toml_text(statement(rotary.problem)), FILE).sha256 == rotary.sha256


def test_claims_have_the_numbers_of_the_linear_device_in_its_units():
    """Where a design fails, in which hand, and what it grows with."""
    linear = {ROTARY.of(quantity): LINEAR.of(quantity) for quantity in QUANTITIES}
    shown = {}
    for units in LINES:
        problem = parse_problem(stated(DEVICE, HANDS + POOR, units), "p", "p")
        records = claim_records(problem, judge(problem, *problem.fixed_design))
        rows = [row for record in records for row in record.rows(problem.units)]
        shown[units] = "\n".join(f"{row.value} {row.unit}" for row in rows)
    assert "N m/rad" in shown["rotary"]
    longest_first = "|".join(re.escape(unit) for unit in sorted(linear, key=len, reverse=True))
    assert re.sub(rf"(?<!\w)({longest_first})(?!\w)", lambda unit: linear[unit[0]], shown["rotary"]) == shown["linear"]


def test_what_has_no_default_is_stated():
    """Of an experiment of a linear device nothing has to be."""
    parse_problem(stated(DEVICE, HANDS, "rotary"), "device.toml", "device")
    number = HANDS.replace("{ min = 0.0, max = 30.0 }", "2.0")
    parse_problem(stated(DEVICE, number, "rotary"), "device.toml", "device")
    passive = '[stability]\ncriterion = "passive"\n'
    parse_problem(stated(DEVICE, passive, "rotary"), "device.toml", "device")
    moves = '[[experiment]]\nname = "a"\nfriction = { coulomb = 1.0 }\n'
    parse_problem(stated(DEVICE, passive + moves, "linear"), "device.toml", "device")
    display = stated('display = "impedance"\n' + DEVICE, "", "rotary")
    assert parse_problem(display, "device.toml", "device").any_hand


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


KNOB = DEVICE + '[stability]\ncriterion = "passive"\n'
LAW = "[gains]\nvelocity = 150.0\nposition = 6000.0\n[coupling]\ndamping = {}\nmass = 0.37\n"
SPRING = """[[experiment]]
name = "spring"
environment = { stiffness = 200.0, damping = 1.0, mass = 0.1 }
operator = { to = 0.005, speed = 0.05, cycles = 1, damping = 2.0, stiffness = 1000.0 }
baseline = { kp = 30.0, kd = 2.0, mass = 0.3, damping = 5.0 }
"""
FILES = {
    "study.toml": 'problem = "good.toml"\n[axes]\n"device.damping" = [1.0, 2.0]\n"device.mass" = [0.4, 0.5]\n',
    "good.toml": KNOB + LAW.format(160.0) + SPRING,
    "poor.toml": KNOB + LAW.format(80.0),
    "free.toml": KNOB,
}
COMMANDS = {
    "sweep": ("sweep", "study.toml", "--executor", "serial"),
    "prices": ("solve", "free.toml"),
    "repairs": ("solve", "poor.toml"),
    "simulate": ("simulate", "good.toml"),
    "region": ("region", "free.toml", "--resolution", "0.125"),
    "export": ("export", "good.toml"),
    "bound": ("bound", "free.toml", "results/free/design.json", "--gap", "0.5"),
}
AFTER = r"(?<=[\d ] )|(?<=\[)|(?<=, )|(?<=\">)|(?<=: \")|(?<=\d</td><td>)"
"""Where a unit stands: behind a number or two spaces, in brackets, behind the name of an axis, alone in a cell."""


def written(command: str, units: str, folder: Path) -> str:
    """Return all that a command prints and writes about a linear or a rotary device."""
    folder.mkdir()
    for name, text in FILES.items():
        (folder / name).write_text(text if name == "study.toml" else f"[device]\n{LINES[units]}{text}")
    if command == "bound":
        run("solve", "free.toml", cwd=folder)
    done = run(*COMMANDS[command], cwd=folder, report=True)
    assert done.returncode in (ExitCode.OK, ExitCode.FAILED), done.stderr
    made = [path for path in sorted(folder.rglob("results/**/*")) if path.suffix in {".csv", ".json", ".html", ".svg"}]
    text = "\n".join([done.stdout, done.stderr, *(path.read_text() for path in made)])
    return re.sub(r"</tspan>\s*<tspan[^>]*>", "", text)  # a label with a symbol is drawn letter by letter


def units_in(text: str, system: Units) -> list[str]:
    """Return the units of one system that stand in a text, in their order, without those of the other."""
    other = {LINEAR: ROTARY, ROTARY: LINEAR}[system]
    ours, theirs = ({each.of(quantity) for quantity in QUANTITIES} for each in (system, other))
    every = "|".join(map(re.escape, sorted(ours | theirs, key=len, reverse=True)))
    found = re.findall(rf"(?:{AFTER})({every})(?![\w/(])", re.sub("[\u202f\u00b7]", " ", text).replace("\u00b2", "2"))
    return [unit for unit in found if unit in ours]


@pytest.mark.parametrize("command", mostly_slow(COMMANDS, ("sweep", "export")))
def test_every_command_states_the_units_of_a_rotary_device(command: str, tmp_path: Path) -> None:
    """None of a linear one, and in each place that of the quantity which a linear device has there."""
    linear, rotary = (written(command, units, tmp_path / units) for units in LINES)
    assert units_in(rotary, LINEAR) == units_in(linear, ROTARY) == []
    same = {LINEAR.of(quantity): ROTARY.of(quantity) for quantity in QUANTITIES}
    assert units_in(rotary, ROTARY) == [same[unit] for unit in units_in(linear, LINEAR)] != []


def test_a_band_is_told_with_edges_that_lie_within_it() -> None:
    """Six digits of a proved band never promise more than it."""
    rng = np.random.default_rng(7)
    for low, high in np.sort(10 ** rng.uniform(-3, 4, (200, 2)), axis=1).tolist():
        inside = [float(edge) for edge in narrowed(low, high)]
        assert low <= inside[0] and inside[1] <= high and inside == pytest.approx([low, high], rel=1e-5)
    assert narrowed(0.5, 100.0) == ("0.5", "100")
