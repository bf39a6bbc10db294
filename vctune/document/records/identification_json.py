"""Define identification.json, which `vctune identify --json` prints, and write the device file."""

from __future__ import annotations

from math import ceil, pi
from typing import Annotated, Any, TypeVar

from pydantic import Field
from pydantic.json_schema import SkipJsonSchema

from vctune.document.records.part import Document, Nullable, Pair, RecordPart
from vctune.document.schema.number_units import unit_of
from vctune.document.schema.rules import MOST_SAMPLES
from vctune.document.text.errors import coded, printable
from vctune.document.text.toml import toml_text
from vctune.model.experiment import MovingHand, usual_share
from vctune.model.fields import record
from vctune.model.numbers.units import UNITS, Units

T = TypeVar("T")
FILE, DEVICE_FILE = "identification.json", "device.toml"
# Stroke, m, and speed, m/s, of the hand in the experiment. vctune shortens the stroke if it would take too many samples
STROKE = {"to": 0.05, "speed": 0.01}
GRIP = 0.1  # Distance from the axis at which a hand holds a rotary servo, m
# Greatest numbers of the hands of a rotary servo: those of a human hand at the distance `GRIP`, in kg m2, N m s/rad and
# N m/rad
ROTARY_HAND = {"mass": 0.005, "damping": 0.3, "stiffness": 30.0}
HALF_WIDTH_STEP = 1e-5  # Step to which half-widths are rounded up, so that the written box contains the identified one


class NumberRecord(RecordPart):
    """An estimate from a recording, with its standard deviation."""

    name: str
    value: float
    sigma: Nullable


class CandidateRecord(RecordPart):
    """A candidate structure of the device, with its fit."""

    structure: str
    chosen: bool
    chi2: Nullable
    model_error: list[Nullable]


class RecordingRecord(RecordPart):
    """A recording and its results."""

    source: str
    sha256: str
    samples: int  # number of samples in the file, and number of samples that the fit uses
    used: int
    sample_time: float
    kind: str  # kind of the excitation, in words
    residual_share: Nullable  # root mean square residual as a share of the motion
    chi2: Nullable  # residual relative to the noise alone, squared, per degree of freedom; null if noise is unknown
    numbers: list[NumberRecord]  # fitted numbers, and numbers derived from them
    derived: list[NumberRecord]
    candidates: list[CandidateRecord]  # structures of the device that the fit compared
    remarks: list[str]


# A field of a record that its file lacks
Hidden = Annotated[T, Field(exclude=True), SkipJsonSchema()]


@record
class Estimate:
    """The estimate of a parameter of the device from one recording, or from one direction of it."""

    key: Hidden[str]  # key of the parameter in the device's table
    value: float  # estimate and standard deviation, SI units, frequencies in Hz
    sigma: float
    source: str  # the recording and the method
    excess: Hidden[tuple[float, float]] = (0.0, 0.0)  # how far the interval extends beyond the standard deviations
    reason: Hidden[str] = coded("halves of the log differ, in time, speed or frequency", "limit-band")  # for the excess
    stated: Hidden[bool] = False  # whether the user stated the parameter, which no recording determines then


@record
class Bounded:
    """A parameter of the device with its interval."""

    key: str  # dotted key without "device.", and the unit of the numbers
    unit: str
    value: float  # middle of the written interval, and its relative half-width
    share: float
    low: float  # ends of the identified interval
    high: float
    limit: str  # what determines the width of the interval, in words
    estimates: list[Estimate]  # estimates from single recordings or directions


class FrictionRecord(RecordPart):
    """Dry friction of the device."""

    coulomb: float


class IdentificationRecord(Document):
    """A device and how well it is known, in SI units and hertz: the object of identification.json."""

    SCHEMA = "vctune/identification/1"

    name: str
    description: str
    rotary: bool
    sample_time: float
    device: dict[str, Any]
    assumed: list[str]
    numbers: Annotated[list[Bounded], Field(min_length=1)]
    unmodelled: list[Pair]
    friction: FrictionRecord | None
    force_noise: Nullable
    recordings: Annotated[list[RecordingRecord], Field(min_length=1)]
    warnings: list[str]
    remarks: list[str]
    versions: dict[str, str | None]

    @property
    def units(self) -> Units:
        """The units of the record, which are the device's units."""
        return UNITS["rotary" if self.rotary else "linear"]


def bounded(key: str, low: float, high: float, limit: str, estimates: list[Estimate], units: Units) -> Bounded:
    """Return a parameter with its interval: its middle with six digits, and a relative half-width, rounded up so that
    the file contains the interval."""
    value, share = float(f"{0.5 * (low + high):.6g}"), 0.0
    if value:
        share = max(high - value, value - low) / value
        share = min(
            round(ceil(share / HALF_WIDTH_STEP) * HALF_WIDTH_STEP, 5), 0.99 if low <= 0 else 1 - HALF_WIDTH_STEP
        )
    unit = unit_of(tuple(key.split(".")), units)
    return Bounded(key, unit, value, share, float(low), float(high), limit, estimates)


def device_text(record: IdentificationRecord) -> str:
    """Return the device file: a problem file with the device, its uncertainty and its friction, and their sources."""
    device = dict(record.device)
    document: dict[str, Any] = {"name": record.name}
    document |= {"description": record.description} if record.description else {}
    document["device"] = device
    if record.rotary:
        document["operator"] = {name: {"min": 0.0, "max": most} for name, most in ROTARY_HAND.items()}
    document["uncertainty"] = {number.key: number.share for number in record.numbers}
    if record.unmodelled:
        document["uncertainty"]["unmodelled"] = record.unmodelled
    if record.friction is not None or record.force_noise:
        document["experiment"] = [_experiment(record)]
    notes = {number.key: _note(number) for number in record.numbers}
    body = _annotated(toml_text(document), notes, record)
    return "\n".join([*_head(record), "", body])


def _head(record: IdentificationRecord) -> list[str]:
    """Return the comments at the top of a device file: its sources, warnings and remarks."""
    lines = ["# Identified by `vctune identify` from"]
    for recording in record.recordings:
        lines.append(
            f"#   {printable(recording.source)}: {recording.used} of {recording.samples} samples, {recording.kind}"
        )
        residual = (
            "" if recording.residual_share is None else f"residual {recording.residual_share:.3%} of the motion, "
        )
        noise = "" if recording.chi2 is None else f"chi2/dof {_short(recording.chi2)} with the noise alone, "
        lines.append(f"#     {residual}{noise}sha256 {recording.sha256}")
    if any(number.low <= 0 for number in record.numbers):
        lines.append("# What may be 0 is written as plus or minus 99 %, down to a hundredth of its middle.")
    lines += [f"# warning: {printable(warning)}" for warning in record.warnings]
    lines += [f"# {printable(remark)}" for remark in record.remarks]
    return lines


def _short(value: float | None) -> str:
    return "not known" if value is None else f"{value:.3g}"


def _note(number: Bounded) -> str:
    """Return the comment on a number: its interval, the reason for its width, and its estimates."""
    estimates = "; ".join(f"{estimate.value:.6g} +- {_short(estimate.sigma)}" for estimate in number.estimates)
    return f"# {number.low:.6g} to {number.high:.6g} {number.unit}".rstrip() + f", by {number.limit}; found {estimates}"


def _annotated(text: str, notes: dict[str, str], record: IdentificationRecord) -> str:
    """Return TOML with a comment after each identified number. The comment of a nested table stands above the table."""
    lines, heading = [], ""
    for line in text.splitlines():
        heading = line if line.startswith("[") else heading
        key = line.partition(" = ")[0]
        if heading == "[device]" and key in notes:
            lines.append(f"{line}  {notes[key]}")
            continue
        if heading == "[device]" and key == "friction":
            lines.append(f"{line}  # dry; the least of the recordings")
            continue
        if heading == "[device]" and key in record.assumed:
            lines.append(f"{line}  # assumed: no log tells it; write what the firmware does")
            continue
        if heading == "[device]" and " = {" in line:
            lines += [
                f"{note.replace('#', f'# {name}:', 1)}" for name, note in notes.items() if name.startswith(f"{key}.")
            ]
        if heading == "[uncertainty]" and key == "unmodelled":
            lines.append(
                "# [Hz, radius]: every measured line, less the effect of Coulomb friction, is that of a device of the "
                "box, times a number this far from 1"
            )
        if heading == "[operator]" and line == heading:
            lines.append(f"# assumed: vctune's hand, {GRIP:g} m from the axis; write the numbers of your users' hands")
        if heading == "[[experiment]]" and line == heading:
            whose = "those of a linear device, times inertia" if record.rotary else "vctune's defaults"
            lines.append(f"# With the friction above and the noise that was found; hand and motion are {whose}.")
        lines.append(line)
    return "\n".join(lines) + "\n"


def _experiment(record: IdentificationRecord) -> dict[str, Any]:
    """Return an experiment that the device can follow, with the identified noise; its friction is the device's."""
    experiment: dict[str, Any] = {"name": "as identified"}
    furthest = 0.9 * MOST_SAMPLES * record.sample_time * STROKE["speed"] / (pi * MovingHand().cycles)
    if record.rotary or furthest < STROKE["to"]:
        experiment["operator"] = STROKE | {"to": min(STROKE["to"], float(f"{furthest:.2g}"))}
    if record.rotary:
        share = float(f"{usual_share(record.device['mass'], 'rotary'):.3g}")
        experiment["operator"] |= {"damping": 2.0 * share, "stiffness": 1000.0 * share}
    if record.force_noise:
        experiment["sensors"] = {"force_noise": record.force_noise}
    return experiment
