"""The parameters of the device that the user states in a log.toml, which are not identified."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from vctune.document.log import LogMap
from vctune.document.schema.rules import impossible_parts
from vctune.document.schema.validation import Fault, refusal
from vctune.document.text import toml
from vctune.model.loop.filters import sensor_response
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.parts import PARTS, VelocityEstimate

SENSOR = "force_sensor"  # Key of the part that senses the force
# Keys of [device] that apply only to a device with a velocity loop in the firmware
OF_OWN_LOOP = {"delay", "delay_uncertainty", "velocity", "actuator"}


@dataclass(frozen=True, slots=True)
class Known:
    """What the user states."""

    parts: dict[str, Any]  # by key; the velocity is a difference of positions unless the user states its source
    delays: dict[str, float]  # "delay" and "sensor_delay", s, for which a fit does not search
    velocity: bool  # whether the source of the velocity is stated


def known_of(log_map: LogMap, sample_time: float) -> Known:
    """Return what the user states, or refuse what is impossible at the sample time, or for a servo."""
    raw: dict[str, Any] = toml.parse(log_map.text, log_map.source).get("device", {})
    own = sorted(set(raw) & OF_OWN_LOOP) if log_map.servo else []
    faults = [
        Fault(("device", key), "a servo has none: its command is all that moves it", "contradiction") for key in own
    ]
    impossible = impossible_parts({"device": raw | {"sample_time": sample_time}})
    faults = faults or [Fault(path, message, "contradiction") for path, message in impossible]
    if faults:
        raise refusal(faults, log_map.text, log_map.source)
    stated, velocity = log_map.document.device, "from" in raw.get("velocity", {})
    parts = {key: part for key in PARTS if (part := getattr(stated, key, None)) is not None}
    if not velocity:
        parts["velocity"] = replace(parts.get("velocity", VelocityEstimate()), source="difference")
    delays = {} if stated.delay is None else {"delay": stated.delay}
    if SENSOR in parts:
        through = sensor_response(parts[SENSOR], 0.0, FLOATS)
        delays["sensor_delay"] = 0.0 if through is None else float(through.lag)
    return Known(parts, delays, velocity)
