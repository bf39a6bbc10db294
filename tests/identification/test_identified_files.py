"""What `vctune identify` writes: the reader of problem files takes it, and it says what is assumed and what is left."""

from __future__ import annotations

import re
import resource
from functools import cache

import numpy as np
import pytest
from command import peak_memory, run
from conftest import drawn
from identification_logs import Log, driven, encoded, multisine, random_case, spoiled

from vctune import check, identify, solve
from vctune.design.check import CheckVerdict
from vctune.document.reading import read_problem
from vctune.document.records.identification_json import Estimate
from vctune.document.text.errors import InputError
from vctune.identification.box import box, readable
from vctune.model.device import Device
from vctune.model.experiment import Friction, MovingHand

T = 1e-3
DEVICE = Device(0.5, 2.0, T, 7e-4)
FRICTION = Friction(0.05, 0.05, 0.005, 1e5, 200.0)
LINES = np.unique(np.round(np.geomspace(4, 120, 30))).astype(int)


@pytest.fixture(scope="module")
def repeated():
    """Eight periods of a multisine, the command held between the samples of the log."""
    wave = 3.0 * multisine(np.random.default_rng(4), LINES, 512, 8, T)
    recorded, time = driven(DEVICE, FRICTION, wave), np.arange(wave.size) * T
    return {"time_s": time, "position_m": encoded(recorded["position"], 1e-8), "command_N": recorded["motor"]}


@pytest.fixture(scope="module")
def held(repeated, tmp_path_factory):
    """The device from that log, whose force is of no stated kind."""
    return identified(repeated, tmp_path_factory.mktemp("held"))


@pytest.fixture(scope="module")
def moved():
    """Four seconds of a slow motion."""
    time = np.arange(4000) * T
    recorded = driven(DEVICE, FRICTION, 3.0 * np.sin(11 * time + 2 * np.sin(0.7 * time)))
    return {"time_s": time, "position_m": encoded(recorded["position"], 1e-6), "command_N": recorded["motor"]}


@pytest.fixture(scope="module")
def told(moved, tmp_path_factory):
    """What is found of that motion with one file or another beside the log."""
    return cache(lambda text: identified(moved, tmp_path_factory.mktemp("moved"), text))


def identified(columns, folder, text="", name="log"):
    return identify(*Log(columns, text).write(folder, name))


@pytest.mark.parametrize("noise", [1e-6, 5e-6])
def test_what_is_left_of_a_log_is_its_noise(noise, tmp_path):
    """Its chi2 is 1, and its share of the motion that of the noise, without the drift that segments take away."""
    wave = 3.0 * multisine(np.random.default_rng(4), LINES, 512, 8, T)
    moved, time = driven(DEVICE, None, wave), np.arange(wave.size) * T
    read = moved["position"] + noise * np.random.default_rng(1).normal(size=time.size)
    columns = {"time_s": time, "position_m": read, "command_N": moved["motor"]}
    (recording,) = identified(columns, tmp_path).record.recordings
    assert recording.chi2 == pytest.approx(1.0, abs=0.2)
    assert 1 < recording.residual_share * moved["position"].std() / noise < 3
    assert recording.samples == wave.size >= recording.used > 0.9 * wave.size
    assert recording.sample_time == pytest.approx(T)


def coded(said, code):
    return [line for line in said if line.endswith(f"[{code}]")]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "source", "assumed"),
    [
        ("", "difference", True),
        ("[device.velocity]\nfilter_hz = 90.0\n", "difference", True),
        ('[device.velocity]\nfrom = "measured"\n', "measured", False),
    ],
)
def test_the_file_says_how_the_velocity_is_known(told, text, source, assumed):
    found = told(text)
    estimate = found.file.problem.device.velocity
    assert (estimate.source if estimate else "measured") == source
    assert bool(coded(found.record.remarks, "remark-assumed-velocity")) == assumed
    (line,) = [line for line in found.text.splitlines() if line.startswith("velocity = ")]
    assert ("# assumed" in line) == assumed


@pytest.mark.slow
def test_much_that_is_left_is_a_warning_in_the_terminal_and_in_the_file(moved, tmp_path):
    time = moved["time_s"]
    Log(moved | {"command_N": moved["command_N"] + 0.6 * np.sin(5.0 * time)}, "").write(tmp_path)
    done = run("identify", "log.csv", "--no-report", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert re.search(r"^warning: log.csv: .*\[warn-residual]$", done.stdout, re.MULTILINE)
    assert "\n# warning: log.csv: " in (tmp_path / "results/log/device.toml").read_text()


@pytest.mark.slow
def test_a_copy_of_the_command_is_no_actuator(repeated, tmp_path):
    """Between two columns that are one there is no lag: none is in the file, where its bandwidth would be refused."""
    found = identified(repeated | {"force_N": repeated["command_N"]}, tmp_path)
    assert found.found.device.actuator is None
    assert found.file.problem.device.actuator is None


@pytest.mark.night
def test_an_identified_file_is_accepted(tmp_path):
    """A log may be refused; what is written is not, whatever the log is like."""
    written = 0
    for seed in range(drawn(200)):
        try:
            found = identify(*spoiled(random_case(seed), seed).write(tmp_path))
        except InputError as error:
            assert error.source != "device.toml", seed
        else:
            written += 1
            assert found.file.problem.name == "log"
    assert written >= drawn(200) / 4


@pytest.mark.slow
@pytest.mark.parametrize("sample_time", [2e-6, 0.04])
def test_a_very_fast_or_slow_log_gives_an_experiment_that_is_accepted(moved, sample_time, tmp_path):
    slower, weaker = sample_time / T, min(1.0, 2 * T / sample_time**2 * 1e-3)
    scaled = moved | {
        "time_s": moved["time_s"] * slower,
        "position_m": moved["position_m"] * slower**2 * weaker,
        "command_N": moved["command_N"] * weaker,
    }
    found = identified(scaled, tmp_path, name="x" * 240)
    assert found.file.problem.experiments and found.file.problem.name == "x" * 200


def estimates(**values):
    return [Estimate(key.replace("handle", "structure.handle_"), *each, "log") for key, each in values.items()]


@pytest.mark.slow
def test_a_handle_is_lighter_than_its_device(told):
    recording = told("").found.studies[0].recording
    bounds = box(estimates(mass=(0.1, 1e-4), handlemass=(0.09, 0.005), delay=(T, 1e-5)), T)
    mass, handle, _ = readable(bounds, recording, T)
    assert bounds[1].high > mass.low > handle.high > 0.99 * mass.low and handle.low == bounds[1].low
    assert handle.limit.endswith("lighter than the device [limit-handle]")
    with pytest.raises(InputError, match="is not told from the device's"):
        readable(box(estimates(mass=(0.1, 1e-2), handlemass=(0.09, 0.03), delay=(T, 1e-5)), T), recording, T)


def test_a_damping_that_comes_out_negative_may_be_nothing_and_as_much():
    (damping,) = box(estimates(damping=(-2.0, 0.1)), T)
    assert (damping.low, damping.high) == (0.0, 2.0)


@pytest.mark.night
@pytest.mark.parametrize("friction", [0.0, 0.75])
def test_two_million_rows_take_a_minute_and_600_megabytes(tmp_path, friction):
    """Processor time and peak memory of the whole command, with its report."""
    wave = np.tile(np.sin(11 * np.arange(100_000) * T) + np.sin(2.7 * np.arange(100_000) * T), 20)
    v, x, force = np.zeros(wave.size), 0.0, 3.0 * wave
    drag, motion = 2.0 / 0.4, 0.0
    for i, push in enumerate(force):
        v[i] = motion
        motion += T * (push / 0.4 - drag * motion - friction * np.tanh(motion / 1e-3))
    x = encoded(np.concatenate([[0.0], np.cumsum(T * (v[1:] + v[:-1]) / 2)]), 1e-6)
    with (tmp_path / "log.csv").open("w") as file:
        file.write("time_s,position_m,command_N\n")
        for first in range(0, wave.size, 100_000):
            rows = slice(first, first + 100_000)
            np.savetxt(
                file, np.column_stack([np.arange(wave.size)[rows] * T, x[rows], force[rows]]), "%.9g", delimiter=","
            )
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    peak = peak_memory("identify", "log.csv", "--quiet", cwd=tmp_path)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < 60
    assert peak < 600_000


@pytest.mark.slow
def test_what_is_solved_for_a_differenced_velocity_passes_its_check(held):
    found = held
    solved = solve(found.file)
    checked = check(found.file.problem, solved.judgement.gains, solved.judgement.coupling)
    assert checked.result is CheckVerdict.PASSED


@pytest.mark.slow
def test_a_force_that_no_noise_explains_is_refused(moved, tmp_path):
    """A force of the position that is no spring, as of a pendulum that turns over, pulls the mass out of its box."""
    pull = moved["command_N"].std() * np.sin(moved["position_m"] / moved["position_m"].std() * 3.0)
    Log(moved | {"command_N": moved["command_N"] + pull}, "").write(tmp_path)
    done = run("identify", "log.csv", "--no-report", cwd=tmp_path)
    assert done.returncode == 2 and "[log-unexplained]" in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(("display", "code"), [("admittance", 2), ("impedance", 0)])
def test_a_spring_is_refused_unless_it_acts_as_a_hand_does(moved, tmp_path, display, code):
    """The motor's force of another log pushes the device on a spring, which is a hand that nothing senses."""
    spring = MovingHand("reciprocate", 0.0, 1e-12, 1e-12, 1, mass=0.0, damping=0.0, stiffness=300.0)
    recorded = driven(DEVICE, FRICTION, moved["command_N"], hand=spring)
    pulled = moved | {"position_m": encoded(recorded["position"], 1e-8), "command_N": recorded["motor"]}
    Log(pulled, f'[device]\ndisplay = "{display}"\n').write(tmp_path)
    done = run("identify", "log.csv", "--config", "log.toml", "--no-report", cwd=tmp_path)
    assert done.returncode == code and "follows the position by about 3e+02 N/m" in done.stdout + done.stderr
    if code == 0:
        found = read_problem(next(tmp_path.rglob("device.toml"))).problem
        assert found.device.display == "impedance" and found.device.mass == pytest.approx(DEVICE.mass, rel=0.01)


@pytest.mark.slow
def test_a_log_slower_than_its_loop_holds_the_delay_within_a_row(moved, repeated, tmp_path):
    """Every third row: the command that the fit holds from row to row is older than the one that moved the device."""
    sparse = {name: values[::3] for name, values in moved.items()}
    found = identified(sparse, tmp_path, f"sample_time = {T}\n").found
    mass, delay = found.bounded("mass"), found.bounded("delay")
    assert found.device.sample_time == T and coded(found.record.remarks, "remark-slow-log")
    said = str(found.record.remarks)
    assert f"the loop runs every {T:g} s and the log has a row every {3 * T:g} s" in said
    assert mass.low <= DEVICE.mass <= mass.high and delay.low <= DEVICE.delay <= delay.high and delay.high >= 2 * T
    with pytest.raises(InputError, match="too fast"):  # a command that moves between the rows
        identified({name: values[::3] for name, values in repeated.items()}, tmp_path, f"sample_time = {T}\n")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "lag_in_delay"),
    [("", True), ("[device]\ndelay = 7e-4\n", False), ("[device.actuator]\nbandwidth_hz = 200.0\n", False)],
)
def test_a_motion_shows_no_high_frequency_nor_what_of_a_delay_is_a_lag(told, text, lag_in_delay):
    remarks = told(text).record.remarks
    assert bool(coded(remarks, "remark-actuator-lag")) == lag_in_delay
    assert bool(coded(remarks, "remark-slow-motion")) != bool(coded(remarks, "remark-highest-line"))


@pytest.mark.slow
@pytest.mark.parametrize(("share", "weak"), [(0.51, True), (0.49, False)])
def test_a_delay_is_weak_if_its_interval_is_wider_than_its_middle(told, share, weak):
    text = f"[device]\ndelay = 7e-4\ndelay_uncertainty = {share * 7e-4}\n"
    assert bool(coded(told(text).record.remarks, "remark-weak-delay")) == weak


@pytest.mark.slow
def test_a_multisine_shows_nothing_above_its_highest_line(held):
    (line,) = coded(held.record.remarks, "remark-highest-line")
    (highest,) = re.findall(r"above (\S+) Hz", line)
    assert float(highest) == pytest.approx(LINES[-1] / (512 * T), rel=0.1)
    assert not coded(held.record.remarks, "remark-slow-motion")
