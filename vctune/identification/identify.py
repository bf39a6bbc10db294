"""Identify a device, its box, and the source of each parameter from recordings. This is the main path of the
package."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi
from typing import Any, Literal

import numpy as np

from vctune.document.log import LogMap
from vctune.document.recording import SERVO_COMMANDS, Recording
from vctune.document.records.identification_json import Bounded, Estimate, FrictionRecord, IdentificationRecord
from vctune.document.schema.rules import MAX_DELAY_SAMPLES, impossible_parts
from vctune.document.schema.statement import device_table
from vctune.document.schema.validation import Fault, refusal
from vctune.document.text import toml
from vctune.document.text.errors import InputError, Note
from vctune.identification.box import DELAY_FLOOR, box, readable, unexplained
from vctune.identification.checks import check, quantum_of, remarks, usable
from vctune.identification.mechanism import mechanism_study
from vctune.identification.response import response_study
from vctune.identification.servo import servo_study
from vctune.identification.study import LEAST_RADII, Study, envelope
from vctune.model.device import Device
from vctune.model.loop.filters import sensor_response
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.parts import LOOP_DELAYS, PARTS, Servo, VelocityEstimate

SENSOR = "force_sensor"  # Key of the part that senses the force
# Keys of [device] that apply only to a device with a velocity loop in the firmware
OF_OWN_LOOP = {"display", "delay", "delay_uncertainty", "velocity", "actuator"}


@dataclass(frozen=True, slots=True)
class Known:
    """What the user states."""

    parts: dict[str, Any]  # by key; the velocity is a difference of positions unless the user states its source
    fixed: dict[str, float]  # "delay", "lag" and "sensor_delay", s, for which a fit does not search
    velocity: bool  # whether the source of the velocity is stated
    display: Literal["admittance", "impedance"]


def known_of(log_map: LogMap, sample_time: float) -> Known:
    """Return what the user states, or refuse what is impossible at the sample time, or for a servo."""
    raw: dict[str, Any] = toml.parse(log_map.text, log_map.source).get("device", {})
    own = sorted(set(raw) & OF_OWN_LOOP) if log_map.servo else []
    faults = [
        Fault(("device", key), "a servo has none: its command is all that moves it", "contradiction") for key in own
    ]
    if raw.get("display") == "impedance" and SENSOR in raw:
        faults.append(Fault(("device", SENSOR), "an impedance display senses no force; leave it out", "contradiction"))
    if raw.get("delay", 0.0) > MAX_DELAY_SAMPLES * sample_time:
        text = f"is {raw['delay'] / sample_time:.4g} sample times, and at most {MAX_DELAY_SAMPLES} are supported"
        faults.append(Fault(("device", "delay"), text, "contradiction"))
    impossible = impossible_parts({"device": raw | {"sample_time": sample_time}})
    faults = faults or [Fault(path, message, "contradiction") for path, message in impossible]
    if faults:
        raise refusal(faults, log_map.text, log_map.source)
    stated, velocity = log_map.document.device, "from" in raw.get("velocity", {})
    parts = {key: part for key in PARTS if (part := getattr(stated, key, None)) is not None}
    if not velocity:
        parts["velocity"] = replace(parts.get("velocity", VelocityEstimate()), source="difference")
    fixed = {} if stated.delay is None else {"delay": stated.delay}
    if SENSOR in parts:
        through = sensor_response(Device(1.0, 0.0, sample_time, force_sensor=parts[SENSOR]), 0.0, FLOATS)
        fixed["sensor_delay"] = 0.0 if through is None else float(through.lag)
    if stated.actuator is not None:
        fixed["lag"] = 1 / (2 * pi * stated.actuator.bandwidth_hz)
    return Known(parts, fixed, velocity, stated.display)


SAME_SAMPLE_TIME = 1e-3  # Greatest relative difference between the sample times of recordings of one device
POOR = 0.05  # Share of the motion that is left, above which there is a warning
WEAK_SHARE = 0.5  # Relative half-width above which a remark calls a delay poorly determined
FAST = 0.02  # Share of a command's power above half of the log's Nyquist frequency


@dataclass(frozen=True, slots=True)
class Identified:
    """A device, with the uncertainty of its parameters."""

    record: IdentificationRecord  # the object of identification.json, with the box
    device: Device  # device at the centre of the box
    studies: list[Study]  # one for each recording

    def bounded(self, key: str) -> Bounded | None:
        """Return a parameter of the device with its interval, by its key; None if it was not identified."""
        return next((bounded for bounded in self.record.numbers if bounded.key == key), None)


def identify(
    recordings: Sequence[Recording],
    log_map: LogMap,
    name: str,
    progress: Callable[[str], None],
    versions: Mapping[str, str | None],
) -> Identified:
    """Identify a device."""
    recordings = [usable(each, log_map.document.sample_time, servo=log_map.servo) for each in recordings]
    times = [check(recording, log_map.document.sample_time, servo=log_map.servo) for recording in recordings]
    first, T = recordings[0], times[0]
    for recording, step in zip(recordings, times, strict=True):
        if abs(step / T - 1) > SAME_SAMPLE_TIME:
            message = f"was sampled every {step:g} s, and {first.source} every {T:g} s; identify them apart"
            raise InputError.of(recording.source, "log-samples", message)
    loop_T = min(log_map.document.sample_time or T, T)  # the loop may be faster than the log
    known, studies = known_of(log_map, loop_T), []
    for recording, step in zip(recordings, times, strict=True):
        progress(f"fitting {recording.source}")
        studies.append(_with_remarks(_study(recording, step, log_map, known)))
    estimates, said = _with_known(studies, log_map, T)
    if T / loop_T > 1 + SAME_SAMPLE_TIME:
        _refuse_fast_commands(recordings)
        estimates, note = _between_rows(estimates, T, loop_T)
        said.append(note)
    bounds = readable(box(estimates, T, first.units), first, loop_T)
    device = _device(bounds, log_map, loop_T, studies, known)
    progress("comparing the response with the box")
    lines = [each for study in studies for each in study.lines if each.hertz.size]
    said += [note for study in studies for note in study.remarks] + _gaps(studies, bounds, log_map, known)
    friction = None if device.friction is None else FrictionRecord(coulomb=device.friction)
    noise = next((study.force_noise for study in studies if study.force_noise), None)
    record = IdentificationRecord(
        name=name,
        description=log_map.document.description,
        rotary=first.rotary,
        sample_time=float(loop_T),
        device=device_table(device),
        assumed=[] if log_map.servo or known.velocity else ["velocity"],
        numbers=bounds,
        unmodelled=[] if device.kind.inverse else envelope(lines, device, bounds),
        friction=friction,
        force_noise=None if noise is None else float(f"{noise:.6g}"),
        recordings=[study.record for study in studies],
        warnings=[note.line for note in said if note.code.startswith("warn-")],
        remarks=[note.line for note in said if not note.code.startswith("warn-")],
        versions=dict(versions),
    )
    return Identified(record, device, studies)


def _study(recording: Recording, T: float, log_map: LogMap, known: Known) -> Study:
    """Fit a servo or a mechanism to a recording."""
    has, held, left_out = recording.channels, known.display == "impedance", set[str]()
    if "hand" not in has:
        left_out.add("sensor_delay")
    if not (recording.is_response or "command" in has):  # both end at the measured force or before it
        left_out |= {"delay", "lag"}
    fixed = {name: each for name, each in known.fixed.items() if name not in left_out}
    if recording.is_response:
        return response_study(recording, T, fixed, servo=log_map.servo, held=held)
    if log_map.servo:
        return servo_study(recording, T)
    if "force" in has and "command" not in has and "delay" not in known.fixed:
        message = (
            "a measured force says nothing of the delay from the command to it, and a design with too little delay "
            "may be unstable: log the command as well; name this column `command` under [columns] if it is what the "
            "firmware wrote; or write device.delay, of the whole path from the command to the motion, into log.toml"
        )
        raise unexplained(recording, message, has["force"].header)
    return mechanism_study(recording, T, fixed, held=held)


def _with_remarks(study: Study) -> Study:
    """Return a study with the remarks on its recording; one of which much is unexplained is refused or warned of."""
    left = study.record.residual_share or 0.0
    text = (
        f"{study.recording.name}: the device in the file leaves {left:.1%} of the motion unexplained: no design "
        "for it is better than that; see the report for when and at which frequencies"
    )
    said = [*remarks(study.recording), *study.remarks, *([Note("warn-residual", text)] if left > POOR else [])]
    record = study.record.model_copy(update={"remarks": [note.line for note in said]})
    return replace(study, remarks=said, record=record)


def _with_known(studies: Sequence[Study], log_map: LogMap, T: float) -> tuple[list[Estimate], list[Note]]:
    """Return all estimates with the user's delay in place of the identified ones, and a remark on it."""
    found, stated = [estimate for study in studies for estimate in study.estimates], log_map.document.device
    if stated.display == "impedance":  # whose firmware senses no force, late or not
        found = [estimate for estimate in found if not estimate.key.startswith(SENSOR)]
    if stated.delay is not None:
        half = max(stated.delay_uncertainty, DELAY_FLOOR * T)
        note = Note("remark-stated-delay", f"the delay is the stated one, {stated.delay:g} s, within {half:g} s")
        delay = Estimate("delay", stated.delay, 0.0, log_map.source, (half, half), stated=True)
        return [*(estimate for estimate in found if estimate.key != "delay"), delay], [note]
    if not log_map.servo and not any(estimate.key == "delay" for estimate in found):
        message = "the command never moves, so no log tells the delay; write device.delay, and delay_uncertainty"
        raise unexplained(studies[0].recording, message, "device.delay")
    return found, []


def _refuse_fast_commands(recordings: Sequence[Recording]) -> None:
    """Refuse a log slower than its loop in which the command may have moved between the rows and come back."""
    for recording in recordings:
        for role in {"command", *SERVO_COMMANDS} & set(recording.channels):
            values = recording.channels[role].values
            power = np.abs(np.fft.rfft(np.diff(values) if role == "position_command" else values - values.mean())) ** 2
            if power[power.size // 2 :].sum() > FAST * power.sum():
                message = "changes too fast for a log slower than its loop: log every sample, or move more slowly"
                raise unexplained(recording, message, recording.channels[role].header)


def _between_rows(estimates: Sequence[Estimate], T: float, loop_T: float) -> tuple[list[Estimate], Note]:
    """Return the estimates for a loop that is faster than its log, and a remark.

    A fit takes the command as held from row to row. The loop has given newer ones meanwhile, which the motion follows
    up to a row earlier: the delay in the fit is too short by up to that.
    """
    late = [
        replace(each, value=each.value + T / 2, excess=(each.excess[0] + T / 2, each.excess[1] + T / 2))
        if each.key in LOOP_DELAYS and not each.stated
        else each
        for each in estimates
    ]
    text = f"the loop runs every {loop_T:g} s and the log has a row every {T:g} s: the delay is known to within a row"
    return late, Note("remark-slow-log", text)


def _device(bounds: Sequence[Bounded], log_map: LogMap, T: float, studies: Sequence[Study], known: Known) -> Device:
    """Return the device at the centre of the box, with the parts that the user states; a servo has the order that is
    likelier over all recordings."""
    value, units = {each.key: each.value for each in bounds}, "rotary" if log_map.document.rotary else "linear"
    parts: dict[str, Any] = {"units": units}
    if log_map.servo:
        order = 1 + (sum(each.servo_orders[1] for each in studies) > sum(each.servo_orders[2] for each in studies))
        roles = studies[0].recording.channels
        command: Literal["velocity", "position"] = "position" if "position_command" in roles else "velocity"
        servo = Servo(value["servo.delay"], value["servo.bandwidth_hz"], order, command)
        return Device(1.0, 0.0, T, display="servo", force_sensor=known.parts.get(SENSOR), servo=servo, **parts)
    for key, part in PARTS.items():
        numbers = {number.name: value[path] for number in part.numbers if (path := f"{key}.{number.name}") in value}
        parts |= {key: part.record(**numbers)} if numbers else {}
    parts |= known.parts
    estimate, step = parts.get("velocity"), _step_read(studies)
    differenced = known.display == "impedance" or (estimate is not None and estimate.source == "difference")
    if differenced and step is not None and (estimate is None or estimate.resolution is None):
        parts["velocity"] = replace(estimate or VelocityEstimate("difference"), resolution=step)
    # the least friction, which holds the least
    friction = min((float(f"{each.friction:.6g}") for each in studies if each.friction is not None), default=None)
    return Device(value["mass"], value["damping"], T, value["delay"], display=known.display, friction=friction, **parts)


def _step_read(studies: Sequence[Study]) -> float | None:
    """Return the greatest step of the logged positions; None if none is rounded."""
    positions = [study.recording.channels.get("position") for study in studies]
    steps = [step for each in positions if each is not None and (step := quantum_of(each)) is not None]
    return float(f"{max(steps):.6g}") if steps else None


def _gaps(studies: Sequence[Study], bounds: Sequence[Bounded], log_map: LogMap, known: Known) -> list[Note]:
    """Return remarks on properties of the device that no recording shows."""
    said, by_key = list[Note](), {each.key: each for each in bounds}
    seen = np.concatenate([np.zeros(0), *(lines.hertz for study in studies for lines in study.lines[:1])])
    if seen.size >= LEAST_RADII:
        text = f"nothing was measured above {seen.max():.4g} Hz, where unmodelled keeps its last value"
        said.append(Note("remark-highest-line", text))
    if log_map.servo:
        if SENSOR not in known.parts:
            text = "no log shows how late the force is sensed: it is assumed to be sensed at once; write "
            said.append(Note("remark-assumed-sensor", f"{text}[device.{SENSOR}] in a log.toml"))
        if seen.size < LEAST_RADII:
            said.append(Note("remark-slow-motion", "no frequency shows clearly enough for unmodelled: record a sweep"))
        if not any(each.name.startswith("compliance") for study in studies for each in study.record.numbers):
            text = "no force was logged, so that it is not known whether the servo yields to one: log it as hand or "
            said.append(Note("remark-unpushed", f"{text}force"))
        return said
    if not known.velocity:
        text = "no log shows how the firmware obtains its velocity: it is assumed to be the difference of the position;"
        said.append(Note("remark-assumed-velocity", f"{text} write [device.velocity] from in a log.toml"))
    # a fit of motion has one lag, which excludes the actuator and the delay if the user states them
    if not {"delay", "lag"} & set(known.fixed) and "actuator.bandwidth_hz" not in by_key:
        text = "no lag of the actuator is told from a delay: the delay includes both"
        said.append(Note("remark-actuator-lag", text))
    delay = by_key["delay"]
    if delay.share > WEAK_SHARE:
        text = f"the delay is poorly determined: anything from {delay.low:.2g} to {delay.high:.2g} s fits"
        said.append(Note("remark-weak-delay", text))
    if "structure.handle_mass" not in by_key and not seen.size:
        text = "nothing but noise is left of the motion, which shows no dynamics above its own frequencies"
        said.append(Note("remark-slow-motion", f"{text}: excite up to a fifth of the sampling rate"))
    return said
