"""Studies of problems whose demands are met in hands: regions, bounds, sweeps, checks, repairs."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from balls import BALLS, ball, device_ball
from command import run
from conftest import DEVICE, ROOT
from devices import device_of
from draws import combined, gains_for
from flint import arb, ctx

import vctune
from vctune.design.advice import repair as repairing
from vctune.design.bound.conditions import conditions_in_hands
from vctune.design.search.theorems import impossible
from vctune.design.solve import solve
from vctune.document.reading import parse_problem, read_problem
from vctune.exit_codes import ExitCode
from vctune.model.gains import Gains
from vctune.model.hands import Hand, PlacesInHands
from vctune.model.loop.limits import lags
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.sampled.hand_loop import loop_in_hand, required_in_hand
from vctune.model.sampled.plant_in_hand import delays_of, plant_in_hand
from vctune.proof.boxes import Cells
from vctune.study.plane import plane
from vctune.study.region import Kind, region

FOLDER = ROOT / "tests/reference/hands"
NAMES = ("hands-friction-wheel", "hands-light-grip", "hands-everything")
GAINS = "[gains]\nvelocity = { min = 20.0, max = 500.0 }\nposition = { min = 3000.0, max = 1e5 }\n"
COUPLING = "[coupling]\ndamping = { min = 1.0, max = 1e4 }\nmass = { min = 1e-3, max = 10.0 }\n"
HANDS = '[stability]\ncriterion = "hands"\n[operator]\ndamping = { min = 0.5, max = 30.0 }\n'
WHEEL = DEVICE + GAINS + COUPLING + HANDS
FIXED = DEVICE + (
    "[gains]\nvelocity = 230.0\nposition = 1e5\n[coupling]\ndamping = 157.0\nmass = 0.055\ndrag = {}\n"
    '[stability]\ncriterion = "hands"\n'
)
"""A design that is certified with a drag of 1.5 and violated with 1."""


def posed(text):
    return parse_problem(text, "x", "x")


@pytest.mark.slow
def test_no_cell_of_a_late_device_with_room_is_undecided():
    """Where the drag is great enough, and next to no K_p = 0, what is undecided is next to the border."""
    text = (ROOT / "problems/friction-wheel-hands.toml").read_text()
    problem = posed(text.replace("sample_time = 1e-3", "sample_time = 1e-3\ndelay = 3e-4"))
    plane_ = plane(problem, "gains.velocity", "gains.position", 6)
    found_ = region(problem, plane_, plane_.coarsest_squares())
    assert found_.area(Kind.UNDECIDED) < 0.045 and found_.area(Kind.FEASIBLE) > 0.25
    decided = np.full((64, 64), int(Kind.UNDECIDED))
    for (a, b, c, d), kind in zip(found_.squares.T, found_.kinds, strict=True):
        decided[a:b, c:d] = kind
    inside = np.pad(decided != Kind.INFEASIBLE, 2, mode="edge")
    around = np.lib.stride_tricks.sliding_window_view(inside, (5, 5)).all(axis=(2, 3))
    assert not (around & (decided == Kind.UNDECIDED)).any(), "two cells from all that is infeasible"


@pytest.mark.parametrize("number", range(0, 192, 17))
def test_what_a_box_asks_for_in_hands_is_no_more_than_its_designs_ask_for(number):
    rng = np.random.default_rng(number)
    table = combined(rng, number)
    device, gains, count, spread = (
        device_of(table),
        Gains(*gains_for(rng, table)),
        30,
        10.0 ** rng.uniform(-4, 0, (4, 30)),
    )
    middle = np.array([[gains.velocity], [gains.position], [1.0], [1.0]])
    boxes = Cells(middle / (1 + spread), middle * (1 + spread))
    places = np.array([*rng.uniform(0, np.pi / device.sample_time, (1, 12)), *rng.uniform(0, 1, (3, 12))])
    places[1:] *= np.array([[device.mass], [30 * device.mass], [3000 * device.mass]])
    places[0, 0], places[0, 1] = 0.0, np.pi / device.sample_time
    with np.errstate(all="ignore"):
        least = conditions_in_hands([device], PlacesInHands(places[0], Hand(*places[1:]))).required.least(boxes)
    hand = Hand(*(x[None, :] for x in places[1:]))
    loop = loop_in_hand(plant_in_hand(device, hand, delays_of(device), FLOATS), places[:1] * device.sample_time, FLOATS)
    for share in rng.random((30, 4, 1)):
        K_v, K_p, *_ = boxes.low + share * (boxes.high - boxes.low)
        required = required_in_hand(loop, Gains(K_v[:, None], K_p[:, None]))
        R = required.lost / required.size
        assert (least <= np.maximum(R, 0) * (1 + 1e-6) + 1e-7 * np.abs(R).max()).all()
    assert count == len(least)


@cache
def reference(name):
    file = read_problem(FOLDER / f"{name}.toml")
    return file, solve(file.problem)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_bounds_are_proved(name):
    file, solved = reference(name)
    bounded = vctune.bound(file, solved, gap=0.03, time_limit=60)
    assert bounded.proved and bounded.optimality.bound <= solved.judgement.error
    if name == NAMES[0]:
        text = (FOLDER / f"{name}.toml").read_text().replace('"hands"', '"both"')
        both = vctune.bound(replace(file, problem=posed(text)), solve(posed(text)), gap=0.03, time_limit=120)
        assert both.proved and both.optimality.bound > 2 * solved.judgement.error


NO_DRAG = WHEEL.replace("[stab", "drag = 0.0\n[stab").replace("min = 0.5", "min = 0.0")


@pytest.mark.slow
@pytest.mark.advice
def test_without_drag_there_is_no_design_in_hands_without_damping(monkeypatch):
    changes = repairing.parameter_changes

    def of_stiffness(*given):  # all numbers: test_repairs_in_hands.py
        return [change for change in changes(*given) if change.key == "operator.stiffness.min"]

    monkeypatch.setattr(repairing, "parameter_changes", of_stiffness)
    file = read_problem(FOLDER / f"{NAMES[0]}.toml")
    file = replace(file, problem=posed(NO_DRAG), text=NO_DRAG)
    solved = vctune.solve(file)
    (repair,) = solved.repairs
    assert solved.status == "infeasible" and repair.key == "operator.stiffness.min" and 0 < repair.new < 3000
    assert "coupling.drag" in solved.infeasibility.reason and "operator.damping.min" in solved.infeasibility.reason


def test_without_drag_some_hands_leave_nothing_to_prove():
    without = impossible(posed(NO_DRAG.replace("min = 3000.0", "min = 0.0")))
    assert not without.proved and "with K_p = 0" in without.reason and "with K_p > 0" in without.reason
    never = NO_DRAG.replace("{ min = 3000.0, max = 1e5 }", "0.0")
    assert "with K_p > 0" not in impossible(posed(never)).reason
    for kinder in ("min = 0.1, max = 30.0 }", "min = 0.0, max = 30.0 }\nstiffness = { min = 5.0, max = 10.0 }"):
        for text in (NO_DRAG, never):
            assert impossible(posed(text.replace("min = 0.0, max = 30.0 }", kinder))) is None


def test_in_hands_without_stiffness_a_free_position_is_no_instability(tmp_path):
    file = tmp_path / "limp.toml"
    file.write_text((ROOT / "problems/paddle.toml").read_text().replace("max = 1000.0", "max = 0.0"))
    assert vctune.solve(file).status == "certified"


@pytest.mark.advice
@pytest.mark.slow
def test_where_any_damping_would_do_a_little_is_proposed():
    text = NO_DRAG.replace("{ min = 3000.0, max = 1e5 }", "0.0")
    file = replace(read_problem(FOLDER / f"{NAMES[0]}.toml"), problem=posed(text), text=text)
    repairs = {repair.key: repair for repair in vctune.solve(file).repairs}
    assert "operator.damping.min" in repairs
    assert 0 < repairs["operator.damping.min"].new <= 0.01 * 30  # of the greatest damping


def test_no_demand_of_passive_hands_makes_a_problem_in_hands_impossible():
    text = DEVICE + "[gains]\nvelocity = { min = 1.0, max = 2.0 }\nposition = { min = 2e4, max = 3e4 }\n"
    text += "[stability]\nband_hz = [0.0, 100.0]\n"
    assert impossible(posed(text)) is not None
    assert impossible(posed(text + 'criterion = "hands"\n[coupling]\ndrag = { min = 0.0, max = 9.0 }\n')) is None


@pytest.mark.parametrize("number", range(1, 192, 7))
def test_in_limp_hands_some_resistance_is_required(number):
    rng = np.random.default_rng(number)
    table = {key: part for key, part in combined(rng, number).items() if key != "structure"}
    device, K_v = device_of(table), gains_for(rng, table)[0]
    K_p = rng.uniform(0.1, 10) * (device.damping + K_v) / device.sample_time
    with ctx.workprec(400):
        sensor = arb(lags(device, FLOATS).sensor)
        K = arb(1e-20) * K_p
        plant = plant_in_hand(device_ball(device), Hand(arb(0), arb(0), K), delays_of(device), BALLS)
        required = required_in_hand(loop_in_hand(plant, arb(0), BALLS), Gains(ball(K_v), ball(K_p)))
        R = float(required.lost / required.size / K)
    expected = device.damping / K_p + float(sensor)
    assert abs(R - expected) <= 1e-9 * expected + 1e-15 * device.sample_time


@pytest.mark.slow
def test_a_region_is_a_baseline_for_other_hands(tmp_path):
    grip = (FOLDER / "hands-light-grip.toml").read_text()
    (tmp_path / "grip.toml").write_text(grip)
    (tmp_path / "stiffer.toml").write_text(grip.replace("max = 1000.0", "max = 1e5"))
    assert run("region", "grip.toml", "--resolution", "0.125", "--out", ".", cwd=tmp_path).returncode == ExitCode.OK
    record = json.loads((tmp_path / "grip/region.json").read_text())
    assert record["demands"]["criterion"] == "hands" and record["demands"]["hands"]["stiffness"] == [0.0, 1000.0]
    kept = run("check", "grip.toml", "--region", "grip/region.json", cwd=tmp_path)
    lost = run("check", "stiffer.toml", "--region", "grip/region.json", cwd=tmp_path)
    assert (kept.returncode, lost.returncode) == (ExitCode.OK, ExitCode.FAILED)


def test_a_range_of_hands_is_an_axis():
    swept = vctune.sweep(posed(FIXED.format(1.5)), {"operator.stiffness.max": [3000.0, 9000.0], "operator.mass": [0.0]})
    assert swept.table.status == ["certified", "violated"]
