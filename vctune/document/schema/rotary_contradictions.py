"""Find the numbers that a rotary device must state because their defaults assume a hand or a length."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from vctune.document.schema.experiment_schema import FrictionTable, SceneOperatorTable
from vctune.document.schema.number_units import unit_of, units_stated
from vctune.document.schema.validation import Contradiction
from vctune.model.hands import HAND
from vctune.model.numbers.units import LINEAR, ROTARY
from vctune.model.problem import HUMAN_HANDS


def missing_of_rotary(raw: dict[str, Any]) -> Iterator[Contradiction]:
    """Yield the numbers that a rotary problem lacks: of its hands, and of hands and friction in its experiments."""
    if units_stated(raw) is not ROTARY:
        return
    if _hands_are_met(raw):
        has_a_choice = "servo" not in raw["device"] and "environment" not in raw
        yield from _hands(raw.get("operator", {}), has_a_choice=has_a_choice)
    tables = raw.get("experiment")
    for index, table in enumerate(tables if isinstance(tables, list) else []):
        stated = table if isinstance(table, dict) else {}
        yield from _defaults(("experiment", index, "operator"), stated.get("operator", {}), SceneOperatorTable)
        yield from _defaults(("experiment", index, "friction"), stated.get("friction"), FrictionTable)


def _hands_are_met(raw: dict[str, Any]) -> bool:
    """Return whether a box of hands is required. On an impedance display without a box of environments, any passive
    hand replaces the box."""
    stability = raw.get("stability", {})
    criterion = stability.get("criterion", "both") if isinstance(stability, dict) else "both"
    any_hand = raw["device"].get("display") == "impedance" and "environment" not in raw
    return criterion == "hands" or (criterion == "both" and not any_hand)


def _hands(operator: Any, *, has_a_choice: bool) -> Iterator[Contradiction]:
    """Yield the fault of missing ranges of the hands. `has_a_choice` states whether the criterion may be "passive"."""
    if not isinstance(operator, dict):
        return
    lacking = [key for key in HAND if key.partition(".")[2] not in operator]
    if not lacking:
        return
    of_a_grip = HUMAN_HANDS.high.by_key
    written = ", ".join(f"{key.partition('.')[2]} = {{ min = 0, max = {of_a_grip[key]:g} r^2 }}" for key in lacking)
    otherwise = ', or ask for stability.criterion = "passive"' if has_a_choice else ""
    yield (
        ("operator",),
        f"a rotary device has no default hands, since they depend on how far from its axis it is held: write {written} "
        f"for a hand that holds it r metres from the axis{otherwise}",
    )


def _defaults(path: tuple[str | int, ...], stated: Any, table: type[BaseModel]) -> Iterator[Contradiction]:
    """Yield those absent keys of a table whose defaults are in the units of a linear device."""
    if not isinstance(stated, dict):
        return
    for name, field in table.model_fields.items():
        key = field.alias or name
        unit, of_rotary = (unit_of((*path, key), units) for units in (LINEAR, ROTARY))
        if key not in stated and isinstance(field.default, float) and field.default and unit != of_rotary:
            yield (*path, key), f"is missing; a rotary device has no default for it: write a number of {of_rotary}"
