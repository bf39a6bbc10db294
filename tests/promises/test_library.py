"""The library as its users meet it: problems from anything, what commands find as values, mistakes as ValueErrors."""

from __future__ import annotations

import dataclasses
import doctest
import inspect
import json
import pkgutil
import re
import subprocess
import sys
import tomllib
from importlib import import_module
from math import pi

import numpy as np
import pytest
from command import run
from conftest import DEVICE, FIXED, PROBLEM_FILES, ROOT, for_passive_hands
from hypothesis import given
from hypothesis import strategies as st

import vctune
from vctune.api.bounding import Bounded
from vctune.api.comparing import Comparison
from vctune.api.regions import AdmissibleGains
from vctune.api.result import design_folder
from vctune.api.simulating import Simulation
from vctune.api.sweeping import Swept
from vctune.document.text.toml import toml_text

WHEEL = {
    "name": "<wheel>",
    "device": {"mass": 0.4, "damping": 2.0, "sample_time": 1e-3},
    "stability": {"criterion": "passive"},
    "gains": {"position": {"min": 3000.0, "max": 1e5}},
    "experiment": [{"name": "spring", "environment": {"stiffness": 200.0}, "operator": {"cycles": 1}}],
}
VIOLATED = {**tomllib.loads(DEVICE + FIXED.format(80.0)), "name": "violated"}
FUNCTIONS = [name for name in vctune.__all__ if inspect.isfunction(getattr(vctune, name))]


@pytest.fixture(scope="module")
def wheel():
    return vctune.problem(WHEEL)


@pytest.fixture(scope="module")
def solved(wheel):
    return vctune.solve(wheel)


@pytest.mark.parametrize("path", PROBLEM_FILES, ids=lambda path: path.stem)
def test_a_problem_is_the_same_from_path_tables_and_itself(path):
    read = vctune.problem(str(path))
    assert vctune.problem(path) == vctune.read_problem(path) == read
    named = {"name": read.problem.name, **tomllib.loads(path.read_text())}
    assert vctune.problem(named).problem == read.problem
    stated = vctune.problem(read.problem)
    assert stated.problem == read.problem
    assert stated.document == tomllib.loads(stated.text)


texts = st.text(max_size=8).filter(lambda text: text.isprintable())
values = st.recursive(
    st.booleans() | st.integers(-(2**60), 2**60) | st.floats(allow_nan=False) | texts,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(texts, inner, max_size=3),
    max_leaves=8,
)


@given(st.dictionaries(texts, values, max_size=5))
def test_a_document_as_text_is_the_document(document):
    assert tomllib.loads(toml_text(document)) == document


def test_tables_may_be_objects_and_numbers_numpys(wheel):
    device = vctune.Device(np.float64(0.4), 2, sample_time=1e-3, operator=vctune.LeastOperator(0.0, 5.0))
    made = vctune.problem({"device": device, "gains": {"position": vctune.Range(*np.array([3000.0, 1e5]))}})
    assert made.problem.device.operator == vctune.LeastOperator(0.0, 5.0)
    assert made.problem.bounds.position == wheel.problem.bounds.position
    heavier = dataclasses.replace(wheel.problem, device=dataclasses.replace(wheel.problem.device, mass=0.5))
    assert vctune.problem(heavier).problem == heavier


@pytest.mark.parametrize(
    ("numbers", "key"),
    [
        ({"mass": -0.4}, "mass"),
        ({"mass": "0.4"}, "mass"),
        ({"mass": True}, "mass"),
        ({"mass": 1e60}, "mass"),
        ({"damping": float("nan")}, "damping"),
        ({"sample_time": 0}, "sample_time"),
        ({"delay": 1e-60}, "delay"),
        ({"hold": "foh"}, "hold"),
    ],
)
def test_a_device_is_held_to_what_a_file_may_say(numbers, key):
    given = {"mass": 0.4, "damping": 2.0, "sample_time": 1e-3, **numbers}
    with pytest.raises(ValueError) as stated:
        vctune.Device(**given)
    with pytest.raises(vctune.InputError) as read:
        vctune.problem({"device": given})
    (mistake,) = stated.value.mistakes
    assert mistake.key == key and mistake.line is None
    assert mistake.message in [at.message for at in read.value.mistakes if at.key == f"device.{key}"]


def test_a_device_has_the_defaults_of_the_file():
    device = vctune.Device(mass=0.4, damping=2.0, sample_time=1e-3)
    read = vctune.problem({"device": {"mass": 0.4, "damping": 2.0, "sample_time": 1e-3}}).problem.device.bare
    assert {each.name: getattr(device, each.name) for each in dataclasses.fields(device)} == {
        each.name: getattr(read, each.name) for each in dataclasses.fields(read)
    }
    with pytest.raises(vctune.InputError, match="mass: -1 is too small"):
        dataclasses.replace(device, mass=-1)


@pytest.mark.parametrize(
    ("source", "text"),
    [
        (5, "5 states none"),
        (None, "null states none"),
        ({}, "device: is missing"),
        ({1: 2}, "1: unknown key"),
        ({**WHEEL, "device": {**WHEEL["device"], "mass": np.array([1.0, 2.0])}}, "device.mass: [1.0, 2.0] is not a"),
        ("a\x00b", "null character"),
    ],
)
def test_bad_problems(source, text):
    with pytest.raises(vctune.InputError) as refused:
        vctune.solve(source)
    assert text in str(refused.value)


def test_a_servo_is_checked_with_a_coupling_alone():
    arm = {"device": {"sample_time": 2e-3, "servo": {"delay": 8e-3, "bandwidth_hz": 20.0}}}
    checks = [vctune.check(arm, None, vctune.Coupling(1e3, mass, drag)) for mass, drag in ((10.0, 100.0), (0.1, 0.1))]
    assert [each.result for each in checks] == ["passed", "failed"]


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: vctune.check(WHEEL), "nothing to check: not fixed"),
        (lambda: vctune.check(WHEEL, vctune.Gains(-5.0, 1.0), vctune.Coupling(1.0, 1.0, 0.0)), "gains.velocity: -5"),
        (lambda: vctune.check(WHEEL, vctune.Gains(5.0, 1.0)), "is no design"),
        (lambda: vctune.check(WHEEL, None, vctune.Coupling(100.0, 1.0, 1.0)), "is no design"),
        (lambda: vctune.simulate(VIOLATED), "add an [[experiment]] table"),
        (lambda: vctune.simulate(WHEEL, experiment="wall"), "none is called 'wall'; there are: spring"),
        (lambda: vctune.bound(VIOLATED), "fixes every number"),
        (lambda: vctune.bound(WHEEL, gap=0.0), "gap: 0 is out of range"),
        (lambda: vctune.region(WHEEL, "gains.velocity", "device.mass"), "device.mass: is no variable"),
        (lambda: vctune.region(WHEEL, resolution=1.0), "resolution: 1 is out of range"),
        (lambda: vctune.sweep(WHEEL), "axes: is missing"),
        (lambda: vctune.sweep(WHEEL, {"device.mas": [1.0]}), 'did you mean "device.mass"?'),
        (lambda: vctune.sweep(WHEEL, {"device.mass": [1.0]}, executor="threads"), "is not"),
        (lambda: vctune.write_report({}), "name the folder"),
    ],
)
def test_bad_calls(call, text):
    with pytest.raises(vctune.InputError) as refused:
        call()
    assert text in str(refused.value)


def test_what_the_command_finds(wheel, solved, tmp_path):
    path = vctune.write_design(wheel, solved, tmp_path / "library")
    (tmp_path / "wheel.toml").write_text(wheel.text)
    assert run("solve", "wheel.toml", cwd=tmp_path).returncode == vctune.ExitCode.OK
    made, commanded = (json.loads(at.read_text()) for at in (path, tmp_path / "results/_wheel_/design.json"))
    assert commanded["problem"].pop("source") == "wheel.toml" != made["problem"].pop("source")
    for key in ("status", "gains", "coupling", "transparency", "certificate", "warnings", "problem"):
        assert made[key] == commanded[key]
    assert vctune.write_report(path, tmp_path / "elsewhere").read_text().startswith("<!")


@pytest.mark.advice
@pytest.mark.parametrize(
    "text",
    [
        for_passive_hands(DEVICE + FIXED.format(80.0)),
        pytest.param(DEVICE + "[gains]\nvelocity = { min = 2e3, max = 5e3 }\n", marks=pytest.mark.slow),
    ],
    ids=["fixed", "free"],
)
def test_reason_and_repairs_are_the_commands(text, tmp_path):
    (tmp_path / "p.toml").write_text(text)
    commanded = json.loads(run("solve", "p.toml", "--json", "--time-limit", "300", cwd=tmp_path).stdout)
    solved = vctune.solve(
        tomllib.loads(text), time_limit=300.0
    )  # of itself it ends the search for repairs by the clock
    assert solved.reason == commanded["reason"]
    assert [repair.needs for repair in solved.repairs] == [repair["needs"] for repair in commanded["repairs"]] != []


@pytest.mark.advice
@pytest.mark.slow
def test_a_violated_design_is_checked_with_its_repairs():
    checked = vctune.check(VIOLATED)
    assert checked.result == "failed"
    assert checked.finding.repairs and "would pass" in checked.message
    gains, coupling = checked.finding.judgement.gains, checked.finding.judgement.coupling
    free = vctune.problem({key: table for key, table in VIOLATED.items() if key not in ("gains", "coupling")})
    assert vctune.check(free, gains, coupling).finding.judgement.min_ratio == checked.finding.judgement.min_ratio


def test_frequencies_are_hertz_where_they_say_so(wheel, solved):
    best = solved.judgement
    assert 2 * pi * best.worst_hz == pytest.approx(best.worst, rel=1e-11)
    assert 2 * pi * best.worst_sensitivity_hz == pytest.approx(best.worst_sensitivity, rel=1e-11)
    band = vctune.design_record(wheel, solved)["certificate"]["band_hz"]
    assert band == list(wheel.problem.stability.band.hz)


@pytest.mark.slow
def test_a_bound_from_a_result_and_from_its_file(wheel, solved, tmp_path):
    found = vctune.bound(wheel, solved, gap=0.3)
    assert found.proved and found.optimality.bound <= solved.judgement.error <= 1.3 * found.optimality.bound
    path = vctune.write_design(wheel, solved, tmp_path)
    assert vctune.bound(wheel, path, gap=0.3).optimality.bound == found.optimality.bound
    assert vctune.bound(wheel, solved, gap=0.01, time_limit=0.0).proved is False


def test_a_sweep_solves_each_point(wheel, tmp_path):
    swept = vctune.sweep(wheel, {"device.damping": np.array([1.0, 4.0])}, folder=tmp_path)
    for row in swept.table.rows():
        alone = vctune.solve({**WHEEL, "device": {**WHEEL["device"], "damping": row["device.damping"]}})
        assert row["error"] == alone.judgement.transparency.error
    assert swept.summary.points == 2 and (tmp_path / "table.csv").exists()
    assert vctune.sweep(wheel, {"device.damping": [1.0, 4.0]}, folder=tmp_path).dropped == 0


def test_a_region_holds_the_design(wheel, solved):
    found = vctune.region(wheel, resolution=1 / 16)
    assert found.status is vctune.Status.CERTIFIED and sum(found.areas.values()) == pytest.approx(1)
    assert found.designs == [(solved.judgement.gains, solved.judgement.coupling)]


def test_results_are_frozen(wheel, solved):
    best = solved.judgement
    for result in (wheel, solved, best, vctune.check(wheel, best.gains, best.coupling)):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(result, dataclasses.fields(result)[0].name, None)
    results = (Bounded, Comparison, AdmissibleGains, Simulation, vctune.Simulated, Swept)
    assert all(result.__dataclass_params__.frozen for result in results)


def test_completion_shows_public_names_alone():
    assert dir(vctune) == sorted(vctune.__all__)
    rooms = {module.name for module in pkgutil.iter_modules(vctune.__path__)}
    assert not rooms & set(vctune.__all__), "a package of that name would hide the function once it is imported"


@pytest.mark.parametrize("name", FUNCTIONS)
def test_public_functions_say_what_they_take_and_give(name):
    text = inspect.getdoc(getattr(vctune, name))
    assert "Parameters\n---" in text and "Returns\n---" in text
    if getattr(vctune, name).__module__.startswith(("vctune.api", "vctune.document")):
        assert "Raises\n---" in text


def test_the_example_of_the_guide():
    module = import_module("vctune.api")
    failed, attempted = doctest.testmod(module, optionflags=doctest.ELLIPSIS)
    assert failed == 0 and attempted > 3


@pytest.mark.slow
def test_the_example_script():
    done = subprocess.run(
        [sys.executable, ROOT / "problems/example.py"], capture_output=True, text=True, check=True, timeout=60
    )
    lines = done.stdout.splitlines()
    assert lines[0].startswith("certified: error") and lines[0].endswith("boxes")
    assert sum(line.startswith("damping ") for line in lines) == 5
    assert lines[-1] == "refused: Device: mass: -0.4 is too small: must be at least 1e-50 [out-of-range]"
    assert done.stderr == ""


def test_paths_of_a_design(tmp_path, wheel):
    assert design_folder(wheel, tmp_path) == tmp_path / "_wheel_"


def test_a_device_with_parts_is_stated_as_in_a_file():
    parts = {
        "velocity": vctune.VelocityEstimate("difference", np.float64(200.0)),
        "actuator": vctune.Actuator(500.0, 2),
        "force_sensor": vctune.ForceSensor(delay=1e-3),
        "structure": vctune.Structure(0.1, 300.0, 0.02),
    }
    stated = vctune.problem({"device": vctune.Device(mass=0.4, damping=2.0, sample_time=1e-3, **parts)})
    tables = {
        "actuator": {"bandwidth_hz": 500.0, "order": 2},
        "velocity": {"from": "difference", "filter_hz": 200.0},
        "force_sensor": {"delay": 1e-3},
        "structure": {"handle_mass": 0.1, "frequency_hz": 300.0, "damping_ratio": 0.02},
    }
    written = vctune.problem({"device": WHEEL["device"] | tables})
    assert stated.problem == written.problem == vctune.problem(stated.problem).problem
    with pytest.raises(vctune.InputError, match="is not less than device"):
        vctune.Device(mass=0.4, damping=2.0, sample_time=1e-3, structure=vctune.Structure(0.5, 300.0, 0.02))
    with pytest.raises(vctune.InputError, match="is too small"):
        vctune.Device(mass=0.4, damping=2.0, sample_time=1e-3, actuator=vctune.Actuator(-1.0))


def by_key(found):
    return {each["key"]: each for each in found}


def test_a_design_compared_with_itself_differs_nowhere(solved, wheel, tmp_path):
    found = vctune.compare(wheel, vctune.write_design(wheel, solved, tmp_path))
    assert found.problem == [] and all(value["a"] == value["b"] for value in found.design)


def test_a_comparison_shows_what_differs(solved, wheel):
    """The errors are of one Z_0, which `b` does not state."""
    changed = {**WHEEL, "device": {**WHEEL["device"], "mass": 0.5}}
    found = vctune.compare(wheel, changed)
    assert found.problem[0] == {"key": "device.mass", "a": 0.4, "b": 0.5}
    assert set(by_key(found.problem)) == {"device.mass", "gains.velocity"}  # its bounds follow the mass
    impedance = wheel.problem.transparency.reference_impedance
    other = vctune.solve({**changed, "transparency": {"reference_impedance": impedance}})
    values = by_key(found.design)
    for side, design in (("a", solved), ("b", other)):
        assert values["gains.velocity"][side] == design.judgement.gains.velocity
        assert values["transparency.error"][side] == design.judgement.error
        assert values["certificate.min_ratio"][side] == design.judgement.min_ratio
    assert json.loads(json.dumps(found.to_json(), allow_nan=False))["problem"] == found.problem


def test_the_command_shows_every_row_of_both_designs(solved, wheel, tmp_path):
    """A row that one of them has not is empty; what differs in the problems stands first."""
    design, file = vctune.write_design(wheel, solved, tmp_path), tmp_path / "other.toml"
    file.write_text(toml_text({**WHEEL, "device": {**WHEEL["device"], "mass": 0.5}}))
    done = run("compare", design, file, cwd=tmp_path)
    assert done.returncode == 0 and done.stderr == ""
    assert re.search(r"^device\.mass +0\.4 +0\.5$", done.stdout, re.MULTILINE)
    found = json.loads(run("compare", design, file, "--json", cwd=tmp_path).stdout)
    assert found["problem"][0] == {"key": "device.mass", "a": 0.4, "b": 0.5}
    shown = by_key(found["design"])["gains.velocity"]
    assert all(f"{shown[side]:.8g} N s/m" in done.stdout for side in "ab")


@pytest.mark.slow
def test_displays_of_either_kind_compare():
    """What one of them has not is None."""
    spring = {
        "device": {"display": "impedance", "mass": 0.06, "damping": 0.1, "sample_time": 1e-3},
        "gains": {"velocity": 0.0},
        "coupling": {"damping": 0.01, "stiffness": 10.0},
    }
    for pair in ((VIOLATED, spring), (spring, VIOLATED), (spring, spring)):
        values = by_key(vctune.compare(*pair).design)
        for side, source in zip("ab", pair, strict=True):
            assert values["coupling.stiffness"][side] == (10.0 if source is spring else None)
            assert values.get("coupling.mass", {}).get(side) == (0.37 if source is VIOLATED else None)
