"""Servos: designs of the reference problems, and what a problem of one may not state."""

from __future__ import annotations

import itertools
import tomllib
from dataclasses import replace
from functools import cache
from math import inf, pi, sqrt
from typing import Any

import pytest

import vctune
from vctune import solve
from vctune.analysis.contact import stiffest_contact
from vctune.analysis.loops_in_hands import loops_in_hands
from vctune.design.judging.judge import Status, judge
from vctune.design.prepared import pose
from vctune.design.records.design import record_of
from vctune.document.reading import parse_problem
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hand, Hands
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.servo import latency

SERVO = """
[device]
sample_time = 0.002
[device.servo]
delay = 0.032
bandwidth_hz = 20.0
order = 2
[operator]
mass = { min = 0.0, max = 2 }
damping = { min = 0.0, max = 30 }
stiffness = { min = 0.0, max = 1000 }
"""
NONE = Gains(0.0, 0.0)


def problem(text: str = SERVO, more: str = ""):
    return parse_problem(text + more, "servo.toml", "servo")


@pytest.mark.parametrize("coupling", [Coupling(10.0, 50.0, 20.0), Coupling(20.0, 5.0, 20.0)], ids=["heavy", "light"])
def test_the_stiffest_contact_without_mass_and_damping_is_that_at_rest(coupling: Coupling) -> None:
    """K L = b_0/g: a mass in the coupling, however heavy, resists nothing at rest."""
    device, hands = problem().device, Hands(Hand(0.0, 0.0, 0.0), Hand(0.0, 0.0, 1000.0))
    bears = coupling.drag / 1.05 / latency(device, FLOATS).total
    assert stiffest_contact([device], hands, coupling, 1.05) == pytest.approx(bears, rel=1e-9)


def test_the_drag_at_rest_is_the_sum_of_its_parts() -> None:
    """Contacts act through the force sensor; the firmware's own spring does not wait for it."""
    sensor = "[device.force_sensor]\ndelay = 0.01\nbandwidth_hz = 30.0\n"
    text = SERVO.replace("order = 2", "order = 2\nstiffness = 40.0") + sensor
    text = text.replace("damping = { min = 0.0", "damping = { min = 1.0").replace("1000 }", "300 }")
    checked = vctune.check(tomllib.loads(text + "[coupling]\ndamping = inf\nmass = 5.0\ndrag = 120.0\n"))
    contact = checked.finding.record()["contact"]
    parts = sum(part["drag"] for part in contact["parts"]) + contact["own_spring"]
    assert contact["rest_drag"] == pytest.approx(parts - contact["safety_factor"] * 1.0, rel=1e-9)


def test_nothing_depends_on_a_mass_that_a_servo_does_not_have():
    base, design = problem(), Coupling(297.0, 2.67, 46.5)
    first, other = (
        judge(replace(base, device=replace(base.device, mass=mass, damping=damping)), NONE, design)
        for mass, damping in ((1.0, 0.0), (7.0, 3.0))
    )
    assert first.status is other.status is Status.CERTIFIED
    assert first.transparency == other.transparency and first.min_ratio == other.min_ratio
    assert first.certificate.boxes == other.certificate.boxes


def test_a_rigid_coupling_offers_its_drag_alone():
    """Mass and drag alone, the law of robots: certified with a drag just above safety factor times R, refuted below."""
    posed = problem()
    R = max(float(loops_in_hands(posed.device, posed.hands).required(NONE).max()), 0.0)
    above, below = (
        judge(posed, NONE, Coupling(inf, 5.0, share * posed.stability.safety_factor * R)) for share in (1.01, 0.98)
    )
    assert above.status is Status.CERTIFIED and below.status is Status.VIOLATED
    assert above.min_ratio == pytest.approx(1.01 * posed.stability.safety_factor, rel=1e-3)


def test_a_rigid_coupling_is_designed():
    solved = solve({**_tables(), "coupling": {"damping": inf, "mass": 4.0}})
    assert solved.status is Status.CERTIFIED
    assert solved.judgement.coupling.rigid and solved.judgement.coupling.mass == 4.0
    assert solved.judgement.min_ratio == pytest.approx(1.05, rel=1e-3)


def _tables():
    return tomllib.loads(SERVO)


@pytest.mark.slow
def test_an_uncertain_servo_is_designed_for_its_whole_box():
    more = '[uncertainty]\n"servo.delay" = 0.1\n"servo.bandwidth_hz" = 0.1\n'
    sure, unsure = (solve(tables) for tables in (_tables(), {**_tables(), "uncertainty": _uncertain(more)}))
    assert sure.status is unsure.status is Status.CERTIFIED
    assert unsure.judgement.transparency.coupling > sure.judgement.transparency.coupling
    base = problem()
    for delay in (0.0288, 0.0352):
        for hertz in (18.0, 22.0):
            servo = replace(base.device.servo, delay=delay, bandwidth_hz=hertz)
            there = replace(base, device=replace(base.device, servo=servo))
            assert judge(there, NONE, unsure.judgement.coupling).status is Status.CERTIFIED


def _uncertain(text: str):
    return tomllib.loads(text)["uncertainty"]


HANDS_MET = {
    "mass": {"min": 0.0, "max": 3.0}, "damping": {"min": 0.0, "max": 30.0}, "stiffness": {"min": 0.0, "max": 500.0},
}  # fmt: skip


def checked(delay: float, sensed: float, drag: float = 900.0) -> dict[str, Any]:
    """Return the certificate of a servo of order 1 at 1 kHz with two delays in ms."""
    device = {"sample_time": 1e-3, "servo": {"delay": delay / 1e3, "bandwidth_hz": 30.0}}
    if sensed:
        device["force_sensor"] = {"delay": sensed / 1e3}
    coupling = {"damping": inf, "mass": 5.0, "drag": drag}
    found = vctune.check({"device": device, "operator": HANDS_MET, "coupling": coupling}).finding
    assert found is not None
    return found.record()["certificate"]


@pytest.mark.parametrize(
    ("delays", "whole"),
    [
        ([(1.0, 0.0), (0.4, 0.6)], 1),
        pytest.param([(2.0, 0.0), (1.4, 0.6), (0.5, 1.5)], 2, marks=pytest.mark.slow),
        ([(0.97, 0.0), (0.6, 0.37)], 1),
        pytest.param([(1.04, 0.0), (0.1, 0.94)], 1, marks=pytest.mark.slow),
        ([(1.1, 0.0), (0.4, 0.7)], None),
        pytest.param([(0.6, 0.0), (0.2, 0.4)], None, marks=pytest.mark.slow),
    ],
)
def test_the_sum_of_both_delays_is_what_may_be_a_whole_sample(delays: list[tuple[float, float]], whole: int) -> None:
    """Only the sum counts: the same samples, the same delay, the same ratio, however it is divided."""
    found = [checked(*pair) for pair in delays]
    for each in found:
        beside = each.get("whole_sample")
        assert (beside and beside["samples"], beside and beside["delay"]) == (whole, whole and whole / 1e3)
        assert each["hands"]["min_ratio"] == pytest.approx(found[0]["hands"]["min_ratio"], rel=1e-9)


@pytest.mark.parametrize(
    ("delay", "sensed", "key", "share", "whole"),
    [
        (0.4, 0.6, "servo.delay", 0.25, {1.0}),
        (0.4, 0.6, "force_sensor.delay", 0.25, {1.0}),
        (1.4, 0.65, "servo.delay", 0.5, {2.0}),
        (1.4, 0.1, "servo.delay", 0.5, {1.0, 2.0}),
        (0.3, 0.3, "force_sensor.delay", 0.5, set()),
        (1.0, 0.0, "servo.delay", 0.1, {1.0}),
    ],
)
def test_a_box_is_posed_on_both_sides_of_each_sum_of_a_whole_sample(
    delay: float, sensed: float, key: str, share: float, whole: set[float]
) -> None:
    """The sums that lie in the box, 1e-7 samples below and above."""
    text = f"[device]\nsample_time = 1e-3\nservo = {{ delay = {delay}e-3, bandwidth_hz = 30.0 }}\n"
    text += f"force_sensor = {{ delay = {sensed}e-3 }}\n" if sensed else ""
    text += "".join(
        ["[operator]\n", *(f"{name} = {{ min = 0.0, max = {HANDS_MET[name]['max']} }}\n" for name in HANDS_MET)]
    )
    posed = pose(parse_problem(f"{text}[uncertainty]\n'{key}' = {share}\n", "x", "x"))
    sums = [1e3 * (each.device.servo.delay + each.device.sensing.delay) for each in posed.hand_cases]
    beside = {round(each) + (1e-7 if each > round(each) else -1e-7) for each in sums if abs(each - round(each)) < 2e-7}
    assert beside == {number + side for number in whole for side in (-1e-7, 1e-7)}


def test_a_servo_that_follows_late_is_not_idle() -> None:
    """It has no loop that could hardly work, however far |1 - G_he| is above that of an idle one."""
    text = SERVO.replace("1000 }", "300 }") + "[coupling]\ndamping = inf\nmass = 5.0\ndrag = 200.0\n"
    checked = vctune.check(tomllib.loads(text + "[transparency]\nband_hz = [2.0, 20.0]\n"))
    judgement = checked.finding.judgement
    assert judgement.status is Status.CERTIFIED and judgement.transparency.tracking > 1
    assert not judgement.idle and not checked.warnings


def late(samples: float, more: str = "") -> str:
    """A servo of which only the latency is known, with nothing behind it."""
    text = f"[device]\nsample_time = 4e-3\n[device.servo]\ndelay = {4e-3 * samples!r}\n{more}"
    return f"{text}[environment]\nmass.max = 0.0\nstiffness.max = 0.0\n"


@cache
def solved_late(samples: float, more: str) -> Any:
    return solve(problem(late(samples, more), ""))


@pytest.mark.night
@pytest.mark.parametrize("more", ["", pytest.param("order = 2\n", marks=pytest.mark.slow)])
def test_a_latency_of_whole_samples_costs_about_what_its_neighbours_cost(more: str) -> None:
    solved = [solved_late(samples, more) for samples in (4.0, 4.4)]
    assert {each.status for each in solved} == {Status.CERTIFIED}
    errors = [each.judgement.transparency.error for each in solved]
    assert max(errors) < 1.2 * min(errors)


@pytest.mark.slow
@pytest.mark.parametrize("more", ["", pytest.param("order = 2\n", marks=pytest.mark.slow)])
def test_a_latency_without_a_bandwidth_is_proved_for_each_division(more: str) -> None:
    """The worst division lies within 5 % of the limit: a smaller coupling fails one of them."""
    design = solved_late(4.0, more).judgement.coupling
    lags = [0.5, 0.51, 0.7, 1.0, 1.01, 1.3, 2.0, 2.5]
    delays = [(4.0 - lag, lag) for lag in lags] + ([] if more else [(3.999999, 0.5), (4.0, 0.5)])
    failed = {1.0: 0, 1 / 1.08: 0}
    for factor, (delay, lag) in itertools.product(failed, delays):
        corner = (1 if not more else sqrt(2)) / (2 * pi * 4e-3 * lag)
        text = late(delay, f"bandwidth_hz = {corner!r}\n{more}")
        drag, mass = factor * design.drag, factor * design.mass
        fixed = f"[coupling]\ndamping = inf\nmass = {mass!r}\ndrag = {drag!r}\n"
        failed[factor] += solve(problem(text, fixed)).status is not Status.CERTIFIED
    assert failed[1.0] == 0
    assert failed[1 / 1.08] > 0


def test_a_latency_of_whole_samples_is_told_with_the_delay_beside_it() -> None:
    """Its least lag makes the delay of half a sample less; where the force jumps, the whole samples are proved too."""
    fixed = vctune.problem(tomllib.loads(late(4.0, "[coupling]\ndamping = inf\nmass = 20.0\ndrag = 900.0\n")))
    solved = solve(fixed.problem)
    rows = {row.label: (row.value, row.unit) for row in record_of(fixed, solved).groups()["uncertainty"]}
    assert solved.status is Status.CERTIFIED
    assert rows["servo.delay"] == ("0.008 to 0.014", "s, and 0.016 beside a whole sample")
    assert rows["least ratio at"] == ("", "servo.delay 0.016")
