"""Make the object of identification.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from vctune.document.records.identification_json import (
    BoundedRecord,
    CandidateRecord,
    EstimateRecord,
    FrictionRecord,
    IdentificationRecord,
    NumberRecord,
    RecordingRecord,
    stated,
)
from vctune.document.schema.number_units import unit_of
from vctune.document.schema.statement import table_of
from vctune.document.text.codes import Note
from vctune.identification.box import Bounded
from vctune.identification.identify import Identified
from vctune.identification.motion.motion_study import MotionStudy
from vctune.identification.record_study import RecordStudy
from vctune.identification.response.periodic_study import PeriodicStudy
from vctune.identification.response.physics import antiresonance_hz
from vctune.identification.response.response_fit import ResponseFit
from vctune.identification.servo.servo_study import ServoStudy
from vctune.model.loop.device_response import mechanism
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.units import UNITS, Units, UnitSystem


def identification_record(
    identified: Identified, description: str, versions: Mapping[str, str | None]
) -> IdentificationRecord:
    """Return the record of an identification."""
    rotary = identified.records[0].recording.rotary
    units: UnitSystem = "rotary" if rotary else "linear"
    numbers = [_bounded_record(each, UNITS[units]) for each in identified.bounds]
    device = replace(identified.device, units=units).with_numbers({each.key: each.value for each in numbers})
    return IdentificationRecord(
        name=identified.name,
        description=description,
        rotary=rotary,
        sample_time=float(device.sample_time),
        device=table_of(device),
        assumed=["velocity"] if any(note.code == "remark-assumed-velocity" for note in identified.remarks) else [],
        numbers=numbers,
        unmodelled=[list(point) for point in identified.unmodelled],
        friction=_friction_record(identified),
        force_noise=None if identified.force_noise is None else float(f"{identified.force_noise:.6g}"),
        recordings=[_recording_record(study) for study in identified.records],
        warnings=[note.line for note in identified.remarks if _is_warning(note)],
        remarks=[note.line for note in identified.remarks if not _is_warning(note)],
        versions=dict(versions),
    )


def _is_warning(note: Note) -> bool:
    return note.code.startswith("warn-")


def _bounded_record(bounded: Bounded, units: Units) -> BoundedRecord:
    """Return a parameter of the device with its interval as a record."""
    value, share = stated(bounded.value, bounded.low, bounded.high)
    return BoundedRecord(
        key=bounded.key,
        unit=unit_of(tuple(bounded.key.split(".")), units),
        value=value,
        low=float(bounded.low),
        high=float(bounded.high),
        share=share,
        limit=bounded.limit,
        estimates=[
            EstimateRecord(source=e.source, value=float(e.value), sigma=float(e.sigma)) for e in bounded.estimates
        ],
    )


def _friction_record(identified: Identified) -> FrictionRecord | None:
    """Return the friction with six digits as a record; None if no friction was identified."""
    if identified.friction is None:
        return None
    return FrictionRecord(coulomb=float(f"{identified.friction:.6g}"))


def _recording_record(study: RecordStudy) -> RecordingRecord:
    """Return the record of a recording. The kind of its study determines the contents."""
    if study.motion is not None:
        return _any_motion_record(study, study.motion)
    if study.servo is not None:
        return _servo_record(study, study.servo)
    assert study.periodic is not None
    return _periodic_record(study, study.periodic)


def _any_motion_record(study: RecordStudy, motion: MotionStudy) -> RecordingRecord:
    """Return the record of a recording of any motion."""
    fit, both = motion.directional, motion.symmetric
    numbers = [_number(name, fit.value(name), fit.sigma(name)) for name in fit.names]
    numbers += [_number(f"{name}, both ways alike", both.value(name), both.sigma(name)) for name in both.names]
    return RecordingRecord(
        source=study.recording.name,
        sha256=study.recording.sha256,
        samples=fit.samples[1],
        used=fit.samples[0],
        sample_time=study.sample_time,
        kind="any motion",
        cutoff_hz=fit.cutoff_hz,
        residual=fit.residual,
        residual_share=study.residual_share,
        chi2=study.chi2,
        numbers=numbers,
        derived=[],
        candidates=[],
        remarks=[note.line for note in study.remarks],
    )


def _periodic_record(study: RecordStudy, periodic: PeriodicStudy) -> RecordingRecord:
    """Return the record of a recording of a periodic excitation."""
    fit, measured = periodic.fit, periodic.measured
    numbers = [_number(name, fit.numbers[name], fit.sigma(name)) for name in fit.names]
    if periodic.drive is not None:
        drive = periodic.drive
        numbers.append(_number("command to force, lag", drive.lag, drive.lag_sigma))
        numbers.append(_number("command to force, delay", drive.delay, drive.delay_sigma))
    return RecordingRecord(
        source=study.recording.name,
        sha256=study.recording.sha256,
        samples=len(study.recording),
        used=measured.period * measured.periods,
        sample_time=study.sample_time,
        kind=f"{measured.periods} periods of {measured.period * study.sample_time:g} s, {fit.position.size} lines",
        cutoff_hz=None,
        residual=None,
        residual_share=study.residual_share,
        chi2=study.chi2,
        numbers=numbers,
        derived=_derived(fit, study.recording.units),
        candidates=[
            CandidateRecord(
                structure=str(each.candidate),
                chosen=each is fit,
                chi2=each.chi2,
                model_error=[float(share) for share in each.model_errors],
            )
            for each in periodic.candidates
        ],
        remarks=[note.line for note in study.remarks],
    )


def _servo_record(study: RecordStudy, servo: ServoStudy) -> RecordingRecord:
    """Return the record of a recording of a servo."""
    fit, T = servo.fit, study.sample_time
    numbers = [
        _number("delay", fit.delay.value, fit.delay.sigma),
        _number("bandwidth, Hz", fit.bandwidth.value, fit.bandwidth.sigma),
        _number("motion over command", fit.gain, fit.gain_sigma),
        _number("jitter of the delay", fit.jitter, None),
        _number("noise of a position", fit.noise.encoder, None),
    ]
    if servo.yielding is not None:
        units = study.recording.units
        numbers.append(_number(f"compliance, {units.compliance}", *servo.yielding.compliance))
        numbers.append(_number(f"mobility, {units.mobility}", *servo.yielding.mobility))
    return RecordingRecord(
        source=study.recording.name,
        sha256=study.recording.sha256,
        samples=len(study.recording),
        used=fit.residual.size + 1,
        sample_time=T,
        kind=f"a servo told its {'position' if servo.servo_log.is_position else 'velocity'}, order {fit.order}",
        cutoff_hz=None,
        residual=None,
        residual_share=study.residual_share,
        chi2=study.chi2,
        numbers=numbers,
        derived=[_number("latency, hold aside", fit.delay.value + fit.lag, None)],
        candidates=[
            CandidateRecord(
                structure=f"order {each.order}",
                chosen=each is fit,
                chi2=servo.chi2_of(each, fit.noise),
                model_error=[each.residual_share],
            )
            for each in (servo.fit, servo.other)
        ],
        remarks=[note.line for note in study.remarks],
    )


def _derived(fit: ResponseFit, units: Units) -> list[NumberRecord]:
    """Return the quantities that describe a structure, such as both masses, the stiffness and the resonance."""
    structure = fit.device.structure
    low = antiresonance_hz(fit.device)
    if structure is None or low is None:
        return []
    parts = mechanism(fit.device, structure, FLOATS)
    identified = {
        "motor mass": parts.motor,
        "handle mass": parts.handle,
        "stiffness": parts.stiffness,
        "antiresonance, Hz": low,
        "resonance, Hz": structure.frequency_hz,
        f"damping between them, {units.damping}": parts.viscosity,
    }
    return [_number(name, float(value), None) for name, value in identified.items()]


def _number(name: str, value: float, sigma: float | None) -> NumberRecord:
    return NumberRecord(name=name, value=float(value), sigma=None if sigma is None else float(sigma))
