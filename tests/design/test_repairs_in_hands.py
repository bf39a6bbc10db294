"""Repairs of problems and designs whose demands are met in hands: each suffices and nine tenths of it do not."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from math import inf

import pytest
from conftest import ROOT
from test_repairs import certified, changed, each_repair_is_least, parsed

from vctune.design.verdict import repair as repairing
from vctune.design.verdict.judge import judge
from vctune.design.verdict.parameter_changes import parameter_changes
from vctune.design.verdict.repair import OF_FIXED, OF_FREE, OF_FREE_IN_USE, find_repairs
from vctune.design.verdict.trial import RepairTest

FIXED = (ROOT / "tests/gains/friction-wheel-hands.toml").read_text().partition("[design]")[0]
"""Gains that are certified in the default hands, with 1.05 of the required R."""


def of(name: str, number: float) -> str:
    """Return these gains with another number of this name."""
    changed, count = re.subn(rf"(?m)^{name} = \S+", f"{name} = {number}", FIXED)
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
INFEASIBLE = {
    "no drag": wheel(bounds(drag="0.0")),
    "no drag, both criteria": wheel(bounds(drag="0.0"), criterion="both"),
    "K_v too great": wheel(bounds(velocity="1200.0, 2000.0")),
    "K_v too small": wheel(bounds(velocity="1.0, 20.0", position="2e4, 1e5")),
    "m_c too small": wheel(bounds(mass="1e-4, 0.01", drag="0.5")),
    "|S| too small": wheel(bounds(velocity="300.0, 1000.0"), sensitivity=1.05),
    "late force sensor": wheel(bounds(damping="1e-3, 60.0", drag="0.0, 5.0"), device=LATE),
}
"""Causes of all kinds."""
REPAIRS = {
    "no drag": {"coupling.drag", "operator.stiffness.min"},
    "no drag, both criteria": {"operator.damping.min"},
    "K_v too great": {"gains.velocity.min", "device.sample_time"},
    "K_v too small": {"gains.velocity.max", "stability.max_sensitivity"},
    "m_c too small": {"coupling.mass.max", "operator.damping.min"},
    "|S| too small": {"stability.max_sensitivity"},
    "late force sensor": {"device.force_sensor.delay", "gains.position.min"},
}
"""Numbers whose change repairs each."""


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    """However busy the machine is, all that was asked for is tried."""
    monkeypatch.setattr(repairing, "LONGEST", inf)


REFUTED = {
    "no drag": wheel(of("drag", 0.0)),
    "b_c": wheel(of("damping", 100.0)),
    "b_c, both criteria": wheel(of("damping", 100.0), criterion="both"),
    "m_c": wheel(of("mass", 0.03)),
    "late": wheel(FIXED, device="delay = 1e-4\n"),
}


def repairs(text, test, *keys):
    """The repairs of a problem by these numbers alone."""
    document = tomllib.loads(text)
    changes = [change for change in parameter_changes(document, parsed(text)) if change.key in keys]
    assert len(changes) >= len(keys)
    return find_repairs(document, changes, test)


def test_a_refuted_drag_is_what_the_worst_hand_asks_for():
    """With it the least Re Z_c / R of any hand is the safety factor, to the width of the search."""
    key = "coupling.drag"
    (found,) = repairs(REFUTED["no drag"], OF_FIXED, key)
    problem = parsed(changed(REFUTED["no drag"], key, found.new, found.needs))
    judgement = judge(problem, *problem.fixed_design)
    assert 1.05 <= judgement.min_ratio < 1.0525 and judgement.in_hand.ratio == judgement.min_ratio


def test_what_no_change_of_a_kind_can_do_is_tried_once():
    """Fewer demands and wider bounds only ever help: where the furthest of them does not, none is looked for."""
    tried = []
    test = RepairTest(tried.append, OF_FREE.verify, 0.05, furthest_first=True)
    keys = "operator.mass.max", "operator.stiffness.max", "stability.max_sensitivity", "coupling.damping.max"
    assert repairs(INFEASIBLE["|S| too small"], test, *keys) == [] and len(tried) == len(keys)
    assert repairs(INFEASIBLE["|S| too small"], test, "device.damping") == [] and len(tried) > len(keys) + 10
    tried.clear()
    cures = replace(OF_FREE_IN_USE, estimate=tried.append)
    assert repairs(INFEASIBLE["|S| too small"], cures, *keys) == [] and len(tried) == len(keys)


def test_small_changes_of_all_numbers_come_before_great_ones_of_any():
    """What a time limit leaves out is more than what is found."""
    tried = []

    def estimate(problem):
        tried.append((problem.stability.max_sensitivity, problem.hands.high.mass))
        return problem.stability.max_sensitivity >= 1.3 or problem.hands.high.mass <= 0.4

    test = RepairTest(estimate, lambda problem: None, 0.05)
    repairs(INFEASIBLE["|S| too small"], test, "operator.mass.max", "stability.max_sensitivity")
    order = [("S", S) if S != 1.05 else ("mass", mass) for S, mass in tried]
    assert [name for name, _ in order[:4]] == ["mass", "S", "mass", "S"]
    (steps,) = ([value for name, value in order[:12] if name == each] for each in ("S",))
    assert steps == sorted(steps)


@pytest.mark.slow
@pytest.mark.parametrize("name", INFEASIBLE)
def test_each_repair_in_hands(name):
    text = INFEASIBLE[name]
    found = repairs(text, OF_FREE, *REPAIRS[name])
    assert {repair.key for repair in found} == REPAIRS[name]
    for repair in found:
        assert certified(changed(text, repair.key, repair.new, repair.needs)), repair
        part = repair.old + 0.9 * (repair.new - repair.old)
        assert not certified(changed(text, repair.key, part, repair.needs)), repair


@pytest.mark.slow
@pytest.mark.parametrize("name", REFUTED)
def test_each_repair_of_a_design_refuted_in_hands(name):
    each_repair_is_least(REFUTED[name], share=0.99)
