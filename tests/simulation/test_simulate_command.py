"""`vctune simulate` as its users meet it, and its measures on closed forms."""

from __future__ import annotations

import json
import shutil
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command import peak_memory, started, strict, wait_for_work, wait_until, without_progress
from command import run as vctune
from conftest import DEVICE, FIXED, ROOT, drawn, for_passive_hands, mostly_slow

from vctune.exit_codes import ExitCode
from vctune.model.device import Device
from vctune.model.experiment import Environment, Experiment, Friction, MovingHand, Sensors
from vctune.model.gains import Coupling, Gains
from vctune.model.parts import VelocityEstimate
from vctune.simulation.metrics import metrics
from vctune.simulation.run import Traces, run
from vctune.simulation.scene import designed_scene, intended_motion, sample_count

EXPERIMENTS = """
[[experiment]]
name = "spring"
environment = { stiffness = 200.0 }
operator = { to = 0.005, cycles = 2 }
friction = { coulomb = 0.3, stiction = 0.4 }
baseline = { kp = 2000.0, kd = 20.0, mass = 1.0, damping = 20.0 }
[[experiment]]
name = "free"
operator = { to = 0.005, cycles = 2, motion = "sine" }
"""
HELD = FIXED.format(160.0)
HAND = MovingHand("reciprocate", 0.0, 0.05, 0.1, 3, 0.0, 2.0, 1000.0)


@pytest.fixture
def problem(tmp_path):
    path = tmp_path / "device.toml"
    path.write_text(for_passive_hands(DEVICE + HELD + EXPERIMENTS))
    return path


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """What `vctune simulate` made of the problem, once: the finished process and its folder."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "device.toml").write_text(for_passive_hands(DEVICE + HELD + EXPERIMENTS))
    return vctune("simulate", "device.toml", cwd=folder), folder


@pytest.fixture
def again(made, tmp_path):
    """A copy of that folder, to go on from."""
    shutil.copytree(made[1], tmp_path, dirs_exist_ok=True)
    return tmp_path


def test_it_solves_simulates_and_reports(made):
    done, place = made
    assert (done.returncode, done.stderr) == (ExitCode.OK, "")
    for part in ("spring", "free", "regular PID", "this design", "N/m", "written to"):
        assert part in done.stdout
    folder = place / "results/device"
    written = {path.name for path in folder.iterdir()}
    assert {"gains.toml", "design.json", "simulation.json", "traces.npz", "simulation.svg", "report.html"} <= written
    record = strict((folder / "simulation.json").read_text())
    assert record["schema"] == "vctune/simulation/1"
    assert [one["name"] for one in record["experiments"]] == ["spring", "free"]
    html = (folder / "report.html").read_text()
    assert 'id="figure-simulation"' in html and len(html.encode()) < 1_000_000
    with np.load(folder / "traces.npz") as traces:
        assert {"spring/baseline/force", "spring/design/force", "free/design/time"} <= set(traces.files)
        assert "free/baseline/time" not in traces.files
        assert len(traces["spring/design/force"]) == record["experiments"][0]["samples"]


@pytest.mark.slow
def test_reports_with_experiments_are_made_again_to_the_byte(again):
    folder = again / "results/device"
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert vctune("report", folder / "design.json", cwd=again).returncode == 0
    assert (folder / "report.html").read_bytes() == before["report.html"]
    vctune("simulate", "device.toml", folder / "gains.toml", cwd=again)
    for name in ("simulation.json", "traces.npz", "simulation.svg", "report.html"):
        assert (folder / name).read_bytes() == before[name], name


def test_a_design_that_is_there_is_simulated_and_stays(again):
    """To the last byte, with a bound that took long; one of another version of the problem stays too."""
    folder = again / "results/device"
    mine = (folder / "gains.toml").read_text().replace("velocity = 150.0", "velocity = 149.0")
    (again / "mine.toml").write_text(mine)
    (record,) = strict(vctune("check", "device.toml", "mine.toml", "--json", cwd=again).stdout)
    text = json.dumps(record)
    (folder / "design.json").write_text(text)
    assert vctune("simulate", "device.toml", cwd=again).returncode == 0
    assert (folder / "design.json").read_text() == text
    assert strict((folder / "simulation.json").read_text())["gains"]["velocity"] == 149.0
    (again / "device.toml").write_text((again / "device.toml").read_text().replace("mass = 0.4", "mass = 0.41"))
    assert vctune("simulate", "device.toml", cwd=again).returncode == 0
    assert (folder / "design.json").read_text() == text
    assert strict((folder / "simulation.json").read_text())["gains"]["velocity"] == 150.0


def test_another_design_does_not_show_the_experiments(again):
    """A report shows a simulation only of its own gains; a simulation of other gains leaves the report alone."""
    folder = again / "results/device"
    before = (folder / "report.html").read_bytes()
    mine = again / "mine.toml"
    mine.write_text((folder / "gains.toml").read_text().replace("velocity = 150.0", "velocity = 140.0"))
    assert vctune("simulate", "device.toml", mine, cwd=again).returncode == 0
    assert (folder / "report.html").read_bytes() == before
    assert strict((folder / "simulation.json").read_text())["gains"]["velocity"] == 140.0
    vctune("report", folder / "design.json", cwd=again)
    assert b'id="figure-simulation"' not in (folder / "report.html").read_bytes()
    assert not (folder / "simulation.svg").exists()


@pytest.mark.parametrize("part", mostly_slow(["loop", "curve", "metrics"], ["loop"]))
def test_a_damaged_simulation_is_refused(again, part):
    path = again / "results/device/simulation.json"
    record = strict(path.read_text())
    del record["experiments"][0]["design"][part]
    path.write_text(json.dumps(record))
    before = path.with_name("report.html").read_bytes()
    done = vctune("report", path.with_name("design.json"), cwd=again)
    assert done.returncode == ExitCode.BAD_INPUT and f"{path}: experiments[0].design.{part}: " in done.stderr
    assert path.with_name("report.html").read_bytes() == before


def test_json_and_one_experiment(problem, tmp_path):
    done = vctune("simulate", problem, "--experiment", "free", "--json", "--out", "o", cwd=tmp_path)
    record = strict(done.stdout)
    assert record == strict((tmp_path / "o/device/simulation.json").read_text())
    assert [one["name"] for one in record["experiments"]] == ["free"]
    assert record["experiments"][0]["baseline"] is None
    assert {"fits", "residual", "ripple", "handle_energy", "peak_motor", "saturated"} <= set(
        record["experiments"][0]["design"]["metrics"]
    )


def test_infeasible_and_unstable_fail(tmp_path):
    path = tmp_path / "device.toml"
    path.write_text(for_passive_hands(DEVICE + "[gains]\nvelocity = { min = 2000.0, max = 3000.0 }\n" + EXPERIMENTS))
    done = vctune("simulate", path, cwd=tmp_path)
    assert done.returncode == ExitCode.FAILED and "nothing to simulate" in done.stderr
    poor = DEVICE + HELD.replace("160.0", "16.0").replace("0.37", "0.02")
    path.write_text(for_passive_hands(poor + EXPERIMENTS.replace("to = 0.005,", "to = 0.005, mass = 0.5,")))
    done = vctune("simulate", path, "--json", cwd=tmp_path)
    assert done.returncode == ExitCode.FAILED
    spring = strict(done.stdout)["experiments"][0]["design"]
    assert spring["metrics"] is None and spring["diverged_s"] > 0 and not spring["loop"]["stable"]


@pytest.mark.slow
def test_an_unstable_design_fails_although_a_short_motion_does_not_show_it(tmp_path: Path) -> None:
    """An environment six samples late makes the loop grow by half a per cent a sample: nothing diverges in a second."""
    late = '[[experiment]]\nname = "late"\nenvironment = { stiffness = 2000.0, late = 6 }\n'
    path = tmp_path / "device.toml"
    path.write_text(for_passive_hands(DEVICE + HELD + late + "operator = { to = 0.002, speed = 0.1, cycles = 1 }\n"))
    done = vctune("simulate", path, "--json", cwd=tmp_path)
    design = strict(done.stdout)["experiments"][0]["design"]
    assert design["metrics"] is not None and not design["loop"]["stable"] and done.returncode == ExitCode.FAILED


def test_interrupted_leaves_nothing_half_written(tmp_path):
    path = tmp_path / "device.toml"
    path.write_text(for_passive_hands(DEVICE + HELD + EXPERIMENTS.replace("cycles = 2", "cycles = 2000")))
    running = started("simulate", "device.toml", cwd=tmp_path, start_new_session=True)
    folder = tmp_path / "results/device"
    wait_until((folder / "gains.toml").exists)
    wait_for_work(running, 0.5)
    running.send_signal(signal.SIGINT)
    _, error = running.communicate(timeout=60)
    assert (running.returncode, without_progress(error).strip()) == (ExitCode.INTERRUPTED, "interrupted")
    assert {item.name for item in folder.iterdir()} == {"gains.toml", "design.json"}


# measures


def traced(force, operator=HAND, T=1e-3, environment_force=None):
    """Traces of a handle that follows the intended motion exactly, with a force of position and velocity."""
    count = sample_count(operator, T)
    path = intended_motion(operator, T, 0, count - 1)
    x, v, still = path.position, path.velocity, np.zeros(count)
    f = force(x, v)
    f_e = f if environment_force is None else environment_force(x, v)
    return Traces(np.arange(count) * T, x, x, v, f, x, v, f_e, still + 0.25, f, None)


def measured(force, environment, operator=HAND, limit=None, **options):
    return metrics(traced(force, operator, **options), environment, operator, limit)


def test_a_perfect_spring():
    found = measured(lambda x, v: 200 * (x - 0.025), Environment(0.0, 0.0, 200.0, 0.025, False))
    assert found.fits["stiffness"].value == pytest.approx(200)
    assert found.offset == pytest.approx(-5)
    assert found.residual == pytest.approx(0, abs=1e-9)
    assert found.non_overlap == pytest.approx(0, abs=1e-9)
    assert found.handle_energy == pytest.approx(0, abs=1e-6)
    assert found.handle_deficit == pytest.approx(200 * 0.025**2 / 2, rel=1e-3)


def test_hysteresis_of_coulomb_friction():
    found = measured(lambda x, v: 200 * x + 0.3 * np.sign(v), Environment(0.0, 0.0, 200.0, 0.0, False))
    assert found.residual == pytest.approx(0.3, rel=0.02)
    assert found.handle_energy == pytest.approx(6 * 0.3 * 0.05, rel=1e-2)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_non_overlap_is_the_greatest_distance_whichever_curve_is_above(sign: float) -> None:
    """A lagging and a leading force; and one that drifts with the way, from the second outward to the third inward."""
    spring = Environment(0.0, 0.0, 200.0, 0.0, False)
    assert measured(lambda x, v: 200 * x + sign * 0.3 * np.sign(v), spring).non_overlap == pytest.approx(0.6, rel=1e-3)

    def drifting(x, v):
        return 200 * x + sign * 10.0 * np.cumsum(np.abs(np.diff(x, prepend=x[0])))

    # at a tenth of a stroke of 0.05 m the ways are 2.1 and 5.9 strokes
    assert measured(drifting, spring).non_overlap == pytest.approx(10.0 * 3.8 * 0.05, rel=1e-2)


def test_handle_and_environment_have_energies_of_their_own() -> None:
    """Of different forces; what either gives back of what it had not received is its deficit."""
    sine, nothing = replace(HAND, motion="sine"), Environment(0.0, 0.0, 0.0, 0.0, False)
    found = measured(lambda x, v: 14 * v, nothing, sine, environment_force=lambda x, v: -3 * v)
    assert found.environment_energy == pytest.approx(-3 / 14 * found.handle_energy)
    assert (found.handle_deficit, found.environment_deficit) == (0.0, pytest.approx(-found.environment_energy))
    other = measured(lambda x, v: -3 * v, nothing, sine, environment_force=lambda x, v: 14 * v)
    assert (other.handle_deficit, other.environment_deficit) == (pytest.approx(-other.handle_energy), 0.0)


def test_a_mass_a_damper_and_a_spring_are_fitted_together() -> None:
    sine, T = replace(HAND, motion="sine"), 1e-3
    found = measured(
        lambda x, v: 2 * np.gradient(v, T) + 3 * v + 50 * (x - 0.01), Environment(2.0, 3.0, 50.0, 0.01, False), sine
    )
    values = {name: (fit.value, fit.asked) for name, fit in found.fits.items()}
    assert values == {
        name: (pytest.approx(asked), asked) for name, asked in (("mass", 2.0), ("damping", 3.0), ("stiffness", 50.0))
    }
    assert found.offset == pytest.approx(-0.5)


def test_a_command_of_either_sign_is_at_the_limit() -> None:
    """Half of the samples at the lower limit, a quarter at the upper one; the greatest may be negative."""
    traces = traced(lambda x, v: 0 * x)
    quarter = np.arange(traces.motor.size) % 4
    motor = np.choose(quarter, [-0.25, -0.25, 0.25, 0.1])
    at_limit = metrics(replace(traces, motor=motor), Environment(0.0, 0.0, 0.0, 0.0, False), HAND, 0.25)
    assert at_limit.saturated == pytest.approx(0.75, abs=1e-3) and at_limit.peak_motor == 0.25
    below = metrics(replace(traces, motor=np.minimum(motor, 0.1)), Environment(0.0, 0.0, 0.0, 0.0, False), HAND, 0.3)
    assert (below.saturated, below.peak_motor) == (0.0, 0.25)


def test_a_damper_and_its_energy():
    sine = replace(HAND, motion="sine")
    found = measured(lambda x, v: 14 * v, Environment(0.0, 14.0, 0.0, 0.0, False), sine)
    assert found.fits["damping"].value == pytest.approx(14)
    assert found.non_overlap is None
    count = sample_count(sine, 1e-3)
    assert found.handle_energy == pytest.approx(14 * 0.1**2 / 2 * count * 1e-3, rel=1e-2)
    assert found.environment_energy == pytest.approx(found.handle_energy)
    assert found.handle_deficit == 0


def test_ripple_residual_and_standard_error():
    """Noise of a known spread about a known line."""
    noise = np.random.default_rng(0).normal(0.0, 0.1, 100_000)
    found = measured(lambda x, v: 14 * v + noise[: len(v)], Environment(0.0, 14.0, 0.0, 0.0, False), T=1e-4)
    fit = found.fits["damping"]
    assert found.residual == pytest.approx(0.1, rel=0.02)
    assert abs(fit.value - 14) < 4 * fit.standard_error
    assert fit.standard_error == pytest.approx(
        0.1 / np.sqrt(2 / 3 * sample_count(HAND, 1e-4) * 0.1**2 * 13 / 15), rel=0.1
    )


def test_a_wall_is_measured_in_contact():
    wall = Environment(0.0, 0.0, 20000.0, 0.04, True)
    found = measured(lambda x, v: np.maximum(0.0, 20000 * (x - 0.04)), wall)
    assert found.fits["stiffness"].value == pytest.approx(20000)
    never = measured(lambda x, v: 0 * x, replace(wall, zero=1.0))
    assert (never.fits, never.residual, never.ripple, never.non_overlap) == ({}, None, None, None)


# the paper


@pytest.mark.slow
def test_the_papers_experiments_on_the_friction_wheel(tmp_path):
    """Section 5: non-overlap below 0.05 N, 2 % of 200 N/m, 3 % of 14 N s/m; better than the PID on the same device."""
    gains = ROOT / "tests/gains/friction-wheel.toml"
    done = vctune("simulate", ROOT / "problems/friction-wheel.toml", gains, "--json", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (ExitCode.OK, "")
    made = {one["name"]: one for one in strict(done.stdout)["experiments"]}
    design, pid = ({name: one[run]["metrics"] for name, one in made.items()} for run in ("design", "baseline"))
    assert design["spring"]["non_overlap"] < 0.05
    assert design["spring"]["fits"]["stiffness"]["value"] == pytest.approx(200, rel=0.02)
    assert pid["spring"]["non_overlap"] > 5 * design["spring"]["non_overlap"]
    assert design["damper"]["fits"]["damping"]["value"] == pytest.approx(14, rel=0.03)
    assert design["damper"]["residual"] < pid["damper"]["residual"]
    assert json.loads(done.stdout)["problem"]["name"] == "friction-wheel"


# extremes


@pytest.mark.slow
def test_stiff_and_extreme():
    """Finite, or a divergence with its time: bristles to 1e8 N/m, walls to 1e6 N/m, T and speed over their decades."""
    rng = np.random.default_rng(3)
    diverged, many = 0, drawn(120)
    for _ in range(many):
        T, stiffness = 10.0 ** rng.uniform(-5, np.log10(2e-2)), 10.0 ** rng.uniform(3, 8)
        speed, wall, mass = 10.0 ** rng.uniform(-5, 1), 10.0 ** rng.uniform(3, 6), float(rng.choice([0.0, 0.5]))
        travel = speed * T * rng.choice([5, 50, 1000])
        delay = float(rng.choice([0.0, 0.4, 3.3])) * T
        velocity = None if rng.random() < 0.5 else VelocityEstimate("difference", 0.1 / T)
        device = Device(0.4, 2.0, T, delay, "zoh", velocity)
        hand = MovingHand(str(rng.choice(["sine", "reciprocate"])), 0.0, travel, speed, 2, mass, 2.0, 1000.0)
        environment = Environment(0.0, float(rng.choice([0.0, 30.0])), wall, travel * 0.7, True)
        friction = Friction(0.3, 0.4, 0.005, stiffness, (stiffness * 0.4) ** 0.5)
        sensors = Sensors(float(rng.choice([0.0, 1e-6])), 0.01, 0)
        e = Experiment("x", environment, hand, friction, sensors, None if rng.random() < 0.5 else 50.0, None)
        scene = designed_scene(device, Gains(0.1 / T, 0.5 / T), Coupling(160.0, 0.35, 0.0), e)
        traces = run(scene)
        assert all(np.isfinite(getattr(traces, name)).all() for name in ("position", "velocity", "force", "motor"))
        if traces.diverged is None:
            assert len(traces.time) == sample_count(hand, T)
        else:
            diverged += 1
            assert traces.diverged == pytest.approx(len(traces.time) * T)
    assert diverged < many / 2


@pytest.mark.slow
def test_half_a_million_samples_in_bounded_memory(tmp_path):
    path = tmp_path / "device.toml"
    spring = EXPERIMENTS.split('[[experiment]]\nname = "free"', maxsplit=1)[0]
    path.write_text(DEVICE + HELD + spring.replace("cycles = 2", "cycles = 450"))
    assert peak_memory("simulate", path, "--quiet", cwd=tmp_path) < 700_000
    (record,) = tmp_path.rglob("simulation.json")
    assert json.loads(record.read_text())["experiments"][0]["samples"] >= 500_000
