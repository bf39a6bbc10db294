"""Uncertain devices: what is proved holds for every device of the box, and costs nothing where nothing is uncertain."""

from __future__ import annotations

import json
import re
from dataclasses import astuple, replace
from fractions import Fraction
from functools import cache
from itertools import product
from math import inf

import numpy as np
import pytest
from arithmetic import DOUBLES
from command import run
from conftest import ROOT, for_passive_hands, mostly_slow
from frequency import demanded, offered
from hypothesis import given
from hypothesis import strategies as st
from loop import Loop, radius

from vctune.analysis.demands import transparency_error
from vctune.design.bound.search import bound
from vctune.design.judging.judge import Status, judge
from vctune.design.prepared import pose
from vctune.design.search import optimum
from vctune.design.solve import solve
from vctune.design.uncertain import device_box
from vctune.document.reading import parse_problem
from vctune.document.schema.statement import device_table
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.problem import Uncertainty
from vctune.proof.outcome import Verdict

WIDE = "[uncertainty]\nmass = 0.1\ndamping = 0.5\ndelay = 0.2\n"
WORST = WIDE + 'objective = "worst"\n'
HELD = "[operator]\nmass = 0.2\ndamping = 1.0\n"
CASES = {
    "zoh": ("friction-wheel", WIDE),
    "lag": ("friction-wheel-paper", WIDE),
    "delay": ("cobot-wrist", WIDE),
    "delay-worst": ("cobot-wrist", WORST),
    "defaults": ("desktop", WIDE),
    "operator": ("friction-wheel", WIDE + HELD),
}
SOME = mostly_slow(CASES, ["zoh", "delay-worst"])


@cache
def problem(name, tables=""):
    text = (ROOT / "problems" / f"{name}.toml").read_text().split("[[experiment]]")[0]
    return parse_problem(for_passive_hands(text + tables), name, name)


@cache
def solved(name, tables=""):
    return solve(problem(name, tables))


decimals = st.floats(1e-6, 1e6).map(lambda x: float(f"{x:.6g}"))
shares = st.floats(0, 0.999).map(lambda x: float(f"{x:.4g}"))


@given(decimals, decimals, decimals, shares, shares, shares)
def test_a_box_has_its_edges_inside_to_the_last_digit(m, b, d, of_m, of_b, of_d):
    box = device_box(
        Device(m, b, 1e-3, d, "zoh"), Uncertainty((("mass", of_m), ("damping", of_b), ("delay", of_d)), "nominal")
    )
    for name, value, share in (("mass", m, of_m), ("damping", b, of_b), ("delay", d, of_d)):
        low, high = (Fraction(repr(value)) * (1 + sign * Fraction(repr(share))) for sign in (-1, 1))
        edges = Fraction(repr(getattr(box.low, name))), Fraction(repr(getattr(box.high, name)))
        assert low <= edges[0] <= edges[1] <= high
        assert edges[0] - low <= 4 * Fraction(2) ** -53 * low and high - edges[1] <= 4 * Fraction(2) ** -53 * high
    assert len(box.corners()) == 2 ** len(box.uncertain)


def test_what_cannot_move_is_no_uncertainty():
    for table in (
        "",
        "[uncertainty]\n",
        "[uncertainty]\nmass = 0.0\n",
        '[uncertainty]\ndelay = 0.9\nobjective = "worst"\n',
    ):
        assert problem("friction-wheel", table).uncertainty is None
    assert problem("cobot-wrist", "[uncertainty]\ndelay = 0.1\n").uncertainty is not None


@pytest.mark.parametrize("case", SOME)
def test_robustness_has_its_price(case):
    """The nominal design fails on some device of the box, whose proof costs an error (`test_claims` has the proof)."""
    given, found = problem(*CASES[case]), solved(*CASES[case])
    assert found.status is Status.CERTIFIED
    assert found.judgement.certificate.proved_ratio == given.stability.safety_factor
    certain = solve(replace(given, uncertainty=None)).judgement
    assert judge(given, certain.gains, certain.coupling).status is Status.VIOLATED
    if given.uncertainty.objective == "nominal":
        assert found.judgement.transparency.error > certain.error * (1 - 1e-5)  # both are rounded to decimals
        assert found.judgement.error == found.judgement.transparency.error


def worst_of_corners(given, judgement):
    """Return the greatest error of a design on the devices at the corners of its box."""
    corners = device_box(given.device, given.uncertainty).corners()
    return max(
        transparency_error(replace(given, device=device, uncertainty=None), *law_of(judgement)).error
        for device in corners
    )


def law_of(judgement):
    return judgement.gains, judgement.coupling


def test_the_worst_error_is_least_where_that_is_the_objective():
    given = problem("cobot-wrist", WORST)
    worst, nominal = (solved("cobot-wrist", tables).judgement for tables in (WORST, WIDE))
    assert worst.error == pytest.approx(worst_of_corners(given, worst), rel=1e-5)
    assert worst.error < 0.9 * worst_of_corners(given, nominal)
    assert worst.transparency.error >= nominal.transparency.error * (1 - 1e-6)


def stepped(given, law, hand=(0.0, 0.0, 0.0)):
    """Return the greatest spectral radius of the velocity loop on the devices at the corners of the box."""
    corners = device_box(given.device, given.uncertainty).corners()
    return max(radius(Loop(device_table(device), astuple(law), hand=hand), at_rest=True) for device in corners)


@pytest.mark.slow
def test_a_delay_may_cross_whole_samples():
    """K_v is stable up to a delay between 2 and 3 samples: the box is proved below and refuted above."""
    base = (
        "[device]\nmass = 1.0\ndamping = 1.0\nsample_time = 1e-3\ndelay = 1.6e-3\n[stability]\nmax_sensitivity = 30.0\n"
    )
    law = Gains(550.0, 0.0)
    for width, stable in ((0.1, True), (0.3, True), (0.8, False)):
        given = parse_problem(for_passive_hands(base + f"[uncertainty]\ndelay = {width}\nmass = 0.05\n"), "x", "x")
        outcome = judge(given, law, Coupling(1e4, 1e3, 0.0)).certificate.outcomes["stable"]
        assert (stepped(given, law) < 1) is stable
        assert outcome.verdict is (Verdict.PROVED if stable else Verdict.REFUTED)
        if not stable:
            assert radius(Loop(device_table(outcome.device), astuple(law)), at_rest=True) >= 1


def test_loops_in_the_hand_are_proved_on_every_device():
    """A K_p that a light operator's mass destabilises, with a hand that adds little damping, on the lightest device."""
    device = "[device]\nmass = 0.4\ndamping = 0.0001\nsample_time = 1e-3\n"
    given = parse_problem(device + "[operator]\nmass = 40.0\n[uncertainty]\nmass = 0.2\n", "x", "x")
    law = Gains(5.0, 20000.0)
    outcome = judge(given, law, Coupling(1e3, 1e2, 0.0)).certificate.outcomes["stable"]
    assert stepped(given, law, (40.0, 0.0, 0.0)) > 1
    assert outcome.verdict is Verdict.REFUTED


@cache
def bound_of_a_certain_device():
    best = solved("desktop").judgement
    return bound(pose(problem("desktop")), best, lambda gains, limit: None, gap=0.02, most_boxes=2e5).bound


@pytest.mark.night
@pytest.mark.parametrize("tables", [WORST, WIDE + HELD], ids=["worst", "operator"])
def test_no_admissible_design_is_below_the_bound(tables):
    given, best = problem("desktop", tables), solved("desktop", tables).judgement
    found = bound(pose(given), best, lambda gains, limit: None, gap=0.05, most_boxes=200_000)
    assert found.proved and found.improved is None
    assert best.error / 1.05 <= found.bound * (1 + 1e-9) and found.bound <= best.error
    assert found.bound > bound_of_a_certain_device()


def test_what_no_design_survives_is_proved_infeasible():
    """Of the wheel with a fixed K_v that only heavy devices stand."""
    given = replace(problem("friction-wheel", "[uncertainty]\nmass = 0.8\n"))
    bounds = given.bounds
    stiff = replace(given, bounds=replace(bounds, velocity=type(bounds.velocity)(300.0, 300.0)))
    found = solve(stiff)
    assert found.status is Status.INFEASIBLE and found.infeasibility.proved
    assert solve(replace(stiff, uncertainty=None)).status is Status.CERTIFIED


@pytest.fixture
def files(tmp_path):
    text = (ROOT / "problems" / "friction-wheel.toml").read_text().split("[[experiment]]")[0]
    (tmp_path / "wheel.toml").write_text(text.replace('"friction-wheel"', '"wheel"') + WIDE)
    return tmp_path


@pytest.mark.slow
def test_solve_check_and_report_tell_of_it(files):
    done = run("solve", "wheel.toml", cwd=files)
    assert done.returncode == 0, done.stderr
    folder = files / "results" / "wheel"
    record = json.loads((folder / "design.json").read_text())
    known = record["uncertainty"]
    assert known["box"] == {"mass": [0.36, 0.44], "damping": [1.0, 3.0]} and known["objective"] == "nominal"
    assert known["robust_error"] < known["worst_error"]
    assert record["certificate"]["min_ratio"] == pytest.approx(1.05, rel=1e-4)
    assert "worst error" in done.stdout and "0.36 to 0.44" in done.stdout
    assert run("report", folder / "design.json", cwd=files).returncode == 0
    assert "worst error" in (folder / "report.html").read_text()
    gains = (folder / "gains.toml").read_text()
    light = re.sub(r"(\[coupling\].*?mass = )(\S+)", lambda m: f"{m[1]}{0.9 * float(m[2])!r}", gains, flags=re.DOTALL)
    (files / "poor.toml").write_text(light)
    assert run("check", "wheel.toml", folder / "gains.toml", cwd=files).returncode == 0
    poor = run("check", "wheel.toml", "poor.toml", cwd=files)
    assert poor.returncode == 1 and "with mass " in poor.stdout


def test_a_study_may_sweep_over_it(files):
    (files / "study.toml").write_text('problem = "wheel.toml"\n[axes]\n"uncertainty.mass" = [0.0, 0.2, 1.5]\n')
    done = run("sweep", "study.toml", "--executor", "serial", "--format", "json", cwd=files)
    rows = [json.loads(line) for line in (files / "results" / "study" / "rows.jsonl").read_text().splitlines()[1:]]
    by_mass = {row["point"]["uncertainty.mass"]: row for row in rows}
    assert done.returncode == 0, done.stderr
    assert by_mass[0.0]["error"] < by_mass[0.2]["error"]
    assert by_mass[1.5]["status"] not in ("certified", "failed")


@pytest.mark.parametrize(
    ("tables", "band"),
    [
        ("sample_time = 1e-3\ndelay = 2e-4\n", (0.0, 300.0)),
        pytest.param("sample_time = 1e-3\nhold = 'lag'\n", (0.0, inf), marks=pytest.mark.slow),
    ],
    ids=["late", "whole axis"],
)
def test_bands_to_the_ends_of_the_axis(tables, band):
    """From 0 Hz on, in the hand of an operator, with a drag to choose: the conditions hold on every corner."""
    text = f"[device]\nmass = 0.4\ndamping = 2.0\n{tables}[coupling]\ndrag = {{ min = 0.0, max = 10.0 }}\n"
    text += f"[stability]\nband_hz = [{band[0]}, {band[1]}]\n"
    given = parse_problem(for_passive_hands(text + WIDE + HELD), "x", "x")
    found = solve(given)
    assert found.status is Status.CERTIFIED and found.judgement.coupling.drag > 0
    s = 2j * np.pi * np.geomspace(1e-5, min(band[1], 1e6), 4000)
    hand, (gains, coupling) = {"mass": 0.2, "damping": 1.0}, map(astuple, law_of(found.judgement))
    for device in device_box(given.device, given.uncertainty).corners():
        at = demanded({"device": device_table(device), "operator": hand}, gains, s, DOUBLES)
        assert (at.resistance > 0).all()
        assert (offered(coupling, s, DOUBLES).real >= 1.05 * (1 - 1e-6) * at.required).all()


@pytest.mark.slow
def test_the_peak_of_many_uncertain_numbers_is_that_of_the_loudest_vertex():
    """All 32 devices at the vertices of five numbers, of which the search tries ten."""
    text = (
        "[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 1e-3\ndelay = 3e-4\n"
        "[device.actuator]\nbandwidth_hz = 300.0\n[device.force_sensor]\nbandwidth_hz = 400.0\n"
        "[uncertainty]\nmass = 0.2\ndamping = 0.5\ndelay = 0.3\n"
        '"actuator.bandwidth_hz" = 0.3\n"force_sensor.bandwidth_hz" = 0.2\n[gains]\nvelocity = 90.0\nposition = 1e3\n'
        '[coupling]\ndamping = 40.0\nmass = 0.5\ndrag = 20.0\n[stability]\ncriterion = "passive"\nband_hz = [1, 60]\n'
    )
    problem = parse_problem(text, "x", "x")
    shares = dict(problem.uncertainty.half_widths)
    certain = replace(problem, uncertainty=None)

    def peak(signs):
        factors = {key: 1 + sign * share for sign, (key, share) in zip(signs, shares.items(), strict=True)}
        device = problem.device.with_numbers({key: problem.device.number(key) * f for key, f in factors.items()})
        return judge(replace(certain, device=device), *problem.fixed_design).peak_sensitivity

    peaks = [peak(signs) for signs in product((-1, 1), repeat=len(shares))]
    assert judge(problem, *problem.fixed_design).peak_sensitivity == pytest.approx(max(peaks), rel=1e-6)


def test_an_uncertain_delay_of_the_force_sensor_may_have_195_samples() -> None:
    text = "[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 1e-3\nforce_sensor = { delay = 0.15 }\n"
    text += '[uncertainty]\n"force_sensor.delay" = 0.3\n'
    assert dict(parse_problem(text, "late", "late").uncertainty.half_widths)["force_sensor.delay"] == 0.3


LATE = """[device]
mass = 1.092
damping = 2.952
sample_time = 2e-3
delay = 9.113e-3
[stability]
criterion = "passive"
[uncertainty]
mass = 0.2484
"""


def test_an_idle_design_is_passed_over_only_for_a_proved_one_that_moves(monkeypatch):
    """If its proof takes long; where no start uses the velocity loop, the proof goes on as long as it takes."""
    idle = solve(parse_problem(LATE, "late", "late")).judgement
    assert idle.idle
    monkeypatch.setattr(optimum, "IDLE_BOXES", 100)
    moving = solve(parse_problem(LATE, "late", "late")).judgement
    assert moving.status is Status.CERTIFIED and not moving.idle
    assert idle.error < moving.error < optimum.WORTH_INSTEAD * idle.error
    slow = solve(parse_problem(LATE + "[gains]\nvelocity = { min = 0.0, max = 1.0 }\n", "slow", "slow")).judgement
    assert slow.idle and slow.certificate.boxes > 100
