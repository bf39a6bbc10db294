"""Every number that vctune prints is what an oracle says that it means: the tables of oracles/meaning.py."""

from __future__ import annotations

import numpy as np
import pytest
from compared import paths, wrong
from conftest import ROOT, mostly_slow
from meaning import DESIGN, Case, Elsewhere
from meaning_of_studies import IDENTIFICATION, REGION, ROWS, SIMULATION
from posed import POSED

import vctune
from vctune.api.json_schemas import SCHEMAS

TABLES = {
    "design": DESIGN, "region": REGION, "rows": ROWS, "simulation": SIMULATION, "identification": IDENTIFICATION,
}  # fmt: skip
REASONS = 0.15
"""Greatest share of paths that have a reason in place of an oracle."""


@pytest.mark.parametrize("name", TABLES)
def test_every_path_of_a_schema_has_an_oracle_or_a_reason(name):
    stated, table = set(paths(SCHEMAS[name]())), TABLES[name]
    assert stated == table.keys()
    for path, oracle in table.items():
        if isinstance(oracle, Elsewhere):
            called = oracle.called or path.rpartition(".")[2].strip("[]{}")
            assert called in (ROOT / "tests" / oracle.test).read_text(), path


def test_few_paths_have_a_reason_alone():
    every = [oracle for table in TABLES.values() for oracle in table.values()]
    assert sum(isinstance(oracle, str) for oracle in every) <= REASONS * len(every)


ROWED = ("hands", "servo", "display", "hands, environments", "both", "wall")
"""Kinds of problems whose rows are compared."""
PLANES = {
    "band": ("gains.velocity", "gains.position"), "hands": ("gains.velocity", "coupling.drag"),
    "display, both": ("coupling.damping", "coupling.stiffness"),
}  # fmt: skip
"""Kinds of problems whose regions are compared, with two variables that span a plane."""


@pytest.mark.parametrize("kind", mostly_slow(ROWED, ROWED[:3]))
def test_the_numbers_of_rows_are_what_they_mean(kind, tmp_path):
    """Of a point each, with the record that a check of the same point has."""
    rng = np.random.default_rng((94, list(POSED).index(kind)))
    tables = POSED[kind](rng)
    key = "stability.safety_factor"
    value = tables["stability"]["safety_factor"]
    (row,) = vctune.sweep(tables, {key: [value]}, folder=tmp_path).table.rows()
    record = vctune.check(tables).finding.record()
    case = Case(tables | {"_point": {key: value}}, record, rng)
    schema = SCHEMAS["rows"]()
    assert wrong(case, ROWS, schema | {"anyOf": schema["anyOf"][1:]}, row) == []


@pytest.mark.parametrize("kind", mostly_slow(PLANES, ["band"]))
def test_the_numbers_of_a_region_are_what_they_mean(kind):
    rng = np.random.default_rng((95, list(POSED).index(kind)))
    tables = POSED[kind](rng)
    for key in PLANES[kind]:
        table, _, name = key.partition(".")
        middle = tables[table][name] or 1.0
        tables[table][name] = {"min": middle / 8, "max": middle * 8}
    found = vctune.region(tables, *PLANES[kind], resolution=1 / 16)
    case = Case(tables | {"_axes": PLANES[kind]}, found.record(), rng)
    assert wrong(case, REGION, SCHEMAS["region"]()) == []


MOVED = {
    "spring": {"environment": {"stiffness": 200.0}, "operator": {"to": 0.005, "cycles": 2}},
    "sine": {
        "environment": {"damping": 3.0, "mass": 0.1, "rule": "trapezoid"}, "operator": {"motion": "sine", "to": 0.003},
    },
    "wall": {"environment": {"stiffness": 500.0, "zero": 0.002, "wall": True}, "operator": {"to": 0.004, "cycles": 1}},
    "limited": {"environment": {}, "operator": {"to": 0.02, "speed": 0.2, "cycles": 2}, "actuator": {"limit": 0.3}},
}  # fmt: skip
"""Experiments whose traces are measured."""
PID = {"kp": 2000.0, "kd": 20.0, "mass": 1.0, "damping": 20.0}


def test_the_numbers_of_a_simulation_are_what_they_mean():
    """Measures are those of the traces, which tests/simulation compares with other code."""
    device = {"mass": 0.4, "damping": 2.0, "sample_time": 1e-3, "friction": 0.05}
    experiments = [{"name": name, "baseline": PID, **table} for name, table in MOVED.items()]
    tables = {
        "device": device, "gains": {"velocity": 150.0, "position": 6000.0}, "experiment": experiments,
        "coupling": {"damping": 160.0, "mass": 0.37, "drag": 1.0}, "stability": {"criterion": "passive"},
    }  # fmt: skip
    done = vctune.simulate(tables, vctune.Gains(150.0, 6000.0), vctune.Coupling(160.0, 0.37, 1.0))
    record, traces = done.record(), {}
    for part, run, table in zip(record["experiments"], done.experiments, experiments, strict=True):
        for name in ("baseline", "design"):
            there = getattr(run, name).traces, table
            traces |= {id(each): there for each in (
                    part[name], part[name]["metrics"], part[name]["loop"], *part[name]["metrics"]["fits"].values()
                )}  # fmt: skip
        traces[id(part["environment"])] = table
    case = Case(tables | {"_traces": traces}, record, np.random.default_rng(0))
    assert wrong(case, SIMULATION, SCHEMAS["simulation"]()) == []
