"""What is said where nothing fits: repairs, each tried as its reader would, and theorems, against 50 digits."""

from __future__ import annotations

import json
import re
import signal
import tomllib
from functools import cache, reduce
from math import pi
from time import perf_counter

import numpy as np
import pytest
from arithmetic import DIGITS
from command import check_files, run
from conftest import DEVICE, FIXED, ROOT, for_passive_hands, mostly_slow
from frequency import demanded, offered
from test_bound import infeasible_texts

import vctune
from vctune.design import solve as solving
from vctune.design.advice import repair as repairing
from vctune.design.advice.parameter_changes import parameter_changes
from vctune.design.advice.repair import find_repairs, with_repairs
from vctune.design.judging.judge import Status
from vctune.design.records.design import design_record
from vctune.design.search.theorems import impossible
from vctune.design.solve import solve
from vctune.document.reading import ProblemFile, parse_problem
from vctune.document.text.errors import InputError
from vctune.document.text.toml import toml_text
from vctune.exit_codes import ExitCode
from vctune.model.numbers.units import KEYS
from vctune.model.problem import Problem
from vctune.running import time_limit

pytestmark = pytest.mark.advice

LAG = '[device]\nmass = 0.5\ndamping = {}\nsample_time = 1e-3\nhold = "lag"\n'
LOOP = "[gains]\nvelocity = 40.0\nposition = 4000.0\n[coupling]\ndamping = 25000.0\nmass = 5.0\n"
"""With damping 2 the ratio is 1 at 5.3410 rad/s, then above it up to 76.196 (model/README.md, section 6)."""
QUICK = {
    "narrow bounds": infeasible_texts(10)[9][1],
    "no damping, whole axis": LAG.format(0.0) + "[stability]\nband_hz = [0.0, inf]\n",
    "undamped and late": DEVICE.replace("2.0", "0.0") + "delay = 5e-3\n[stability]\nband_hz = [0.05, 100.0]\n",
    "gains too high": DEVICE + "[gains]\nvelocity = { min = 2000.0, max = 5000.0 }\n",
}
THEOREMS = {
    "K_p > 0 from 0": LAG.format(2.0) + "[gains]\nposition = { min = 10.0, max = 100.0 }\n"
    "[coupling]\ndamping = { min = 1.0, max = 1e4 }\nmass = { min = 1e-3, max = 10.0 }\n"
    "[stability]\nband_hz = [0.0, 10.0]\n",
    "both faces from 0": DEVICE + "[gains]\nvelocity = { min = 20.0, max = 200.0 }\n"
    "[coupling]\ndamping = { min = 50.0, max = 1e4 }\nmass = { min = 1e-3, max = 0.05 }\n"
    "[stability]\nband_hz = [0.0, 50.0]\n",
    "K_p too high from 0": LAG.format(2.0) + "[gains]\nvelocity = { min = 1.0, max = 100.0 }\n"
    "position = { min = 3e5, max = 1e6 }\n[stability]\nband_hz = [0.0, 10.0]\n",
    "b_c too small towards inf": LAG.format(2.0) + "[gains]\nvelocity = { min = 20.0, max = 100.0 }\n"
    "[coupling]\ndamping = { min = 1.0, max = 5000.0 }\n[stability]\nband_hz = [1.0, inf]\n",
    "held too lightly": LAG.format(2.0) + "[operator]\nmass = 0.1\ndamping = 0.005\n[gains]\n"
    "velocity = { min = 5.0, max = 100.0 }\nposition = { min = 10.0, max = 100.0 }\n"
    "[stability]\nband_hz = [0.0, 10.0]\n",
}
REFUTED = {
    "b_c": DEVICE + FIXED.format(80.0),
    "K_v": DEVICE + FIXED.format(160.0).replace("150.0", "900.0"),
    "delay": DEVICE + "delay = 6e-3\n" + FIXED.format(160.0),
    "from 0": LAG.format(2.0) + LOOP + "[stability]\nband_hz = [0.0, 10.0]\nsafety_factor = 1.0\n",
    "reserve": DEVICE + FIXED.format(160.0).replace("0.37", "0.35"),
}


HELD = (ROOT / "tests/gains/friction-wheel-hands.toml").read_text().partition("[design]")[0]
"""Gains that are certified in the default hands, with 1.05 of the required R."""


def of(name: str, number: float) -> str:
    """Return these gains with another number of this name."""
    changed, count = re.subn(rf"(?m)^{name} = \S+", f"{name} = {number}", HELD)
    assert count == 1
    return changed


def wheel(gains: str, *, device: str = "", criterion: str = "hands", sensitivity: float = 2.0) -> str:
    """Return the friction wheel with other bounds, or fixed gains, in the default hands."""
    return (
        f"[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 1e-3\n{device}{gains}"
        "[operator]\nmass = { min = 0.0, max = 0.5 }\ndamping = { min = 0.0, max = 30.0 }\n"
        "stiffness = { min = 0.0, max = 3000.0 }\n[transparency]\nreference_impedance = 10.0\n"
        f"[stability]\ncriterion = '{criterion}'\nmax_sensitivity = {sensitivity}\n"
    )


def bounds(velocity="1.0, 1000.0", position="3e3, 1e5", damping="1e-3, 1e5", mass="1e-4, 1e4", drag="0.0, 1e3") -> str:
    """Return the bounds of a problem that leaves everything free; a drag of one number is fixed."""
    low, high = velocity.split(", ")
    said = f"[gains]\nvelocity = {{ min = {low}, max = {high} }}\n"
    low, high = position.split(", ")
    said += f"position = {{ min = {low}, max = {high} }}\n[coupling]\n"
    for name, ends in (("damping", damping), ("mass", mass), ("drag", drag)):
        low, _, high = ends.partition(", ")
        said += f"{name} = {{ min = {low}, max = {high} }}\n" if high else f"{name} = {low}\n"
    return said


LATE = "[device.force_sensor]\ndelay = 20e-3\n"
INFEASIBLE_IN_HANDS = {
    "no drag": (wheel(bounds(drag="0.0")), {"coupling.drag", "operator.stiffness.min"}),
    "late force sensor": (
        wheel(bounds(damping="1e-3, 60.0", drag="0.0, 5.0"), device=LATE),
        {"device.force_sensor.delay", "gains.position.min"},
    ),
    "no drag, both criteria": (wheel(bounds(drag="0.0"), criterion="both"), {"operator.damping.min"}),
    "K_v too great": (wheel(bounds(velocity="1200.0, 2000.0")), {"gains.velocity.min", "device.sample_time"}),
    "K_v too small": (
        wheel(bounds(velocity="1.0, 20.0", position="2e4, 1e5")), {"gains.velocity.max", "stability.max_sensitivity"}
    ),
    "|S| too small": (wheel(bounds(velocity="300.0, 1000.0"), sensitivity=1.05), {"stability.max_sensitivity"}),
}  # fmt: skip
"""Causes of all kinds, and values whose change repairs each."""
IN_HANDS = {
    "no drag": wheel(of("drag", 0.0)),
    "b_c": wheel(of("damping", 100.0)),
    "b_c, both criteria": wheel(of("damping", 100.0), criterion="both"),
    "m_c": wheel(of("mass", 0.03)),
    "late": wheel(HELD, device="delay = 1e-4\n"),
}


def parsed(text: str) -> Problem:
    return parse_problem(for_passive_hands(text), "test.toml", "test")


def changed(text: str, key: str, value: float, needs: str) -> str:
    """Write a repair, or a value in its place, into a problem file; `needs` is the line that the repair asks for."""

    def joined(table, other):
        for name, each in other.items():
            ranged = isinstance(each, dict) and not each.keys() <= {"min", "max"}
            table[name] = joined(table.get(name, {}), each) if ranged else each
        return table

    document = joined(tomllib.loads(text), tomllib.loads(needs))
    *tables, last = key.partition("[")[0].split(".")
    entry = reduce(lambda table, name: table[name], tables, document)
    if key.endswith("]"):
        entry[last][int(key[-2])] = value
    else:
        entry[last] = value
    return toml_text(document)


def certified(text: str) -> bool:
    try:
        problem = parsed(text)
    except InputError:
        return False
    return solve(problem).status is Status.CERTIFIED


LONG = 300.0  # A time limit, s, in place of the one that a search for repairs has of itself


@cache
def each_repair_suffices(text: str) -> list[dict]:
    """Write every repair into the file as printed and solve. A smaller step of the same value was not enough."""
    text = for_passive_hands(text)
    file = ProblemFile(parsed(text), text)
    with time_limit(LONG):
        solved = with_repairs(file, solve(file.problem))
    record = json.loads(json.dumps(design_record(file, solved), allow_nan=False))
    found = record["repairs"]
    assert found or record["together"]  # of pairs: test_pairs.py
    for repair in found:
        key, old, new, needs = repair["key"], repair["old"], repair["new"], repair["needs"]
        assert new != old
        assert certified(changed(text, key, new, needs)), repair
        change = next(
            one
            for one in parameter_changes(tomllib.loads(text), file.problem)
            if one.key == key and (one.limit > one.old) == (new > one.old)
        )
        before = change.applied(tomllib.loads(text), change.old + 0.9 * (new - change.old))
        if abs(old) < 1e-3 * abs(new):  # a bound of nothing may have to grow by decades: none is the least
            continue
        assert change.switch or not certified(toml_text(before)), ("nine tenths of the way suffice", repair)
    assert len(found) <= 4
    ranks = [(repair["assumes"], not repair["chooses"], repair["size"]) for repair in found]
    assert ranks == sorted(ranks)
    with time_limit(LONG):
        again = with_repairs(file, solve(file.problem)).repairs
    assert [(each.key, each.new) for each in again] == [(each["key"], each["new"]) for each in found]
    return found


CAUSES = QUICK | dict(infeasible_texts(20)) | THEOREMS
CAUSES |= {name: (ROOT / f"problems/{name}.toml").read_text() for name in ("infeasible", "extremes/unstable-bounds")}


@pytest.mark.parametrize("name", mostly_slow(CAUSES, []))
def test_each_repair_suffices(name):
    each_repair_suffices(CAUSES[name])


@pytest.mark.parametrize("name", mostly_slow(REFUTED | IN_HANDS, ["no drag"]))
def test_each_repair_of_a_refuted_design(name):
    """A gain or a number of the coupling is among the changes, and at most one is of what is assumed."""
    found = each_repair_suffices((REFUTED | IN_HANDS)[name])
    assert name == "delay" or any(repair["key"] in KEYS for repair in found)
    assert [repair["assumes"] for repair in found].count(True) <= 1


@pytest.mark.night
@pytest.mark.parametrize("name", INFEASIBLE_IN_HANDS)
def test_each_repair_in_hands(name):
    text, keys = INFEASIBLE_IN_HANDS[name]
    assert {repair["key"] for repair in each_repair_suffices(text)} & keys


@pytest.mark.slow
def test_a_step_is_at_most_a_few_times_what_is_needed():
    """R -> b^2/(4 (b + K_v - tau K_p)) = 0.025 for omega -> 0; a dense scan of the drag needed beyond."""
    (found,) = (r for r in each_repair_suffices(REFUTED["from 0"]) if r["key"] == "coupling.drag")
    s = 1j * np.geomspace(1e-3, 20 * pi, 200_001)
    Z_d, C = 0.5 * s + 2, (40 + 4000 / s) * 2 / (2 + 1e-3 * s)
    q = C / (Z_d + C)
    R = (abs(q) - q.real) / (2 * (1 / (Z_d + C)).real)
    series = 1 / (1 / 25000 + 1 / (5 * s))
    needed = max(0.025, (R - series.real).max())
    assert needed <= found["new"] <= 1.1 * needed


@pytest.mark.night
def test_a_small_change_is_found_as_such():
    """A servo whose drag misses by 3 %: the drag, and hands that are a little softer."""
    text = """[device]
sample_time = 3.3333333e-3
servo = { delay = 0.4, bandwidth_hz = 4.0, order = 2 }
[operator]
mass = { min = 0.0, max = 1.0 }
damping = { min = 0.0, max = 20.0 }
stiffness = { min = 0.0, max = 500.0 }
[environment]
mass = { min = 0.0, max = 0.0 }
stiffness = { min = 0.0, max = 0.0 }
[stability]
criterion = "hands"
[coupling]
damping = inf
mass = 0.5
drag = DRAG
"""
    assert certified(text.replace("DRAG", "155.0"))
    found = {each["key"]: each for each in each_repair_suffices(text.replace("DRAG", "150.0"))}
    assert found["coupling.drag"]["new"] <= 155.0 and found["operator.stiffness.max"]["new"] >= 480.0


@pytest.mark.slow
def test_a_check_names_the_best_change_of_a_gain_and_what_else_would_do(tmp_path):
    (tmp_path / "problem.toml").write_text(for_passive_hands(DEVICE))
    (tmp_path / "poor.toml").write_text(FIXED.format(80.0))
    (tmp_path / "pasted.toml").write_text(for_passive_hands(REFUTED["b_c"]))
    apart = check_files([tmp_path / "problem.toml", tmp_path / "poor.toml"])[0]
    pasted = check_files([tmp_path / "pasted.toml"])[0]
    assert apart.message == pasted.message
    assert re.search(r"(gains|coupling)\.\w+ = (\S+) instead of \S+ would pass; so would ", apart.message)
    assert re.search(r"; with operator.damping = \S+ instead of 0, if that is so, it passes", apart.message)
    assert apart.finding.record()["repairs"] == pasted.finding.record()["repairs"]
    assert (apart.line, pasted.line) == (2, 6)


@pytest.mark.slow
def test_nothing_found_is_said(tmp_path):
    text = REFUTED["from 0"].replace("10.0]", "inf]").replace("25000.0", "9.0")
    (tmp_path / "poor.toml").write_text(text)
    document = tomllib.loads(text)
    found = find_repairs(document, parameter_changes(document, parsed(text)))
    assert found.repairs == [] and {said.split(" to ")[0] for said in found.tried} == {
        "gains.velocity",
        "gains.position",
    }
    said = check_files([tmp_path / "poor.toml"])[0].message
    assert f"; none of these, each changed alone, passes: {', '.join(found.tried)}" in said


@pytest.mark.slow
def test_no_design_found_is_undecided_and_has_repairs_too(monkeypatch):
    monkeypatch.setattr(solving, "EARLY_BOXES", -1)
    monkeypatch.setattr(solving, "SEARCH_BOXES", -1)
    file = ProblemFile(parsed(QUICK["gains too high"]), QUICK["gains too high"])
    solved = solve(file.problem)
    assert (solved.status, solved.infeasibility.proved) == (Status.UNDECIDED, False)
    assert solved.infeasibility.reason.startswith("no admissible design was found, nor proved impossible")
    record = design_record(file, with_repairs(file, solved))
    assert (
        record["repairs"]
        and f"the least change that gives a design: {record['repairs'][0]['key']} = " in record["reason"]
    )


def test_a_certified_design_needs_no_repairs():
    file = ProblemFile(parsed(DEVICE), DEVICE)
    solved = solve(file.problem)
    assert with_repairs(file, solved) is solved
    assert design_record(file, solved)["repairs"] is None


def test_changes_leave_alone_what_the_file_does_not_say():
    keys = {change.key for change in parameter_changes(tomllib.loads(DEVICE), parsed(DEVICE))}
    assert not any(key.startswith(("gains.", "coupling.damping", "coupling.mass", "device.delay")) for key in keys)
    assert {"device.damping", "operator.damping", "coupling.drag", "stability.band_hz[0]"} <= keys
    text = DEVICE + "[gains]\nposition = { min = 1.0, max = 1e4 }\n"
    change = next(
        one for one in parameter_changes(tomllib.loads(text), parsed(text)) if one.key == "gains.position.min"
    )
    assert change.line(0.5) == "gains.position = { min = 0.5, max = 10000.0 }"
    assert change.applied(tomllib.loads(text), 0.5) == tomllib.loads(text.replace("1.0,", "0.5,"))


def random_request(rng: np.random.Generator, far: bool) -> str:
    """Return a problem whose band reaches an end of the axis, possible or not."""

    def about(size, decades):
        return float(size * 10 ** rng.uniform(-decades, decades))

    m, T = about(1.0, 1), about(1e-3, 1)
    hold, delay = ("lag", 0.0) if far or rng.random() < 0.5 else ("zoh", T * rng.uniform(0, 3))
    tau = T / 2 + delay
    b = 0.0 if rng.random() < 0.15 else about(m / tau, 1) * 10 ** -rng.uniform(1, 3)
    k = about(0.05 * m / tau, 1)
    K_v = [0.0 if rng.random() < 0.2 else k * rng.uniform(0.01, 1), k]
    K_p = [0.0 if rng.random() < 0.5 else about(k / tau, 1.5), 0.0]
    K_p[1] = K_p[0] * 3 if rng.random() < 0.8 else K_p[0]
    K_p[1] = max(K_p[1], about(k / tau, 1)) if K_p[0] == 0 and rng.random() < 0.7 else K_p[1]
    drag = 0.0 if rng.random() < 0.5 else about((b + 1e-3 * k) ** 2 / (4 * k), 1)
    hand = "" if rng.random() < 0.6 else f"[operator]\nmass = {about(m, 1)}\ndamping = {about(b + 0.01 * k, 1)}\n"
    b_c, m_c = about(2 * m * k / (T * (b + 0.01 * k)) if far else k, 1), about(m, 1)
    band = "[1.0, inf]" if far else f"[0.0, {0.1 / T}]"
    return (
        f'[device]\nmass = {m}\ndamping = {b}\nsample_time = {T}\nhold = "{hold}"\ndelay = {delay}\n{hand}'
        f"[gains]\nvelocity = {{ min = {K_v[0]}, max = {K_v[1]} }}\nposition = {{ min = {K_p[0]}, max = {K_p[1]} }}\n"
        f"[coupling]\ndamping = {{ min = {b_c / 10}, max = {b_c} }}\nmass = {{ min = {m_c / 10}, max = {m_c} }}\n"
        f"drag = {{ min = 0.0, max = {drag} }}\n[stability]\nband_hz = {band}\nsafety_factor = 1.2\n"
    )


UNDEFINED = -1.0
"""The margin where the device in the operator's hand has no positive resistance."""


def exact_margin(text: str, problem: Problem, values, omega: float):
    """Re Z_c minus what the two-port that has absorbed Z_h needs, over their size, with 50 digits."""
    s = DIGITS.i * DIGITS.number(omega)
    found, given = demanded(tomllib.loads(text), values[:2], s), offered(values[2:], s).real
    if found.resistance <= 0:
        return UNDEFINED
    need = problem.stability.safety_factor * found.required
    return float((given - need) / (abs(given) + abs(need)))


def designs(problem: Problem, rng: np.random.Generator, count: int):
    """Yield the corners of the bounds, K_p next to 0, K_v next to what Re G_hh > 0 needs, and random designs."""
    ranges = [getattr(problem.bounds, name) for name in ("velocity", "position", "damping", "mass", "drag")]
    tau, b = problem.device.loop_lag, problem.device.with_operator.damping
    K_v = tau * ranges[1].min - b * (1 + (problem.stability.band.min * tau) ** 2)
    if ranges[0].min < K_v < ranges[0].max:
        yield [K_v * (1 + 1e-9), ranges[1].min, *(r.max for r in ranges[2:])]
    for mask in range(32):
        yield [(r.max if mask >> i & 1 else r.min) for i, r in enumerate(ranges)]
        if ranges[1].min == 0 < ranges[1].max:
            corner = [(r.max if mask >> i & 1 else r.min) for i, r in enumerate(ranges)]
            yield [corner[0], ranges[1].max * 1e-9, *corner[2:]]
    for _ in range(count):
        yield [r.min + (r.max - r.min) * rng.random() for r in ranges]


@pytest.mark.night
@pytest.mark.parametrize("far", [False, True], ids=["omega -> 0", "omega -> inf"])
def test_a_theorem_speaks_exactly_where_no_design_meets_the_limit(far):
    """Where it refuses, corners and random designs fail in 50 digits; where it does not, a corner holds."""
    rng, refused = np.random.default_rng(3), 0
    for _ in range(300):
        text = random_request(rng, far)
        problem = parsed(text)
        omega = 1e12 / problem.device.sample_time if far else 1e-14 / problem.device.loop_lag
        theorem, edge = impossible(problem), problem.stability.band.min if far else omega
        margins = [
            exact_margin(text, problem, values, omega)
            if edge == omega or exact_margin(text, problem, values, edge) != UNDEFINED
            else UNDEFINED
            for values in designs(problem, rng, 10)
        ]
        assert (max(margins) < 1e-6) == (theorem is not None), (text, theorem, max(margins))
        refused += theorem is not None
    assert 60 < refused < 240


def test_lag_without_delay_has_its_resistance_theorem_on_every_band():
    """Re D = b + (K_v - tau K_p)/(1 + (omega tau)^2), at the band's lower edge."""
    gains = "[gains]\nvelocity = {{ min = 1.0, max = 10.0 }}\nposition = {{ min = {}, max = 1e6 }}\n"
    tau, omega = 5e-4, 2 * pi * 100.0
    limit = (2.0 * (1 + (omega * tau) ** 2) + 10.0) / tau
    for share, refused in ((1.001, True), (0.999, False)):
        text = LAG.format(2.0) + gains.format(limit * share) + "[stability]\nband_hz = [100.0, 200.0]\n"
        theorem = impossible(parsed(text))
        assert (theorem is not None) == refused
        if theorem is not None:
            assert f"below {limit:.4g} N/m" in theorem.advice


@pytest.mark.parametrize(
    ("hand", "named", "own"), [("", "b", 2.0), ("[operator]\nmass = 0.1\ndamping = 0.5\n", "(b + b_h)", 2.5)]
)
def test_a_least_operator_damps_too(hand, named, own):
    """Re D = b + b_h + K_v - tau K_p for omega -> 0, with tau = T/2."""
    gains = "[gains]\nvelocity = { min = 1.0, max = 20.0 }\nposition = { min = 3e5, max = 1e6 }\n"
    theorem = impossible(parsed(LAG.format(2.0) + hand + gains + "[stability]\nband_hz = [0.0, 10.0]\n"))
    assert f"needs K_v > tau K_p - {named}, at least {5e-4 * 3e5 - own:.4g} N s/m" in theorem.cause


@pytest.mark.parametrize(
    ("criterion", "narrower"), [("passive", "stability.band_hz"), ("hands", "the hands of [operator]")]
)
def test_without_repairs_the_advice_names_what_can_be_narrowed(criterion, narrower):
    coupling = "[coupling]\ndamping = { min = 1.0, max = 30.0 }\nmass = { min = 1e-3, max = 0.01 }\n"
    gains = "[gains]\nvelocity = { min = 100.0, max = 200.0 }\nposition = { min = 3e3, max = 1e4 }\n"
    problem = parsed(DEVICE + gains + coupling + f"[stability]\ncriterion = '{criterion}'\n")
    assert solve(problem, exhaustive=False).reason.endswith(f", or narrow {narrower}")


def test_the_command_lists_repairs_in_table_record_and_report(tmp_path):
    (tmp_path / "stuck.toml").write_text(for_passive_hands(QUICK["gains too high"]))
    done = run("solve", "stuck.toml", cwd=tmp_path, report=True)
    assert (done.returncode, done.stderr) == (ExitCode.FAILED, "")
    record = json.loads((tmp_path / "results/stuck/design.json").read_text())
    page = (tmp_path / "results/stuck/report.html").read_text()
    assert record["proved"]
    for repair in record["repairs"]:
        assert repair["needs"] in done.stdout and repair["needs"] in page
    assert "any one of these alone would do:" in done.stdout
    run("report", "results/stuck/design.json", "--out", "again", cwd=tmp_path)
    assert "<h2>Repairs</h2>" in (tmp_path / "again/report.html").read_text()


def test_a_sweep_looks_for_no_repairs(tmp_path, monkeypatch):
    from vctune.study.sweep import solve_point

    monkeypatch.setattr(repairing, "parameter_changes", None)
    assert solve_point(parsed(QUICK["gains too high"]))["status"] == "infeasible"


@pytest.mark.parametrize("band", ["[0.05, 100.0]", "[3.0, 7.0]", "[0.0, 500.0]"])
def test_a_narrower_stability_band_keeps_an_octave(band: str) -> None:
    """Every step of both edges, as README of the design promises."""
    text = for_passive_hands(DEVICE + f"[stability]\nband_hz = {band}\n")
    edges = [each for each in parameter_changes(tomllib.loads(text), parsed(text)) if "band_hz" in each.path]
    for edge in edges:
        for _, new in edge.steps({}):
            low, high = sorted((new, edge.other))
            assert high >= 2 * low * (1 - 1e-9)
    assert len(edges) == 2


def test_the_edge_that_a_theorem_at_0_hz_advises_is_where_the_coupling_offers_what_is_required() -> None:
    """There m_c^2 omega^2/b_c, next to 0 Hz all of Re Z_c, is the drag that is advised instead."""
    advice = impossible(parsed(THEOREMS["K_p > 0 from 0"].replace("[stability]", "drag = 0.0\n[stability]"))).advice
    drag, edge = (float(found) for found in re.findall(r"coupling.drag of (\S+) .* at least (\S+) Hz", advice)[0])
    assert (10.0 * 2 * pi * edge) ** 2 / 1.0 == pytest.approx(drag, rel=2e-3)


def test_the_coupling_that_a_theorem_towards_infinity_advises_is_just_enough_with_drag() -> None:
    """b_c + b_0 is what counts there: the drag that the bounds allow is not asked for again."""
    text = THEOREMS["b_c too small towards inf"].replace(
        "[stability]", "drag = { min = 0.0, max = 600.0 }\n[stability]"
    )
    least = float(re.search(r"coupling.damping.max to (\S+) ", impossible(parsed(text)).advice)[1])
    for factor, excluded in ((0.999, True), (1.001, False)):
        assert (impossible(parsed(text.replace("max = 5000.0", f"max = {factor * least}"))) is not None) == excluded


@pytest.mark.parametrize(
    ("filtered", "offered"),
    [
        ("[device.velocity]\nfilter_hz = 50.0\n", True),
        ("[device.velocity]\nfilter_coefficient = 0.5\n", False),
        ("[device.force_sensor]\nfilter_coefficient = 1.0\n", True),
        ("[device.force_sensor]\nsections = [[0.1, 0.0, 0.0, 1.0, -0.9, 0.0]]\n", False),
    ],
)
def test_no_other_rate_is_offered_where_coefficients_are_of_one(filtered, offered):
    text = DEVICE + filtered
    keys = {change.key for change in parameter_changes(tomllib.loads(text), parse_problem(text, "", "x"))}
    assert ("device.sample_time" in keys) is offered


NO_DRAG = {
    "device": {"mass": 7.0, "damping": 20.0, "sample_time": 0.002, "delay": 0.003},
    "coupling": {"drag": 0.0},
    "stability": {"band_hz": [0.2, 30.0]},
}


@pytest.mark.slow
def test_ctrl_c_keeps_the_repairs_that_were_found():
    def interrupted(stage: str) -> None:
        if stage.endswith("found"):
            signal.raise_signal(signal.SIGINT)

    file = vctune.problem(NO_DRAG)
    cut = with_repairs(file, solve(file.problem), interrupted)
    whole = with_repairs(file, solve(file.problem))
    assert repairing.REPAIRS in cut.cut and not whole.cut
    assert 0 < len(cut.repairs) < len(whole.repairs)


@pytest.mark.slow
def test_what_cannot_be_proved_is_answered_soon_with_repairs():
    """Without drag nothing opposes a drift in limp hands; the search for repairs ends before those of a long proof."""
    began = perf_counter()
    solved = vctune.solve(NO_DRAG)
    assert solved.judgement is None and perf_counter() - began < 20
    assert "coupling.drag" in {repair.key for repair in solved.repairs}
