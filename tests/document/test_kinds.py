"""Gains, designs and regions are for a kind of device: admittance or impedance display, linear or rotary."""

from __future__ import annotations

import json
from itertools import permutations

import pytest
from command import run, strict
from conftest import DEVICE

import vctune
from vctune.document.gains_file import gains_text
from vctune.document.reading import read_gains
from vctune.document.text.errors import InputError
from vctune.exit_codes import ExitCode
from vctune.model.display import DISPLAYS
from vctune.model.gains import Coupling, Gains, SpringDamper

EXPERIMENT = """[[experiment]]
name = "free"
operator = { to = 0.05, speed = 0.01, damping = 2.0, stiffness = 1000.0 }
"""
PASSIVE = '[stability]\ncriterion = "passive"\n'
DEVICES = {
    "admittance": DEVICE + PASSIVE,
    "impedance": DEVICE.replace("[device]", '[device]\ndisplay = "impedance"'),
    "rotary": DEVICE.replace("[device]", '[device]\nunits = "rotary"') + PASSIVE,
}
SERIES, SPRING = (Gains(150.0, 6000.0), Coupling(160.0, 0.37, 0.0)), (Gains(0.0, 0.0), SpringDamper(0.5, 1000.0))
DESIGNS = {"admittance": SERIES, "impedance": SPRING, "rotary": SERIES}
NAMED = {
    "admittance": ("an admittance display", "a linear device, in N s/m"),
    "impedance": ("an impedance display", "a linear device, in N s/m"),
    "rotary": ("an admittance display", "a rotary device, in N m s/rad"),
}


@pytest.fixture
def files(tmp_path):
    """Each kind's problem, its gains file as it is written, and one that states neither display nor units."""
    for kind, (gains, coupling) in DESIGNS.items():
        units = "rotary" if kind == "rotary" else "linear"
        display = DISPLAYS["impedance" if kind == "impedance" else "admittance"]
        text = gains_text(display, gains, coupling, {"verdict": "proved"}, units)
        (tmp_path / f"{kind}.toml").write_text(DEVICES[kind] + EXPERIMENT)
        (tmp_path / f"gains-{kind}.toml").write_text(text)
        (tmp_path / f"bare-{kind}.toml").write_text(text[: text.index("[design]")])
    return tmp_path


@pytest.mark.parametrize("of, on", list(permutations(DEVICES, 2)))
@pytest.mark.parametrize("command", ["check", "export", "simulate"])
def test_gains_of_another_kind_are_refused_with_what_each_is(files, command, of, on):
    done = run(command, f"{on}.toml", f"gains-{of}.toml", cwd=files)
    told = done.stdout + done.stderr
    assert done.returncode == ExitCode.BAD_INPUT and "Traceback" not in told
    lines = [line for line in told.splitlines() if line.endswith("[other-kind]")]
    differ = [(given, here) for given, here in zip(NAMED[of], NAMED[on], strict=True) if given != here]
    assert len(lines) == len(differ)
    for line, (given, here) in zip(lines, differ, strict=True):
        assert f"the gains are for {given}" in line and f"{on}.toml has {here}" in line
        assert f"gains-{of}.toml:" in line
    if NAMED[of][0] != NAMED[on][0]:  # a file that states nothing is told by its coupling
        done = run(command, f"{on}.toml", f"bare-{of}.toml", cwd=files)
        key = "coupling.stiffness" if of == "impedance" else "coupling.mass"
        assert done.returncode == ExitCode.BAD_INPUT
        assert f"{key}: the gains are for {NAMED[of][0]}" in done.stdout + done.stderr
    assert not (files / "results").exists()


@pytest.mark.parametrize("kind", DEVICES)
@pytest.mark.parametrize("form", ["gains", "bare"])
def test_gains_of_the_same_kind_are_judged(files, kind, form):
    done = run("check", f"{kind}.toml", f"{form}-{kind}.toml", "--json", cwd=files)
    (found,) = strict(done.stdout)
    assert found["status"] in ("certified", "violated") and "[other-kind]" not in done.stdout


def test_units_that_are_not_stated_are_the_problems(files):
    done = run("check", "rotary.toml", "bare-admittance.toml", "--json", cwd=files)
    assert strict(done.stdout)[0]["status"] == "certified"


@pytest.mark.parametrize("kind", DEVICES)
def test_what_solve_writes_states_its_kind(files, kind):
    gains = "" if kind == "impedance" else "[gains]\nvelocity = 150.0\nposition = 6000.0\n"
    fixed = "stiffness = 1000.0\n" if kind == "impedance" else "mass = 0.37\ndrag = 0.0\n"
    (files / "one.toml").write_text(f"{DEVICES[kind]}{gains}[coupling]\n{fixed}")
    assert run("solve", "one.toml", cwd=files).returncode == ExitCode.OK
    text = (files / "results/one/gains.toml").read_text()
    found = read_gains(files / "results/one/gains.toml")
    assert found.kind.name == ("impedance" if kind == "impedance" else "admittance")
    assert found.units == ("rotary" if kind == "rotary" else "linear")
    assert f'display = "{found.kind.name}"' in text and f'units = "{found.units}"' in text


def test_the_library_refuses_objects_too(files):
    for call in (vctune.check, vctune.simulate, vctune.export):
        with pytest.raises(InputError, match="gains are for an impedance display"):
            call(files / "admittance.toml", *SPRING)
        with pytest.raises(InputError, match="a linear device, in N s/m"):
            call(files / "rotary.toml", files / "gains-admittance.toml")


@pytest.mark.parametrize("of, on", list(permutations(DEVICES, 2)))
def test_a_design_json_of_another_kind_is_refused(files, of, on):
    (record,) = strict(run("check", f"{of}.toml", f"gains-{of}.toml", "--json", cwd=files).stdout)
    (files / "design.json").write_text(json.dumps(record))
    done = run("bound", f"{on}.toml", "design.json", cwd=files)
    assert done.returncode == ExitCode.BAD_INPUT
    for given, here in zip(NAMED[of], NAMED[on], strict=True):
        if given != here:
            assert f"the design is for {given}" in done.stderr and f"{on}.toml has {here}" in done.stderr


@pytest.mark.parametrize("of, on", list(permutations(DEVICES, 2)))
def test_a_region_of_another_kind_is_refused(files, of, on):
    design = {"schema": "vctune/region/1", "designs": [], "edges": {"x": [0.0, 1.0], "y": [0.0, 1.0]}}
    design["cells"] = [[0, 1, 0, 1, "undecided", None]]
    problem = {"name": of, "sha256": vctune.read_problem(files / f"{of}.toml").sha256, "text": DEVICES[of]}
    problem["units"] = "rotary" if of == "rotary" else "linear"
    axes = {"x": "coupling.damping", "y": "coupling.stiffness" if of == "impedance" else "coupling.mass"}
    (files / "region.json").write_text(json.dumps({**design, "problem": problem, "axes": axes}))
    done = run("check", f"{on}.toml", "--region", "region.json", cwd=files)
    assert done.returncode == ExitCode.BAD_INPUT
    assert "[other-kind]" in done.stdout and "the region is for" in done.stdout
