"""The least operator: the two-port that has absorbed it, in every arithmetic, in the search and in the proof."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest
from conftest import DEVICE, for_passive_hands
from dense import below, meet_demands
from random_problems import random_designs, random_texts
from test_witness import closed_loop_poles, handle_admittance, passive, reactance, value

from vctune.analysis.demands import rollett_factor_at, stability_ratio
from vctune.bench.digits import exact
from vctune.bench.evaluator import case_of, cases, coupling_impedance, impedances, required
from vctune.design.nlp.nlp import assembled
from vctune.design.prepared import pose
from vctune.design.solve import solve
from vctune.design.verdict.judge import judge, judge_all
from vctune.document.reading import parse_problem, problem_file
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import LeastOperator
from vctune.model.loop.device_response import device_response
from vctune.model.loop.limits import high_frequency_limit, low_frequency_limit
from vctune.model.loop.llewellyn import required_resistance
from vctune.model.loop.loop import loop_response
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.problem import HUMAN_HANDS, Demands
from vctune.proof.certificate import certify
from vctune.proof.claims.many_designs import prove
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.claims.model_poles import prove_model_poles
from vctune.proof.engine.boxes import Cells
from vctune.proof.engine.interval import Verdict

FRICTION_WHEEL = (
    DEVICE
    + """
[gains]
velocity = { min = 1.0, max = 1000.0 }
position = { min = 3000.0, max = 1e5 }
[transparency]
band_hz = [0.5, 30.0]
reference_impedance = 10.0
[stability]
criterion = 'passive'
band_hz = [0.5, 100.0]
"""
)


def random_case(rng, hold=None):
    """A device with a stable-looking loop and an operator, as plain numbers."""
    mass, T = 10 ** rng.uniform(-2, 1), 10 ** rng.uniform(-4, -2)
    damping = mass / T * 10 ** rng.uniform(-4, -1)
    operator = LeastOperator(mass * 10 ** rng.uniform(-2, 1), damping * 10 ** rng.uniform(-2, 2))
    device = Device(mass, damping, T, 0.0, hold or ("zoh", "lag")[rng.integers(2)], operator)
    K_v = mass / T * 10 ** rng.uniform(-2, -0.2)
    gains = Gains(K_v, 0.0 if rng.random() < 0.3 else K_v / T * 10 ** rng.uniform(-4, -1))
    return device, gains, Coupling(K_v * 10 ** rng.uniform(-1, 2), mass * 10 ** rng.uniform(-1, 2), 0.0)


@pytest.mark.parametrize("seed", range(200))
def test_required_resistance_is_that_of_the_two_port_that_has_absorbed_the_operator(seed):
    rng = np.random.default_rng(seed)
    device, gains, virtual = random_case(rng)
    omega = 10 ** rng.uniform(-3, 0) / device.sample_time
    case = case_of(device, gains, virtual)
    true, (Z_d, C) = exact(case, omega), impedances(case, 1j * omega)
    R, K = true.required, float(true.rollett)
    relief = case.b_h * abs(C.real) / abs((C + Z_d + case.b_h).real)
    at = np.array([omega])
    response = loop_response(device_response(device, at, FLOATS), gains, FLOATS)
    assert abs(float(required_resistance(response, FLOATS)[0]) - R) < 1e-10 * (abs(R) + relief)
    assert rollett_factor_at(device, gains, virtual, omega) == pytest.approx(K, rel=1e-9, abs=1e-9)
    ratio = float(stability_ratio(device, gains, virtual, at)[0])
    if true.resistance > 0:
        assert (ratio >= 1) == (K >= 1)


def test_an_operator_of_nothing_is_none():
    problem = parse_problem(FRICTION_WHEEL + "[operator]\nmass = 0.0\n", "p", "p")
    assert problem.device.operator is None
    assert replace(problem, hands=HUMAN_HANDS) == parse_problem(FRICTION_WHEEL, "p", "p")


def test_a_vanishing_operator_gives_the_numbers_of_none():
    bare = solve(parse_problem(FRICTION_WHEEL, "p", "p")).judgement
    tiny = solve(parse_problem(FRICTION_WHEEL + "[operator]\nmass = 1e-12\ndamping = 1e-12\n", "p", "p")).judgement
    assert tiny.transparency.error == pytest.approx(bare.transparency.error, rel=1e-7)
    assert tiny.min_ratio == pytest.approx(bare.min_ratio, rel=1e-7)


@pytest.mark.parametrize("seed", range(30))
def test_limits_at_both_ends(seed):
    device, gains, virtual = random_case(np.random.default_rng(seed), hold="lag")
    virtual = replace(virtual, drag=0.1)
    for limit, omega in (
        (low_frequency_limit(device, gains, virtual), 1e-14),
        (high_frequency_limit(device, gains, virtual), 1e16),
    ):
        if limit.required < inf:
            R = exact(case_of(device, gains, virtual), omega).required
            assert limit.required == pytest.approx(float(R), rel=1e-6)


@pytest.mark.parametrize("seed", range(60))
def test_verdicts_of_both_provers_agree_with_a_dense_scan(seed):
    rng = np.random.default_rng(seed)
    device, gains, virtual = random_case(rng)
    corner = 10 ** rng.uniform(-3, -1) / device.sample_time
    band = (corner / 30, corner * 3)
    omega = np.geomspace(*band, 4001)
    text = f"[device]\nmass = {device.mass!r}\ndamping = {device.damping!r}\nsample_time = {device.sample_time!r}\n"
    text += (
        f'hold = "{device.hold}"\n[operator]\nmass = {device.operator.mass!r}\ndamping = {device.operator.damping!r}\n'
    )
    problem = parse_problem(for_passive_hands(text), "p", "p")
    numbers = np.array([gains.velocity, gains.position, virtual.damping, virtual.mass, 0.0])
    case = cases(problem.device, numbers)
    R, Z_c = required(case, omega), coupling_impedance(case, 1j * omega).real
    clear = rng.uniform(0.9, 1.1)
    worst = np.max(R / Z_c)
    if 0 < worst < inf:  # scale the coupling next to its limit
        virtual = Coupling(virtual.damping * worst * clear, virtual.mass * worst * clear, 0.0)
    certificate = certify(Design(device, gains, virtual), Demands(device, band, 1.0, 100.0))
    conditions = certificate.outcomes["passive"].verdict
    if worst == inf or (worst > 0 and clear < 1 - 1e-6):
        assert conditions is Verdict.REFUTED
    elif clear > 1 + 1e-4:
        assert conditions is Verdict.PROVED
    numbers[2:4] = virtual.damping, virtual.mass
    demands = replace(pose(problem).demands, band=band, factor=1.0, max_sensitivity=100.0)
    cell = Cells(numbers[:, None], numbers[:, None])
    assert not (prove(demands, cell).proved[0] and certificate.verdict is not Verdict.PROVED)


def test_a_loop_that_a_heavy_hand_makes_unstable_is_refused():
    """m s^2 + b s + K_p e^{-s tau}: without mass it is stable for tau K_p < pi/2 b, with much mass for tau K_p < b."""
    device, gains = Device(1e-3, 10.0, 1e-3, 2e-3, "zoh"), Gains(1e-3, 5200.0)
    heavy = replace(device, operator=LeastOperator(1.0, 0.0))
    case = [prove_model_poles(loop, gains).verdict for loop in heavy.loops]
    assert case == [Verdict.PROVED, Verdict.REFUTED]
    for claim in ("stable_model", "stable"):
        design = Design(heavy, gains, Coupling(10.0, 1.0, 0.0))
        assert certify(design, Demands(heavy, (600.0, 700.0), 1.0, 100.0)).outcomes[claim].verdict is Verdict.REFUTED


WHOLE_AXIS = """
[device]
mass = 0.5
damping = 2.0
sample_time = 1e-3
hold = "lag"
[operator]
mass = 0.2
damping = {}
[gains]
velocity = 40.0
position = 2000.0
[stability]
criterion = 'passive'
band_hz = [0.0, inf]
"""


def test_certified_means_stable_with_every_passive_operator_that_contains_the_least_one():
    """Without drag no design has K_p > 0 on a band from 0, but in the hand of an operator.

    See model/README.md, section 6.
    """
    bare = solve(parse_problem(WHOLE_AXIS.format("0.0").replace("mass = 0.2\n", ""), "p", "p"))
    assert bare.status == "infeasible" and bare.infeasibility.proved
    problem = parse_problem(WHOLE_AXIS.format("0.1"), "p", "p")
    solved = solve(problem)
    assert solved.status == "certified"
    judgement, device = solved.judgement, problem.device
    case = case_of(device.bare, judgement.gains, judgement.coupling)
    rng, least = np.random.default_rng(3), np.array([device.operator.mass, device.operator.damping])
    for _ in range(1000):
        hand, environment = passive(rng, 40.0, 80.0), passive(rng, 40.0, 80.0)
        operator = np.polyadd(hand[0], np.polymul(least, hand[1])), hand[1]
        poles = closed_loop_poles(case, operator, environment)
        moving = poles[np.abs(poles) > 1e-9 * np.abs(poles).max()]
        assert np.all(moving.real <= 1e-9 * np.abs(moving))
    # what the criterion without an operator refuses, a hand without it can make unstable
    refused = judge(replace(problem, device=device.bare), judgement.gains, judgement.coupling).certificate
    assert refused.verdict is Verdict.REFUTED
    omega = refused.outcomes["passive"].witness or 1e-3
    s = 1j * omega
    Z_d, C = impedances(case, s)
    q, Z_c = C / (Z_d + C), coupling_impedance(case, s)
    environment = reactance(-Z_c.real * np.tan((np.pi - np.angle(q)) / 2) - Z_c.imag, omega)
    handle = handle_admittance(case, value(environment, s), s)
    assert handle.real < 0
    Z_h = -1 / handle
    lossless = reactance(Z_h.imag, omega)
    operator = (np.polyadd(lossless[0], Z_h.real * 0.99 * lossless[1]), lossless[1])
    assert Z_h.real > 0
    assert closed_loop_poles(case, operator, environment).real.max() > 0


@pytest.mark.slow
def test_no_random_design_is_admissible_and_better_than_the_bound():
    problem = parse_problem(FRICTION_WHEEL + "[operator]\nmass = 0.1\ndamping = 1.0\n", "p", "p")
    solved = solve(problem, gap=0.01)
    assert solved.optimality.proved
    found = solved.judgement
    best = np.array([*vars_of(found.gains), *vars_of(found.coupling)])
    assert meet_demands(problem, best[:, None]).all()
    rng = np.random.default_rng(5)
    for near in (None, best):
        designs = random_designs(problem, 20_000, rng, near)
        assert below(problem, solved.optimality.bound * (1 - 1e-9), designs).size == 0


def vars_of(part):
    return [getattr(part, name) for name in part.__slots__]


def test_the_price_of_the_ratio_is_what_a_smaller_factor_saves():
    from vctune.design.verdict.nlp_record import active

    text, operator = FRICTION_WHEEL + "safety_factor = ", "\n[operator]\ndamping = 2.0\n"
    solved = solve(parse_problem(f"{text}{1.05}{operator}", "p", "p"))
    eased = solve(parse_problem(f"{text}{1.05 / 1.01}{operator}", "p", "p"))
    price = sum(row.multiplier for row in active(solved) if row.demand.startswith("Re Z_c"))
    saved = np.log(solved.judgement.transparency.error / eased.judgement.transparency.error) / np.log(1.01)
    assert price == pytest.approx(saved, rel=0.02)


def test_an_absent_operator_is_not_in_the_nlp():
    """The same graph as one built from a device that has never heard of operators: 15 common numbers, no relief."""
    bare = solve(parse_problem(FRICTION_WHEEL, "p", "p")).polished.structure
    held = solve(parse_problem(FRICTION_WHEEL + "[operator]\ndamping = 1.0\n", "p", "p")).polished.structure
    assert not bare.operator_damping and held.operator_damping
    same = replace(bare, operator_damping=True)
    without, with_it = assembled(bare), assembled(same)
    assert with_it["p"].numel() - without["p"].numel() == 2
    assert with_it["x"].numel() == without["x"].numel() and with_it["g"].numel() == without["g"].numel()


def test_many_designs_are_judged_as_one_by_one():
    problem = parse_problem(FRICTION_WHEEL + "[operator]\nmass = 0.3\ndamping = 0.5\n", "p", "p")
    rng = np.random.default_rng(1)
    designs = [
        (Gains(10 ** rng.uniform(1, 2.95), 10 ** rng.uniform(3.5, 4.5)), Coupling(10 ** rng.uniform(1, 3), 0.1, 0.0))
        for _ in range(40)
    ]
    together = judge_all(problem, designs)
    assert [j.certificate.verdict for j in together] == [judge(problem, *d).certificate.verdict for d in designs]


def test_the_record_shows_both():
    from vctune.design.verdict.design_record import design_record

    file = problem_file(FRICTION_WHEEL.replace("0.5, 100", "0.0, 100") + "[operator]\ndamping = 1.0\n", Path("p.toml"))
    record = design_record(file, solve(file.problem))
    assert record["status"] == "certified"
    assert record["certificate"]["without_operator"] == {"verdict": "refuted", "min_ratio": 0.0, "worst_hz": 0.0}
    bare = problem_file(FRICTION_WHEEL, Path("p.toml"))
    assert "without_operator" not in design_record(bare, solve(bare.problem))["certificate"]


def held_texts(seed, rng):
    """Random problems in random hands, many of them with a band from 0."""
    for text in random_texts(seed):
        device = parse_problem(for_passive_hands(text), "p", "p").device
        Z = device.mass / device.loop_lag + device.damping
        mass, damping = device.mass * 10 ** rng.uniform(-2, 2), Z * 10 ** rng.uniform(-6, 0)
        hand = f"[operator]\nmass = {mass!r}\ndamping = {damping!r}\n"
        from_0 = re.sub(r"(\[stability\]\ncriterion = 'passive'\nband_hz = \[)[^,]*,", r"\g<1>0.0,", text)
        yield (from_0 if rng.random() < 0.4 else text) + hand


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_random_problems_are_never_certified_in_vain(seed, capsys):
    """Random operators, many bands from 0; designs and random others judged by plain complex numbers."""
    rng, met = np.random.default_rng(seed), {}
    for text, _ in zip(held_texts(seed, rng), range(40), strict=False):
        problem = parse_problem(for_passive_hands(text), "p", "p")
        solved = solve(problem)
        met[solved.status.value] = met.get(solved.status.value, 0) + 1
        designs, least = random_designs(problem, 4000, rng), 1e300
        if solved.status == "certified":
            found = solved.judgement
            best = np.array([*vars_of(found.gains), *vars_of(found.coupling)])
            assert meet_demands(problem, best[:, None]).all()
            designs = np.hstack((designs, random_designs(problem, 4000, rng, best)))
            least = 0.99 * found.transparency.error
        if solved.status != "undecided":
            assert below(problem, least, designs).size == 0, text
    with capsys.disabled():
        sys.stdout.write(f"\n{met}\n")
