"""Study one recording."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi

import numpy as np

from vctune.document.log import LogMap
from vctune.document.recording import Floats, Recording
from vctune.document.text.codes import Note
from vctune.document.text.errors import InputError
from vctune.identification.box import Estimate
from vctune.identification.checks import remarks
from vctune.identification.known import known_actuator
from vctune.identification.motion.drive_fit import fit_drive
from vctune.identification.motion.motion_study import MotionStudy, motion_study, refuse_spring
from vctune.identification.response.periodic_study import PeriodicStudy, periodic_estimates
from vctune.identification.response.response import response
from vctune.identification.response.response_fit import fit_response
from vctune.identification.servo.servo_study import ServoStudy, servo_notes, servo_study

POOR = 0.05  # Relative residual of the force or of the response above which the study warns

UNEXPLAINED = 0.25  # Share of a periodic response above which the log is refused


@dataclass(frozen=True, slots=True)
class RecordStudy:
    """A recording and the result of one of three kinds of study."""

    recording: Recording
    sample_time: float  # T, s
    motion: MotionStudy | None  # study of any motion, of a periodic excitation, or of a servo
    periodic: PeriodicStudy | None
    remarks: tuple[Note, ...]  # remarks on the recording
    servo: ServoStudy | None = None

    @property
    def residual_share(self) -> float:
        """The share of the force, of the response or of the motion that the fit leaves unexplained."""
        if self.servo is not None:
            return self.servo.fit.residual_share
        if self.motion is not None:
            return self.motion.directional.residual / self.motion.directional.force
        assert self.periodic is not None
        return float(np.sqrt(np.mean(self.periodic.left**2)))

    @property
    def measured_hz(self) -> Floats:
        """The frequencies at which the recording shows a response, Hz. A study of any motion has none, and is not
        permitted here."""
        if self.servo is not None:
            return self.servo.bands.hertz
        assert self.periodic is not None
        return np.asarray(self.periodic.measured.position.omega / (2 * pi))

    @property
    def chi2(self) -> float:
        """The power of the residual divided by the power of the noise, per degree of freedom."""
        if self.servo is not None:
            return self.servo.chi2
        if self.motion is not None:
            return self.motion.chi2
        assert self.periodic is not None
        return self.periodic.fit.chi2

    @property
    def estimates(self) -> list[Estimate]:
        """Return the estimates of the parameters that a problem file states."""
        if self.servo is not None:
            return self.servo.estimates(self.recording.name)
        if self.motion is not None:
            return self.motion.estimates(self.recording.name)
        assert self.periodic is not None
        return periodic_estimates(self.periodic, self.recording.name, self.sample_time)


def record_study(recording: Recording, T: float, log_map: LogMap) -> RecordStudy:
    """Study a recording."""
    if log_map.servo:
        study = servo_study(recording, T)
        notes = (*remarks(recording), *servo_notes(recording.name, study, recording.units))
        return _with_warning(RecordStudy(recording, T, None, None, notes, study))
    force = recording.channels.get("force")
    if force is not None and "command" not in recording.channels and log_map.document.device.delay is None:
        message = (
            "a measured force says nothing of the delay from the command to it, and a design with too little delay "
            "may be unstable: log the command as well; name this column `command` under [columns] if it is what the "
            "firmware wrote; or write device.delay, of the whole path from the command to the motion, into log.toml"
        )
        raise InputError.of(recording.source, "log-unexplained", message, key=force.header)
    return _with_warning(_studied(recording, T, log_map))


def _studied(recording: Recording, T: float, log_map: LogMap) -> RecordStudy:
    """Return the study of a periodic excitation, or of any motion if the recording has no usable periodic response."""
    notes, actuator = tuple(remarks(recording)), known_actuator(log_map)
    measured = None if "hand" in recording.channels else response(recording, T)
    fitted = None if measured is None else fit_response(measured, actuator)
    if measured is None or fitted is None:
        refuse_spring(recording, T, actuator, log_map)
        return RecordStudy(recording, T, motion_study(recording, T, actuator, log_map), None, notes)
    drive = None if measured.drive is None else fit_drive(measured.drive, T)
    return RecordStudy(recording, T, None, PeriodicStudy(measured, *fitted, drive), notes)


def _with_warning(study: RecordStudy) -> RecordStudy:
    """Return a study with a warning if the residual is large."""
    unexplained = study.residual_share
    if unexplained <= POOR:
        return study
    quantity = (
        study.recording.units.force_name
        if study.motion is not None
        else "motion"
        if study.servo is not None
        else "response"
    )
    if study.periodic is not None and unexplained > UNEXPLAINED:
        message = f"{unexplained:.0%} of the response is that of no device: record longer, or with more force or lines"
        raise InputError.of(study.recording.source, "log-unexplained", message)
    text = (
        f"{study.recording.name}: the device in the file leaves {unexplained:.1%} of the {quantity} unexplained: no "
        "design for it is better than that; see the report for when and at which frequencies"
    )
    return replace(study, remarks=(*study.remarks, Note("warn-residual", text)))
