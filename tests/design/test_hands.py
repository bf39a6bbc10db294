"""Every hand of a box: what is solved, judged and said."""

from __future__ import annotations

import json
from dataclasses import astuple, replace

import numpy as np
import pytest
from conftest import ROOT, for_passive_hands, mostly_slow
from loop import Loop, offered, seen

from vctune.api.solving import solve
from vctune.design.judging.judge import Status, judge
from vctune.design.records.design import design_record
from vctune.document.reading import parse_problem, read_problem
from vctune.model.hands import Hands
from vctune.proof.outcome import Verdict

FOLDER = ROOT / "tests/reference/hands"
EXPECTED = json.loads((FOLDER / "expected.json").read_text())
THREE = "[device]\nmass = 0.4\ndamping = 2.0\nsample_time = 1e-3\n"
HANDS = THREE + '[stability]\ncriterion = "hands"\n'


@pytest.fixture(scope="module", params=mostly_slow(EXPECTED, ["hands-friction-wheel"]))
def solved(request):
    return request.param, solve(FOLDER / f"{request.param}.toml")


def test_the_record_names_the_hands(solved):
    name, found = solved
    file = read_problem(FOLDER / f"{name}.toml")
    hands = design_record(file, found)["certificate"]["hands"]
    assert hands["verdict"] == "proved" and hands["boxes"] > 0
    assert hands["min_ratio"] == pytest.approx(1.05, rel=3e-4)
    for number, (low, high) in hands["box"].items():
        assert low <= hands["worst_hand"][number] <= high


def test_a_design_for_any_passive_hand_on_a_band_fails_in_a_human_hand_above_it():
    passive = solve(parse_problem(for_passive_hands(THREE), "x", "x"))
    assert passive.status is Status.CERTIFIED
    problem = parse_problem(HANDS, "x", "x")
    judged = judge(problem, passive.judgement.gains, passive.judgement.coupling)
    outcome = judged.certificate.outcomes["hands"]
    assert judged.status is Status.VIOLATED and outcome.verdict is Verdict.REFUTED and judged.in_hand.ratio < 1
    device = {"mass": 0.4, "damping": 2.0, "sample_time": 1e-3}
    loop = Loop(device, astuple(judged.gains), astuple(judged.coupling), astuple(outcome.hand))
    z = np.exp(2j * np.pi * outcome.witness_hz * 1e-3)
    assert offered(loop, z).real < 1.05 * -seen(loop, z).real


def test_without_an_integrator_a_free_position_is_no_instability():
    problem = parse_problem(
        HANDS + "[gains]\nvelocity = 100.0\nposition = 0.0\n[coupling]\ndamping = 100.0\nmass = 1.0\ndrag = 5.0\n",
        "x",
        "x",
    )
    hands = problem.hands
    for low, high, verdict in (
        (0.0, hands.high.stiffness, Verdict.PROVED),
        (100.0, hands.high.stiffness, Verdict.PROVED),
        (0.0, 0.0, Verdict.PROVED),
    ):
        some = Hands(replace(hands.low, stiffness=low), replace(hands.high, stiffness=high))
        found = solve(replace(problem, hands=some)).judgement.certificate.outcomes["hands"]
        assert found.verdict is verdict, (low, high)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["velocity-only", "slow"])
def test_extremes_are_certified_in_every_hand_without_an_integrator(name):
    """Their best designs have none; `slow`'s worst hands ring above Nyquist, and only the proof meets them."""
    text = (ROOT / f"problems/extremes/{name}.toml").read_text().replace('"passive"', '"both"')
    found = solve(parse_problem(text, name, name))
    assert found.status is Status.CERTIFIED
    assert found.judgement.gains.position == 0


def test_a_mechanism_without_a_loop_is_stable_in_every_hand():
    """With a drag; without one the coupling's mass drifts by itself, which is not proved to be stable."""
    text = HANDS + "[gains]\nvelocity = 0.0\nposition = 0.0\n[coupling]\ndamping = 1.0\nmass = 1.0\ndrag = {}\n"
    for drag, verdict in ((1.0, Verdict.PROVED), (0.0, Verdict.UNDECIDED)):
        found = solve(parse_problem(text.format(drag), "x", "x"))
        assert found.judgement.certificate.outcomes["hands"].verdict is verdict


def test_a_plain_number_is_that_number():
    problem = parse_problem(HANDS + "[operator]\ndamping = 40.0\nmass = 0.1\n", "x", "x")
    assert astuple(problem.hands.low) == (0.1, 40.0, 0.0) and astuple(problem.hands.high) == (0.1, 40.0, 3000.0)
    assert problem.device.operator is None
    passive = parse_problem(THREE + "[operator]\ndamping = 40.0\n", "x", "x")
    assert passive.device.operator.damping == 40.0


@pytest.mark.parametrize("display", ["admittance", "impedance"])
def test_a_released_handle_is_a_box_of_its_own(display):
    """Nobody's hand is easier than every hand, and the pole at 1 of a free position is no instability."""
    device = f'[device]\nmass = 0.1\ndamping = 1.0\nsample_time = 5e-4\ndisplay = "{display}"\n'
    device += '[stability]\ncriterion = "hands"\n[coupling]\n' + ("drag = 0.5\n" if display == "admittance" else "")
    nobody = "[operator]\nmass = 0\ndamping = 0\nstiffness = 0\n"
    held, released = (solve(parse_problem(text, "x", "x")) for text in (device, device + nobody))
    assert held.status is released.status is Status.CERTIFIED
    assert released.judgement.error <= held.judgement.error * (1 + 1e-6)
    assert released.judgement.certificate.demands.hands.high.stiffness < 1e-6
