"""Identify a device, its box, and the source of each parameter from recordings. This is the main path of the
package."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from vctune.document.log import LogMap
from vctune.document.recording import Recording
from vctune.document.records.identification_json import (
    BoundedRecord,
    EstimateRecord,
    FrictionRecord,
    IdentificationRecord,
    stated,
)
from vctune.document.schema.number_units import unit_of
from vctune.document.schema.rules import MAX_DELAY_SAMPLES
from vctune.document.schema.statement import device_table
from vctune.document.text.codes import Note
from vctune.document.text.errors import InputError
from vctune.identification.box import Bounded, box
from vctune.identification.checks import check, on_even_rows, remarks
from vctune.identification.known import SENSOR, check_known, known_delays, known_parts, states_velocity, with_known
from vctune.identification.motion import motion_study
from vctune.identification.response import periodic_study
from vctune.identification.servo import servo_study
from vctune.identification.study import Study, distances, envelope, unexplained
from vctune.model.device import Device
from vctune.model.numbers.units import UnitSystem
from vctune.model.parts import PARTS, Servo

Progress = Callable[[str], None]
SAME_SAMPLE_TIME = 1e-3  # Greatest relative difference between the sample times of recordings of one device
LIGHTER = 1 - 1e-3  # Greatest permitted mass of the handle, relative to the least mass of the device
POOR, UNEXPLAINED = 0.05, 0.25  # Residual share with a warning, and share of a response at which the log is refused
WEAK_SHARE = 0.5  # Relative half-width above which a remark calls a delay poorly determined
LEAST_RADII = 2  # Least number of frequencies between which the radii of unmodelled can be interpolated


@dataclass(frozen=True, slots=True)
class Identified:
    """A device, with the uncertainty of its parameters."""

    name: str
    device: Device  # device at the centre of the box
    bounds: tuple[Bounded, ...]  # the box, one interval for each parameter
    unmodelled: tuple[tuple[float, float], ...]  # radii at frequencies, Hz
    friction: float | None  # greatest Coulomb friction, N; None if none was found
    force_noise: float | None  # standard deviation of the noise in a sample of the hand's sensed force, N
    records: tuple[Study, ...]  # one study for each recording
    remarks: tuple[Note, ...]  # on what the recordings do not show

    def bounded(self, key: str) -> Bounded | None:
        """Return a parameter of the device with its interval, by its key; None if it was not identified."""
        return next((bounded for bounded in self.bounds if bounded.key == key), None)


def identify(recordings: Sequence[Recording], log_map: LogMap, name: str, progress: Progress) -> Identified:
    """Identify a device."""
    if not log_map.servo:
        recordings = [on_even_rows(recording) for recording in recordings]
    times = [check(recording, log_map.document.sample_time, servo=log_map.servo) for recording in recordings]
    T = times[0]
    for recording, step in zip(recordings, times, strict=True):
        if abs(step / T - 1) > SAME_SAMPLE_TIME:
            message = f"was sampled every {step:g} s, and {recordings[0].source} every {T:g} s; identify them apart"
            raise InputError.of(recording.source, "log-samples", message)
    check_known(log_map, T)
    studies = []
    for recording, step in zip(recordings, times, strict=True):
        progress(f"fitting {recording.source}")
        studies.append(_with_remarks(_study(recording, step, log_map)))
    estimates, on_known = with_known(studies, log_map, T)
    bounds = readable(box(estimates, T), recordings[0], T)
    device = _device(bounds, log_map, T, studies)
    progress("comparing the response with the box")
    lines = [each for study in studies for each in study.lines]
    hertz = np.concatenate([np.zeros(0), *(each.hertz for each in lines)])
    needed = np.concatenate([np.zeros(0), *(distances(each, device, bounds) for each in lines)])
    frictions = [study.friction for study in studies if study.friction is not None]
    return Identified(
        name=name,
        device=device,
        bounds=bounds,
        unmodelled=envelope(hertz, needed) if hertz.size >= LEAST_RADII else (),
        friction=max(frictions, default=None),
        force_noise=next((study.force_noise for study in studies if study.force_noise), None),
        records=tuple(studies),
        remarks=(*on_known, *remarks_on_gaps(studies, bounds, log_map)),
    )


def _study(recording: Recording, T: float, log_map: LogMap) -> Study:
    """Fit a servo, or a periodic excitation, or any motion if the recording has no usable periodic response."""
    if log_map.servo:
        return servo_study(recording, T)
    force, delays = recording.channels.get("force"), known_delays(log_map)
    if force is not None and "command" not in recording.channels and "delay" not in delays:
        message = (
            "a measured force says nothing of the delay from the command to it, and a design with too little delay "
            "may be unstable: log the command as well; name this column `command` under [columns] if it is what the "
            "firmware wrote; or write device.delay, of the whole path from the command to the motion, into log.toml"
        )
        raise unexplained(recording, message, force.header)
    actuator = known_parts(log_map).get("actuator")
    return periodic_study(recording, T, actuator) or motion_study(recording, T, actuator, delays)


def _with_remarks(study: Study) -> Study:
    """Return a study with the remarks on its recording; one of which much is unexplained is refused or warned of."""
    name, left, quantity = study.recording.name, study.record.residual_share or 0.0, study.quantity
    if quantity == "response" and left > UNEXPLAINED:
        message = f"{left:.0%} of the response is that of no device: record longer, or with more force or lines"
        raise unexplained(study.recording, message)
    quantity = study.recording.units.force_name if quantity == "force" else quantity
    text = (
        f"{name}: the device in the file leaves {left:.1%} of the {quantity} unexplained: no design for it is better "
        "than that; see the report for when and at which frequencies"
    )
    warnings = [Note("warn-residual", text)] if left > POOR else []
    said = (*remarks(study.recording), *study.remarks, *warnings)
    record = study.record.model_copy(update={"remarks": [note.line for note in said]})
    return replace(study, remarks=said, record=record)


def readable(bounds: Sequence[Bounded], recording: Recording, T: float) -> tuple[Bounded, ...]:
    """Return a box that the reader of problem files accepts."""
    for each in bounds:
        if each.key.endswith("delay"):
            _check_delay(each, recording, T)
    mass = next((each for each in bounds if each.key == "mass"), None)
    return tuple(
        _lighter(each, mass, recording) if mass is not None and each.key == "structure.handle_mass" else each
        for each in bounds
    )


def _check_delay(delay: Bounded, recording: Recording, T: float) -> None:
    """Refuse a delay that is certainly negative, or greater than the greatest supported delay."""
    latest = max(each.value for each in delay.estimates)
    name = "command" if delay.key == "servo.delay" else recording.units.force_name
    widest = 4 * max(each.sigma for each in delay.estimates)
    remedy = f"the columns were not sampled together; shift the {name}'s column, or log both in the same interrupt"
    if delay.key in ("delay", "servo.delay") and latest + widest < -0.5 * T:
        raise unexplained(recording, f"the position is {-latest:.3g} s ahead of the {name}: {remedy}")
    if delay.high > MAX_DELAY_SAMPLES * T > latest:
        limits = f"{max(delay.low, 0):.3g} to {delay.high:.3g} s"
        raise unexplained(recording, f"{delay.key} is not determined: {limits}; move faster, or record longer")
    if delay.high > MAX_DELAY_SAMPLES * T:
        message = f"{delay.key} is up to {delay.high:.3g} s, {delay.high / T:.3g} sample times, and at most "
        raise unexplained(recording, f"{message}{MAX_DELAY_SAMPLES} are supported: {remedy}")


def _lighter(handle: Bounded, mass: Bounded, recording: Recording) -> Bounded:
    """Return the mass of a handle with an interval that ends below the least mass of the device."""
    most, units = mass.low * LIGHTER, recording.units
    if handle.high < most:
        return handle
    if handle.value >= most:
        message = (
            f"the handle's {units.mass_name}, {handle.low:.3g} to {handle.high:.3g} {units.mass}, is not told from the "
            f"device's, {mass.low:.3g} to {mass.high:.3g}: record longer, or excite more lines around the resonance"
        )
        raise unexplained(recording, message)
    limits = (*handle.limits, Note("limit-handle", "lighter than the device"))
    return replace(handle, value=0.5 * (handle.low + most), high=most, limits=limits)


def _device(bounds: Sequence[Bounded], log_map: LogMap, T: float, studies: Sequence[Study]) -> Device:
    """Return the device at the centre of the box, with the parts that the user states; a servo has the order that is
    likelier over all recordings."""
    value = {bounded.key: bounded.value for bounded in bounds}
    parts: dict[str, Any] = {}
    if log_map.servo:
        order = 1 + (sum(each.servo_orders[1] for each in studies) > sum(each.servo_orders[2] for each in studies))
        roles = studies[0].recording.channels
        command: Literal["velocity", "position"] = "velocity" if "velocity_command" in roles else "position"
        servo = Servo(value["servo.delay"], value["servo.bandwidth_hz"], order, command)
        parts = {SENSOR: known_parts(log_map).get(SENSOR), "servo": servo}
        return Device(1.0, 0.0, T, display="servo", **parts)
    for key, part in PARTS.items():
        numbers = {number.name: value[path] for number in part.numbers if (path := f"{key}.{number.name}") in value}
        parts |= {key: part.record(**numbers)} if numbers else {}
    return Device(value["mass"], value["damping"], T, value["delay"], **(parts | known_parts(log_map)))


def remarks_on_gaps(studies: Sequence[Study], bounds: Sequence[Bounded], log_map: LogMap) -> list[Note]:
    """Return the remarks of the studies, and remarks on properties of the device that no recording shows."""
    remarks = [remark for study in studies for remark in study.remarks]
    keys = {bounded.key for bounded in bounds}
    document, parts = log_map.document.device, known_parts(log_map)

    def add(code: Any, text: str) -> None:
        remarks.append(Note(code, text))

    if log_map.servo:
        if parts.get(SENSOR) is None:
            text = "no log shows how late the force is sensed: it is assumed to be sensed at once; write "
            add("remark-assumed-sensor", f"{text}[device.{SENSOR}] in a log.toml")
        hertz = np.concatenate([study.lines[0].hertz for study in studies])
        if hertz.size >= LEAST_RADII:
            text = f"nothing was measured above {hertz.max():.4g} Hz, where unmodelled keeps its last value"
            add("remark-highest-line", text)
        else:
            add("remark-slow-motion", "no frequency shows clearly enough for unmodelled: record a sweep")
        names = [each.name for study in studies for each in study.record.numbers]
        if not any(name.startswith("compliance") for name in names):
            text = "no force was logged, so that it is not known whether the servo yields to one: log it as hand or "
            add("remark-unpushed", f"{text}force")
        return remarks
    if not states_velocity(log_map):
        text = "no log shows how the firmware obtains its velocity: it is assumed to be the difference of the position;"
        add("remark-assumed-velocity", f"{text} write [device.velocity] from in a log.toml")
    # a fit of motion has one lag, which excludes the actuator and the delay if the user states them
    lag_is_apart = "actuator" in parts or document.delay is not None or "actuator.bandwidth_hz" in keys
    if any(study.quantity == "force" for study in studies) and not lag_is_apart:
        text = "a log of motion does not separate the actuator's lag from a delay: the delay includes both"
        add("remark-actuator-lag", text)
    delay = next(bounded for bounded in bounds if bounded.key == "delay")
    if delay.share > WEAK_SHARE:
        text = f"the delay is poorly determined: anything from {delay.low:.2g} to {delay.high:.2g} s fits"
        add("remark-weak-delay", text)
    if "structure.handle_mass" not in keys and all(study.quantity == "force" for study in studies):
        text = "the motion shows nothing above its own frequencies, neither a resonance nor unmodelled dynamics"
        add("remark-slow-motion", f"{text}: record a multisine")
    return remarks


def identification_record(
    identified: Identified, description: str, versions: Mapping[str, str | None]
) -> IdentificationRecord:
    """Return the object of identification.json."""
    rotary, warnings = identified.records[0].recording.rotary, list[str]()
    units: UnitSystem = "rotary" if rotary else "linear"
    numbers = [_bounded_record(each, identified.records[0].recording) for each in identified.bounds]
    device = replace(identified.device, units=units).with_numbers({each.key: each.value for each in numbers})
    warnings = [note.line for note in identified.remarks if note.code.startswith("warn-")]
    assumed = any(note.code == "remark-assumed-velocity" for note in identified.remarks)
    friction, noise = (None if x is None else float(f"{x:.6g}") for x in (identified.friction, identified.force_noise))
    return IdentificationRecord(
        name=identified.name,
        description=description,
        rotary=rotary,
        sample_time=float(device.sample_time),
        device=device_table(device),
        assumed=["velocity"] if assumed else [],
        numbers=numbers,
        unmodelled=[list(point) for point in identified.unmodelled],
        friction=None if friction is None else FrictionRecord(coulomb=friction),
        force_noise=noise,
        recordings=[study.record for study in identified.records],
        warnings=warnings,
        remarks=[note.line for note in identified.remarks if note.line not in warnings],
        versions=dict(versions),
    )


def _bounded_record(bounded: Bounded, recording: Recording) -> BoundedRecord:
    value, share = stated(bounded.value, bounded.low, bounded.high)
    return BoundedRecord(
        key=bounded.key,
        unit=unit_of(tuple(bounded.key.split(".")), recording.units),
        value=value,
        low=float(bounded.low),
        high=float(bounded.high),
        share=share,
        limit=bounded.limit,
        estimates=[
            EstimateRecord(source=e.source, value=float(e.value), sigma=float(e.sigma)) for e in bounded.estimates
        ],
    )
