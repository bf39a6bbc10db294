"""What a design that does not ask for it says of hands whose damping changes: table, file and page."""

from __future__ import annotations

import tomllib

import pytest
from conftest import ROOT

import vctune
from vctune.design.verdict.design_record import record_of
from vctune.report.page.changing_lines import changing_lines


def published(name, **tables):
    """Return the record of a problem's published gains, examined for changing hands, and the problem."""
    document = tomllib.loads((ROOT / f"problems/{name}.toml").read_text())
    law = tomllib.loads((ROOT / f"results/{name}/gains.toml").read_text())
    file = vctune.problem(document | {key: law[key] for key in ("gains", "coupling") if key in law} | tables)
    return record_of(file, vctune.solve(file, changing=True)), file


def rows(record):
    return list(record.groups().get("hands change", []))


def test_hands_without_mass_fail_and_the_heavier_ones_are_stated():
    record, file = published("friction-wheel-hands")
    (row,) = rows(record)
    assert (row.label, row.value) == ("damping", "proved")
    assert row.unit == "of hands of 0.05 to 0.5 kg, 0 to 30 N s/m, 0 to 3000 N/m, at every sample"
    (line,) = changing_lines(record, file.problem)
    assert "may change at every sample, for M ≥ 50\u202fg." in line
    assert record.changing is not None and record.certificate is not None
    assert record.changing.storages and record.certificate.changing is None
    assert "changing" not in [claim.id for claim in record.certificate.claims]


def test_it_changes_nothing_else():
    record, file = published("friction-wheel-hands")
    without = record_of(file, vctune.solve(file)).to_json()
    assert "changing" not in without
    known = {key: value for key, value in record.to_json().items() if key not in ("changing", "solver")}
    assert known == {key: value for key, value in without.items() if key != "solver"}


def test_what_is_not_proved_is_said():
    record, file = published("friction-wheel-hands", operator={"mass": {"min": 0.0, "max": 0.0}})
    assert record.status == "certified" and [row.value for row in rows(record)] == ["not proved"]
    (line,) = changing_lines(record, file.problem)
    assert line.startswith("vctune did not prove that the damping of the hand may change")


@pytest.mark.parametrize(
    ("name", "tables", "said"),
    [
        ("cobot-wrist", {}, "may change at every sample. Mass"),
        ("late-arm", {}, "vctune did not examine hands that change while they hold the handle; stability.changing"),
        ("arm-contact", {}, "vctune did not examine hands that change while they hold the handle; stability.changing"),
        ("friction-wheel", {}, None),
    ],
)
def test_each_kind_of_problem_is_answered(name, tables, said):
    """The wrist's delay is two samples. The late arm has many states, and the other one is uncertain."""
    record, file = published(name, **tables)
    lines = changing_lines(record, file.problem)
    assert (record.status, len(lines)) == ("certified", said is not None)
    assert said is None or said in lines[0]
