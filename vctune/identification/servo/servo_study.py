"""Study a recording of a servo.

The study fits both orders, compares them, and tests whether the servo yields to a force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress
from math import ceil, sqrt

import numpy as np

from vctune.document.recording import Floats, Recording
from vctune.document.text.codes import Note
from vctune.document.text.errors import InputError
from vctune.identification.box import Estimate
from vctune.identification.motion.covariance import joint_factor, robust_covariance
from vctune.identification.motion.signals import position_noise
from vctune.identification.servo.servo_bands import Bands, bands
from vctune.identification.servo.servo_fit import STATED, Interval, ServoFit, ServoLog, fit_servos
from vctune.identification.servo.servo_motion import interpolating_velocity, positions
from vctune.identification.servo.servo_noise import Noise, whitened
from vctune.model.numbers.units import Units

EVIDENCE = 10.0
"""Gain in -2 log likelihood, for independent residuals, that decides between the orders."""
UNEXPLAINED = 0.5
"""Relative residual of the motion above which vctune refuses a log."""
GAINS = (0.8, 1.25)
"""Permitted range of the ratio of a servo's motion to its command. Outside this range, the unit or the axis is
wrong."""
CLEAR = 4.0
"""Significance, in standard deviations, with which a gain differs from 1 or a servo yields."""
YIELDS = 0.005
"""A servo's yielding to the force matters if it causes more than this share of the motion."""
LATENCY, JITTER = Note("limit-latency", "a delay and a lag are alike in this motion"), Note("limit-jitter", "jitter")


@dataclass(frozen=True, slots=True)
class Yielding:
    """The part of a servo's motion that follows the force on it.

    Attributes
    ----------
    compliance, mobility : m/N and m/(N s), each with its standard deviation
    share : root mean square share of the motion that follows the force, for the more significant of the two
    clear : whether each of the two is significant
    """

    compliance: tuple[float, float]
    mobility: tuple[float, float]
    share: float
    clear: tuple[bool, bool]


@dataclass(frozen=True, slots=True)
class ServoStudy:
    """A recording of a servo.

    Attributes
    ----------
    seen : the log as fitted
    fit : fit of the order that explains the log best
    other : fit of the other order
    told : whether chi2 decides between the orders
    yielding : part of the motion that follows the force; None if no force was recorded
    bands : measured response in bands
    """

    seen: ServoLog
    fit: ServoFit
    other: ServoFit
    told: bool
    yielding: Yielding | None
    bands: Bands

    @property
    def fits(self) -> tuple[ServoFit, ...]:
        """The fits that explain the log."""
        return (self.fit,) if self.told else (self.fit, self.other)

    def of_order(self, order: int) -> ServoFit:
        """Return the fit of a given order."""
        return self.fit if self.fit.order == order else self.other

    @property
    def chi2(self) -> float:
        """The power of the residual divided by that of the encoder's noise, per row."""
        return self.chi2_of(self.fit, Noise(self.fit.noise.encoder, 0.0))

    def chi2_of(self, fit: ServoFit, noise: Noise) -> float:
        """Return the power of a fit's residual divided by that of a noise, per row.

        Parameters
        ----------
        fit : fit of either order
        noise : noise for comparison
        """
        white, _ = whitened(fit.left, noise, fit.exposed, is_position=self.seen.is_position)
        return float(np.mean(white**2))

    def estimates(self, source: str) -> list[Estimate]:
        """Return the estimates of the numbers in a problem file."""
        found = []
        for fit in self.fits:
            text = f"{source}: order {fit.order}"
            found.append(_estimate("servo.delay", fit.delay, text, fit.jitter))
            found.append(_estimate("servo.bandwidth_hz", fit.bandwidth, text, 0.0))
        return found


def likelier_order(studies: Sequence[ServoStudy]) -> int:
    """Return the order that is likelier over all recordings.

    The weight of a recording is smaller if its residuals are correlated.

    Parameters
    ----------
    studies : studies of the same servo
    """
    gain = 0.0
    for study in studies:
        worth = (study.other.unlikely - study.fit.unlikely) / max(study.fit.inflation, study.other.inflation)
        gain += worth if study.fit.order == 1 else -worth
    return 1 if gain >= 0 else 2


def _estimate(key: str, found: Interval, source: str, jitter: float) -> Estimate:
    """Return an interval as an estimate. The excess of the estimate is the width beyond its standard deviations."""
    own = joint_factor(STATED) * found.sigma
    beyond = (max(found.value - own - found.low, 0.0), max(found.high - own - found.value, 0.0))
    reason = JITTER if jitter > max(beyond) else LATENCY
    return Estimate(key, found.value, found.sigma, source, (beyond[0] + jitter, beyond[1] + jitter), reason=reason)


def servo_study(recording: Recording, sample_time: float) -> ServoStudy:
    """Fit both orders of a servo to a recording and decide between them.

    Parameters
    ----------
    recording : checked recording of position and command; it needs a force as well to show whether the servo yields
    sample_time : sample time of the servo's commands, s

    Returns
    -------
    ServoStudy
        Fits of both orders in SI units: the one that explains the log better, the other, and whether the log decides
        between them.

    Raises
    ------
    InputError
        If no servo explains the motion.
    """
    seen = _seen(recording, sample_time)
    first, second = fit_servos(seen)
    fit, other = (first, second) if first.unlikely <= second.unlikely else (second, first)
    told = other.unlikely - fit.unlikely > EVIDENCE * max(fit.inflation, other.inflation)
    study = ServoStudy(
        seen=seen,
        fit=fit,
        other=other,
        told=told,
        yielding=_yielding(recording, seen, fit),
        bands=bands(seen, fit),
    )
    _check_explained(recording, study)
    return study


def _spread(values: Floats) -> float:
    return float(np.std(values))


def _seen(recording: Recording, T: float) -> ServoLog:
    position, logged = recording.channels["position"], recording.values("time")
    time = np.asarray(np.arange(position.values.size) * T if logged is None else logged, dtype=np.float64)
    command = recording.channels[commanded(recording)].values
    is_position = commanded(recording) == "position_command"
    velocity = interpolating_velocity(time, command) if is_position else command
    least = 1e-9 * float(np.ptp(position.values))
    noise = position_noise(position.values, position.quantum)
    steps = np.abs(np.diff(position.values))
    quantum = position.quantum or float(steps[steps > 0].min(initial=np.inf))
    rounding = min(quantum / sqrt(12), noise)
    return ServoLog(time - time[0], velocity, position.values, T, is_position, max(rounding, least))


def _check_explained(recording: Recording, study: ServoStudy) -> None:
    command = commanded(recording)
    header, position = recording.channels[command].header, recording.channels["position"].header
    gain = study.fit.gain
    if study.fit.left_share > UNEXPLAINED:
        message = (
            f"{study.fit.left_share:.0%} of the motion of {position} does not follow {header}: is it the command of "
            "another axis, or was the robot moved by something else?"
        )
    elif gain < 0:
        message = f"{position} moves against {header}; turn one sign by scale = -1"
    elif not GAINS[0] < gain < GAINS[1]:
        message = f"{position} moves {gain:.4g} times as far as {header} says; write the unit or scale of one of them"
    else:
        return
    raise InputError.of(recording.source, "log-unexplained", message, key=header)


def commanded(recording: Recording) -> str:
    """Return the role of the command that the servo received."""
    return "velocity_command" if "velocity_command" in recording.channels else "position_command"


def _yielding(recording: Recording, seen: ServoLog, fit: ServoFit) -> Yielding | None:
    """Return the part of the motion that follows the force, fitted together with gain, delay and bandwidth."""
    force = recording.values("hand")
    force = recording.values("force") if force is None else force
    if force is None or np.ptp(force) == 0:
        return None
    measured = np.diff(seen.position[fit.first :])
    pushed = np.stack([np.diff(force)[fit.first :], (force * seen.sample_time)[fit.first + 1 :]], axis=1)
    columns = np.column_stack([pushed, *_slopes(seen, fit)])
    size = np.sqrt(np.mean(columns**2, axis=0))
    noise = fit.noise
    white = whitened(np.column_stack([fit.left, columns / size]), noise, fit.exposed, is_position=seen.is_position)[0]
    regressors = white[:, 1:]
    values = np.linalg.lstsq(regressors, white[:, 0], rcond=None)[0]
    left = white[:, 0] - regressors @ values
    reach = ceil(sqrt(left.size))
    covariance = robust_covariance(regressors * left[:, None], regressors.T @ regressors, reach)
    sigma = np.sqrt(np.diag(covariance))
    moved = np.abs(values[:2]) * [_spread(np.cumsum(each)) for each in (columns / size)[:, :2].T]
    share = moved / _spread(np.cumsum(measured))
    sure = (np.abs(values[:2]) > CLEAR * sigma[:2]) & (share > YIELDS)
    which = int(np.argmax(share * sure))
    compliance, mobility = ((float(values[i] / size[i]), float(sigma[i] / size[i])) for i in (0, 1))
    return Yielding(compliance, mobility, float(share[which]), (bool(sure[0]), bool(sure[1])))


def _slopes(seen: ServoLog, fit: ServoFit) -> list[Floats]:
    """Return the steps of the fit, and their derivatives with respect to delay and bandwidth."""
    delay, bandwidth = fit.delay.value, fit.bandwidth.value

    def made(delay: float, bandwidth: float) -> Floats:
        return np.diff(positions(seen.time, seen.velocity, delay, bandwidth, fit.order)[fit.first :])

    by = 1e-4 * seen.sample_time
    at = made(delay, bandwidth)
    later, faster = made(delay + by, bandwidth) - at, made(delay, 1.0001 * bandwidth) - at
    return [at, later, faster]


def servo_notes(name: str, study: ServoStudy, units: Units) -> list[Note]:
    """Return remarks on a recording of a servo.

    Parameters
    ----------
    name : name of the recording
    study : study of the recording
    units : units of the recording
    """
    fit, T, said = study.fit, study.seen.sample_time, []
    if not study.told:
        text = f"{name}: orders 1 and 2 explain it equally well: the box contains both, and unmodelled covers the rest"
        said.append(Note("remark-order", text))
    if fit.jitter > 0.01 * T:
        text = f"{name}: the delay jitters by {fit.jitter:.2g} s from command to command, which its interval includes; "
        said.append(Note("remark-jitter", f"{text}proofs assume a constant delay"))
    if not all(each.told for each in study.fits):
        text = f"{name}: shows a latency of {fit.delay.value + fit.lag:.3g} s, and not how much of it is a low-pass: "
        said.append(Note("remark-latency-only", f"{text}record a sweep up to a tenth of the sampling rate or higher"))
    if abs(fit.gain - 1) > max(CLEAR * fit.gain_sigma, 2e-3):
        text = f"{name}: moves {fit.gain:.4g} times as far as it is told, which a servo does not: unmodelled covers it"
        said.append(Note("warn-gain", text))
    if study.yielding is not None and any(study.yielding.clear):
        each = study.yielding
        numbers = (f"{each.compliance[0]:.3g} {units.compliance}", f"{each.mobility[0]:.3g} {units.mobility}")
        shown = " and ".join(compress(numbers, each.clear))
        text = (
            f"{name}: the servo yields: {each.share:.1%} of its motion goes with the force, {shown}. Such a device is "
            "outside the model, in which the motion follows the command alone: no claim about the file "
            "holds for it"
        )
        said.append(Note("warn-yields", text))
    return said
