"""Make remarks on properties of the device that the recordings do not show (README, section 7)."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi

from vctune.document.log import LogMap
from vctune.document.text.codes import Note
from vctune.identification.box import Bounded
from vctune.identification.known import SENSOR, known_actuator, known_sensor, velocity_assumed
from vctune.identification.record_study import RecordStudy
from vctune.identification.response.periodic_study import PeriodicStudy

WEAK_SHARE = 0.5  # Relative half-width above which a remark calls a delay poorly determined
LEAST_RADII = 2  # Least number of frequencies between which the radii of unmodelled can be interpolated


def remarks_on_gaps(studies: Sequence[RecordStudy], bounds: Sequence[Bounded], log_map: LogMap) -> list[Note]:
    """Return the remarks of the studies, and remarks on properties of the device that the recordings do not show."""
    remarks = [remark for study in studies for remark in study.remarks]
    if log_map.servo:
        return remarks + _remarks_on_servo(studies, log_map)
    keys = {bounded.key for bounded in bounds}
    if velocity_assumed(log_map):
        text = (
            "no log shows how the firmware obtains its velocity: it is assumed to be the difference of the position; "
            "write [device.velocity] from in a log.toml"
        )
        remarks.append(Note("remark-assumed-velocity", text))
    # a fit of motion has one lag, which excludes the actuator and the delay if the user states them
    lag_not_in_delay = known_actuator(log_map) is not None or log_map.document.device.delay is not None
    in_motion = any(study.motion is not None for study in studies)
    if in_motion and "actuator.bandwidth_hz" not in keys and not lag_not_in_delay:
        text = "a log of motion does not separate the actuator's lag from a delay: the delay includes both"
        remarks.append(Note("remark-actuator-lag", text))
    delay = next(bounded for bounded in bounds if bounded.key == "delay")
    if delay.share > WEAK_SHARE:
        text = f"the delay is poorly determined: anything from {delay.low:.2g} to {delay.high:.2g} s fits"
        remarks.append(Note("remark-weak-delay", text))
    if "structure.handle_mass" not in keys and all(study.periodic is None for study in studies):
        text = "the motion shows nothing above its own frequencies, neither a resonance nor unmodelled dynamics"
        remarks.append(Note("remark-slow-motion", f"{text}: record a multisine"))
    return remarks + [note for study in studies if study.periodic for note in _remarks_on_lines(study, study.periodic)]


def _remarks_on_servo(studies: Sequence[RecordStudy], log_map: LogMap) -> list[Note]:
    """Return remarks on the delay of the force sensor, on the measured frequencies, and on a missing force column."""
    remarks = []
    if known_sensor(log_map) is None:
        text = (
            "no log shows how late the force is sensed: it is assumed to be sensed at once; write "
            f"[device.{SENSOR}] in a log.toml"
        )
        remarks.append(Note("remark-assumed-sensor", text))
    hertz = [frequency for study in studies for frequency in study.measured_hz]
    if len(hertz) >= LEAST_RADII:
        remarks.append(_highest_line(max(hertz)))
    else:
        remarks.append(Note("remark-slow-motion", "no frequency shows clearly enough for unmodelled: record a sweep"))
    if all(study.servo.yielding is None for study in studies if study.servo is not None):
        text = "no force was logged, so that it is not known whether the servo yields to one: log it as hand or force"
        remarks.append(Note("remark-unpushed", text))
    return remarks


def _remarks_on_lines(study: RecordStudy, periodic: PeriodicStudy) -> list[Note]:
    """Return remarks on a periodic excitation: on its highest line, and on parameters that the file leaves out."""
    remarks = [_highest_line(periodic.measured.position.omega[-1] / (2 * pi), f"{study.recording.name}: ")]
    if periodic.lag is not None and not periodic.lag_significant:
        samples = periodic.lag[0] / study.sample_time
        text = f"{study.recording.name}: the actuator's lag, {samples:.2f} samples, is not significant: "
        remarks.append(Note("remark-no-lag", f"{text}it is left out, and the delay includes it"))
    if periodic.fit.candidate.damped_handle:
        text = (
            f"{study.recording.name}: the handle has a damping of its own, "
            f"{periodic.fit.numbers['handle_damping']:.3g} {study.recording.units.damping}, which a problem file "
            "cannot state: the intervals of both dampings contain it and the fit without it, and unmodelled covers the "
            "rest"
        )
        remarks.append(Note("remark-handle-damping", text))
    return remarks


def _highest_line(hertz: float, name: str = "") -> Note:
    """Return the remark on the highest measured frequency; `name` is the name of the recording with a colon."""
    text = f"{name}nothing was measured above {hertz:.4g} Hz, where unmodelled keeps its last value"
    return Note("remark-highest-line", text)
