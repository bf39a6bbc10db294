"""Delays at whole samples, where the sensed force jumps: a microsecond does not decide whether a design is stable."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import Any

import numpy as np
import pytest
from conftest import mostly_slow
from random_devices import decades, decimal

from vctune.analysis.demands import sensitivity_maxima
from vctune.analysis.in_hands import least_ratios
from vctune.design.prepared import pose
from vctune.design.solve import solve
from vctune.design.variables import ranges
from vctune.design.verdict.design_record import design_record
from vctune.design.verdict.judge import Status, judge, least_ratio
from vctune.design.verdict.prices import with_prices
from vctune.document import reading
from vctune.document.reading import ProblemFile
from vctune.model.gains import Coupling, Gains, SpringDamper
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.parts import DELAYS
from vctune.model.problem import Problem
from vctune.model.sampled.hand_loop import offered
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.model.sampled.servo_in_hand import demand_of
from vctune.proof.claims.every_hand import prove_hands
from vctune.proof.claims.margins_of_claims import Design, hand_margin
from vctune.proof.claims.whole_samples import beside_whole_sample, sensed_force_jumps
from vctune.proof.device_box import DeviceBox
from vctune.proof.engine.interval import Verdict
from vctune.study.plane import Plane
from vctune.study.region import Kind, region

FIRM = Hands(Hand(0.0, 0.0, 0.0), Hand(0.5, 30.0, 3000.0))
SHORTER = (0.01, 1e-7, 0.0, -1e-7)
"""By what share of a sample a delay is shorter than whole samples."""


def problem_of(tables: dict[str, Any]) -> Problem:
    problem, faults = reading.pose(tables, "whole")
    assert problem is not None, faults
    return problem


def random_tables(number: int) -> dict[str, Any]:
    """Return a device at a whole number of samples of delay: parts, a slow sensor and criterion by chance."""
    rng = np.random.default_rng((31, number))
    T, mass, whole = decades(rng, -3.7, -2.7), decades(rng, -0.7, 0.7), int(rng.integers(1, 4))
    device: dict[str, Any] = {"mass": mass, "damping": decimal(mass / T * 10 ** rng.uniform(-3.5, -1.5))}
    device |= {"sample_time": T}
    late = decimal(T * rng.uniform(0, whole)) if rng.random() < 0.4 else 0.0
    device["delay"] = float(f"{whole * T - late:.15g}")
    sensor = {"delay": late} if late else {}
    if rng.random() < 0.25:
        sensor |= {"bandwidth_hz": decimal(rng.uniform(0.05, 0.4) / T)}
    device |= {"force_sensor": sensor} if sensor else {}
    if rng.random() < 0.3:
        device["velocity"] = {"from": "difference"}
    if rng.random() < 0.15:
        device["actuator"] = {"bandwidth_hz": decimal(rng.uniform(0.05, 0.4) / T)}
    criterion = str(rng.choice(["hands", "both", "passive"], p=[0.45, 0.45, 0.1]))
    high = 1 / (12 * (whole + 0.5) * T)
    stability = {"criterion": criterion, "band_hz": [decimal(high / 200), decimal(high)]}
    transparency = {"band_hz": [decimal(high / 200), decimal(high / 3)], "reference_impedance": decimal(mass * high)}
    return {"device": device, "stability": stability, "transparency": transparency}


def shorter(problem: Problem, share: float) -> Problem:
    """Return the problem of a delay that is shorter by a share of a sample."""
    device = problem.device
    delay = float(f"{device.delay - share * device.sample_time:.15g}")
    return replace(problem, device=replace(device, delay=delay))


@pytest.mark.parametrize("number", mostly_slow(range(200), [1]))
def test_one_microsecond_does_not_decide(number):
    whole = problem_of(random_tables(number))
    jumps = whole.hands_met is not None and sensed_force_jumps(whole.device, whole.hands_met)
    problems = [shorter(whole, share) for share in SHORTER]
    assert [len(pose(problem).cases) for problem in problems] == ([3, 2, 2, 3] if jumps else [1, 1, 1, 1])
    for made_for in problems:
        solved = solve(made_for, exhaustive=False)
        if solved.judgement is None or solved.status is not Status.CERTIFIED:
            assert not solved.judgement or solved.status is Status.UNDECIDED
            continue
        design = solved.judgement.gains, solved.judgement.coupling
        for other in problems:
            if other is made_for:
                continue
            if jumps and other is not problems[0]:
                assert judge(other, *design).status is Status.CERTIFIED
            # what touches a limit misses it by no more than the delay differs
            assert least_ratio_of(other, *design) > 1.05 * (1 - 0.05)
            assert -sensitivity_maxima(other, design[0]).value[0] < 2 * (1 + 0.05)


def least_ratio_of(problem: Problem, gains: Gains, coupling: Coupling) -> float:
    """Return the least ratio of a design by estimate, on the band and in hands, as far as they are to be met."""
    found = [worst.ratio for worst in least_ratios(problem, gains, coupling)]
    return min([*found, least_ratio(problem, gains, coupling)[0]] if problem.passive else found)


JUMPING = """
[device]
mass = 0.4
damping = 2.0
sample_time = 1e-3
delay = {}
[stability]
criterion = "hands"
band_hz = [0.5, 50.0]
[transparency]
band_hz = [0.5, 20.0]
reference_impedance = 8.0
"""


def jumping(delay: float, more: str = "") -> ProblemFile:
    text = JUMPING.format(delay) + more
    return ProblemFile(reading.parse_problem(text, "whole.toml", "whole"), text)


@pytest.fixture(scope="module")
def nearly_near():
    """A design of a delay that is nearly near: 0.94 of a sample."""
    return solve(jumping(9.4e-4).problem).judgement


@pytest.fixture(scope="module")
def just_below():
    """What is solved for 0.99 of a sample."""
    return solve(jumping(9.9e-4).problem)


def test_gains_that_are_stable_just_below_are_refused_with_the_delay(nearly_near):
    """The ratio is above 1 at 0.99 samples, far below at 1: the certificate says so at 0.99."""
    design = nearly_near.gains, nearly_near.coupling
    below, at = jumping(9.9e-4).problem, jumping(1e-3).problem
    own = min(worst.ratio for worst in least_ratios(below, *design))
    beyond = min(worst.ratio for worst in least_ratios(at, *design))
    assert beyond < 0.9 and own > 1.0
    judged = judge(below, *design)
    assert judged.status is Status.VIOLATED and "delay 0.001" in " ".join(judged.open_claims)
    assert judged.min_ratio == pytest.approx(beyond)


def test_the_record_names_the_delay_that_is_proved_too(just_below, nearly_near):
    record = design_record(jumping(9.9e-4), just_below)["certificate"]
    assert record["whole_sample"] == {"verdict": "proved", "samples": 1, "delay": 1e-3}
    assert nearly_near.certificate.beside == ()


@pytest.mark.parametrize(
    ("parts", "hands", "jumps"),
    [
        ({}, FIRM, True),
        ({"velocity": {"from": "difference", "filter_hz": 100.0}}, FIRM, True),
        ({}, replace(FIRM, high=replace(FIRM.high, mass=0.0)), False),
        ({"force_sensor": {"bandwidth_hz": 100.0}}, FIRM, False),
        ({"actuator": {"bandwidth_hz": 100.0}}, FIRM, False),
        ({"structure": {"handle_mass": 0.1, "frequency_hz": 60.0, "damping_ratio": 0.05}}, FIRM, False),
        ({"display": "impedance"}, FIRM, False),
    ],
)
def test_the_ratio_jumps_only_where_the_force_does(parts, hands, jumps):
    """R of the worst hands either side of a whole sample, from the same formulas: it is continuous, or it jumps."""
    table = {"mass": 0.4, "damping": 2.0, "sample_time": 1e-3, "delay": 1e-3} | parts
    problem = problem_of({"device": table, "stability": {"criterion": "hands"}})
    problem = replace(problem, hands=hands)
    assert sensed_force_jumps(problem.device, hands) is jumps
    at, below = (room_in_a_firm_hand(each) for each in (problem, shorter(problem, 1e-6)))
    assert (abs(at / below - 1) > 1e-3) is jumps


def room_in_a_firm_hand(problem: Problem) -> float:
    """Return |F|^2 (Re Z_c - R) of some gains at a third of Nyquist."""
    device, hand = problem.device, replace(problem.hands.high, stiffness=500.0)
    coupling = SpringDamper(0.1, 50.0) if device.kind.inverse else Coupling(100.0, 0.2, 1.0)
    gains = Gains(0.0, 0.0) if device.kind.inverse else Gains(100.0, 2000.0)
    plant = plant_in_hand(device, hand, delays_of(device), FLOATS)
    return float(hand_margin(plant, Design(device, gains, coupling), pi / 3, 1.0, FLOATS))


def test_the_delays_beside_a_whole_number_of_samples():
    table = {"mass": 1.0, "damping": 1.0, "sample_time": 1e-3}
    device = problem_of({"device": table}).device
    sensed = problem_of({"device": table | {"force_sensor": {"delay": 9.8e-4}}}).device
    for far in (0.0, 1e-5, 9.49e-4, 1.051e-3):
        assert beside_whole_sample(replace(device, delay=far), FIRM) == ()
    for near in (9.51e-4, 1.049e-3):
        delays = [other.delay for other in beside_whole_sample(replace(device, delay=near), FIRM)]
        assert delays == [9.999999e-4, 1e-3]
    assert [other.delay for other in beside_whole_sample(replace(device, delay=1e-3), FIRM)] == [9.999999e-4]
    assert [other.delay for other in beside_whole_sample(replace(device, delay=9.999999e-4), FIRM)] == [1e-3]
    others = beside_whole_sample(sensed, FIRM)
    assert [(other.delay, other.number("force_sensor.delay")) for other in others] == [(0.0, 9.999999e-4), (0.0, 1e-3)]
    others = beside_whole_sample(replace(sensed, delay=1.01e-3), FIRM)
    sums = [sum(other.number(key) or 0.0 for key in DELAYS) for other in others]
    assert sums == pytest.approx([1.9999999e-3, 2e-3], rel=1e-14)
    assert all(other.number("force_sensor.delay") == 9.8e-4 for other in others)


@pytest.mark.parametrize(
    ("delay", "half_width", "low", "high"),
    [
        (9.0e-4, 0.05, 8.55e-4, 9.45e-4),
        (9.2e-4, 0.055, 8.694e-4, 1e-3),
        (1.1e-3, 0.05, 9.999999e-4, 1.155e-3),
        (1.0e-3, 0.1, 9e-4, 1.1e-3),
    ],
)
def test_an_uncertain_delay_reaches_whole_samples(delay, half_width, low, high):
    box = pose(jumping(delay, f"[uncertainty]\ndelay = {half_width}\n").problem).box
    assert box is not None
    assert (box.low.delay, box.high.delay) == pytest.approx((low, high), rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("low", [9e-4, 1e-3])
def test_an_uncertain_delay_is_proved_at_the_whole_samples_that_end_it(nearly_near, low):
    """The least ratio of gains made for 0.94 of a sample is below 1 at the end of the box alone."""
    design = Design(jumping(9.5e-4).problem.device, nearly_near.gains, nearly_near.coupling)
    posed = pose(jumping(9.5e-4).problem)
    ends = (replace(design.device, delay=delay) for delay in sorted((low, 9.5e-4)))
    box = DeviceBox(design.device, *ends)
    demands = replace(posed.demands, factor=1.0)
    assert prove_hands(design, demands, replace(box, high=replace(box.high, delay=9.999e-4))).verdict is Verdict.PROVED
    refuted = prove_hands(design, demands, replace(box, high=replace(box.high, delay=1e-3)))
    assert refuted.verdict is Verdict.REFUTED and refuted.device is not None
    assert refuted.device.delay == pytest.approx(1e-3, rel=1e-6)


def test_a_region_is_that_of_both_delays():
    """No cell is feasible that the whole number refutes, and corners of feasible cells are certified."""
    more = "[gains]\nvelocity = { min = 108.0, max = 112.0 }\nposition = 12000.0\n"
    more += "[coupling]\ndamping = { min = 165.0, max = 170.0 }\nmass = 0.3\ndrag = 3.0\n"
    problem, whole = (jumping(delay, more).problem for delay in (9.9e-4, 1e-3))
    edges = (np.linspace(108, 112, 5), np.linspace(165, 170, 5))
    squares = np.array([[0, 4, 0, 4]]).T
    found = [region(each, Plane((0, 2), edges, ranges(each)), squares) for each in (problem, whole)]
    feasible = [{tuple(cell) for cell in each.squares[:, each.kinds == Kind.FEASIBLE].T} for each in found]
    assert feasible[0] and feasible[0] <= feasible[1]


@pytest.mark.parametrize("delay", mostly_slow([9.6e-4, 9.9e-4, 1e-3], [9.9e-4]))
def test_less_delay_than_whole_samples_is_worth_nothing_next_to_them(delay, just_below):
    """The demands hold at the whole number, whether the file states that or a little less."""
    solved = with_prices(just_below if delay == 9.9e-4 else solve(jumping(delay).problem))
    assert solved.prices is not None
    prices = {price.key: price.change for price in solved.prices}
    assert abs(prices["device.delay"]) < 1e-6
    assert -0.02 < prices["device.sample_time"] < -1e-3


def test_the_certificate_keeps_those_of_the_other_delays(just_below):
    judged = just_below.judgement
    below, at = judged.certificate.beside
    assert (below.design.device.delay, at.design.device.delay) == (9.999999e-4, 1e-3)
    assert below.verdict is at.verdict is Verdict.PROVED
    assert judged.certificate.boxes > below.boxes + at.boxes
    for delay in (9.999999e-4, 1e-3):
        assert judge(jumping(delay).problem, judged.gains, judged.coupling).status is Status.CERTIFIED


def test_neither_side_is_the_safe_one():
    """Gains made for a device that is said to be exact at a sample grow in a firm hand where it is a little less."""
    whole = problem_of(random_tables(5))
    alone = replace(whole, device=replace(whole.device, delay=whole.device.delay * (1 + 0.051)))
    solved = solve(alone).judgement
    at, below = (
        min(worst.ratio for worst in least_ratios(each, solved.gains, solved.coupling))
        for each in (whole, shorter(whole, 1e-7))
    )
    assert below < 0.95 and at > 1.0


def test_the_least_ratio_of_a_quick_servo_is_that_of_the_worst_of_its_uncertain_delays():
    """Its sensed acceleration has a peak a part of its lag below a whole number of samples, between all corners."""
    T, whole = 8e-4, 9
    quick = problem_of({
        "device": {"sample_time": T, "servo": {"delay": whole * T, "bandwidth_hz": 8000.0, "order": 2}},
        "operator": {"mass": {"min": 0.05, "max": 0.06}, "damping": {"min": 0.0, "max": 0.1},
                     "stiffness": {"min": 400.0, "max": 410.0}},
        "coupling": {"damping": 32.0, "mass": 15.0, "drag": 3000.0},
        "uncertainty": {"servo.delay": 0.01},
    })  # fmt: skip
    coupling, theta = quick.fixed_design[1], np.linspace(0.0, np.pi, 2001)[1:-1]
    given = np.asarray(offered(coupling, quick.device, theta, FLOATS))

    def least(device):
        asked = demand_of(device, quick.hands_met).at(theta)
        return np.min(given[asked > 0] / asked[asked > 0])

    delays = (whole - np.linspace(0.0, 0.09, 91)) * T
    ratios = [least(quick.device.with_numbers({"servo.delay": float(delay)})) for delay in delays]
    assert np.argmin(ratios) not in (0, len(ratios) - 1)
    assert min(least(case.device) for case in pose(quick).hand_cases) == pytest.approx(min(ratios), rel=0.02)
