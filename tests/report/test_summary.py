"""The head of a page: its sentence names the claim that fails, and the scale fits its errors."""

from __future__ import annotations

import pytest

from vctune.design.solve import solve
from vctune.design.verdict.design_record import record_of
from vctune.document.reading import ProblemFile, parse_problem
from vctune.report.page.summary import doubt, summary

DESIGN = """[device]
mass = 0.4
damping = 2.0
sample_time = 1e-3
[gains]
velocity = 150.0
position = 6000.0
[coupling]
damping = 160.0
mass = {mass}
[stability]
criterion = "passive"
safety_factor = {factor}
"""
MISSED = "(a ratio of 1 is proved, the safety factor is missed)"


def made(text):
    problem = parse_problem(text, "design.toml", "design")
    record = record_of(ProblemFile(problem, text), solve(problem))
    return record, problem, summary(record, problem)


@pytest.mark.parametrize(
    ("stability", "sentence"),
    [
        ({"mass": 0.35, "factor": 1.05}, f" Hz {MISSED}."),
        ({"mass": 0.2, "factor": 1.05}, " Hz."),
        ({"mass": 0.35, "factor": "1.0\nmax_sensitivity = 1.05"}, " Hz."),
    ],
)
def test_only_a_claim_on_the_ratio_can_miss_the_safety_factor(stability, sentence):
    """The remark follows the claim `passive` if a ratio of 1 is proved, and no other claim."""
    record, problem, head = made(DESIGN.format(**stability))
    assert (record.status, head.kind, head.sign, head.word) == ("violated", "bad", "\u2717", "violated")
    assert head.sentence.endswith(sentence)
    assert (MISSED in head.sentence) == (MISSED in sentence)
    assert doubt(record, problem) == "violated: not for use"


def test_a_certified_design_is_measured_by_the_device_without_a_loop():
    record, problem, head = made(DESIGN.partition("[gains]")[0] + '[stability]\ncriterion = "passive"\n')
    assert (record.status, head.kind, head.sign) == ("certified", "good", "\u2713") and doubt(record, problem) == ""
    assert head.sentence == f"Proved {record.promise}."
    assert "the device without a loop differs by" in head.measure
    assert [mark.label for mark in head.scale.marks][:2] == ["this design", "device without a loop"]
    assert all(0 <= mark.share <= 1 for mark in [*head.scale.marks, *head.scale.ticks])
    assert head.scale.marks[0].share < head.scale.little_use < head.scale.marks[1].share


def test_a_servo_without_contacts_is_not_compared_with_a_loop():
    record, _, head = made(
        """[device]
sample_time = 0.002
servo = { delay = 0.032, bandwidth_hz = 20.0, order = 2 }
[operator]
mass = { min = 0.0, max = 2.0 }
damping = { min = 0.0, max = 30.0 }
stiffness = { min = 0.0, max = 1000.0 }
[coupling]
damping = 500.0
mass = 2.7
drag = 40.0
"""
    )
    assert record.contact.stiffest_contact is None
    assert "without a loop" not in head.measure
