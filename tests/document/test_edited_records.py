"""A record whose gains, problem, verdict or digest do not belong together is refused by every command that reads it."""

from __future__ import annotations

import json
from copy import deepcopy

import pytest
from command import run, strict
from conftest import DEVICE

import vctune
from vctune.design.records.design import read_design
from vctune.document.text.errors import InputError
from vctune.exit_codes import ExitCode

GAINS = "[gains]\nvelocity = 80.0\nposition = 1000.0\n[coupling]\ndamping = 100.0\nmass = 0.3\ndrag = 60.0\n"
EXPERIMENT = '[[experiment]]\nname = "free"\noperator = { to = 0.005, motion = "sine" }\n'
SERVO = "[device]\nsample_time = 2e-3\nservo = { delay = 0.02 }\n"
HANDS = (
    "[operator]\nmass = { min = 0, max = 2 }\ndamping = { min = 0, max = 30 }\nstiffness = { min = 0, max = 1000 }\n"
)
SPRING = "[coupling]\ndamping = 1.0\nstiffness = 100.0\n"
DEVICES = {
    "admittance": DEVICE + GAINS + EXPERIMENT,
    "impedance": DEVICE.replace("[device]", '[device]\ndisplay = "impedance"') + SPRING + EXPERIMENT,
    "servo": SERVO + HANDS + "[coupling]\ndamping = inf\nmass = 10.0\ndrag = 100.0\n" + EXPERIMENT,
    "uncertain": DEVICE + GAINS + "[uncertainty]\nmass = 0.1\n" + EXPERIMENT,
    "infeasible": DEVICE
    + "[coupling]\ndamping = { min = 1e-3, max = 5.0 }\n[gains]\nposition = { min = 3e3, max = 1e5 }\n"
    + '[stability]\ncriterion = "passive"\nband_hz = [0.5, 100.0]\n' + EXPERIMENT,
}  # fmt: skip
READERS = {
    "report": ("report", "results/edited/design.json"),
    "export": ("export", "results/edited/design.json"),
    "simulate": ("simulate", "edited.toml"),
    "bound": ("bound", "edited.toml", "results/edited/design.json"),
}
OTHER = {"proved": "refuted", "refuted": "proved", "certified": "violated", "violated": "certified"}
# The key to edit, its new value, and the key that is named
EDITS = {
    "gains.velocity": (lambda old: old + 1.0, "transparency."),
    "coupling.damping": (lambda old: 1.01 * old, "transparency."),
    "coupling.stiffness": (lambda old: 1.01 * old, "transparency."),
    "coupling.drag": (lambda old: 1.01 * old, "transparency."),
    "transparency.error": (lambda old: 0.99 * old, "transparency.error"),
    "problem.text": (lambda old: old.replace("e-3", "e-4"), "problem.sha256"),
    "problem.sha256": (lambda old: "0" * 64, "problem.sha256"),
    "status": (lambda old: OTHER.get(old, "certified"), "status"),
    "certificate.verdict": (OTHER.get, "status"),
    "certificate.claims.0.verdict": (OTHER.get, "certificate.verdict"),
}
# Edits of which only the digest tells
UNSEEN = {"certificate.min_ratio": lambda old: 2 * old, "date": lambda old: "x"}


pytestmark = pytest.mark.slow  # six designs with their pages


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder for each device, with its problem and the record that solving it wrote."""
    folders = {}
    for name, text in DEVICES.items():
        folders[name] = tmp_path_factory.mktemp(name)
        (folders[name] / "edited.toml").write_text(text)
        done = run("solve", "edited.toml", cwd=folders[name])
        assert done.returncode in (ExitCode.OK, ExitCode.FAILED), done.stderr
    return folders


def edited(record, key, change):
    """Return a copy of a record with another value of a dotted key; None if the record has nothing there."""
    copy = at = deepcopy(record)
    *path, last = (int(name) if name.isdigit() else name for name in key.split("."))
    for name in path:
        at = at[name]
        if at is None:
            return None
    if isinstance(at, dict) and not at.get(last):
        return None
    at[last] = change(at[last])
    return copy if copy != record else None


def left(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("device", DEVICES)
def test_an_edited_design_is_refused_with_the_key_that_contradicts(made, device):
    """Also if its file has no digest, as those of earlier versions; nothing is written."""
    folder = made[device]
    path = folder / "results/edited/design.json"
    text = path.read_text()
    readers, tried = [READERS[name] for name in READERS if name != "bound" or device == "infeasible"], 0
    try:
        for key, (change, named) in {**EDITS, **{key: (change, "sha256") for key, change in UNSEEN.items()}}.items():
            if (record := edited(json.loads(text), key, change)) is None:
                continue
            older = {each: value for each, value in record.items() if each != "sha256"}
            for written in (record, *[older] * (named != "sha256")):
                path.write_text(json.dumps(written))
                before, tried = left(folder), tried + 1
                for command in readers if tried <= 2 else readers[:1]:
                    done = run(*command, cwd=folder)
                    told = f"results/edited/design.json: {named}"
                    assert done.returncode == ExitCode.BAD_INPUT and told in done.stderr, (key, command, done)
                    assert "is damaged; solve the problem again" in done.stderr
                    assert left(folder) == before
    finally:
        path.write_text(text)
    assert tried >= (13 if device != "infeasible" else 6)


@pytest.mark.slow
def test_a_design_is_read_without_a_digest_and_as_other_programs_write_it(made):
    path = made["admittance"] / "results/edited/design.json"
    text = path.read_text()
    record = json.loads(text)
    try:
        assert "sha256" in record
        for value in ({key: part for key, part in record.items() if key != "sha256"}, dict(reversed(record.items()))):
            path.write_text(json.dumps(value).replace(".0,", ","))
            assert run("report", path, "--out", "report", cwd=made["admittance"]).returncode == ExitCode.OK
    finally:
        path.write_text(text)


def test_a_record_that_a_program_changed_is_refused(made):
    found = read_design(made["admittance"] / "results/edited/design.json")
    assert vctune.compare(found, found).design
    changed = found.model_copy(update={"gains": vctune.Gains(81.0, 1000.0)})
    for call in (vctune.export, lambda design: vctune.compare(design, found)):
        with pytest.raises(InputError, match=r"design: transparency\.error: is .*, and gains, coupling"):
            call(changed)


def test_an_edited_simulation_is_refused(made):
    folder = made["admittance"]
    assert run("simulate", "edited.toml", cwd=folder).returncode == ExitCode.OK
    path = folder / "results/edited/simulation.json"
    record = strict(path.read_text())
    record["experiments"][0]["design"]["metrics"]["peak_force"] = 1.5
    path.write_text(json.dumps(record))
    before = left(folder)
    done = run("report", "results/edited/design.json", "--out", "elsewhere", cwd=folder)
    assert done.returncode == ExitCode.BAD_INPUT and left(folder) == before and not (folder / "elsewhere").exists()
    assert "results/edited/simulation.json: sha256: does not belong to the rest of the file" in done.stderr
    assert "simulate again, or remove the file" in done.stderr
    path.unlink()
