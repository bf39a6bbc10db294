"""Study one recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import log, pi

import numpy as np

from vctune.document.log import LogMap
from vctune.document.recording import Floats, Recording
from vctune.document.text.codes import Note
from vctune.document.text.errors import InputError
from vctune.identification.box import DELAY_FLOOR, Estimate
from vctune.identification.checks import remarks
from vctune.identification.known import known_actuator
from vctune.identification.motion.drive_fit import fit_drive
from vctune.identification.motion.motion_study import MotionStudy, motion_study
from vctune.identification.response.periodic_study import PeriodicStudy, periodic_estimates
from vctune.identification.response.response import response
from vctune.identification.response.response_fit import fit_response
from vctune.identification.servo.servo_study import ServoStudy, servo_notes, servo_study

POOR = 0.05  # Relative residual of the force or of the response above which the study warns
# Possible roles of a force in a log without a command: the held command of the firmware, or the sample of a sensor
HELD, MEASURED = "held command", "measured force"
EVIDENCE, HALF = 10.0, 2.0  # Gain in log likelihood, or factor in chi2, that decides between the two roles


@dataclass(frozen=True, slots=True)
class RecordStudy:
    """A recording and the result of one of three kinds of study."""

    recording: Recording  # the recording; a force without a command has the role that the fit gave it
    sample_time: float  # T, s
    motion: MotionStudy | None  # study of any motion, of a periodic excitation, or of a servo
    periodic: PeriodicStudy | None
    remarks: tuple[Note, ...]  # remarks on the recording
    servo: ServoStudy | None = None
    alike: tuple[Estimate, ...] = ()

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
    def sharp_chi2(self) -> tuple[float, float]:
        """The chi2 in the range where two models differ the most, and its degrees of freedom; not for a servo."""
        if self.motion is not None:
            return self.motion.sharp_chi2
        assert self.periodic is not None
        return self.chi2, 2.0 * self.periodic.fit.lines

    @property
    def estimates(self) -> list[Estimate]:
        """Return the estimates of the parameters that a problem file states."""
        if self.servo is not None:
            return self.servo.estimates(self.recording.name)
        if self.motion is not None:
            estimates = self.motion.estimates(self.recording.name)
        else:
            assert self.periodic is not None
            estimates = periodic_estimates(self.periodic, self.recording.name, self.sample_time)
        # if two roles explain the recording equally well, the interval of the delay includes the delays of both roles
        least = DELAY_FLOOR * self.sample_time if self.alike else 0.0
        return [
            _at_least(estimate, least) if estimate.key == "delay" else estimate
            for estimate in (*estimates, *self.alike)
        ]


def _at_least(estimate: Estimate, least: float) -> Estimate:
    """Return an estimate whose excess is at least `least` on both sides."""
    below, above = estimate.excess
    return replace(estimate, excess=(max(below, least), max(above, least)))


def record_study(recording: Recording, T: float, log_map: LogMap) -> RecordStudy:
    """Study a recording."""
    if log_map.servo:
        study = servo_study(recording, T)
        notes = (*remarks(recording), *servo_notes(recording.name, study, recording.units))
        return _with_warning(RecordStudy(recording, T, None, None, notes, study))
    if "force" not in recording.channels or "command" in recording.channels:
        return _with_warning(_studied(recording, T, log_map))
    attempts = {HELD: _attempt(_commanded(recording), T, log_map), MEASURED: _attempt(recording, T, log_map)}
    studies = {role: attempt for role, attempt in attempts.items() if isinstance(attempt, RecordStudy)}
    if not studies:
        raise next(attempt for attempt in attempts.values() if isinstance(attempt, InputError))
    best, *others = sorted(studies, key=lambda role: studies[role].sharp_chi2)
    equal_roles = [role for role in others if not _clearly_better(studies[best], studies[role])]
    remark = Note("remark-force-role", _force_role_text(recording, studies, best, equal_roles))
    delays = tuple(estimate for role in equal_roles for estimate in studies[role].estimates if estimate.key == "delay")
    return _with_warning(replace(studies[best], remarks=(*studies[best].remarks, remark), alike=delays))


def _clearly_better(best: RecordStudy, other: RecordStudy) -> bool:
    """Return whether chi2 decides between two roles. The function treats model error as if it were noise."""
    (least, dof), (more, _) = best.sharp_chi2, other.sharp_chi2
    return log(more / least) > min(log(HALF), EVIDENCE * 2 * max(1.0, least) / dof)


def _commanded(recording: Recording) -> Recording:
    """Return the recording with its force in the role of the firmware's command, which is held between samples."""
    channels = {"command" if role == "force" else role: channel for role, channel in recording.channels.items()}
    return replace(recording, channels=channels)


def _attempt(recording: Recording, T: float, log_map: LogMap) -> RecordStudy | InputError:
    """Return the study of a recording, or the error that states why the study failed."""
    try:
        return _studied(recording, T, log_map)
    except InputError as error:
        return error


def _studied(recording: Recording, T: float, log_map: LogMap) -> RecordStudy:
    """Return the study of a periodic excitation, or of any motion if the recording has no usable periodic response."""
    notes, actuator = tuple(remarks(recording)), known_actuator(log_map)
    measured = None if "hand" in recording.channels else response(recording, T)
    fitted = None if measured is None else fit_response(measured, actuator)
    if measured is None or fitted is None:
        return RecordStudy(recording, T, motion_study(recording, T, actuator, log_map), None, notes)
    drive = None if measured.drive is None else fit_drive(measured.drive, T)
    return RecordStudy(recording, T, None, PeriodicStudy(measured, *fitted, drive), notes)


def _force_role_text(
    recording: Recording, studies: Mapping[str, RecordStudy], best: str, equal_roles: Sequence[str]
) -> str:
    """Return the text of the remark on the role of a force. The text states the residual of each role, and the role
    that the study uses."""
    results = [
        f"as a {role} {study.residual_share:.3%} of it is left, chi2/dof {study.sharp_chi2[0]:.4g}"
        for role, study in studies.items()
    ]
    text = f"{recording.name}: {recording.channels['force'].header} is taken for a {best}: {'; '.join(results)}"
    text += "; chi2 does not separate these: the delay includes both" if equal_roles else ""
    return text + ("; what lies between command and force is in no number" if best == MEASURED else "")


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
    text = (
        f"{study.recording.name}: the device in the file leaves {unexplained:.1%} of the {quantity} unexplained: no "
        "design for it is better than that; see the report for when and at which frequencies"
    )
    return replace(study, remarks=(*study.remarks, Note("warn-residual", text)))
