"""Parameter files of ROS 2: what is checked is what the controller steps, and a verdict holds where it is stepped."""

from __future__ import annotations

import re
from dataclasses import replace
from math import log, pi, sqrt

import numpy as np
import pytest
import yaml
from command import run as vctune
from command import strict
from loop import Loop, radius

from vctune.design.ros import admittance_check
from vctune.design.ros.admittance import corner_hz, coupling_of_admittance
from vctune.document.reading import read_problem
from vctune.document.ros import Admittance, read_admittances
from vctune.document.schema.statement import device_table
from vctune.exit_codes import ExitCode
from vctune.simulation.controller import coupling_coefficients

ARM = """[device]
mass = 10.0
damping = 20.0
sample_time = 1e-3
delay = 1e-3
[gains]
velocity = 800.0
position = 8000.0
"""
PARAMETERS = """/**:
  admittance_controller:
    ros__parameters:
      joints: [j1]
      ft_sensor:
        name: ft
        filter_coefficient: 0.05
      admittance:
        selected_axes: [true, false, false, false, false, false]
        mass: [5.0, 5.0, 5.0, 0.1, 0.1, 0.1]
        damping_ratio: [2.5, 2.5, 2.5, 2.5, 2.5, 2.5]
        stiffness: [50.0, 50.0, 50.0, 10.0, 10.0, 10.0]
"""
T = 1e-3


@pytest.fixture
def arm(tmp_path):
    (tmp_path / "arm.toml").write_text(ARM)
    (tmp_path / "ros.yaml").write_text(PARAMETERS)
    return tmp_path


def changed(folder, **values):
    """Write the file again with other texts behind keys."""
    text = PARAMETERS
    for key, value in values.items():
        line = next(line for line in text.splitlines() if line.strip().startswith(f"{key}:"))
        text = text.replace(line, f"{line.split(':')[0]}: {value}")
    (folder / "ros.yaml").write_text(text)


def six(value):
    return str([value] * 6)


def damped(ratio, joint_damping):
    """Return what to write behind damping_ratio to state joint_damping too."""
    return f"{six(ratio)}\n        joint_damping: {joint_damping}"


def test_it_reads_the_selected_axes(arm):
    changed(arm, selected_axes="[true, false, false, true, false, false]")
    found = read_admittances(arm / "ros.yaml")[0]
    assert [axis.axis for axis in found.axes] == ["x", "rx"]
    assert found.filter_coefficient == 0.05
    x = found.axes[0]
    assert (x.mass, x.stiffness, x.line) == (5.0, 50.0, 10)
    assert replace(x, joint_damping=0.0).damping == pytest.approx(2 * 2.5 * sqrt(5.0 * 50.0))
    assert x.joint_damping == 5.0, "the controller's default"
    assert x.damping == pytest.approx(2 * 2.5 * sqrt(5.0 * 50.0) + 5.0 * 5.0)
    changed(arm, damping_ratio=damped(2.5, 0.5))
    assert read_admittances(arm / "ros.yaml")[0].axes[0].joint_damping == 0.5
    assert corner_hz(0.05, T) == pytest.approx(8.16, abs=0.01)
    assert corner_hz(0.05, T) == pytest.approx(-log(0.95) / (2 * pi * T))


def test_the_explicit_step_is_the_coupling_and_a_lossless_spring():
    """To rounding, on any force: acceleration from the forces of the sample before, then velocity, then position."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        mass, stiffness, ratio = rng.uniform(0.5, 20.0), 10 ** rng.uniform(0, 3), rng.uniform(0.3, 3.0)
        joints = rng.uniform(0.0, 20.0)
        axis = Admittance("x", float(mass), float(ratio), float(stiffness), float(joints), 1)
        made = coupling_coefficients(coupling_of_admittance(axis, T), T)
        v = x = w = y = coupling = 0.0
        for force in rng.normal(size=500):
            acceleration = (force - 2 * ratio * sqrt(mass * stiffness) * v - stiffness * x) / mass
            v += T * (acceleration - joints * v)  # every joint loses of its own velocity, whatever mass is rendered
            x += T * v
            # f = f_c + b_0 w + spring, with the spring at the mean of both positions
            free = force + made["coupling_step"] * w - made["coupling_decay"] * coupling - stiffness * (y + T / 2 * w)
            after = free / (made["resistance"] + stiffness * T / 2)
            coupling = made["coupling_decay"] * coupling + made["coupling_step"] * (after - w)
            y, w = y + T / 2 * (w + after), after
            assert w == pytest.approx(v, rel=1e-9, abs=1e-12)


def growth(problem, axis, coefficient, hand):
    """Return the spectral radius of the arm under the admittance, both as the controller computes them."""
    table = device_table(problem.device)
    table["force_sensor"] = table.get("force_sensor", {}) | {"filter_coefficient": coefficient}
    gains = problem.bounds.velocity.min, problem.bounds.position.min
    return radius(Loop(table, gains, hand=hand, rule=(axis.mass, axis.damping, axis.stiffness)))


LIGHT = {"mass": six(0.1), "stiffness": six(10.0), "filter_coefficient": "0.9"}
"""An axis that is too light for a stiff hand."""


def test_what_is_proved_and_a_hand_in_which_it_grows_are_told(arm):
    done = vctune("check", "arm.toml", "ros.yaml", cwd=arm)
    assert done.returncode == ExitCode.OK and "x: proved" in done.stdout
    assert "filter_coefficient 0.05 at 1000 Hz is a low-pass of 8.2 Hz" in done.stdout
    changed(arm, **LIGHT)
    done = vctune("check", "arm.toml", "ros.yaml", cwd=arm)
    told = r"in the hand of (\S+) kg, (\S+) N s/m, (\S+) N/m with its spring alone a motion grows"
    hand = tuple(map(float, re.search(told, done.stdout).groups()))
    problem, axis = read_problem(arm / "arm.toml").problem, read_admittances(arm / "ros.yaml")[0].axes[0]
    assert done.returncode == ExitCode.FAILED and growth(problem, axis, 0.9, hand) > 1


UNSPRUNG = {"stiffness": six(0.0)}


def pasted(folder, line):
    """Write the file with a line as a refusal prints it, under its dotted name."""
    name, value = line.partition(".")[2].split(": ", 1)
    text = (folder / "ros.yaml").read_text()
    text, places = re.subn(rf"^(\s*{name}:).*$", rf"\1 {value}", text, flags=re.MULTILINE)
    text = text if places else text.replace("admittance:", f"admittance:\n        {name}: {value}")
    (folder / "ros.yaml").write_text(text)


@pytest.mark.advice
@pytest.mark.slow
@pytest.mark.parametrize(
    "axis, words", [(LIGHT, "damping_ratio joint_damping mass"), (UNSPRUNG, "filter_coefficient joint_damping mass")]
)
def test_what_would_help_does(arm, axis, words):
    """Each parameter that has an effect, alone: without stiffness damping_ratio has none."""
    changed(arm, **axis)
    done = vctune("check", "arm.toml", "ros.yaml", cwd=arm)
    assert "coupling." not in done.stdout and re.search(r"in arm.toml (operator|stability)\.", done.stdout)
    (found,) = strict(vctune("check", "arm.toml", "ros.yaml", "--json", cwd=arm).stdout)
    own = [repair for repair in found["repairs"] if repair["chooses"]]
    assert own and {repair["key"].split(".")[1] for repair in own} <= {*words.split()}
    for repair in own:
        assert f"{repair['needs']} instead of {repair['old']:.12g}" in done.stdout
        changed(arm, **axis)
        pasted(arm, repair["needs"])
        assert vctune("check", "arm.toml", "ros.yaml", cwd=arm).returncode == ExitCode.OK


@pytest.mark.parametrize(
    "ratio, joint_damping, code, said",
    [
        (1.0, 0.0, "[ros-no-damping]", "stiffness 0 and joint_damping 0 mean no damping at all"),
        (1.0, 5.0, "[ros-unused-ratio]", "joint_damping 5 alone damps, by 25 N s/m"),
        (0.0, 5.0, None, ""),
    ],
)
def test_without_stiffness_the_joints_alone_damp(arm, ratio, joint_damping, code, said):
    (arm / "arm.toml").write_text(ARM + "[operator]\ndamping = { min = 40.0, max = 60.0 }\n")
    changed(arm, stiffness=six(0.0), filter_coefficient="0.9", damping_ratio=damped(ratio, joint_damping))
    done = vctune("check", "arm.toml", "ros.yaml", "--format", "json", cwd=arm)
    (found,) = strict(done.stdout)
    warned = [warning for warning in found["warnings"] if "[ros-" in warning]
    assert found["coupling"]["drag"] == joint_damping * 5.0
    assert len(warned) == (code is not None) and all(code in each and said in each for each in warned)


def test_the_controllers_default_of_joint_damping_makes_a_good_file_pass(arm):
    """Not enough by 2 damping_ratio sqrt(M S) alone, and enough with the 25 N s/m of a joint_damping of 5."""
    ratios = []
    for text in (damped(1.6, 0.0), six(1.6), damped(1.6, 5.0)):
        changed(arm, damping_ratio=text)
        (found,) = strict(vctune("check", "arm.toml", "ros.yaml", "--json", cwd=arm).stdout)
        ratios.append((found["status"], found["certificate"]["hands"]["min_ratio"]))
    assert ratios[1] == ratios[2] and ratios[1][0] == "certified" and ratios[1][1] > 1.05
    assert ratios[0][0] == "violated" and ratios[0][1] < 1


@pytest.fixture
def proofs(monkeypatch):
    """Return the problems that are proved."""
    seen, prove = [], admittance_check.judge
    monkeypatch.setattr(admittance_check, "judge", lambda *design: seen.append(design) or prove(*design))
    return seen


def test_identical_axes_are_one_check(arm, proofs):
    changed(arm, selected_axes="[true, true, true, false, false, false]", mass="[5.0, 6.0, 5.0, 1.0, 1.0, 1.0]")
    done = vctune("check", "arm.toml", "ros.yaml", "--json", cwd=arm)
    alike, other = strict(done.stdout)
    assert done.returncode == ExitCode.OK and len(proofs) == 2
    assert [each["problem"]["name"] for each in (alike, other)] == ["arm x and z", "arm y"]
    assert alike["coupling"] != other["coupling"]
    text = vctune("check", "arm.toml", "ros.yaml", cwd=arm).stdout
    assert [f"ros.yaml: {axes}: proved" in text for axes in ("x and z", "y")] == [True] * 2


def test_axes_are_selected_and_those_of_the_other_motion_are_not_looked_at(arm, proofs):
    changed(arm, selected_axes="[true, true, false, true, false, false]")
    whole = vctune("check", "arm.toml", "ros.yaml", cwd=arm)
    assert whole.returncode == ExitCode.UNDECIDED and len(proofs) == 1
    (line,) = (line for line in whole.stdout.splitlines() if "not looked at" in line)
    assert line.startswith("undecided  ros.yaml: rx: not looked at: a rotation, and arm.toml has a linear device")
    assert line.endswith("in kg m2 and N m s/rad [ros-rotation]") and "1 passed, 1 undecided" in whole.stdout
    for style, word in (("json", '"reason"'), ("github", "::warning")):
        done = vctune("check", "arm.toml", "ros.yaml", "--format", style, cwd=arm)
        assert done.returncode == ExitCode.UNDECIDED and word in done.stdout and "not looked at" in done.stdout


def test_axes_that_are_all_off_pass_with_a_note(arm, proofs):
    changed(arm, selected_axes=six("false").replace("'", ""))
    done = vctune("check", "arm.toml", "ros.yaml", cwd=arm)
    assert done.returncode == ExitCode.OK and not proofs
    assert "no axis is selected" in done.stdout and done.stdout.startswith("passed ")


@pytest.mark.parametrize(
    "values, complaint",
    [
        ({"mass": six(0.1), "damping_ratio": six(50.0)}, "more than 0.5051 kg with damping_ratio = 50 kept"),
        ({"stiffness": six(1e5), "damping_ratio": six(0.01)}, "takes S T/2"),
        ({"stiffness": six(0.0), "damping_ratio": damped(1.0, 1e4)}, "joint_damping must be below 1/T = 1000"),
    ],
)
def test_an_explicit_step_that_is_not_passive_fails(arm, values, complaint):
    """The limits are those of M - D T > 0, D with the mass in it, and of D >= S T/2."""
    changed(arm, **values)
    done = vctune("check", "arm.toml", "ros.yaml", cwd=arm)
    assert done.returncode == ExitCode.FAILED and complaint in done.stdout


def test_a_disc_that_is_not_covered_is_told(arm):
    (arm / "arm.toml").write_text(ARM + "[uncertainty]\nunmodelled = [[1.0, 0.01], [100.0, 0.1]]\n")
    assert "uncertainty.unmodelled is not covered" in vctune("check", "arm.toml", "ros.yaml", cwd=arm).stdout


def test_the_filter_is_the_files_whatever_the_problem_states(arm):
    """A coefficient of 1 is no filter, also beside one of the problem's own."""
    changed(arm, filter_coefficient="1.0")
    alone = vctune("check", "arm.toml", "ros.yaml", cwd=arm).stdout
    (arm / "arm.toml").write_text(ARM + "[device.force_sensor]\nfilter_coefficient = 0.05\n")
    assert vctune("check", "arm.toml", "ros.yaml", cwd=arm).stdout == alone


SPRUNG = """[device]
mass = 1.0
damping = 5.0
sample_time = 2.5e-4
force_sensor = { delay = 0.015 }
[gains]
velocity = 800.0
position = 20000.0
"""


@pytest.mark.parametrize(
    ("mass", "stiffness"), [("{ max = 0.0 }", "0.0"), ("{ min = 0.0, max = 0.0 }", "{ max = 0.0 }")]
)
def test_the_controllers_spring_is_there_however_nothing_is_stated(arm, mass, stiffness):
    """With it the axis grows in a hand of .5 kg."""
    changed(arm, mass=six(2.0), stiffness=six(2e5), damping_ratio=damped(0.0, 50.0), filter_coefficient="1.0")
    (arm / "arm.toml").write_text(f"{SPRUNG}[environment]\nmass = {mass}\nstiffness = {stiffness}\n")
    problem, axis = read_problem(arm / "arm.toml").problem, read_admittances(arm / "ros.yaml")[0].axes[0]
    assert growth(problem, axis, 1.0, (0.5, 0.0, 0.0)) > 1.001
    assert vctune("check", "arm.toml", "ros.yaml", cwd=arm).returncode == ExitCode.FAILED


def test_a_rotary_device_is_told_in_its_units(arm):
    """An explicit step that is not passive, about an axis: named in kg m2, and the axis is no surprise."""
    hands = "mass = { min = 0, max = 0.1 }\ndamping = { min = 0, max = 1.0 }\nstiffness = { min = 0, max = 100.0 }\n"
    turning = ARM.replace("[device]\n", '[device]\nunits = "rotary"\n') + f"[operator]\n{hands}"
    (arm / "arm.toml").write_text(turning)
    changed(arm, selected_axes="[false, false, false, false, false, true]", mass=six(0.001), damping_ratio=six(20.0))
    done = vctune("check", "arm.toml", "ros.yaml", cwd=arm)
    assert done.returncode == ExitCode.FAILED, done.stderr
    assert re.search(
        r"a damping of [\d.]+ N m s/rad is modelled from an inertia of [\d.]+ kg m2 on, not 0.001", done.stdout
    )
    assert "[ros-rotation]" not in done.stdout


MANAGER = """{}:
  ros__parameters:
    update_rate: {}
    admittance_controller:
      type: {}
"""
KIND = "admittance_controller/AdmittanceController"


@pytest.mark.parametrize("manager", ["controller_manager", "/arm/controller_manager", "/**"])
def test_a_rate_and_a_type_of_the_file_may_be_those_of_the_problem(arm, manager):
    body = PARAMETERS if manager != "/**" else PARAMETERS.removeprefix("/**:\n")
    (arm / "ros.yaml").write_text(MANAGER.format(manager, 1000, KIND) + body)
    assert vctune("check", "arm.toml", "ros.yaml", cwd=arm).returncode != ExitCode.BAD_INPUT


def test_dotted_names_are_tables_and_each_of_two_controllers_has_a_line(arm):
    whole = vctune("check", "arm.toml", "ros.yaml", cwd=arm).stdout
    (table,) = yaml.safe_load(PARAMETERS).values()
    given = table["admittance_controller"]["ros__parameters"]
    flat = {
        f"{name}.{key}": value for name, part in given.items() if isinstance(part, dict) for key, value in part.items()
    }
    (arm / "ros.yaml").write_text(yaml.safe_dump({"admittance_controller": {"ros__parameters": flat}}))
    assert vctune("check", "arm.toml", "ros.yaml", cwd=arm).stdout == whole
    both = {f"{side}_admittance": {"ros__parameters": given} for side in ("left", "right")}
    (arm / "ros.yaml").write_text(yaml.safe_dump(both))
    lines = vctune("check", "arm.toml", "ros.yaml", cwd=arm).stdout
    assert lines.count("left_admittance x: ") == lines.count("right_admittance x: ") == 1


def test_keys_that_the_controller_ignores_and_lists_of_integers_are_warned_of(arm):
    text = PARAMETERS + "        joint_dampng: 2.0\n"
    (arm / "ros.yaml").write_text(text)
    said = vctune("check", "arm.toml", "ros.yaml", cwd=arm).stdout
    line = next(number for number, each in enumerate(text.splitlines(), 1) if "joint_dampng" in each)
    assert f"line {line}: admittance.joint_dampng: the controller ignores it; did you mean joint_damping?" in said
    changed(arm, mass="[30, 30, 30, 1, 1, 1]")
    assert "admittance.mass is a list of integers" in vctune("check", "arm.toml", "ros.yaml", cwd=arm).stdout


def test_the_rate_of_another_controller_is_not_that_of_this_one(arm):
    other = "joint_state_broadcaster:\n  ros__parameters:\n    update_rate: 50\n"
    (arm / "ros.yaml").write_text(other + PARAMETERS)
    assert vctune("check", "arm.toml", "ros.yaml", cwd=arm).returncode != ExitCode.BAD_INPUT


@pytest.mark.parametrize("coefficient, said", [(0.26, True), (0.28, False), (0.4, False)])
def test_a_filter_below_a_tenth_of_the_nyquist_frequency_is_warned_of(arm, coefficient, said) -> None:
    """At 1 kHz that is 50 Hz: 0.26 is a low-pass of 48 Hz, 0.28 of 52 Hz and 0.4 of 81 Hz."""
    changed(arm, filter_coefficient=coefficient)
    (found,) = strict(vctune("check", "arm.toml", "ros.yaml", "--json", cwd=arm).stdout)
    assert (
        any("[ros-slow-filter]" in warning for warning in found["warnings"]) == said == (corner_hz(coefficient, T) < 50)
    )


def test_a_warning_that_is_allowed_does_not_fail_a_strict_check_and_is_told_once(arm):
    """Two arms of one file with one slow filter: one warning; --strict fails for it, and does not if it is allowed."""
    given = yaml.safe_load(PARAMETERS)["/**"]["admittance_controller"]["ros__parameters"]
    both = {f"{side}_admittance": {"ros__parameters": given} for side in ("left", "right")}
    (arm / "ros.yaml").write_text(yaml.safe_dump(both))
    lost, allowed = (
        vctune("check", "arm.toml", "ros.yaml", "--strict", *allow, cwd=arm)
        for allow in ((), ("--allow", "ros-slow-filter"))
    )
    assert lost.stdout.count("[ros-slow-filter]") == allowed.stdout.count("[ros-slow-filter]") == 1
    assert lost.returncode == 1 and "fails for its warnings" in lost.stdout
    assert "fails for its warnings" not in allowed.stdout


def test_what_the_joints_lose_is_a_damping_of_every_axis():
    """Six joints, stepped as the controller does, against one axis each: joint_damping is 1/s and scales with M."""
    rng = np.random.default_rng(5)
    jacobian, joints = rng.normal(size=(6, 6)) + 3 * np.eye(6), 12.0
    mass, ratio, stiffness = (rng.uniform(1.0, 5.0, 6) for _ in range(3))
    axes = [Admittance("x", *map(float, numbers), joints, 1) for numbers in zip(mass, ratio, stiffness, strict=True)]
    damping = np.array([axis.damping for axis in axes])
    q = q_dot = np.zeros(6)
    v = x = np.zeros(6)
    for force in rng.normal(size=(300, 6)):
        wanted = (
            force - 2 * ratio * np.sqrt(mass * stiffness) * (jacobian @ q_dot) - stiffness * (jacobian @ q)
        ) / mass
        q_dot = q_dot + T * (np.linalg.solve(jacobian, wanted) - joints * q_dot)
        q = q + T * q_dot
        v = v + T * (force - damping * v - stiffness * x) / mass
        x = x + T * v
        assert jacobian @ q_dot == pytest.approx(v, rel=1e-9, abs=1e-12)


def test_each_way_out_of_a_step_that_is_too_long_is_one(arm):
    """The mass is that with the ratio kept, and the ratio that with the mass kept: a step beyond either passes it."""
    changed(arm, mass=six(0.1), damping_ratio=six(50.0))
    said = vctune("check", "arm.toml", "ros.yaml", cwd=arm).stdout
    mass, ratio = (float(re.search(rf"{words} ([0-9.e+-]+)", said)[1]) for words in ("heavier, more than", "less than"))
    for way in ({"mass": six(mass * 1.001)}, {"mass": six(0.1), "damping_ratio": six(ratio * 0.999)}):
        changed(arm, **({"mass": six(0.1), "damping_ratio": six(50.0)} | way))
        assert "ros-step" not in vctune("check", "arm.toml", "ros.yaml", cwd=arm).stdout
