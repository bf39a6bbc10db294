"""Kinds of display: one record of facts each, which the variables, the files and the error agree with."""

from __future__ import annotations

from dataclasses import fields

import pytest

from vctune.document.schema.statement import table_of
from vctune.model.device import Device
from vctune.model.display import ADMITTANCE, DISPLAYS
from vctune.model.problem import Bounds


@pytest.mark.parametrize("kind", DISPLAYS.values(), ids=DISPLAYS)
def test_numbers_of_a_design(kind):
    """Gains first, then the fields of its coupling in their order; each has bounds."""
    assert kind.names[2:] == tuple(field.name for field in fields(kind.coupling))
    assert set(kind.names) <= {field.name for field in fields(Bounds)}
    assert kind.stated == tuple(key for key in kind.keys if key not in kind.absent)


@pytest.mark.parametrize("kind", DISPLAYS.values(), ids=DISPLAYS)
def test_references_are_inverse_where_the_coupling_is(kind):
    assert kind.reference(4.0) == (0.25 if kind.inverse else 4.0)
    assert kind.ratio == f"Re {'1/' if kind.inverse else ''}Z_c / R"


@pytest.mark.parametrize("kind", DISPLAYS.values(), ids=DISPLAYS)
def test_a_table_states_the_kind_unless_it_is_the_usual_one(kind):
    table = table_of(Device(mass=1.0, damping=1.0, sample_time=1e-3, display=kind.name))
    assert table.get("display") == (None if kind is ADMITTANCE else kind.name)
