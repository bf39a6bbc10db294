"""Impedance displays: published limits, discs against hands, loops in exact time, search and region in closed form."""

from __future__ import annotations

from dataclasses import astuple, replace
from math import inf, pi

import numpy as np
import pytest
from command import check_files
from loop import Loop, Triple, radius
from loop import seen as answer
from pushed_handle import Stepped
from scipy.optimize import minimize_scalar

import vctune
from vctune.analysis.demands import transparency_error
from vctune.analysis.feel import feel
from vctune.analysis.in_hands import least_ratios_in_any_hand
from vctune.analysis.loops_in_hands import loops_in_hands
from vctune.design.check import CheckVerdict
from vctune.design.judging.judge import Status, judge
from vctune.design.prepared import pose
from vctune.design.records.design import record_of
from vctune.design.records.felt import in_hand_record
from vctune.design.solve import solve
from vctune.document.building import problem as problem_of
from vctune.document.schema.statement import device_table
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import Gains, SpringDamper
from vctune.model.hands import Hand
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.parts import Actuator, Structure, VelocityEstimate
from vctune.model.problem import HUMAN_HANDS
from vctune.model.sampled.any_hand import any_hand
from vctune.model.sampled.hand_loop import offered
from vctune.model.sampled.plant_in_hand import delays_of
from vctune.proof.certificate import certify
from vctune.proof.enclosures.intervals import ENCLOSURES, Enclosure, decimal
from vctune.proof.outcome import Verdict
from vctune.report.page import report_files

B, T = 0.8, 1e-3


def display(**numbers) -> Device:
    parts = {"velocity": VelocityEstimate("difference"), "display": "impedance"} | numbers
    return Device(**({"mass": 0.1, "damping": B, "sample_time": T} | parts))


def arm(device: Device | None = None, *, criterion: str = "passive", factor: float = 1.0, **tables):
    device = device or display()
    stated = {"mass": device.mass, "damping": device.damping, "sample_time": device.sample_time, "delay": device.delay}
    document = {"device": {"display": "impedance", **stated}} | tables
    document["stability"] = {"criterion": criterion, "safety_factor": factor}
    found = problem_of(document).problem
    return replace(found, device=replace(found.device, **{part: getattr(device, part) for part in PARTS}))


PARTS = "velocity", "actuator", "structure", "display"


def verdict(device: Device, coupling: SpringDamper, K_v: float = 0.0) -> Verdict:
    problem = arm(device)
    return certify(Design(device, Gains(K_v, 0.0), coupling), pose(problem).demands).verdict


LIMITS = [
    (T, 0.0, 0.0, 1600.0),
    (2 * T, 0.0, 0.0, 800.0),
    (5 * T, 0.0, 0.0, 320.0),
    (T, 0.0, 0.2, 1200.0),
    (T, 1.0, 0.0, 400.0),
    (T, 2.0, 0.0, 1600.0 / 9),
    (T, 0.5, 0.0, 640.0),  # a part of a sample turns the aliases against each other: not 2 b/(T (1 + d)^2) = 711
    (T, 0.25, 0.0, 1600.0 / (1.25**2 + 0.25 * 0.75)),
]


@pytest.mark.parametrize(("sample_time", "late", "b_c", "k_c"), LIMITS)
def test_the_limit_in_any_passive_hand_is_the_published_one(sample_time, late, b_c, k_c):
    device = display(sample_time=sample_time, delay=late * sample_time)
    ratio = least_ratios_in_any_hand(device, Gains(0.0, 0.0), SpringDamper(b_c, k_c))[0].ratio
    assert ratio == pytest.approx(1, abs=1e-9)
    assert verdict(device, SpringDamper(b_c, k_c * (1 - 1e-6))) is Verdict.PROVED
    assert verdict(device, SpringDamper(b_c, k_c * (1 + 1e-6))) is Verdict.REFUTED


def test_half_a_sample_of_delay_costs_more_than_its_size():
    """In a hand whose reactance turns three aliases to where they ask for most, less than 2 b/(T (1 + d)^2) grows.

    By Foster's theorem there is a lossless hand of any reactance at single frequencies: a mass and two resonators here.
    """
    late, theta = 0.5, 0.05
    omega, sampling = theta / T, 2 * pi / T
    poles = np.array([0.9, 1.0]) * sampling
    aliases = np.array([omega, sampling - omega, sampling + omega])
    turns = (1 + late) * theta + 2 * pi * late * np.array([0, -1, 1])
    reactance = B / np.tan(turns / 2) * np.array([1, -1, 1])
    shapes = np.column_stack([aliases, *(aliases / (pole**2 - aliases**2) for pole in poles)])
    M, *springs = np.linalg.solve(shapes, reactance - aliases * 0.1)  # the device's own mass is 0.1 kg
    assert min(M, *springs) > 0
    resonators = tuple((k / pole**2, 0.0, k) for k, pole in zip(springs, poles, strict=True))
    too_kind = 2 * B / (T * (1 + late) ** 2)
    held = loop_of(display(delay=late * T), Hand(M, 0.0, 0.0), resonators)
    G = answer(held, np.exp(1j * theta))
    limit = (1 - np.cos(theta)) / (T * -G.real)
    assert 640 < limit < 660 < too_kind
    for k_c, grows in ((0.5 * (limit + too_kind), True), (639.0, False)):
        lacking = (G + (1 - np.exp(-1j * theta)) / (k_c * T)).imag  # a lossless environment makes up for it
        spring, mass = np.tan(theta / 2) * 2 / (T * -lacking), T / (2 * np.tan(theta / 2) * lacking)
        world = (mass, 0.0, 0.0) if lacking > 0 else (0.0, 0.0, spring)
        assert (radius(replace(held, coupling=(0.0, k_c), world=world)) > 1 + 1e-6) == grows


def loop_of(device: Device, hand: Hand, resonators: tuple[Triple, ...] = (), K_v: float = 0.0) -> Loop:
    """Return the loop of the oracles; what its environment sees is y over a force that is not rendered."""
    return Loop(device_table(device), (K_v, 0.0), (0.0, 0.0), astuple(hand), resonators=resonators)


def disc(device: Device, theta: np.ndarray):
    delays = delays_of(device)
    return any_hand(device, delays.loop, theta, FLOATS, fractional=delays.loop_fractional)


DEVICES = [
    display(),
    display(delay=0.35 * T),
    display(delay=1.6 * T, actuator=Actuator(300.0, 1)),
    display(structure=Structure(0.04, 60.0, 0.05)),
    display(delay=0.7 * T, structure=Structure(0.03, 180.0, 0.1), actuator=Actuator(500.0, 1)),
]


def test_the_aliases_that_are_not_summed_are_enclosed() -> None:
    """A million aliases of an actuator that is far quicker than the sampling: (r - Re c)/s^2 is in its enclosure."""
    device = display(actuator=Actuator(500.0 / T, 1))
    theta, delays = np.array([0.3, 1.5, 3.0]), delays_of(device)
    given = device.converted(decimal), delays.loop, Enclosure(theta), ENCLOSURES
    short = any_hand(*given, fractional=delays.loop_fractional).short
    at = theta[:, None] + 2 * pi * np.arange(-500_000, 500_001)
    A = 1 / (1 + 1j * at / (2 * pi * 500.0))
    true = ((np.abs(A) - (A * np.exp(-1j * theta[:, None])).real) * (2 / at) ** 2).sum(axis=1) / (2 * B)
    assert (np.abs(true - short.mid) <= short.rad).all()


@pytest.mark.parametrize("device", DEVICES)
def test_every_hand_answers_within_the_disc_and_at_low_frequencies_some_next_to_its_edge(device):
    random = np.random.default_rng(5)
    theta = np.array([0.05, 0.5, 1.5, 2.5, 3.1])
    seen = disc(device, theta)
    c = seen.centre.re + 1j * seen.centre.im
    sine2 = np.sin(theta / 2) ** 2
    r = np.sqrt(np.maximum((c * c.conjugate()).real - seen.beyond * sine2, 0))
    r = np.where(r > 0, r, seen.short * sine2 + c.real)
    nearest = np.zeros(theta.size)
    for _ in range(120):
        hand = Hand(
            random.choice([0, 10 ** random.uniform(-3, 1)]), 0.0, random.choice([0, 10 ** random.uniform(0, 6)])
        )
        resonators = [
            (m := 10 ** random.uniform(-3, 0), random.choice([0, 0.3]), m * (random.uniform(0.1, 8) * pi / T) ** 2)
            for _ in range(random.integers(0, 3))
        ]
        G = answer(loop_of(device, hand, tuple(resonators)), np.exp(1j * theta))
        share = np.abs(G - c) / r
        nearest = np.maximum(nearest, share)
        assert (share <= 1 + 1e-9).all()
    assert nearest[0] > 0.99  # above, several aliases have to be turned at once


def test_the_best_coupling_is_that_of_the_closed_form():
    """Without delay any passive hand asks for b_c + k_c T/2 <= b/f: the best point of that line is one search."""
    factor = 1.2
    for middle in (3.0, 40.0, 150.0):
        tables = {
            "transparency": {"band_hz": [middle / 3, middle * 3], "weights": {"admittance": 0.0, "tracking": 0.0}}
        }
        problem = arm(factor=factor, **tables)
        solved = solve(problem)
        best = solved.judgement.coupling

        def error(share, problem=problem):
            total = B / factor
            coupling = SpringDamper((1 - share) * total, share * total * 2 / T)
            return pose(problem).error(Gains(0.0, 0.0), coupling)

        found = minimize_scalar(error, bounds=(1e-3, 1), method="bounded", options={"xatol": 1e-9})
        least = min(found.fun, error(1.0))
        assert solved.judgement.error == pytest.approx(least, rel=3e-4)
        assert best.damping + best.stiffness * T / 2 <= B / factor


@pytest.mark.parametrize(
    ("environment", "open_"), [({}, 0.031), ({"environment": {"stiffness": inf}}, 0.03)], ids=["any", "wall"]
)
def test_the_region_is_a_triangle(environment, open_):
    """Of Colgate and Schenkel: b > k T/2 + b_c, for walls as for every environment."""
    document = {
        "device": {"display": "impedance", "mass": 0.1, "damping": B, "sample_time": T},
        "coupling": {"stiffness": {"min": 1.0, "max": 2500.0}, "damping": {"min": 0.0, "max": 1.0}},
        "stability": {"safety_factor": 1.0},
    }
    found = vctune.region(document | environment, resolution=1 / 64)
    record, spare = found.record(), {"feasible": set(), "infeasible": set(), "undecided": set()}
    x, y = (np.array(record["edges"][axis]) for axis in "xy")
    for left, right, low, high, kind, _ in record["cells"]:
        corners = (x[left], y[low]), (x[right], y[high])
        spare[kind] |= {k * T / 2 + b < B for b, k in corners}
    assert spare == {"feasible": {True}, "infeasible": {False}, "undecided": {True, False}}
    assert found.areas["undecided"] < open_


def test_a_device_without_damping_is_refused_in_any_passive_hand():
    problem = arm(display(damping=0.0))
    solved = solve(problem)
    assert solved.status is Status.INFEASIBLE
    assert "device.damping is 0" in solved.reason


@pytest.mark.slow
def test_a_device_without_damping_needs_hands_with_damping():
    """Without any damping, a handle that swings on the spring of a hand never settles when the environment is free."""
    undamped = solve(arm(display(damping=0.0), criterion="hands"))
    assert undamped.status is Status.INFEASIBLE and undamped.optimality is not None and undamped.optimality.proved
    hands = {"damping": {"min": 2.0, "max": 30.0}}
    assert not proved_infeasible(solve(arm(display(damping=0.0), criterion="hands", operator=hands)))
    assert solve(arm(display(damping=1e-6), criterion="hands", operator=hands)).status is Status.CERTIFIED


def proved_infeasible(solved) -> bool:
    return solved.infeasibility is not None and solved.infeasibility.proved


def test_what_no_design_changes_is_no_part_of_the_error():
    assert arm().counted == ("coupling",)
    assert "admittance" in arm(gains={"velocity": {"min": 0.0, "max": 2.0}}).counted
    found = solve(arm()).judgement
    assert found.error == pytest.approx(found.transparency.coupling)
    twice = judge(arm(), Gains(0, 0), SpringDamper(found.coupling.damping / 2, found.coupling.stiffness / 2))
    assert twice.error == pytest.approx(2 * found.error)  # as soft again: the device's own mass does not hide it
    table = {"display": "impedance", "mass": 0.06, "damping": 0.1, "sample_time": 1e-3}
    for weight, apart in ((1.0, ["admittance", "tracking"]), (0.0, None)):  # 0 removes a term
        file = problem_of({"device": table, "transparency": {"weights": {"coupling": weight}}})
        assert record_of(file, solve(file.problem)).transparency.apart == apart


def test_uncertain_damping_counts_with_its_least():
    tables = {"uncertainty": {"damping": 0.25}}
    solved = solve(arm(**tables))
    assert solved.status is Status.CERTIFIED
    best = solved.judgement.coupling
    assert best.damping + best.stiffness * T / 2 == pytest.approx(0.75 * B, rel=1e-3)


@pytest.mark.advice
def test_a_gains_file_without_gains_is_checked(tmp_path):
    device = f'[device]\ndisplay = "impedance"\nmass = 0.1\ndamping = {B}\nsample_time = {T}\n'
    (tmp_path / "arm.toml").write_text(device + "[stability]\nsafety_factor = 1.0\n")
    for name, stiffness in (("soft", 1199.0), ("stiff", 1201.0)):
        (tmp_path / f"{name}.toml").write_text(f"[coupling]\ndamping = 0.2\nstiffness = {stiffness}\n")
    passed, failed = check_files([tmp_path / "arm.toml", tmp_path / "soft.toml", tmp_path / "stiff.toml"])
    assert passed.verdict is CheckVerdict.PASSED
    assert "in any passive hand up to Nyquist" in passed.message
    assert failed.verdict is CheckVerdict.FAILED
    chosen = next(repair for repair in failed.finding.repairs if repair.chooses)
    assert chosen.size < 0.01 and str(chosen) in failed.message
    assert "drag" not in failed.message


def test_the_report_of_an_impedance_display(tmp_path):
    solved = vctune.solve("problems/delta-4khz.toml")
    made = report_files(record_of(problem_of("problems/delta-4khz.toml"), solved), tmp_path)
    assert {path.stem for path in made} == {"report", "any-hand", "impedance", "transparency"}
    page = made[tmp_path / "report.html"].replace("\u202f", " ")
    stiffest = solved.judgement.coupling.stiffness
    assert f"A wall may be as stiff as {stiffest!r} N/m" in page and 3231 < stiffest < 3233
    assert "Re 1/<i>Z</i><sub>c</sub>" in page
    assert "device without a loop by" not in page


def test_a_wall_feels_as_stiff_as_the_coupling_and_free_motion_as_the_device():
    device, coupling = display(), SpringDamper(0.0, 1000.0)
    felt = feel(device, Gains(0.0, 0.0), coupling)
    assert felt.mass == pytest.approx((0.1, 0.1), rel=1e-9)
    assert felt.damping == pytest.approx((B, B), rel=1e-9)
    table = {"display": "impedance", "mass": 0.1, "damping": B, "sample_time": T}
    wall = Stepped(table, (0.0, 0.0), (0.0, 1000.0), (0.0, 0.0, inf), 2 * pi * 10.0).felt()
    assert felt.stiffness == pytest.approx(2 * pi * 10.0 * abs(wall), rel=1e-7)


@pytest.mark.parametrize("count", [4, pytest.param(12, marks=pytest.mark.slow)])
def test_where_the_coupling_drives_no_multiple_of_R_is_asked_for(count):
    """Behind two slow low-passes Re 1/Z_c is negative somewhere; what is proved is at least R there, too."""
    device, random, driving = display(velocity=VelocityEstimate("difference", 20.0, 2)), np.random.default_rng(9), 0
    assert device.coupling_may_drive and not display().coupling_may_drive
    where = loops_in_hands(device, HUMAN_HANDS)
    required = where.required(Gains(0.0, 0.0)).max(axis=0)
    for _ in range(count):
        coupling = SpringDamper(float(10 ** random.uniform(-1, 1)), float(10 ** random.uniform(0, 2)))
        given = offered(coupling, device, where.theta, FLOATS)
        driving += given.min() < 0
        judged = judge(arm(device, criterion="hands", factor=1.5), Gains(0.0, 0.0), coupling)
        assert judged.status is not Status.CERTIFIED or (given >= required).all()
    assert driving > count / 6


WEIGHTS = {"admittance": 2.0, "tracking": 3.0, "coupling": 0.5}
LOOSE = {"handle_mass": 0.02, "frequency_hz": 80.0, "damping_ratio": 0.05}


@pytest.mark.parametrize("coupled", [True, False])
@pytest.mark.parametrize(
    ("structure", "free", "counted"),
    [
        ({}, False, {"coupling"}),
        ({}, True, {"admittance", "coupling"}),
        ({"structure": LOOSE}, False, {"coupling"}),
        ({"structure": LOOSE}, True, {"admittance", "tracking", "coupling"}),
    ],
    ids=["rigid, no K_v", "rigid", "flexible, no K_v", "flexible"],
)
def test_the_error_counts_what_a_design_can_change(structure, free: bool, counted: set[str], coupled: bool) -> None:
    """A term that stays over two K_v and two couplings is the device's own; with it alone in weights all count."""
    weights = {**WEIGHTS, "coupling": WEIGHTS["coupling"] * coupled}
    velocity = {"min": 0.0, "max": 1.0} if free else 0.0
    device = {"display": "impedance", "mass": 0.1, "damping": B, "sample_time": T, **structure}
    posed = problem_of(
        {"device": device, "gains": {"velocity": velocity}, "transparency": {"weights": weights}}
    ).problem
    speeds = (0.0, 0.3) if free else (0.0,)
    laws = [(Gains(K_v, 0.0), SpringDamper(b_c, 50.0)) for K_v in speeds for b_c in (0.1, 0.2)]
    found = [transparency_error(posed, *law) for law in laws]
    moved = {term for term in WEIGHTS if len({round(getattr(each, term), 9) for each in found}) > 1}
    assert moved == counted
    expected = counted if coupled else {"admittance", "tracking"}
    for each in found:
        assert each.error == pytest.approx(np.hypot.reduce([weights[t] * getattr(each, t) for t in expected]), rel=1e-9)


def test_a_count_of_the_encoder_is_felt_through_damping_and_spring() -> None:
    """In its sample a step of the position is resolution/T of velocity too: (K_v + b_c)/T + k_c, N/m."""
    problem = arm(display(velocity=VelocityEstimate("difference", resolution=1e-5)))
    found = in_hand_record(problem, judge(problem, Gains(0.1, 0.0), SpringDamper(0.05, 150.0)))
    assert found.count == pytest.approx(1e-5 * ((0.1 + 0.05) / T + 150.0), rel=1e-12)
