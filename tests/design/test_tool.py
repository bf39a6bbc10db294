"""A tool that is always there: part of every hand, of every experiment, and read from a ROS 2 file that states it."""

from __future__ import annotations

import json
import re
from math import inf

import numpy as np
import pytest
from command import run as vctune
from draws import servo
from loop import Loop
from loop import radius as stepped

from vctune import Status, check, problem, solve
from vctune.document.text.toml import toml_text
from vctune.exit_codes import ExitCode

ARM = {
    "device": {"sample_time": 2e-3, "servo": {"delay": 0.03, "bandwidth_hz": 22.0, "order": 2}},
    "environment": {"mass": {"max": 0.0}, "stiffness": {"max": 0.0}},
}
PARAMETERS = """admittance_controller:
  ros__parameters:
    gravity_compensation: {{frame: {{id: {frame}}}, CoG: {{pos: [0.0, 0.0, 0.1], force: {force}}}}}
    control: {{frame: {{id: tool0}}}}
    ft_sensor: {{filter_coefficient: 0.5}}
    admittance:
      selected_axes: [true, false, false, false, {turns}, false]
      mass: [{mass}, {mass}, {mass}, 0.3, 0.3, 0.3]
      damping_ratio: [3.0, 3.0, 3.0, 3.0, 3.0, 3.0]
      stiffness: [50.0, 50.0, 50.0, 2.0, 2.0, 2.0]
      joint_damping: 60.0
"""


def test_a_tool_is_part_of_every_hand_and_of_the_experiments():
    """The problem is that of heavier hands, to the digit."""
    experiment = [{"name": "wall", "environment": {"stiffness": 100.0}, "operator": {"mass": 0.2}}]
    tool = problem(ARM | {"tool": {"mass": {"min": 0.1, "max": 4.7}, "damping": 1.3}, "experiment": experiment})
    hands = {"mass": {"min": 0.1, "max": 5.2}, "damping": {"min": 1.3, "max": 31.3}}
    heavier = problem(ARM | {"operator": hands, "experiment": experiment})
    assert tool.sha256 == heavier.sha256 != problem(ARM).sha256
    assert tool.problem.experiments[0].operator.mass == pytest.approx(4.9)
    assert "the tool of 0.1 to 4.7 kg and 1.3 N s/m included" in tool.problem.hands.in_words(tool.problem.units)


def test_a_tool_alone_can_be_the_hand():
    """A robot that nobody holds: its gripper feeds back."""
    nobody = {"mass": 0.0, "damping": 0.0, "stiffness": 0.0}
    assert solve(ARM | {"operator": nobody, "tool": {"mass": 2.0}}).status == "certified"


def checked(tmp_path, *, problem=ARM, **values):
    """Return the exit code and the line of x for a parameter file."""
    (tmp_path / "arm.toml").write_text(toml_text(problem))
    (tmp_path / "ros.yaml").write_text(PARAMETERS.format(**{"frame": "tool0", "turns": "false", "mass": 2.0} | values))
    done = vctune("check", "arm.toml", "ros.yaml", cwd=tmp_path)
    return done.returncode, done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.advice
def test_a_ros_file_states_its_tool(tmp_path):
    """49 N are 5 kg: refuted, with the weight that passes, which does."""
    code, text = checked(tmp_path, force=49.0)
    assert code == ExitCode.FAILED
    found = re.search(
        r"a tool of at most ([0-9.]+) kg passes, gravity_compensation.CoG.force = ([0-9.]+), not 49", text
    )
    assert found and float(found[1]) == pytest.approx(float(found[2]) / 9.81, rel=1e-3)
    passed, said = checked(tmp_path, force=float(found[2]))
    assert passed == ExitCode.OK and "the tool of" in said
    assert checked(tmp_path, force=1.03 * float(found[2]))[0] == ExitCode.FAILED
    assert checked(tmp_path, force=0.0)[0] == ExitCode.OK
    text = (tmp_path / "ros.yaml").read_text()
    for empty in ("gravity_compensation:", "gravity_compensation: {CoG: {pos: [0.0, 0.0, 0.0]}}"):
        (tmp_path / "ros.yaml").write_text(re.sub("gravity_compensation:.*", empty, text))
        assert vctune("check", "arm.toml", "ros.yaml", cwd=tmp_path).returncode == ExitCode.OK


def test_the_tool_of_a_problem_and_of_its_file_agree(tmp_path):
    same = ARM | {"tool": {"mass": 1.0}}
    assert checked(tmp_path, problem=same, force=9.81)[0] == ExitCode.OK


@pytest.mark.slow
def test_a_tool_turns_about_the_axes_of_its_frame(tmp_path):
    """As a point .1 m along z: .01 kg m2 for each kg about y; about any axis up to that if the frame is another."""
    turning = {"device": ARM["device"] | {"units": "rotary"}, "environment": ARM["environment"]}
    turning["operator"] = {"mass": 0.0, "damping": {"min": 0.0, "max": 0.3}, "stiffness": {"min": 0.0, "max": 30.0}}
    (tmp_path / "wrist.toml").write_text(toml_text(turning))
    for frame, words in (("tool0", "of 0.02 kg m2"), ("flange", "of 0 to 0.02 kg m2")):
        checked(tmp_path, force=19.62, turns="true", frame=frame)
        done = vctune("check", "arm.toml", "wrist.toml", "ros.yaml", cwd=tmp_path)
        assert f"the tool {words} included" in done.stdout, done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(25))
def test_the_lightest_arm_with_a_tool_is_what_its_hands_permit(seed):
    """Stepped with the tool in the hand: stable in every hand as designed, and with 3 % less not in one of them."""
    rng = np.random.default_rng(seed)
    device, weight, most = servo(rng), float(rng.uniform(0, 10)), np.array([0.5, 30.0, 10 ** rng.uniform(2, 3.5)])
    names = ("mass", "damping", "stiffness")
    hands = {name: {"min": 0.0, "max": float(x)} for name, x in zip(names, most, strict=True)}
    asked = {"device": device, "operator": hands, "tool": {"mass": weight}, "stability": {"safety_factor": 1.0}}
    found = solve(asked | {"environment": ARM["environment"]})
    assert found.status == "certified"
    mass, drag = found.judgement.coupling.mass, found.judgement.coupling.drag
    shares = np.stack(np.meshgrid((0, 0.3, 1), (0, 1), (0, 0.1, 0.4, 1)), axis=-1).reshape(-1, 3)

    def stable(by):
        each = (tuple(share * most + (weight, 0, 0)) for share in shares)
        return all(stepped(Loop(device, (0.0, 0.0), (np.inf, by * mass, by * drag), hand)) < 1 for hand in each)

    assert stable(1.0) and not stable(0.97)


@pytest.mark.slow
def test_an_answer_about_an_arm_tells_its_latency_its_contact_and_its_first_step(tmp_path):
    """With nothing behind it too: the stiffest contact is proved, and with 1 % more it is not."""
    (tmp_path / "arm.toml").write_text(toml_text(ARM | {"coupling": {"rule": "euler", "mass": 6.0, "drag": 150.0}}))
    record = vctune("check", "arm.toml", "--json", cwd=tmp_path)
    found = json.loads(record.stdout)[0]
    contact, felt = found["contact"], found["felt"]
    late = 1e-3 + 0.03 + 2**0.5 / (2 * np.pi * 22.0)
    assert contact["latency_s"] == pytest.approx(late) and "rest_drag" not in contact
    assert felt["first_acceleration"] == pytest.approx(1 / 6.0) and felt["first_speed"] == pytest.approx(2e-3 / 6.0)
    stiffest = contact["stiffest_contact"]
    assert stiffest > 3000.0 and contact["stiffest_contact_verdict"] == "proved"
    soft = ARM | {"coupling": {"rule": "euler", "mass": 6.0, "drag": 100.0}}
    (tmp_path / "soft.toml").write_text(toml_text(soft))
    (judged,) = json.loads(vctune("check", "soft.toml", "--json", cwd=tmp_path).stdout)
    most = judged["contact"]["stiffest_contact"]
    for by, status in ((1.0, "certified"), (1.01, "violated")):
        assert solve(soft | {"operator": {"stiffness": {"min": 0.0, "max": by * most}}}).status == status


def test_a_real_table_in_the_virtual_world_is_told(tmp_path):
    table = {"device": ARM["device"], "environment": {"stiffness": {"max": 50000.0}}}
    (tmp_path / "table.toml").write_text(toml_text(table | {"coupling": {"damping": 1e4, "mass": 5.0, "drag": 150.0}}))
    done = vctune("check", "table.toml", cwd=tmp_path)
    assert "operator.stiffness.max = 50000" in done.stdout + done.stderr and "virtual" in done.stdout + done.stderr


def test_a_first_step_beyond_the_acceleration_of_the_servo_is_told(tmp_path):
    for most, told in ((0.1, True), (10.0, False)):
        device = ARM["device"] | {"servo": ARM["device"]["servo"] | {"max_acceleration": most}}
        law = {"rule": "euler", "mass": 6.0, "drag": 150.0}
        (tmp_path / "arm.toml").write_text(toml_text(ARM | {"device": device, "coupling": law}))
        done = vctune("check", "arm.toml", cwd=tmp_path)
        assert ("max_acceleration" in done.stdout + done.stderr) == told


@pytest.mark.parametrize("law", [{"rule": "euler", "mass": 6.0, "drag": 150.0}, {"mass": 6.0, "drag": 150.0}])
@pytest.mark.parametrize("filtered", [False, True])
def test_the_noise_of_the_sensor_is_that_of_a_long_run(law, filtered):
    """noise_speed and noise_acceleration: the law stepped with white noise, as the firmware steps it."""
    T, noise, a = ARM["device"]["sample_time"], 0.2, 0.3 if filtered else 1.0
    sensor = {"noise": noise} | ({"filter_coefficient": a} if filtered else {})
    rigid = law | ({} if "rule" in law else {"damping": inf})
    felt = check(ARM | {"device": ARM["device"] | {"force_sensor": sensor}, "coupling": rigid}).finding.record()["felt"]
    force, rng = 0.0, np.random.default_rng(1)
    M, D, v, last, run = law["mass"], law["drag"], 0.0, 0.0, []
    for sample in rng.normal(scale=noise, size=200_000):
        force += a * (sample - force)
        if "rule" in law:
            v += T / M * (force - D * v)
        else:  # M v' + D v = F by the trapezoidal rule
            v, last = ((M / T - D / 2) * v + (force + last) / 2) / (M / T + D / 2), force
        run.append(v)
    assert felt["noise_speed"] == pytest.approx(np.std(run), rel=0.05)
    assert felt["noise_acceleration"] == pytest.approx(np.std(np.diff(run)) / T, rel=0.02)


def test_a_free_mass_keeps_to_the_acceleration_of_the_servo():
    """1/M of the law by Euler's rule is what 1 N from rest commands in its first sample."""
    servo = ARM["device"]["servo"]
    heavy = {"tool": {"mass": 5.0}, "operator": {"stiffness": {"max": 300.0}}, "coupling": {"rule": "euler"}}
    for limit in (0.2, 5.0):
        device = ARM["device"] | {"servo": servo | {"max_acceleration": limit}}
        found = solve(ARM | heavy | {"device": device}).judgement
        assert found.status is Status.CERTIFIED and 1 / found.coupling.mass <= limit * (1 + 1e-9)
