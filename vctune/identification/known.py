"""Handle the parameters of the device that the user states in a log.toml. vctune does not identify them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from vctune.document.log import LogMap
from vctune.document.recording import Recording
from vctune.document.schema.defaults import stated_parts
from vctune.document.schema.device_contradictions import impossible_parts
from vctune.document.schema.validation import Fault, refusal
from vctune.document.text import toml
from vctune.document.text.codes import Note
from vctune.document.text.errors import InputError
from vctune.identification.box import DELAY_FLOOR, Estimate
from vctune.model.loop.filters import sensor_response
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.parts import Actuator, ForceSensor, VelocityEstimate

SENSOR = "force_sensor"  # Key of the part that senses the force
# Keys of [device] that apply only to a device with a velocity loop in the firmware
OF_OWN_LOOP = {"delay", "delay_uncertainty", "velocity", "actuator"}


def check_known(log_map: LogMap, sample_time: float) -> None:
    """Check that the known parameters of the device are possible at its sample time."""
    raw: dict[str, Any] = toml.parse(log_map.text, log_map.source) if log_map.text else {}
    device = raw.get("device", {}) | {"sample_time": sample_time}
    if log_map.servo and (own := sorted(set(device) & OF_OWN_LOOP)):
        faults = [
            Fault(("device", key), "a servo has none: its command is all that moves it", "contradiction") for key in own
        ]
        raise refusal(faults, log_map.text, log_map.source)
    faults = [Fault(path, message, "contradiction") for path, message in impossible_parts({"device": device})]
    if faults:
        raise refusal(faults, log_map.text, log_map.source)


def known_actuator(log_map: LogMap) -> Actuator | None:
    """Return the actuator that the user states; None if the user states no actuator."""
    stated = log_map.document.device.actuator
    return None if stated is None else Actuator(stated.bandwidth_hz, stated.order)


def known_sensor(log_map: LogMap) -> ForceSensor | None:
    """Return the force sensor that the user states; None if the user states no force sensor."""
    sensor: ForceSensor | None = stated_parts(log_map.document.device).get(SENSOR)
    return sensor


def velocity_estimate(log_map: LogMap) -> VelocityEstimate:
    """Return the source of the firmware's velocity: the difference of positions, unless the user states another
    source."""
    stated = log_map.document.device.velocity
    if stated is None:
        return VelocityEstimate("difference")
    return VelocityEstimate(stated.source or "difference", stated.filter_hz, stated.filter_order)


def known_parts(log_map: LogMap) -> dict[str, Any]:
    """Return the parts of the device that the user states, by their keys."""
    return stated_parts(log_map.document.device) | {"velocity": velocity_estimate(log_map)}


def velocity_assumed(log_map: LogMap) -> bool:
    """Return whether the user does not state how the firmware obtains its velocity."""
    stated = log_map.document.device.velocity
    return stated is None or stated.source is None


def known_delays(log_map: LogMap) -> dict[str, float]:
    """Return the delays that the user states, s, by "delay" and "sensor_delay". A fit does not search for them."""
    stated, delays = log_map.document.device, {}
    if stated.delay is not None:
        delays["delay"] = stated.delay
    sensor = known_sensor(log_map)
    if sensor is not None:
        through = sensor_response(sensor, 0.0, FLOATS)
        delays["sensor_delay"] = 0.0 if through is None else float(through.lag)
    return delays


def with_known(
    estimates: Sequence[Estimate], log_map: LogMap, T: float, recordings: Sequence[Recording]
) -> tuple[list[Estimate], list[Note]]:
    """Return the estimates with the user's delay in place of the identified one, and remarks on it. A servo's estimates
    stay the same."""
    stated = log_map.document.device
    if log_map.servo:
        return list(estimates), []
    if stated.delay is not None:
        others = [estimate for estimate in estimates if estimate.key != "delay"]
        half = max(stated.delay_uncertainty, DELAY_FLOOR * T)
        text = f"the delay is the stated one, {stated.delay:g} s, within {half:g} s"
        stated_delay = Estimate("delay", stated.delay, 0.0, log_map.source, (half, half), stated=True)
        return [*others, stated_delay], [Note("remark-stated-delay", text)]
    if not any(estimate.key == "delay" for estimate in estimates):
        message = "the command never moves, so no log tells the delay; write device.delay, and delay_uncertainty"
        raise InputError.of(recordings[0].source, "log-unexplained", message, key="device.delay")
    return list(estimates), []
