"""Uncertain devices: what is proved holds for every device of the box, and costs nothing where nothing is uncertain."""

from __future__ import annotations

import json
import re
from dataclasses import astuple, replace
from fractions import Fraction
from functools import cache
from itertools import product

import numpy as np
import pytest
from command import run
from conftest import ROOT, for_passive_hands, mostly_slow
from dense import conditions_surplus, error, loops, spectral_radius, surpluses
from hypothesis import given
from hypothesis import strategies as st
from random_problems import corners, on_devices, random_devices

from vctune.design.bound.search import bound
from vctune.design.judging.judge import Status, judge
from vctune.design.prepared import pose
from vctune.design.search import optimum
from vctune.design.solve import solve
from vctune.design.uncertain import device_box
from vctune.document.reading import parse_problem
from vctune.document.text.errors import InputError
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
FEW = 400
EXACT = 1e-9
"""Rounding of the oracle."""


@cache
def problem(name, tables=""):
    text = (ROOT / "problems" / f"{name}.toml").read_text().split("[[experiment]]")[0]
    return parse_problem(for_passive_hands(text + tables), name, name)


@cache
def solved(name, tables=""):
    return solve(problem(name, tables))


def numbers(judgement):
    return np.array(astuple(judgement.gains) + astuple(judgement.coupling))


def failing(given, design, devices):
    """Return which devices fail a demand."""
    return ~(surpluses(given, on_devices(given, design, devices)) >= -EXACT).all(axis=0)


def errors(given, design, devices):
    return error(given, on_devices(given, design, devices), 2001)


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
def test_a_robust_design_holds_on_every_device_and_a_nominal_one_does_not(case):
    """Random devices of the box and its vertices, judged by plain complex arithmetic."""
    given, found = problem(*CASES[case]), solved(*CASES[case])
    assert found.status is Status.CERTIFIED
    assert found.judgement.certificate.proved_ratio == given.stability.safety_factor
    devices = np.hstack((corners(given), random_devices(given, FEW, np.random.default_rng(7))))
    assert not failing(given, numbers(found.judgement), devices).any()
    nominal = solve(replace(given, uncertainty=None)).judgement
    assert failing(given, numbers(nominal), devices).mean() > 0.5


@pytest.mark.parametrize("case", SOME)
def test_robustness_has_its_price(case):
    given, found = problem(*CASES[case]), solved(*CASES[case])
    design = numbers(found.judgement)
    on_corners = errors(given, design, corners(given))
    if given.uncertainty.objective == "nominal":
        certain = solve(replace(given, uncertainty=None)).judgement
        assert found.judgement.transparency.error > certain.error * (1 - 1e-5)  # both are rounded to decimals
        assert found.judgement.error == found.judgement.transparency.error
    else:
        assert found.judgement.error == pytest.approx(on_corners.max(), rel=1e-5)


def test_the_worst_error_is_least_where_that_is_the_objective():
    given = problem("cobot-wrist", WORST)
    worst, nominal = (solved("cobot-wrist", tables).judgement for tables in (WORST, WIDE))
    assert (
        errors(given, numbers(worst), corners(given)).max()
        < 0.9 * errors(given, numbers(nominal), corners(given)).max()
    )
    assert worst.transparency.error >= nominal.transparency.error * (1 - 1e-6)


def test_operator_uncertainty_and_drag_combine():
    """From 0 Hz on, with a delay, in the hand of an operator, with a drag to choose."""
    text = (ROOT / "problems" / "friction-wheel.toml").read_text().split("[[experiment]]")[0]
    text = text.replace("sample_time = 1e-3", "sample_time = 1e-3\ndelay = 2e-4").replace(
        "[0.5, 100.0]", "[0.0, 300.0]"
    )
    text = text.replace("[coupling]", "[coupling]\ndrag = { min = 0.0, max = 10.0 }")
    given = parse_problem(for_passive_hands(text + WIDE + HELD), "x", "x")
    found = solve(given)
    assert found.status is Status.CERTIFIED and found.judgement.coupling.drag > 0
    seen = replace(given, stability=replace(given.stability, band=replace(given.stability.band, min=1e-5)))
    devices = np.hstack((corners(given), random_devices(given, FEW, np.random.default_rng(5))))
    assert not failing(seen, numbers(found.judgement), devices).any()


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
        design = np.array([550.0, 0.0, 1e4, 1e3, 0.0])
        radii = spectral_radius(on_devices(given, design, corners(given)))
        assert bool(radii.max() < 1) is stable
        assert outcome.verdict is (Verdict.PROVED if stable else Verdict.REFUTED)
        if not stable:
            alone = np.array([[outcome.device.mass], [outcome.device.damping], [outcome.device.delay]])
            assert spectral_radius(on_devices(given, design, alone))[0] >= 1


def test_loops_in_the_hand_are_proved_on_every_device():
    """A K_p that a light operator's mass destabilises, with a hand that adds little damping, on the lightest device."""
    device = "[device]\nmass = 0.4\ndamping = 0.0001\nsample_time = 1e-3\n"
    given = parse_problem(device + "[operator]\nmass = 40.0\n[uncertainty]\nmass = 0.2\n", "x", "x")
    design = np.array([5.0, 20000.0, 1e3, 1e2, 0.0])
    in_hand = loops(on_devices(given, design, corners(given)))[1]
    outcome = judge(given, Gains(*design[:2]), Coupling(*design[2:])).certificate.outcomes["stable"]
    unstable = spectral_radius(in_hand).max() >= 1
    assert (outcome.verdict is Verdict.REFUTED) is bool(unstable)


@cache
def bound_of_a_certain_device():
    best = solved("desktop").judgement
    return bound(pose(problem("desktop")), best, lambda gains, limit: None, gap=0.02, most_boxes=2e5).bound


@pytest.mark.slow
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


def test_a_region_is_refused(files):
    done = run("region", "wheel.toml", cwd=files)
    assert done.returncode == 2 and "uncertainty: a region is proved for one device" in done.stderr


def test_a_study_may_sweep_over_it(files):
    (files / "study.toml").write_text('problem = "wheel.toml"\n[axes]\n"uncertainty.mass" = [0.0, 0.2, 1.5]\n')
    done = run("sweep", "study.toml", "--executor", "serial", "--format", "json", cwd=files)
    rows = [json.loads(line) for line in (files / "results" / "study" / "rows.jsonl").read_text().splitlines()[1:]]
    by_mass = {row["point"]["uncertainty.mass"]: row for row in rows}
    assert done.returncode == 0, done.stderr
    assert by_mass[0.0]["error"] < by_mass[0.2]["error"]
    assert by_mass[1.5]["status"] not in ("certified", "failed")


@pytest.mark.slow
def test_bands_to_the_ends_of_the_axis():
    """Hold "lag" on [0, inf] with free drag: every device, and in the hand of an operator."""
    text = (
        "[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 1e-3\nhold = 'lag'\n"
        "[coupling]\ndrag = { min = 0.0, max = 5.0 }\n[stability]\nband_hz = [0.0, inf]\n"
    )
    for tables in (WIDE, WIDE + HELD):
        given = parse_problem(for_passive_hands(text + tables), "x", "x")
        found = solve(given)
        assert found.status is Status.CERTIFIED
        ends = replace(given.stability.band, min=1e-4, max=1e7)
        far = replace(given, stability=replace(given.stability, band=ends))
        devices = np.hstack((corners(given), random_devices(given, FEW, np.random.default_rng(5))))
        assert conditions_surplus(far, on_devices(far, numbers(found.judgement), devices)).min() >= -1e-6


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


@pytest.mark.parametrize("share, refused", [(0.3, False), (0.4, True)])
def test_an_uncertain_delay_of_the_force_sensor_has_at_most_200_samples(share: float, refused: bool) -> None:
    """150 sample times and a share of them."""
    text = "[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 1e-3\nforce_sensor = { delay = 0.15 }\n"
    text += f'[uncertainty]\n"force_sensor.delay" = {share}\n'
    if refused:
        with pytest.raises(InputError, match=r"force_sensor\.delay: 0\.15 s is up to 210 sample times"):
            parse_problem(text, "late", "late")
    else:
        assert dict(parse_problem(text, "late", "late").uncertainty.half_widths)["force_sensor.delay"] == share


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
