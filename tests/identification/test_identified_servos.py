"""Simulated servos, identified: the truth is in the box, the file is solved, and what a log does not tell is said."""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from command import run
from conftest import drawn, mostly_slow
from jsonschema import Draft202012Validator
from servo_logs import limited_case, mildly_limited_case, moved, robot_case, servo_case

from vctune import check, identify, problem, solve
from vctune.api.json_schemas import SCHEMAS
from vctune.design.check import CheckVerdict
from vctune.document.text.errors import ENDING, InputError

SERVO = {"T": 4e-3, "late": 3.4, "order": 1, "bandwidth": 12.0, "command": "velocity", "jitter": 0.0}
MANY = range(drawn(75))


@dataclass(frozen=True)
class Trial:
    """One servo: whether delay, bandwidth and order are in the file, and the half-width of the delay over T."""

    kind: str
    inside: bool
    half_width: float


def trial(case, folder) -> Trial:
    identified = identify(case.write(folder), servo=True)
    found, unknown = identified.found, "remark-order" in codes(identified.record.remarks)
    delay, bandwidth = (found.bounded(f"servo.{name}") for name in ("delay", "bandwidth_hz"))
    inside = delay.low <= case.delay <= delay.high and bandwidth.low <= case.bandwidth_hz <= bandwidth.high
    order = found.device.servo.order == case.order or unknown
    return Trial(case.kind, inside and order, (delay.high - delay.low) / 2 / case.T)


def tables(case, coupling):
    """Return the true servo with a coupling as a problem."""
    servo = {"delay": case.delay, "bandwidth_hz": case.bandwidth_hz, "order": case.order, "command": case.command}
    numbers = {name: float(getattr(coupling, name)) for name in ("damping", "mass", "drag")}
    return {"device": {"sample_time": case.T, "servo": servo}, "coupling": numbers}


def certified_for_the_truth(case, folder) -> bool:
    solved = solve(identify(case.write(folder), servo=True).file)
    return check(problem(tables(case, solved.judgement.coupling))).result is CheckVerdict.PASSED


def codes(said):
    return {line.rpartition(" [")[2].rstrip("]") for line in said}


def number(identified, name):
    return next(each.value for each in identified.record.recordings[0].numbers if each.name == name)


@pytest.mark.parametrize("seed", [2, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (0, 9, 76))])
def test_a_simulated_servo_is_in_its_box(seed, tmp_path):
    found = trial(servo_case(seed, n=2500), tmp_path)
    assert found.inside
    assert found.half_width <= 0.25 or found.kind != "sweep"


@pytest.mark.night
def test_nineteen_of_twenty_servos_are_in_their_boxes(tmp_path):
    trials = [trial(servo_case(seed), tmp_path) for seed in MANY]
    assert np.mean([each.inside for each in trials]) >= 0.95
    assert max(each.half_width for each in trials if each.kind == "sweep") <= 0.25


@pytest.mark.night
def test_nineteen_of_twenty_slow_motions_have_the_servo_in_their_boxes(tmp_path):
    assert np.mean([trial(servo_case(seed, kind="slow"), tmp_path).inside for seed in MANY[: drawn(40)]]) >= 0.95


def off(case, identified):
    """Return by how many widths of their intervals delay and bandwidth are outside."""
    known = {"servo.delay": case.delay, "servo.bandwidth_hz": case.bandwidth_hz}
    return [
        max(each.low - known[each.key], known[each.key] - each.high, 0.0) / (each.high - each.low)
        for each in identified.record.numbers
    ]


@pytest.mark.parametrize("seed", [9, 24, 49, 58])
def test_a_robot_whose_columns_are_rounded_is_in_its_box(seed, tmp_path):
    """Position or velocity read, stamps that jitter; a command of few counts a row is refused with its quantum."""
    case = robot_case(seed)
    if seed == 9:
        with pytest.raises(InputError, match=r"position_command_m: is rounded to 0\.00068 m, of which it moves few"):
            identify(case.write(tmp_path), servo=True)
        return
    assert not any(off(case, identify(case.write(tmp_path), servo=True)))


@pytest.mark.slow
def test_robots_whose_columns_are_rounded_are_in_their_boxes(tmp_path):
    """Of the numbers 98 of 100 are inside and none is off by its interval's width; one log in five is refused at most,
    each for its rounding."""
    widths, causes = list[float](), list[str]()
    for seed in range(drawn(60)):
        try:
            case = robot_case(seed)
            widths += off(case, identify(case.write(tmp_path), servo=True))
        except InputError as error:
            causes.append(str(error))
    assert sum(width == 0 for width in widths) >= 0.98 * len(widths) and max(widths) <= 1.0
    assert len(causes) <= 0.2 * drawn(60) and all("is rounded to" in each for each in causes)


@pytest.mark.slow
def test_a_design_for_the_box_is_certified_for_the_truth(tmp_path):
    slow = SERVO | {"T": 8e-3, "late": 1.0, "order": 2, "bandwidth": 1.4}
    assert certified_for_the_truth(servo_case(0, n=1500, **slow), tmp_path)


@pytest.mark.night
def test_designs_for_nineteen_of_twenty_boxes_are_certified_for_the_truth(tmp_path):
    cases = [each for each in map(servo_case, MANY) if each.kind == "sweep"][: drawn(25)]
    assert np.mean([certified_for_the_truth(case, tmp_path) for case in cases]) >= 0.95


def test_a_slow_motion_shows_a_latency_and_no_bandwidth(tmp_path):
    case = servo_case(1, kind="slow", n=1500, **SERVO)
    quantum = 1e-3
    position = quantum * np.floor(case.columns["position_m"] / quantum + 0.5)
    identified = identify(case.write(tmp_path, position_m=position), servo=True)
    found, record = identified.found, identified.record
    assert {"remark-latency-only", "remark-order"} <= codes(record.remarks)
    delay, bandwidth = (found.bounded(f"servo.{name}") for name in ("delay", "bandwidth_hz"))
    assert delay.low <= case.delay <= delay.high and bandwidth.low <= case.bandwidth_hz <= bandwidth.high
    latency = case.delay + 1 / (2 * np.pi * case.bandwidth_hz)
    (hold_aside,) = record.recordings[0].derived
    assert hold_aside.value == pytest.approx(latency, abs=0.3 * case.T)
    assert bandwidth.high > 100 * bandwidth.low
    assert max(radius for hertz, radius in record.unmodelled if hertz > 0.1 / case.T) > 0.3  # the other order


@pytest.mark.slow
def test_jitter_of_the_link_widens_the_delay(tmp_path):
    calm, hasty = (
        identify(servo_case(2, n=2500, **(SERVO | {"jitter": jitter})).write(tmp_path), servo=True)
        for jitter in (0.0, 0.4)
    )
    delays = [each.found.bounded("servo.delay") for each in (calm, hasty)]
    assert delays[0].high - delays[0].low < delays[1].high - delays[1].low < 0.5 * SERVO["T"]
    assert number(hasty, "jitter of the delay") == pytest.approx(0.4 * SERVO["T"] / np.sqrt(12), rel=0.3)
    assert "remark-jitter" in codes(hasty.record.remarks) - codes(calm.record.remarks)


@pytest.mark.slow
def test_steps_of_the_clock_may_jitter(tmp_path):
    case, random = servo_case(3, n=2000, **SERVO), np.random.default_rng(3)
    time = case.columns["time_s"] + 0.25 * case.T * random.uniform(-1, 1, 2000)
    velocity = case.columns["velocity_command_m_s"]
    position = moved(time, velocity, time + case.delay, case.bandwidth_hz, case.order)
    path = case.write(tmp_path, time_s=time, position_m=np.round(position, 6))
    found = identify(path, servo=True).found
    for key, truth in (("servo.delay", case.delay), ("servo.bandwidth_hz", case.bandwidth_hz)):
        assert found.bounded(key).low <= truth <= found.bounded(key).high


@pytest.mark.slow
def test_a_servo_that_yields_is_outside_the_model(tmp_path):
    case, random = servo_case(4, n=1200, **SERVO), np.random.default_rng(4)
    force = 10 * np.convolve(random.normal(size=1200), np.ones(40) / 40, "same")
    stiff = identify(case.write(tmp_path, hand_N=force), servo=True)
    assert stiff.record.warnings == [] and "remark-unpushed" not in codes(stiff.record.remarks)
    position = case.columns["position_m"] + 2e-4 * force
    soft = identify(case.write(tmp_path, force_N=force, position_m=position), servo=True)
    assert number(soft, "compliance, m/N") == pytest.approx(2e-4, rel=0.05)
    assert "warn-yields" in codes(soft.record.warnings)
    assert "outside the model" in soft.text


@pytest.mark.parametrize(
    ("times", "warned"),
    [pytest.param(1.0, False, marks=pytest.mark.slow), (1.03, True), pytest.param(0.97, True, marks=pytest.mark.slow)],
)
def test_a_servo_that_moves_farther_than_it_is_told_is_warned_of(tmp_path: Path, times: float, warned: bool) -> None:
    """Or less far; not one that follows, with the same noise."""
    case = servo_case(8, n=500, **SERVO)
    found = identify(case.write(tmp_path, position_m=times * case.columns["position_m"]), servo=True)
    assert ("warn-gain" in codes(found.record.warnings)) is warned
    assert number(found, "motion over command") == pytest.approx(times, abs=5e-3)


def test_what_is_written_is_a_problem_a_record_and_a_report(tmp_path):
    case = servo_case(5, n=1500, **(SERVO | {"command": "position", "order": 2}))
    case.write(tmp_path)
    done = run("identify", "--servo", "servo.csv", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    folder = tmp_path / "results/servo"
    assert {path.name for path in folder.iterdir()} == {
        "device.toml", "identification.json", "report.html", "identified.svg"
    }  # fmt: skip
    record = json.loads((folder / "identification.json").read_text())
    Draft202012Validator(SCHEMAS["identification"]()).validate(record)
    stated = tomllib.loads((folder / "device.toml").read_text())
    assert stated["device"]["servo"] == record["device"]["servo"]
    assert stated["device"]["servo"]["command"] == "position" and stated["device"]["servo"]["order"] == 2
    assert set(stated["uncertainty"]) == {"servo.delay", "servo.bandwidth_hz", "unmodelled"}
    for line in record["remarks"]:
        assert line in done.stdout and line in (folder / "device.toml").read_text()
    assert any(line.endswith("[remark-highest-line]") for line in record["remarks"])
    assert [each["chosen"] for each in record["recordings"][0]["candidates"]] == [True, False]


@pytest.mark.slow
def test_two_logs_and_other_headers(tmp_path):
    case, other = servo_case(6, n=1500, **SERVO), servo_case(7, kind="steps", n=1500, **SERVO)
    paths = []
    for name, each in (("one.csv", case), ("two.csv", other)):
        named = {"t": each.columns["time_s"], "v": each.columns["velocity_command_m_s"]}
        paths.append(tmp_path / name)
        rows = np.column_stack([*named.values(), 1e3 * each.columns["position_m"]])
        np.savetxt(paths[-1], rows, delimiter=",", header="t,v,x_mm", comments="", fmt="%.12g")
    config = tmp_path / "log.toml"
    config.write_text(
        '[columns]\ntime = { column = "t", unit = "s" }\nposition = "x_mm"\n'
        'velocity_command = { column = "v", unit = "m/s" }\n[device.force_sensor]\nbandwidth_hz = 30.0\n'
    )
    identified = identify(paths, config, servo=True)
    assert len(identified.found.bounded("servo.delay").estimates) == 2
    assert identified.file.problem.device.force_sensor.bandwidth_hz == 30.0
    assert "remark-assumed-sensor" not in codes(identified.record.remarks)


def test_a_rotary_servo_has_hands_so_that_it_can_be_solved(tmp_path):
    case = servo_case(8, n=1500, **SERVO)
    columns = {
        "time_s": case.columns["time_s"],
        "velocity_command_rad_s": case.columns["velocity_command_m_s"],
        "position_rad": case.columns["position_m"],
    }
    np.savetxt(
        tmp_path / "wrist.csv", np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns),
        comments="", fmt="%.12g",
    )  # fmt: skip
    (tmp_path / "log.toml").write_text("rotary = true\n")
    identified = identify(tmp_path / "wrist.csv", tmp_path / "log.toml", servo=True)
    assert identified.file.problem.device.units == "rotary"
    assert "# assumed: vctune's hand, 0.1 m from the axis" in identified.text


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: {"position_m": 1e3 * c["position_m"]}, "moves at up to"),
        (lambda c: {"position_m": 10 * c["position_m"]}, "position_m moves 10 times as far as velocity_command_m_s"),
        (lambda c: {"position_m": -c["position_m"]}, "position_m moves against velocity_command_m_s; turn one sign"),
        (lambda c: {"position_m": c["position_m"][::-1]}, "of the motion of position_m does not follow velocity"),
        (lambda c: {"position_command_m": c["position_m"]}, "a servo is sent a velocity or a position, and"),
        (lambda c: {"velocity_command_m_s": 1e4 * c["velocity_command_m_s"]}, "velocity_command_m_s: reaches"),
    ],
)
def test_a_log_that_is_of_no_servo_is_refused(change, message, tmp_path):
    case = servo_case(9, n=1000, **SERVO)
    with pytest.raises(InputError, match=message):
        identify(case.write(tmp_path, **change(case.columns)), servo=True)


def told(position, command):
    """A log of a servo as CSV, with times of 10 ms."""
    rows = (f"{0.01 * k:.2f},{x:.6f},{y:.6f}" for k, (x, y) in enumerate(zip(position, command, strict=True)))
    return "time_s,position_m,position_command_m\n" + "\n".join(rows) + "\n"


@pytest.mark.parametrize("number", mostly_slow(range(6), [0]))
def test_a_log_whose_command_is_not_of_its_motion_is_refused_without_a_word_of_numpy(tmp_path, number):
    """Moved before the command, long after it, at its end, by another command, or ahead of it."""
    rng, n = np.random.default_rng(number), 600
    bump = np.convolve(rng.normal(0, 0.01, 200).cumsum(), np.ones(20) / 20, "same")
    bump -= np.linspace(bump[0], bump[-1], bump.size)
    late, early = np.zeros(n), np.zeros(n)
    early[20:220], late[380:580] = bump, bump
    still, at_end = np.zeros(n), np.zeros(n)
    at_end[-3:] = 0.1
    position, command = (
        (early, late), (late, early), (late, at_end), (late, np.roll(early[::-1], 7)),
        (early, still + 1e-3 * (np.arange(n) == 300)), (np.roll(late, -5), late),
    )[number]  # fmt: skip
    (tmp_path / "log.csv").write_text(told(position, command))
    done = run("identify", "log.csv", "--servo", "--no-report", cwd=tmp_path)
    if done.returncode == 0:  # late by seconds, and followed all the same
        assert number == 1
    else:
        assert done.returncode == 2 and ENDING.search(done.stderr.strip()), done.stderr
    assert "Warning" not in done.stderr and "Error" not in done.stderr


@pytest.mark.slow
def test_a_slow_motion_ahead_of_its_command_is_refused_although_a_lag_and_a_delay_are_alike_in_it(tmp_path):
    """A low-pass and a more negative delay explain it as well; their sum, the latency, is negative in any case."""
    time = 0.008 * np.arange(700)
    command = np.cumsum(0.0032 * np.clip((time - 2.02) / 0.04, 0.0, 1.0) * (time < 4.02))
    overshoot = 0.004 * np.exp(-(((time - 4.06) / 0.05) ** 2))
    ahead = np.append(command[2:], command[-2:]) + overshoot  # by two rows
    rows = (f"{t:.3f},{x:.6f},{y:.6f}" for t, x, y in zip(time, ahead, command, strict=True))
    (tmp_path / "log.csv").write_text("time_s,position_m,position_command_m\n" + "\n".join(rows) + "\n")
    done = run("identify", "log.csv", "--servo", "--no-report", cwd=tmp_path)
    assert done.returncode == 2 and "before position_command_m tells it to" in done.stderr, done.stderr


LIMITS = [
    ({"speed": 0.4}, "speed"),
    ({"acceleration": 0.3}, "acceleration"),
    ({"speed": 0.6, "acceleration": 0.5}, "speed"),
]


@pytest.mark.parametrize(("limits", "word"), LIMITS)
@pytest.mark.parametrize("seed", mostly_slow(range(4), [0]))
def test_a_robot_at_a_limit_is_refused_with_its_value(tmp_path, seed, limits, word):
    case = limited_case(seed, **limits)
    told = case.columns["velocity_command_m_s"]
    greatest = {"speed": np.abs(told).max(), "acceleration": np.abs(np.diff(told)).max() / case.T}[word] * limits[word]
    with pytest.raises(InputError, match="saturates in") as caught:
        identify(case.write(tmp_path), servo=True)
    value = float(re.search(rf"in {word}, at about (\S+) m/s", str(caught.value))[1])
    assert value == pytest.approx(greatest, rel=0.15)


def test_a_robot_below_its_limits_is_not(tmp_path):
    assert trial(limited_case(1, speed=1.2, acceleration=1.2), tmp_path).inside


def told_limits(case, folder):
    """Return the words of the limits with which a log is refused, and whether its box holds the truth if it is not."""
    try:
        found = identify(case.write(folder), servo=True).found
    except InputError as error:
        return re.findall(r"in (speed|acceleration), at about", str(error)), False
    delay, bandwidth = (found.bounded(f"servo.{name}") for name in ("delay", "bandwidth_hz"))
    inside = delay.low <= case.delay <= delay.high and bandwidth.low <= case.bandwidth_hz <= bandwidth.high
    return [], inside


@pytest.mark.parametrize("limited", ["speed", "acceleration"])
def test_a_mild_limit_of_a_servo_of_either_order_is_told_or_does_no_harm(tmp_path, limited):
    """At 30 to 90 % of the greatest value: refused with the right word, or the box holds the truth."""
    right, harmless, seeds = 0, 0, range(drawn(30) // 3)
    for seed in seeds:
        words, inside = told_limits(mildly_limited_case(seed, limited=limited), tmp_path)
        right += words == [limited]
        harmless += inside
    assert right + harmless == len(seeds) and right >= 0.8 * len(seeds)


def test_a_robot_without_a_limit_is_refused_for_none(tmp_path):
    """Nor one whose link jitters, or that moves less far than it is told."""
    for seed in range(max(drawn(12) // 3, 1)):
        case = mildly_limited_case(seed, limited=None)
        shorter = {"position_m": 0.9 * case.columns["position_m"]}
        assert told_limits(case, tmp_path)[0] == []
        assert told_limits(replace(case, columns=case.columns | shorter), tmp_path)[0] == []
        hasty = servo_case(seed, n=900, **(SERVO | {"jitter": 0.6}))
        assert told_limits(hasty, tmp_path)[0] == []


def test_swapped_columns_of_a_robot_are_named(tmp_path):
    case = limited_case(2)
    names = "velocity_command_m_s", "position_m"
    swapped = dict(zip(names, (case.columns[name] for name in reversed(names)), strict=True))
    with pytest.raises(InputError, match="are the two columns swapped"):
        identify(case.write(tmp_path, **swapped), servo=True)
