"""Gains that somebody edited: the first repair is the number that was edited, and the line that of the edit."""

from __future__ import annotations

from itertools import product
from math import log10

import numpy as np
import pytest
from command import check_files
from conftest import DEVICE, for_passive_hands

import vctune
from vctune.design.advice.repair import with_repairs
from vctune.design.check import Checked, CheckVerdict
from vctune.design.judging.judge import Status, judge
from vctune.design.solve import solve
from vctune.document.gains_file import design_numbers
from vctune.document.reading import parse_problem, problem_file, read_gains
from vctune.document.text import toml
from vctune.model.gains import Coupling, SpringDamper

pytestmark = pytest.mark.advice

FACTORS = (1e-3, 0.5, 0.95, 1.05, 2.0)
DISPLAYS = ("admittance", "impedance")
CRITERIA = ("passive", "hands", "both")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """A folder with a problem and the gains that solving it wrote."""
    return solved(tmp_path_factory.mktemp("wheel"), for_passive_hands(DEVICE))


def solved(folder, text):
    """Solve a problem and write its gains as the command does; None where there is no design."""
    (folder / "problem.toml").write_text(text)
    file = problem_file(text, folder / "problem.toml")
    found = solve(file.problem)
    if found.status is not Status.CERTIFIED:
        return None
    vctune.write_design(file, found, folder)
    return folder


def edited(folder, changes: dict[str, float]) -> Checked:
    """Check the gains with numbers of other values, written as by hand."""
    lines = (folder / "gains.toml").read_text().splitlines()
    for key, value in changes.items():
        at = toml.Lines("\n".join(lines)).locate(tuple(key.split("."))) - 1
        lines[at] = f"{key.split('.')[1]} = {value!r}"
    (folder / "mine.toml").write_text("\n".join(lines) + "\n")
    return check_files([folder / "problem.toml", folder / "mine.toml"])[0]


def line_of(folder, key: str) -> int:
    return toml.Lines((folder / "mine.toml").read_text()).locate(tuple(key.split(".")))


def numbers_of(folder) -> dict[str, float]:
    file = read_gains(folder / "gains.toml")
    return design_numbers(file.kind, file.gains, file.coupling)


def test_an_edited_number_is_among_the_repairs_with_the_one_that_was_solved(wheel):
    """Far from where it was, too; the repair is the least change that passes, at most back to where it was."""
    numbers = numbers_of(wheel)
    for key, share in (("coupling.damping", 0.55), ("gains.velocity", 0.01)):
        value = share * numbers[key]
        checked = edited(wheel, {key: value})
        assert checked.verdict is CheckVerdict.FAILED
        repair = next(each for each in checked.finding.repairs if each.key == key)
        assert value < repair.new <= 1.02 * numbers[key]
        assert f"{repair} (the design of this problem has {numbers[key]:.12g})" in checked.message
        assert checked.line == line_of(wheel, next(each.key for each in checked.finding.repairs if each.chooses))


def test_numbers_that_pass_only_together_are_all_named(wheel):
    numbers = numbers_of(wheel)
    changes = {"gains.velocity": 2 * numbers["gains.velocity"], "coupling.damping": 0.1 * numbers["coupling.damping"]}
    checked = edited(wheel, changes)
    told = [f"{key} = {numbers[key]:.12g} instead of {value:.12g}" for key, value in changes.items()]
    assert f"; the design of this problem, with {' and '.join(told)}, passes" in checked.message
    assert checked.line == line_of(wheel, "gains.velocity")


def test_of_two_edits_the_one_that_matters_is_named(wheel):
    numbers = numbers_of(wheel)
    harmless = {"coupling.mass": 1.001 * numbers["coupling.mass"]}
    assert edited(wheel, harmless).verdict is CheckVerdict.PASSED
    checked = edited(wheel, harmless | {"gains.velocity": 1.2 * numbers["gains.velocity"]})
    assert next(repair.key for repair in checked.finding.repairs if repair.chooses) == "gains.velocity"
    assert checked.line == line_of(wheel, "gains.velocity")


@pytest.mark.slow
def test_what_a_file_says_that_it_was_is_believed_of_its_own_problem_only(wheel):
    """Numbers of another version, or that are none, are not named."""
    text, numbers = (wheel / "gains.toml").read_text(), numbers_of(wheel)
    sha256 = read_gains(wheel / "gains.toml").sha256
    known = " ".join(map(repr, numbers.values()))
    low = 0.5 * numbers["coupling.damping"]
    try:
        for old, new in ((sha256, "0" * 64), (known, f"{known} x")):
            (wheel / "gains.toml").write_text(text.replace(old, new))
            checked = edited(wheel, {"coupling.damping": low})
            assert checked.verdict is CheckVerdict.FAILED and "the design of this problem" not in checked.message
    finally:
        (wheel / "gains.toml").write_text(text)


def test_a_number_that_the_file_does_not_state_is_annotated_at_its_table(tmp_path):
    """Of pasted gains, too, the line is of the first repair's table and of no other number."""
    text = "[gains]\nvelocity = 40.0\nposition = 4000.0\n[coupling]\ndamping = 25000.0\nmass = 5.0\n"
    text = f'[device]\nmass = 0.5\ndamping = 2.0\nsample_time = 1e-3\nhold = "lag"\n{text}'
    text += '[stability]\ncriterion = "passive"\nband_hz = [0.0, 10.0]\nsafety_factor = 1.0\n'
    (tmp_path / "problem.toml").write_text(text)
    checked = check_files([tmp_path / "problem.toml"])[0]
    assert (checked.finding.repairs[0].key, checked.line) == ("coupling.drag", 9)


@pytest.mark.slow
def test_solving_given_gains_says_the_same_as_checking_them(tmp_path):
    text = for_passive_hands(
        DEVICE + "[gains]\nvelocity = 150.0\nposition = 6000.0\n[coupling]\ndamping = 80.0\nmass = 0.37\n"
    )
    (tmp_path / "problem.toml").write_text(text)
    file = problem_file(text, tmp_path / "problem.toml")
    repairs = with_repairs(file, solve(file.problem)).repairs
    assert repairs == check_files([tmp_path / "problem.toml"])[0].finding.repairs and repairs


def random_device(rng: np.random.Generator, display: str, criterion: str) -> str:
    mass, T = 10 ** rng.uniform(-1, log10(5)), 10 ** rng.uniform(-3.7, -2.7)
    delay = T * rng.choice([0.0, 0.3, 1.0])
    damping = mass / (T / 2 + delay) * 10 ** rng.uniform(-3, -1.5)
    return (
        f'[device]\ndisplay = "{display}"\nmass = {mass}\ndamping = {damping}\nsample_time = {T}\ndelay = {delay}\n'
        f'[stability]\ncriterion = "{criterion}"\n'
    )


def violating_edits(folder):
    """Yield every change of a number of the gains, up and down, after which the design is refuted."""
    problem, numbers = parse_problem((folder / "problem.toml").read_text(), "", ""), numbers_of(folder)
    for key, number in numbers.items():
        for factor in FACTORS:
            value = factor * number if number else factor * (problem.device.mass / problem.device.loop_lag) / 100
            changed = [value if key == other else kept for other, kept in numbers.items()]
            law = read_gains(folder / "gains.toml").gains
            law = type(law)(*changed[:2]) if not problem.device.kind.inverse else type(law)(changed[0], 0.0)
            coupling = Coupling(*changed[2:]) if not problem.device.kind.inverse else SpringDamper(*changed[1:])
            if judge(problem, law, coupling).status is Status.VIOLATED:
                yield key, value


@pytest.mark.night
@pytest.mark.parametrize(("display", "criterion"), list(product(DISPLAYS, CRITERIA)))
def test_every_edit_that_fails_is_among_the_repairs(display, criterion, tmp_path):
    """Of random problems."""
    rng, failed = np.random.default_rng(5), 0
    for number in range(3):
        (tmp_path / str(number)).mkdir()
        folder = solved(tmp_path / str(number), random_device(rng, display, criterion))
        assert folder is not None
        for key, value in violating_edits(folder):
            checked = edited(folder, {key: value})
            if checked.finding.repairs is None:  # the search ended before all was tried
                continue
            repair, before = next(each for each in checked.finding.repairs if each.key == key), numbers_of(folder)[key]
            assert abs(repair.new - value) <= 1.05 * abs(before - value)
            failed += 1
    assert failed >= 15
