"""Make remarks on what the recordings do not show, and on what the file states instead (README, section 8)."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi

from vctune.document.log import LogMap
from vctune.document.text.codes import Note
from vctune.identification.box import Bounded
from vctune.identification.known import SENSOR, known_actuator, known_sensor, velocity_assumed
from vctune.identification.record_study import RecordStudy
from vctune.identification.response.periodic_study import PeriodicStudy

WEAK = 0.5
"""Relative half-width above which a remark calls a delay poorly determined."""


def what_is_not_told(studies: Sequence[RecordStudy], bounds: Sequence[Bounded], known: LogMap) -> list[Note]:
    """Return remarks on what the recordings do not show.

    Parameters
    ----------
    studies : studies of all recordings
    bounds : intervals of the box
    known : statements of the user about the device
    """
    said = [remark for study in studies for remark in study.remarks]
    if known.servo:
        return said + _of_servo(studies, known)
    keys = {each.key for each in bounds}
    if velocity_assumed(known):
        text = (
            "no log shows how the firmware obtains its velocity: it is assumed to be the difference of the position; "
            "write [device.velocity] from in a log.toml"
        )
        said.append(Note("remark-assumed-velocity", text))
    lag_known = known_actuator(known) is not None or known.document.device.delay is not None
    if any(study.motion is not None for study in studies) and "actuator.bandwidth_hz" not in keys and not lag_known:
        text = "a log of motion does not separate the actuator's lag from a delay: the delay includes both"
        said.append(Note("remark-actuator-lag", text))
    delay = next(each for each in bounds if each.key == "delay")
    if delay.share > WEAK:
        text = f"the delay is poorly determined: anything from {delay.low:.2g} to {delay.high:.2g} s fits"
        said.append(Note("remark-weak-delay", text))
    if "structure.handle_mass" not in keys and all(study.periodic is None for study in studies):
        text = "the motion shows nothing above its own frequencies, neither a resonance nor unmodelled dynamics"
        said.append(Note("remark-slow-motion", f"{text}: record a multisine (vctune identify --excitation)"))
    return said + [note for study in studies if study.periodic for note in _of_lines(study, study.periodic)]


def _of_servo(studies: Sequence[RecordStudy], known: LogMap) -> list[Note]:
    said = []
    if known_sensor(known) is None:
        text = (
            "no log shows how late the force is sensed: it is assumed to be sensed at once; write "
            f"[device.{SENSOR}] in a log.toml"
        )
        said.append(Note("remark-assumed-sensor", text))
    hertz = [each for study in studies for each in study.measured_hz]
    if len(hertz) > 1:
        top = max(hertz)
        text = f"nothing was measured above {top:.4g} Hz, where unmodelled keeps its last value"
        said.append(Note("remark-highest-line", text))
    else:
        said.append(Note("remark-slow-motion", "no frequency shows clearly enough for unmodelled: record a sweep"))
    if all(study.servo.yielding is None for study in studies if study.servo is not None):
        text = "no force was logged, so that it is not known whether the servo yields to one: log it as hand or force"
        said.append(Note("remark-unpushed", text))
    return said


def _of_lines(study: RecordStudy, periodic: PeriodicStudy) -> list[Note]:
    top = periodic.measured.position.omega[-1] / (2 * pi)
    text = f"{study.recording.name}: nothing was measured above {top:.4g} Hz, where unmodelled keeps its last value"
    said = [Note("remark-highest-line", text)]
    if periodic.lag is not None and not periodic.lag_told:
        text = f"{study.recording.name}: the actuator's lag, {periodic.lag[0]:.2g} s, is not significant: "
        said.append(Note("remark-no-lag", f"{text}it is left out, and the delay includes it"))
    if periodic.fit.candidate.load:
        text = (
            f"{study.recording.name}: the handle has a damping of its own, "
            f"{periodic.fit.numbers['handle_damping']:.3g} {study.recording.units.damping}, which a problem file "
            "cannot state: the intervals of both dampings contain it and the fit without it, and unmodelled covers the "
            "rest"
        )
        said.append(Note("remark-handle-damping", text))
    return said
