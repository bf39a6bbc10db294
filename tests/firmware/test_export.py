"""`vctune export`: what is proved is what is compiled, and what is compiled is what was simulated."""

from __future__ import annotations

import json
import re
import shutil
import tomllib
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from command import run as vctune
from compilers import by_each_compiler, done, has, period, warned
from conftest import DEVICE, FIXED, ROOT, for_passive_hands, mostly_slow
from draws import decades, sections
from kinds import admittance, servo
from test_servos import WALKER, stated

from vctune import InputError, export, write_export
from vctune.design.records.claims import HandsRecord, WallsRecord
from vctune.document.reading import parse_problem, read_gains, read_problem
from vctune.document.text.toml import toml_text
from vctune.exit_codes import ExitCode
from vctune.firmware.firmware import NO_ENVIRONMENT, certified, firmware, rounded
from vctune.firmware.preamble import rendered
from vctune.firmware.vectors import commands, default_experiments, replays
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hand
from vctune.simulation.controller import (
    FLOATS,
    Measurement,
    at_rest,
    control,
    controller_of,
    coupling_coefficients,
    coupling_of,
)
from vctune.simulation.scene import designed_law

EXPERIMENTS = """
[[experiment]]
name = "everything at once"
environment = { mass = 0.1, damping = 3.0, stiffness = 5000.0, zero = 0.004, wall = true }
operator = { to = 0.01, speed = 0.04, cycles = 1, mass = 0.1 }
friction = { coulomb = 0.3, stiction = 0.4 }
sensors = { position_resolution = 1e-5, force_noise = 0.01 }
actuator = { limit = 2.0 }
[[experiment]]
name = "lossless"
environment = { mass = 0.05, stiffness = 200.0, rule = "trapezoid" }
operator = { from = 0.001, to = 0.01, speed = 0.05, cycles = 1 }
[[experiment]]
name = "free motion"
operator = { to = 0.01, speed = 0.1, cycles = 1, motion = "sine" }
"""
NAME = r"""name = 'a /* ??/ \ %d " é */ name'
"""
"""What a comment of C must not trip over."""
OF_SERVOS = EXPERIMENTS.replace("friction = { coulomb = 0.3, stiction = 0.4 }\n", "")
OF_SERVOS = OF_SERVOS.replace("position_resolution = 1e-5, ", "").replace("actuator = { limit = 2.0 }\n", "")
CONTACT = stated(
    {
        "sample_time": 0.001, "servo": {"delay": 0.004, "bandwidth_hz": 40.0},
        "force_sensor": {"bandwidth_hz": 200.0, "order": 2},
    },
    (1943.9452, 2.8515397, 302.56473), (5.0, 100.0, 30000.0),
)  # fmt: skip
SERVOS = {"velocity": toml_text(CONTACT) + OF_SERVOS, "position": toml_text(WALKER) + OF_SERVOS}
EULER = "damping = 1943.9452", 'rule = "euler"'
PARTS = {
    "ideal": "",
    "filtered": '[device.velocity]\nfrom = "difference"\nfilter_hz = 200.0\nfilter_order = 2\n',
    "late": "[device.velocity]\nfilter_hz = 300.0\n[device.force_sensor]\nbandwidth_hz = 400.0\ndelay = 1.3e-3\n",
    "flexible": "[device.structure]\nhandle_mass = 0.1\nfrequency_hz = 200.0\ndamping_ratio = 0.05\n",
}
NOTCH = "[[0.9408092961815945, -1.749484722589444, 0.9408092961815944, 1.0, -1.749484722589444, 0.881618592363189]]"
PARTS["notched"] = f"[device.velocity]\nfilter_coefficient = 0.7\nfilter_order = 2\nsections = {NOTCH}\n"
PARTS["notched"] += f"[device.force_sensor]\nfilter_coefficient = 0.5\nsections = {NOTCH}\n"
KINDS = {name: NAME + DEVICE + part + FIXED.format(160.0) + EXPERIMENTS for name, part in PARTS.items()} | SERVOS
KINDS["pulled"] = SERVOS["velocity"].replace("bandwidth_hz = 40.0 }", "bandwidth_hz = 40.0, stiffness = 20.0 }")
KINDS["pulled"] = KINDS["pulled"].replace("force_sensor = { ", f"force_sensor = {{ sections = {NOTCH}, ")
KINDS["euler"] = SERVOS["velocity"].replace(*EULER)
KINDS["euler position"] = KINDS["euler"].replace("bandwidth_hz = 40.0 }", 'bandwidth_hz = 40.0, command = "position" }')


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Return the folder of exported C of a kind and a precision: made once, unproved ones for what they compute."""

    def folder(kind="ideal", precision="double"):
        place = tmp_path_factory.mktemp(kind)
        (place / "device.toml").write_text(KINDS[kind])
        return write_export(export(place / "device.toml", precision=precision, unproved=True), place / "out")

    return cache(folder)


@pytest.mark.parametrize("precision", ["double", pytest.param("single", marks=pytest.mark.slow)])
@by_each_compiler
def test_it_compiles_without_a_warning(made, name, precision, tmp_path):
    for kind in KINDS:
        assert warned(name, made(kind, precision), tmp_path) == "", kind


@has("cppcheck")
def test_cppcheck_has_nothing_to_say(made):
    for folder in (made("ideal"), made("filtered", "single"), made("position")):
        options = ["--std=c99", "--enable=warning,style,performance,portability", "--error-exitcode=1", "-q"]
        found = done("cppcheck", *options, f"-DVCTUNE_TIMER_PERIOD_NS={period(folder)}", ".", cwd=folder)
        assert (found.returncode, found.stdout + found.stderr) == (0, "")


@has("make", "gcc")
@pytest.mark.parametrize("compiler", [pytest.param(name, marks=has(name)) for name in ("gcc", "clang")])
@pytest.mark.parametrize("kind", KINDS)
def test_double_precision_replays_to_the_last_bit(made, kind, compiler, tmp_path):
    """Friction, encoder, noise, a wall, a limit and the trapezoidal rule included: the same operations, every one."""
    shutil.copytree(made(kind), tmp_path / "c")
    found = done("make", "-s", "check", f"CC={compiler}", cwd=tmp_path / "c")
    assert found.returncode == 0, found.stdout + found.stderr
    assert found.stdout.count(" greatest difference 0 ulp  ok") == 3


@has("make", "gcc")
@pytest.mark.parametrize("kind", mostly_slow(KINDS, ["filtered"]))
def test_single_precision_replays_within_the_bound_that_it_states(made, kind, tmp_path):
    shutil.copytree(made(kind, "single"), tmp_path / "c")
    found = done("make", "-s", "check", cwd=tmp_path / "c")
    assert found.returncode == 0, found.stdout + found.stderr
    stated = float((tmp_path / "c/replay.c").read_text().split("#define VCTUNE_ALLOWED ")[1].split()[0])
    lines = found.stdout.splitlines()
    greatest = max(float(line.split("difference ")[1].split()[0]) for line in lines)
    assert greatest == pytest.approx(stated / 2, rel=0.02)  # what NumPy measured is what C comes to
    unit = {"velocity": "m/s", "pulled": "m/s", "position": "m", "euler": "m/s", "euler position": "m"}.get(kind, "N")
    assert all(line.endswith(f" {unit}  ok") for line in lines)


@has("make", "gcc")
@pytest.mark.parametrize(
    "kind, constant",
    [("ideal", name) for name in ("VELOCITY_GAIN", "COUPLING_STEP", "COUPLING_DECAY", "HALF_SAMPLE_TIME")]
    + [("velocity", "RESISTANCE")],
)
def test_a_constant_that_was_changed_in_its_last_digit_fails_the_check(made, kind, constant, tmp_path):
    shutil.copytree(made(kind), tmp_path / "c")
    header = tmp_path / "c/vctune_controller.h"
    text = header.read_text()
    number = text.split(f"#define VCTUNE_{constant} (")[1].split(")")[0]
    header.write_text(text.replace(f"({number})", f"({float(np.nextafter(float(number), np.inf))!r})"))
    found = done("make", "-s", "check", cwd=tmp_path / "c")
    assert found.returncode != 0 and "FAILED" in found.stdout


@has("gcc")
@pytest.mark.parametrize(
    "options, complaint",
    [
        ([], "define VCTUNE_TIMER_PERIOD_NS"),
        (["-DVCTUNE_TIMER_PERIOD_NS=500000"], "certified for another sample time"),
        (["-DVCTUNE_TIMER_PERIOD_NS=1000000", "-ffast-math"], "order of operations"),
        (["-DVCTUNE_TIMER_PERIOD_NS=1000000", "-std=c89"], "needs C99"),
    ],
)
def test_what_the_certificate_assumes_is_checked_by_the_compiler(made, options, complaint, tmp_path):
    found = done("gcc", "-std=c99", *options, "-c", "vctune_controller.c", "-o", tmp_path / "o", cwd=made())
    assert found.returncode != 0 and complaint in found.stderr


@has("gcc", "nm")
def test_nothing_is_global_and_nothing_is_called(made, tmp_path):
    options = ["-std=c99", "-O2", "-DVCTUNE_TIMER_PERIOD_NS=1000000", "-o", tmp_path / "o"]
    done("gcc", *options, "-c", "vctune_controller.c", cwd=made())
    kinds = [line.split()[-2] for line in done("nm", tmp_path / "o", cwd=tmp_path).stdout.splitlines()]
    assert set(kinds) <= {"T", "t", "r"}  # no data, no bss, no undefined symbol: no malloc, no I/O, no library


def test_coefficients_go_back_to_their_coupling():
    rng = np.random.default_rng(1)
    for _ in range(300):
        T, b_c, m_c, b_0 = (float(f"{10**each:.6g}") for each in rng.uniform((-5, -2, -3, -3), (-2, 4, 2, 1)))
        back = coupling_of(coupling_coefficients(Coupling(b_c, m_c, b_0), T), T)
        alpha = T * b_c / (2 * m_c)  # far from 1 on one side a mass hardly matters, on the other a damping
        assert back.damping == pytest.approx(b_c, rel=1e-14 * (1 + alpha) ** 2)
        assert back.mass == pytest.approx(m_c, rel=1e-14 * (1 + 1 / alpha) ** 2)
        assert back.drag == pytest.approx(b_0, abs=1e-15 * (b_0 + b_c / (1 + alpha)))


def test_in_single_precision_it_is_the_rounded_constants_that_are_proved():
    file = read_problem(ROOT / "problems/friction-wheel-hands.toml")
    given = read_gains(ROOT / "tests/gains/friction-wheel-hands.toml")
    made = firmware(file, given.gains, given.coupling, "single")
    problem, (gains, coupling) = rounded(file.problem, made.coefficients, made.controller)
    assert certified(made)
    assert (made.record.gains, made.record.coupling) == (gains, coupling) != (given.gains, given.coupling)
    assert all(float(np.float32(number)) == number for number in made.coefficients.values())
    assert problem.device.sample_time == float(np.float32(1e-3)) != 1e-3
    again = coupling_coefficients(coupling, problem.device.sample_time)
    for name, number in again.items():
        assert made.coefficients[name] == pytest.approx(number, rel=1e-14)


EDGE = """device = { mass = 0.4, damping = 0.0, sample_time = 0.0009765625 }
gains = { velocity = 409.59999, position = 0.0 }
coupling = { damping = 1e4, mass = 30.0 }
stability = { band_hz = [1.0, 20.0], criterion = "passive" }
"""
"""|S| at Nyquist is 1/(1 - K_v T/(2m)), below its limit of 2 for K_v < m/T = 409.6: 409.59999 is, and stays so in
single precision; that of `OVER` rounds up."""
OVER = EDGE.replace("409.59999", "409.599999")


def test_a_design_that_does_not_survive_its_rounding_is_refused(tmp_path):
    (tmp_path / "under.toml").write_text(EDGE)
    (tmp_path / "over.toml").write_text(OVER)
    for name, precision, code in (
        ("under", "double", ExitCode.OK),
        ("under", "single", ExitCode.OK),
        ("over", "double", ExitCode.OK),
    ):
        assert vctune("export", f"{name}.toml", "--precision", precision, cwd=tmp_path).returncode == code
    refused = vctune("export", "over.toml", "--precision", "single", "--out", "single", cwd=tmp_path)
    assert refused.returncode in (ExitCode.FAILED, ExitCode.UNDECIDED)
    assert "rounded to single precision" in refused.stderr and "max_sensitivity" in refused.stderr
    assert not (tmp_path / "single").exists()


def test_what_is_not_proved_is_refused_or_says_so_at_the_top_of_every_file(folder):
    refused = vctune("export", "poor.toml", cwd=folder)
    assert (refused.returncode, refused.stdout) == (ExitCode.FAILED, "")
    assert "violated" in refused.stderr and "--unproved" in refused.stderr
    assert not (folder / "results").exists()
    done = vctune("export", "poor.toml", "--unproved", cwd=folder)
    assert done.returncode == ExitCode.OK and done.stdout.startswith("NOT PROVED")
    files = list((folder / "results/poor/firmware").iterdir())
    assert len(files) == 5
    for path in files:
        assert "NOT PROVED" in "".join(path.read_text().splitlines(keepends=True)[:3]), path
    assert "#define VCTUNE_PROVED 0" in (folder / "results/poor/firmware/vctune_controller.h").read_text()
    assert vctune("export", "good.toml", cwd=folder).returncode == ExitCode.OK
    good = folder / "results/good/firmware"
    assert "#define VCTUNE_PROVED 1" in (good / "vctune_controller.h").read_text()
    assert not any("NOT PROVED" in path.read_text() for path in good.iterdir())


def test_a_design_is_exported_as_it_was_solved(folder):
    assert vctune("solve", "good.toml", cwd=folder).returncode == ExitCode.OK
    path = folder / "results/good/design.json"
    told = export(path)
    record = json.loads(path.read_text())
    assert told.firmware.problem_sha256 == record["problem"]["sha256"]
    assert told.firmware.gains == Gains(**record["gains"])
    from_record = export(record)
    assert from_record.files == told.files
    assert vctune("export", path, cwd=folder).returncode == ExitCode.OK
    assert (folder / "results/good/firmware/vctune_controller.c").read_text() == told.files["vctune_controller.c"]
    assert vctune("export", path, "good.toml", cwd=folder).returncode == ExitCode.BAD_INPUT
    path.write_text(json.dumps(record | {"problem": record["problem"] | {"sha256": "0" * 64}}))
    assert "was changed" in vctune("export", path, cwd=folder).stderr


def test_an_export_names_its_formats():
    with pytest.raises(InputError, match="one of c, ros2"):
        export({"device": {"mass": 1.0, "damping": 1.0, "sample_time": 1e-3}}, to="ada")


def test_a_limit_that_does_not_act_changes_nothing():
    """To the last bit, also where the position part alone asks for more than it: the certified loop is linear."""
    device = read_problem(ROOT / "problems/friction-wheel.toml").problem.device
    free = designed_law(device, Gains(150.0, 6000.0), Coupling(160.0, 0.35, 0.5), NO_ENVIRONMENT)
    limited = replace(free, limit=30.0)
    laws = [controller_of(law) for law in (free, limited)]
    states = [at_rest(law, 0.0, 0.0) for law in laws]
    rng, beyond = np.random.default_rng(5), 0
    for _ in range(500):
        position, force = float(rng.normal(0.0, 3e-3)), float(rng.normal(0.0, 1.0))
        # a velocity by which the damping part holds against the position part
        ahead = states[0].reference + 1e-3 * states[0].desired - position
        seen = Measurement(position, states[0].desired + 40 * ahead, force)
        (states[0], one), (states[1], other) = (
            control(law, state, seen, FLOATS) for law, state in zip(laws, states, strict=True)
        )
        assert (states[0], one) == (states[1], other)
        assert abs(one.given) < 30.0
        beyond += abs(6000.0 * (states[0].reference - position)) > 30.0
    assert beyond > 10


def test_behind_a_limit_the_position_error_stays_within_reach():
    """What the limit can hold: the position part alone never asks for more, and is back as soon as the hand lets go."""
    gains, limit = Gains(150.0, 6000.0), 2.0
    device = read_problem(ROOT / "problems/friction-wheel.toml").problem.device
    law = controller_of(replace(designed_law(device, gains, Coupling(160.0, 0.35, 0.5), NO_ENVIRONMENT), limit=limit))
    state = at_rest(law, 0.0, 0.0)
    for _ in range(500):  # the hand pushes with 20 N against a handle that is stuck
        state, command = control(law, state, Measurement(0.0, 0.0, 20.0), FLOATS)
        assert abs(state.reference) <= limit / gains.position * (1 + 1e-12)
    assert command.given == limit
    for _ in range(8000):
        state, command = control(law, state, Measurement(0.0, 0.0, 0.0), FLOATS)
    assert abs(command.given) <= limit
    assert abs(state.desired) < 1e-3


def random_tables(kind, rng):
    """Return the tables of a random design with random parts before random environments."""
    device = servo(rng) if kind == "servo" else admittance(rng)
    if rng.random() < 0.5:
        device["force_sensor"] = device.get("force_sensor", {}) | {"sections": sections(rng)}
        device["velocity"] = device.get("velocity", {}) | {"sections": sections(rng)}
    if kind == "servo":
        device.pop("velocity", None)
    T, mass = device["sample_time"], device.get("mass", 1.0)
    gain = mass / T * 10 ** rng.uniform(-2, -0.3)
    environments = [
        {"mass": rng.uniform(0, 1), "stiffness": decades(rng, 0, 5), "zero": 0.005, "wall": True},
        {"mass": rng.uniform(0, 1), "damping": rng.uniform(0, 20), "stiffness": decades(rng, 0, 3)},
        {"mass": rng.uniform(0.01, 1), "stiffness": decades(rng, 0, 3), "rule": "trapezoid"},
    ]
    own = {"operator": {"to": 0.01, "cycles": 1, "mass": rng.uniform(0, 0.3), "stiffness": 100.0}}
    own |= {"sensors": {"force_noise": 0.01}, "actuator": {"limit": decades(rng, -1, 2)}}
    law = {"gains": {"velocity": gain, "position": rng.integers(4) * gain * decades(rng, -1, 1.5)}}
    law["coupling"] = {"damping": decades(rng, -1, 4), "mass": decades(rng, -2, 1), "drag": rng.uniform(0, 5)}
    if kind == "impedance":
        device |= {"display": "impedance"} | {name: {"from": "difference"} for name in ("velocity",) if name in device}
        law = {"gains": {"velocity": rng.uniform(0, 2)}}
        law["coupling"] = {"damping": rng.uniform(0, 0.1) * mass / T, "stiffness": mass / T**2 * decades(rng, -4, -1)}
        del own["sensors"], own["operator"]["mass"]
        device.pop("force_sensor", None)
    if kind == "servo":
        del law["gains"], own["actuator"]
        law["coupling"]["drag"] = decades(rng, 1, 3)
    named = [{"name": f"random {k}", "environment": each} | own for k, each in enumerate(environments)]
    return {"device": device, **law, "experiment": named}


@pytest.mark.slow
@has("make", "gcc")
@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("kind", ["admittance", "impedance", "servo"])
def test_random_designs_replay_to_the_last_bit(kind, seed, tmp_path):
    """With and without an integrator, in both precisions."""
    replayed(random_tables(kind, np.random.default_rng(seed)), tmp_path)


def replayed(tables, folder):
    """The C commands what `control` commands, to the last bit in both precisions."""
    for precision in ("double", "single"):
        told = export(tables, precision=precision, unproved=True)
        place = write_export(told, folder / precision)
        if precision == "single":  # its vectors have the commands of double precision; write those of 32 bits
            header, *rows = (place / "vectors.csv").read_text().splitlines()[-1 - sum(map(len, of_32_bits(told))) :]
            numbers = np.concatenate(of_32_bits(told)).tolist()
            lines = [f"{row.rpartition(',')[0]},{number!r}" for row, number in zip(rows, numbers, strict=True)]
            (place / "vectors.csv").write_text("\n".join([header, *lines]) + "\n")
            text = (place / "replay.c").read_text()
            (place / "replay.c").write_text(re.sub("#define VCTUNE_ALLOWED .*", "#define VCTUNE_ALLOWED 0.0", text))
        found = done("make", "-s", "check", cwd=place)
        assert found.returncode == 0, found.stdout + found.stderr
        assert len(re.findall(" difference 0 .* ok", found.stdout)) == 3


def of_32_bits(told):
    return [commands(told.firmware, replay) for replay in replays(told.file, told.firmware)]


BOXED = "[gains]\nvelocity = 229.82386\nposition = 100000.0\n[coupling]\ndamping = 155.7726\nmass = 0.055018942\n"
BOXED += 'drag = 1.3311356\n[stability]\ncriterion = "hands"\n[environment]\n'


@pytest.mark.slow
@pytest.mark.parametrize(
    ("environment", "said"),
    [
        ("mass = { min = 0.1 }\n", "a mass of at least 0.1 kg; not as a wall."),
        ("walls = true\ndamping = { min = 20.0 }\nstiffness = { max = 2000.0 }\n", "not as a wall."),
        ("walls = true\nmass = { min = 0.1 }\nstiffness = { max = 2000.0 }\n", "also as a wall without damping."),
    ],
)
def test_a_header_says_which_built_in_environments_are_proved(tmp_path, environment, said):
    """A built-in wall is nothing when it is not touched: neither the least damping of a box nor the least mass."""
    (tmp_path / "boxed.toml").write_text(DEVICE + BOXED + environment)
    assert vctune("export", "boxed.toml", cwd=tmp_path).returncode == 0
    (header,) = tmp_path.rglob("vctune_controller.h")
    text = " ".join(header.read_text().replace("*", " ").split())
    assert said in text.split("Proved within the box: ")[1][:120]
    assert "Not proved: by this rule" in text and "every environment that is passive" not in text


@pytest.mark.parametrize(
    "least, as_wall, backward",
    [((0.0, 0.0, 0.0), True, True), ((0.1, 0.0, 0.0), True, False), ((0.0, 20.0, 0.0), False, False)],
    ids=["nothing", "a mass", "a damping"],
)
def test_a_built_in_wall_is_proved_where_what_it_leaves_is_in_the_box(
    least: tuple[float, float, float], as_wall: bool, backward: bool
) -> None:
    """A wall that is not touched is neither spring nor damper; backward Euler steps it only without a mass."""
    proved = export(tomllib.loads(for_passive_hands(DEVICE + FIXED.format(160.0)))).firmware
    same = {"verdict": "proved", "boxes": 1, "min_ratio": 1.1, "worst_hz": 2.0, "worst_hand": Hand(0.0, 0.0, 0.0)}
    ends = zip(("mass", "damping", "stiffness"), least, (None, None, 2000.0), strict=True)
    hands = {"box": {name: [0.0, 1.0] for name in ("mass", "damping", "stiffness")}, **same}
    hands |= {"worlds": {name: [low, high] for name, low, high in ends}, "walls": WallsRecord(**same, corner_hz=9.0)}
    certificate = proved.record.certificate.model_copy(update={"hands": HandsRecord(**hands)})
    said = rendered(replace(proved, record=proved.record.model_copy(update={"certificate": certificate})))
    assert said["trapezoidal"].endswith("also as a wall without damping." if as_wall else "not as a wall.")
    assert ("but for a wall without mass and damping" in said["backward"]) == backward


@pytest.mark.parametrize("damping, proved", [(160.0, True), (80.0, False)])
def test_a_header_says_proved_again_only_of_what_is_proved(damping: float, proved: bool) -> None:
    """With single precision, and never of a design that is exported unproved."""
    text = for_passive_hands(DEVICE + FIXED.format(damping))
    said = " ".join(export(tomllib.loads(text), precision="single", unproved=True).statement)
    assert ("Proved again" in said) == proved == ("NOT PROVED" not in said)


def test_what_replays_a_rotary_design_grows_with_its_inertia() -> None:
    """Of 0.4 kg m2 it has the numbers of a linear device, and of twice the inertia twice the spring, hand and limit."""
    linear, *rotary = (
        default_experiments(parse_problem(device + for_passive_hands(FIXED.format(160.0)), "x", "x"))
        for device in (DEVICE, *(DEVICE.replace("mass = 0.4", f'units = "rotary"\nmass = {m}') for m in (0.4, 0.8)))
    )
    assert rotary[0] == linear
    for one, two in zip(*rotary, strict=True):
        for numbers in (lambda each: each.environment.stiffness, lambda each: each.operator.stiffness):
            assert numbers(two) == pytest.approx(2 * numbers(one), rel=1e-12)
    assert rotary[1][1].limit == pytest.approx(2 * rotary[0][1].limit, rel=1e-12)
