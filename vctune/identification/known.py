"""The parameters of the device that the user states in a log.toml, which are not identified."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from vctune.document.log import LogMap
from vctune.document.schema.rules import impossible_parts
from vctune.document.schema.validation import Fault, refusal
from vctune.document.text import toml
from vctune.document.text.codes import Note
from vctune.identification.box import DELAY_FLOOR, Estimate
from vctune.identification.study import Study, unexplained
from vctune.model.loop.filters import sensor_response
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.parts import PARTS, VelocityEstimate

SENSOR = "force_sensor"  # Key of the part that senses the force
# Keys of [device] that apply only to a device with a velocity loop in the firmware
OF_OWN_LOOP = {"delay", "delay_uncertainty", "velocity", "actuator"}


def check_known(log_map: LogMap, sample_time: float) -> None:
    """Refuse known parameters that are impossible at the sample time, or for a servo."""
    raw: dict[str, Any] = toml.parse(log_map.text, log_map.source) if log_map.text else {}
    device = raw.get("device", {}) | {"sample_time": sample_time}
    own = sorted(set(device) & OF_OWN_LOOP) if log_map.servo else []
    text = "a servo has none: its command is all that moves it"
    said: list[tuple[tuple[str | int, ...], str]] = [(("device", key), text) for key in own]
    faults = said or list(impossible_parts({"device": device}))
    if faults:
        raise refusal([Fault(path, message, "contradiction") for path, message in faults], log_map.text, log_map.source)


def known_parts(log_map: LogMap) -> dict[str, Any]:
    """Return the stated parts of a device; its velocity is a difference of positions unless the user states more."""
    stated = {key: part for key in PARTS if (part := getattr(log_map.document.device, key, None)) is not None}
    velocity = stated.get("velocity", VelocityEstimate())
    source = velocity.source if states_velocity(log_map) else "difference"
    return stated | {"velocity": replace(velocity, source=source)}


def states_velocity(log_map: LogMap) -> bool:
    """Return whether the user states where the firmware gets the velocity from."""
    device = toml.parse(log_map.text, log_map.source).get("device", {})
    return "from" in device.get("velocity", {})


def known_delays(log_map: LogMap) -> dict[str, float]:
    """Return the stated delays, s, by "delay" and "sensor_delay". A fit does not search for them."""
    delay, sensor = log_map.document.device.delay, known_parts(log_map).get(SENSOR)
    delays = {} if delay is None else {"delay": delay}
    if sensor is not None:
        through = sensor_response(sensor, 0.0, FLOATS)
        delays["sensor_delay"] = 0.0 if through is None else float(through.lag)
    return delays


def with_known(studies: Sequence[Study], log_map: LogMap, T: float) -> tuple[list[Estimate], list[Note]]:
    """Return all estimates with the user's delay in place of the identified ones, and a remark on it."""
    found, stated = [estimate for study in studies for estimate in study.estimates], log_map.document.device
    if log_map.servo:
        return found, []
    if stated.delay is not None:
        half = max(stated.delay_uncertainty, DELAY_FLOOR * T)
        note = Note("remark-stated-delay", f"the delay is the stated one, {stated.delay:g} s, within {half:g} s")
        delay = Estimate("delay", stated.delay, 0.0, log_map.source, (half, half), stated=True)
        return [*(estimate for estimate in found if estimate.key != "delay"), delay], [note]
    if not any(estimate.key == "delay" for estimate in found):
        message = "the command never moves, so no log tells the delay; write device.delay, and delay_uncertainty"
        raise unexplained(studies[0].recording, message, "device.delay")
    return found, []
