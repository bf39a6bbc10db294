"""Find contradictions in an [[experiment]] between values that are valid on their own."""

from __future__ import annotations

from collections.abc import Iterator
from math import pi
from typing import Any

from vctune.document.schema.experiment_schema import EnvironmentTable, SceneOperatorTable
from vctune.document.schema.number_units import units_stated
from vctune.document.schema.validation import Contradiction
from vctune.document.text.raw import number_at

LEAST_STROKE = 4  # Least duration of a stroke at the greatest speed of the hand, sample times
MOST_SAMPLES = 5_000_000  # Greatest number of samples of an experiment
# Keys that do not apply to the experiment of a servo, each with the reason
MEANINGLESS_EXPERIMENT_WITH_SERVO: dict[tuple[str, ...], str] = {
    ("friction",): "the hand does not move it, and its motion follows the command whatever rubs",
    ("sensors", "position_resolution"): "the firmware reads no position of it",
    ("actuator", "limit"): "the firmware commands no force",
    ("baseline",): "a regular PID commands a force, which it does not take",
}


def impossible_experiments(raw: dict[str, Any]) -> Iterator[Contradiction]:
    """Yield the contradictions in the valid parts of the experiments."""
    tables = raw.get("experiment")
    if not isinstance(tables, list):
        return
    names: list[object] = []
    for index, table in enumerate(tables):
        if not isinstance(table, dict):
            continue
        if isinstance(table.get("name"), str) and table["name"] in names:
            yield ("experiment", index, "name"), f"{table['name']!r} is the name of another experiment; choose its own"
        names.append(table.get("name"))
        for path, message in (*_hand(raw, table), *_rendering(table), *_hardware(table), *_of_servo(raw, table)):
            yield ("experiment", index, *path), message


def _value(table: dict[str, Any], model: Any, group: str, key: str) -> float | None:
    """Return a number in the sub-table `group` of a table, or its default if it is absent; None if it is not a
    number."""
    values = table.get(group, {})
    if isinstance(values, dict) and key not in values:
        fields = model.model_fields.items()
        return float(next(field.default for name, field in fields if key in (name, field.alias)))
    return number_at(table, group, key)


def _hand(raw: dict[str, Any], table: dict[str, Any]) -> Iterator[Contradiction]:
    """Yield the contradictions in the hand of an experiment: its connection and its motion."""
    start, end, speed, cycles, damping, stiffness = (
        _value(table, SceneOperatorTable, "operator", key)
        for key in ("from", "to", "speed", "cycles", "damping", "stiffness")
    )
    if damping == 0 and stiffness == 0:
        yield ("operator",), "damping and stiffness are both 0: the hand does not move the handle; give it one of them"
    if start is None or end is None:
        return
    if start == end:
        yield ("operator",), f"from and to are both {start:g}: nothing moves; give them different places"
        return
    sample_time = number_at(raw, "device", "sample_time")
    if not (sample_time and sample_time > 0 and speed and speed > 0):
        return
    samples = abs(end - start) / speed / sample_time
    if samples < LEAST_STROKE:
        yield (
            ("operator", "speed"),
            f"a stroke takes {samples:.3g} sample times; move slower or further: at least {LEAST_STROKE}",
        )
    if cycles and pi * cycles * samples > MOST_SAMPLES:
        yield (
            ("operator",),
            f"about {pi * cycles * samples:.3g} samples; at most {MOST_SAMPLES}: fewer cycles, faster or less far",
        )


def _rendering(table: dict[str, Any]) -> Iterator[Contradiction]:
    """Yield the environments and baselines that the simulation does not allow."""
    environment = table.get("environment", {})
    stiffness = _value(table, EnvironmentTable, "environment", "stiffness")
    if isinstance(environment, dict) and environment.get("wall") is True and stiffness == 0:
        yield ("environment", "wall"), "a wall needs a stiffness"
    if isinstance(environment, dict) and environment.get("wall") is True:
        if environment.get("rule") in ("trapezoid", "explicit"):
            yield ("environment", "rule"), "a wall is passive by backward Euler alone; leave the rule out"
        if environment.get("late"):
            yield ("environment", "late"), "a wall is simulated on time alone; leave it out, or write wall = false"
    if table.get("baseline") and isinstance(environment, dict):
        late_or_explicit = environment.get("late") or environment.get("rule") == "explicit"
        if late_or_explicit:
            yield (
                ("baseline",),
                "the regular PID renders environments on time alone, and not by explicit Euler; leave it out",
            )
    inertia = [number_at(table, "baseline", key) for key in ("mass", "damping")]
    elastic = environment if isinstance(environment, dict) and environment.get("wall") is not True else {}
    if inertia == [0, 0] and not any(
        _value({"environment": elastic}, EnvironmentTable, "environment", key)
        for key in ("mass", "damping", "stiffness")
    ):
        yield (
            ("baseline",),
            "mass and damping are both 0: a free handle would have no limit to its speed; give one of them",
        )


def _hardware(table: dict[str, Any]) -> Iterator[Contradiction]:
    coulomb, stiction = number_at(table, "friction", "coulomb"), number_at(table, "friction", "stiction")
    if coulomb is not None and stiction is not None and stiction < coulomb:
        yield ("friction", "stiction"), f"{stiction:g} is below coulomb = {coulomb:g}; swap them"


def _of_servo(raw: dict[str, Any], table: dict[str, Any]) -> Iterator[Contradiction]:
    """Yield the keys that do not apply to the experiment of a servo."""
    device = raw.get("device")
    if not isinstance(device, dict) or "servo" not in device:
        return
    for path, reason in MEANINGLESS_EXPERIMENT_WITH_SERVO.items():
        stated: Any = table
        for key in path:
            stated = stated.get(key) if isinstance(stated, dict) else None
        if stated not in (None, 0):
            reason_in_units = units_stated(raw).translated(reason)
            yield path, f"means nothing with [device.servo]: {reason_in_units}; leave it out"
