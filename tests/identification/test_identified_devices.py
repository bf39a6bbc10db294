"""Simulated devices, identified from their logs: the truth is in the box, the box is no larger than it has to be, and
what is designed for the box is certified for the truth."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np
import pytest
from conftest import drawn
from identification_logs import Log, driven, encoded, random_case

from vctune import check, identify, solve
from vctune.design.check import CheckVerdict
from vctune.document.records.identification_json import Bounded
from vctune.document.text.errors import InputError
from vctune.identification.box import joint_factor
from vctune.model.device import Device
from vctune.model.experiment import Friction, MovingHand

FEW, MANY = (1, 2), range(drawn(60))


@dataclass(frozen=True)
class Trial:
    """One device: relative errors, half-widths without and with floors, whether all are inside, and has the parts."""

    errors: dict[str, float]
    found: dict[str, float]
    half_widths: dict[str, float]
    inside: bool
    parts: bool


def trial(seed, folder) -> Trial:
    case = random_case(seed)
    identified = identify(*case.log.write(folder, f"log-{seed}"))
    numbers = {each.key: each for each in identified.record.numbers}
    true = {key: case.device.number(key) for key in numbers}
    if case.device.actuator is not None and "actuator.bandwidth_hz" not in numbers:
        true["delay"] += 1 / (2 * np.pi * case.device.actuator.bandwidth_hz)  # which the delay then holds
    parts = (case.device.structure is None) == ("structure.frequency_hz" not in numbers)
    known = {key: each for key, each in numbers.items() if true[key] is not None}
    return Trial(
        errors={key: each.value / true[key] - 1 for key, each in known.items()},
        found={key: without_floor(each, len(numbers)) for key, each in known.items()},
        half_widths={key: each.share for key, each in known.items()},
        inside=all(abs(true[key] / each.value - 1) <= each.share for key, each in known.items()),
        parts=parts,
    )


def without_floor(bounded: Bounded, count: int) -> float:
    """Return the half-width that records, directions and residuals ask for, as a share of the middle."""
    factor = joint_factor(count)
    low = min(each.value - factor * each.sigma - each.excess[0] for each in bounded.estimates)
    high = max(each.value + factor * each.sigma + each.excess[1] for each in bounded.estimates)
    return (high - max(low, 0.0)) / (high + max(low, 0.0))


def designed_for_the_box(seed, folder) -> bool:
    """Whether the design for the identified file passes on the true device."""
    case = random_case(seed)
    identified = identify(*case.log.write(folder, f"log-{seed}"))
    solved = solve(identified.file)
    posed = replace(identified.file.problem, device=case.device, uncertainty=None)
    return check(posed, solved.judgement.gains, solved.judgement.coupling).result is CheckVerdict.PASSED


@pytest.mark.night
@pytest.mark.parametrize("seed", FEW)
def test_a_simulated_device_is_in_its_box(seed, trials):
    found = trials[seed]
    assert found.parts
    assert found.inside, found


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3])
def test_a_design_for_the_box_is_certified_for_the_truth(seed, tmp_path):
    assert designed_for_the_box(seed, tmp_path)


@pytest.fixture(scope="module")
def trials(tmp_path_factory):
    """Sixty devices."""
    return [trial(seed, tmp_path_factory.mktemp("trials")) for seed in MANY]


@pytest.mark.night
@pytest.mark.xfail(reason="18 of 20: a lag that is not told from a second mass beside friction that is not Coulomb's")
def test_nineteen_of_twenty_devices_are_in_their_boxes(trials):
    assert np.mean([each.inside and each.parts for each in trials]) >= 0.95


@pytest.mark.night
@pytest.mark.parametrize(
    "key",
    [
        "mass",
        "damping",
        "delay",
        "actuator.bandwidth_hz",
        "structure.handle_mass",
        "structure.frequency_hz",
        pytest.param("structure.damping_ratio", marks=pytest.mark.xfail(reason="3.2 times: blocks of lines left out")),
    ],
)
def test_no_interval_is_wider_than_the_errors_that_are_made(trials, key):
    """Half the devices have an interval of at most three times the root mean square of the errors to each side.

    Floors aside, which are for what differs between two days, and which no simulation has.
    """
    having = [each for each in trials if key in each.errors]
    rms = np.sqrt(np.mean([each.errors[key] ** 2 for each in having]))
    assert np.median([each.found[key] for each in having]) <= 3 * rms


@pytest.mark.night
@pytest.mark.parametrize(
    ("key", "floor"),
    [
        ("mass", 0.01),
        ("damping", 0.01),
        ("actuator.bandwidth_hz", 0.01),
        ("structure.handle_mass", 0.01),
        ("structure.frequency_hz", 0.005),
        ("structure.damping_ratio", 0.01),
    ],
)
def test_a_floor_widens_an_interval_to_itself_and_not_beyond(trials, key, floor):
    for each in trials:
        if key in each.errors and each.half_widths[key] < 0.9:  # not one that reaches down to 0
            stated = each.half_widths[key]  # in five decimals, rounded up
            assert 0 <= stated - max(each.found[key], floor) < 2e-5


@pytest.mark.night
def test_designs_for_nineteen_of_twenty_boxes_are_certified_for_the_truth(tmp_path):
    passed = [designed_for_the_box(seed, tmp_path) for seed in MANY[: drawn(12)]]
    assert np.mean(passed) >= 0.95


@pytest.mark.slow
def test_a_hand_moves_the_device_and_the_sensor_s_lag_is_found(tmp_path):
    """Hand and motor push at once; the force is sensed late and with noise."""
    random, T, n = np.random.default_rng(1), 1e-3, 12000
    device = Device(0.4, 2.0, T, 4e-4)
    f = np.fft.rfftfreq(n, T)
    wave = np.fft.irfft(np.fft.rfft(random.normal(size=n)) * (f > 0.3) / (1 + (f / 6.0) ** 2), n)
    hand = MovingHand("sine", 0.0, 0.05, 0.3, 40, 0.1, 5.0, 400.0)
    recorded = driven(device, Friction(0.3, 0.35, 0.005, 1e5, 200.0), 3 * wave / wave.std(), hand=hand)
    late = 2.5e-3
    time = np.arange(n) * T
    sensed = np.interp(time - late, time, recorded["force"]) + random.normal(size=n) * 0.02
    columns = {
        "time_s": time,
        "position_m": encoded(recorded["position"], 1e-6),
        "command_N": recorded["motor"],
        "hand_N": sensed,
    }
    found = identify(*Log(columns, "").write(tmp_path)).found
    for key in ("mass", "damping", "delay"):
        assert found.bounded(key).low <= device.number(key) <= found.bounded(key).high
    sensor = found.bounded("force_sensor.delay")
    assert sensor.low <= late <= sensor.high < 1.2 * sensor.low
    assert found.record.force_noise == pytest.approx(0.02, rel=0.1)


@pytest.mark.slow
def test_where_the_command_rests_the_delay_is_asked_for(tmp_path):
    random, T, n = np.random.default_rng(2), 1e-3, 8000
    hand = MovingHand("sine", 0.0, 0.05, 0.3, 40, 0.1, 5.0, 400.0)
    recorded = driven(Device(0.4, 2.0, T), None, np.zeros(n), hand=hand)
    sensed = recorded["force"] + random.normal(size=n) * 0.01
    columns = {
        "time_s": np.arange(n) * T,
        "position_m": encoded(recorded["position"], 1e-6),
        "command_N": np.zeros(n),
        "hand_N": sensed,
    }
    log, config = Log(columns, "").write(tmp_path)
    with pytest.raises(InputError, match="the command never moves"):
        identify(log, config)
    config.write_text("[device]\ndelay = 3e-4\ndelay_uncertainty = 2e-4\n")
    delay = identify(log, config).found.bounded("delay")
    assert (delay.low, delay.high) == pytest.approx((1e-4, 5e-4))


@pytest.mark.slow
def test_a_structure_that_overflows_in_a_fit_is_dropped(tmp_path):
    """The fit of two masses runs away to a resonance in the megahertz, whose motion over a sample overflows."""
    samples, T, mass, damping = 2000, 1e-3, 0.4, 2.0
    lines = np.unique(np.geomspace(1, 400, 40).astype(int))
    phases = np.random.default_rng(1).uniform(0, 2 * np.pi, lines.size)
    angles = 2 * np.pi * np.outer(lines, np.arange(samples)) / samples
    force = np.tile(0.5 * np.cos(angles + phases[:, None]).sum(axis=0), 8)
    decay, x, v, position = np.exp(-damping * T / mass), 0.0, 0.0, []
    for f in force:
        position.append(x)
        x += f * T / damping + (v - f / damping) * (1 - decay) * mass / damping
        v = f / damping + (v - f / damping) * decay
    log = np.column_stack([T * np.arange(force.size), 1e-6 * np.round(np.array(position) / 1e-6), force])
    path = tmp_path / "wheel.csv"
    np.savetxt(path, log, delimiter=",", header="time_s,position_m,command_N", comments="", fmt="%.9g")
    assert identify(path).file.problem.device.mass == pytest.approx(mass, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_velocity_that_was_read_is_enough(friction, tmp_path):
    """Of a mass with friction, stepped finely; the stamps jitter by 0.3 rows around 1 kHz."""
    T, rows, parts, random = 1e-3, 3000, 50, np.random.default_rng(3)
    mass, damping, delay = 0.4, 2.0, 1.4e-3
    f = np.fft.rfftfreq(rows, T)
    wave = np.fft.irfft(np.fft.rfft(random.normal(size=rows)) * (f > 0.5) / (1 + (f / 8.0) ** 2), rows)
    told, read, v, h = 3.0 * wave / wave.std(), np.zeros(rows), 0.0, T / parts
    for i in range(rows):
        read[i] = v
        for j in range(parts):
            acting = told[max(int(np.floor(i + (j + 0.5) / parts - delay / T)), 0)]
            free = v + h / mass * (acting - damping * v)
            v = float(np.sign(free) * max(abs(free) - h * friction / mass, 0.0))
    stamps = T * (np.arange(rows) + 0.3 * random.uniform(-1, 1, rows))
    columns = np.column_stack([stamps, told, np.round(read + 1e-4 * random.normal(size=rows), 5)])
    np.savetxt(tmp_path / "log.csv", columns, "%.9g", ",", header="time_s,command_N,velocity_m_s", comments="")
    found = identify(tmp_path / "log.csv").record
    assert found.sample_time == T
    for key, truth in (("mass", mass), ("damping", damping), ("delay", delay)):
        number = next(each for each in found.numbers if each.key == key)
        assert number.low <= truth <= number.high, number
    assert (found.friction.coulomb if found.friction else 0.0) == pytest.approx(friction, abs=3e-3)


def position_loop(seed, seconds=10.0, T=1e-3, parts=16, most=np.inf):
    """Return mass, dampings and latency of a device in a position loop, and its log; stepped in parts of a row.

    Viscous and dry friction differ by direction; near rest the friction is greater (Stribeck) and smooth. The motor's
    force is at most `most`.
    """
    random = np.random.default_rng(seed)
    mass, delay = random.uniform(0.3, 2.0), T * random.integers(2, 30) / parts
    damping = mass * random.uniform(2.0, 8.0) * np.array([1.0, random.uniform(1.2, 1.5)])
    dry = 0.15 * damping * random.uniform(0.8, 1.2, 2)
    more, speed_of_more = random.uniform(0.0, 0.4), 0.008
    t = np.arange(round(seconds / T)) * T
    hertz, phases = random.uniform(0.2, 4.0, 6), random.uniform(0, 2 * np.pi, 6)
    wanted = np.sum(0.03 / hertz[:, None] ** 0.7 * np.sin(2 * np.pi * hertz[:, None] * t + phases[:, None]), axis=0)
    K_d = mass * 60.0
    K_p = K_d * 20.0
    x = v = last = 0.0
    commands, positions = [0.0] * 4, []
    whole, late = divmod(round(delay / T * parts), parts)
    for row, goal in enumerate(wanted):
        read = 1e-6 * round(x / 1e-6)
        ahead = (wanted[min(row + 1, t.size - 1)] - goal) / T
        commands.append(round(K_p * (goal - read) + K_d * (ahead - (read - last) / T), 3))
        last = read
        positions.append(read)
        for part in range(parts):
            force = min(max(commands[-1 - whole - (part < late)], -most), most)
            way = int(v < 0)
            rubs = dry[way] * np.tanh(v / 1e-3) * (1 + more * np.exp(-((v / speed_of_more) ** 2)))
            h = T / parts
            faster = v + h * (force - rubs - damping[way] * v) / mass / (1 + damping[way] * h / (2 * mass))
            x, v = x + h * (v + faster) / 2, faster
    log = Log({"time_s": t, "position_m": np.array(positions), "command_N": np.array(commands[4:])}, "")
    return mass, damping, delay, log


@pytest.mark.parametrize("seed", range(2))
def test_friction_that_differs_by_direction_is_told(tmp_path, seed):
    """The box holds both dampings, mass and delay, and is no wider than these differ, or a fiftieth of the mass."""
    mass, damping, delay, log = position_loop(seed)
    found = identify(*log.write(tmp_path)).found
    boxes = {key: found.bounded(key) for key in ("mass", "damping", "delay")}
    assert boxes["mass"].low < mass < boxes["mass"].high < 1.021 * boxes["mass"].low
    assert boxes["delay"].low <= delay <= boxes["delay"].high < boxes["delay"].low + 3e-4
    assert boxes["damping"].low < damping.min() and damping.max() < boxes["damping"].high
    assert boxes["damping"].high - boxes["damping"].low < 1.5 * (damping.max() - damping.min())


def test_a_motor_at_its_limit_is_refused_with_its_force(tmp_path):
    """Of a loop whose greatest command is a third more than its motor gives."""
    greatest = np.abs(position_loop(0)[3].columns["command_N"]).max()
    log = position_loop(0, most=0.75 * greatest)[3]
    with pytest.raises(InputError, match="saturates") as caught:
        identify(*log.write(tmp_path))
    assert float(re.search(r"at about (\S+) N", str(caught.value))[1]) == pytest.approx(0.75 * greatest, rel=0.2)
