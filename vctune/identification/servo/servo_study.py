"""Study a recording of a servo."""

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
from vctune.identification.servo.servo_fit import JOINT_INTERVALS, Interval, ServoFit, ServoLog, fit_servos
from vctune.identification.servo.servo_motion import interpolating_velocity, positions
from vctune.identification.servo.servo_noise import Noise, whitened
from vctune.model.numbers.units import Units

AHEAD = 0.25  # Greatest time by which a motion may seem to precede its command, in samples
DECISIVE_GAIN = 10.0  # Gain in -2 log likelihood, for independent residuals, that decides between the orders
MAX_RESIDUAL_SHARE = 0.5  # Relative residual of the motion above which vctune refuses a log
GAIN_RANGE = (0.8, 1.25)  # Permitted range of the ratio of a servo's motion to its command
SIGNIFICANT = 4.0  # Significance, in standard deviations, above which a gain differs from 1 or a servo yields
LEAST_YIELDING_SHARE = 0.005  # Least share of the motion that follows the force if vctune reports that the servo yields
LATENCY, JITTER = Note("limit-latency", "a delay and a lag are alike in this motion"), Note("limit-jitter", "jitter")


@dataclass(frozen=True, slots=True)
class Yielding:
    """The part of a servo's motion that follows the force on the servo."""

    compliance: tuple[float, float]  # m/N and m/(N s), each with its standard deviation
    mobility: tuple[float, float]
    share: float
    significant: tuple[bool, bool]  # whether the compliance and the mobility are significant


@dataclass(frozen=True, slots=True)
class ServoStudy:
    """A recording of a servo."""

    servo_log: ServoLog  # the log as fitted
    fit: ServoFit  # fit of the order that explains the log best
    other: ServoFit  # fit of the other order
    order_is_known: bool  # whether the likelihood decides between the orders
    yielding: Yielding | None  # part of the motion that follows the force
    bands: Bands  # measured response in bands

    @property
    def fits(self) -> tuple[ServoFit, ...]:
        """The fits that explain the log."""
        return (self.fit,) if self.order_is_known else (self.fit, self.other)

    def of_order(self, order: int) -> ServoFit:
        """Return the fit of a given order."""
        return self.fit if self.fit.order == order else self.other

    @property
    def chi2(self) -> float:
        """The power of the residual divided by the power of the encoder's noise, per row."""
        return self.chi2_of(self.fit, Noise(self.fit.noise.encoder, 0.0))

    def chi2_of(self, fit: ServoFit, noise: Noise) -> float:
        """Return the power of a fit's residual divided by the power of a given noise, per row."""
        white, _ = whitened(fit.residual, noise, fit.exposed, is_position=self.servo_log.is_position)
        return float(np.mean(white**2))

    def estimates(self, source: str) -> list[Estimate]:
        """Return the estimates of the parameters that a problem file states."""
        estimates = []
        for fit in self.fits:
            text = f"{source}: order {fit.order}"
            estimates.append(_estimate("servo.delay", fit.delay, text, fit.jitter))
            estimates.append(_estimate("servo.bandwidth_hz", fit.bandwidth, text, 0.0))
        return estimates


def likelier_order(studies: Sequence[ServoStudy]) -> int:
    """Return the order that is likelier over all recordings."""
    gain = 0.0
    for study in studies:
        advantage = (study.other.minus_twice_log_likelihood - study.fit.minus_twice_log_likelihood) / max(
            study.fit.inflation, study.other.inflation
        )
        gain += advantage if study.fit.order == 1 else -advantage
    return 1 if gain >= 0 else 2


def _estimate(key: str, interval: Interval, source: str, jitter: float) -> Estimate:
    """Return an interval as an estimate."""
    half_width = joint_factor(JOINT_INTERVALS) * interval.sigma
    beyond = (
        max(interval.value - half_width - interval.low, 0.0),
        max(interval.high - half_width - interval.value, 0.0),
    )
    reason = JITTER if jitter > max(beyond) else LATENCY
    return Estimate(
        key, interval.value, interval.sigma, source, (beyond[0] + jitter, beyond[1] + jitter), reason=reason
    )


def servo_study(recording: Recording, sample_time: float) -> ServoStudy:
    """Fit both orders of a servo to a recording and decide between them."""
    servo_log = _servo_log(recording, sample_time)
    try:
        with np.errstate(divide="raise", invalid="raise"):
            first, second = fit_servos(servo_log)
    except (FloatingPointError, ValueError, np.linalg.LinAlgError):  # no part of the motion fits the command
        raise _unexplained(recording, "the motion does not follow the command anywhere") from None
    fit, other = (
        (first, second) if first.minus_twice_log_likelihood <= second.minus_twice_log_likelihood else (second, first)
    )
    order_is_known = other.minus_twice_log_likelihood - fit.minus_twice_log_likelihood > DECISIVE_GAIN * max(
        fit.inflation, other.inflation
    )
    study = ServoStudy(
        servo_log=servo_log,
        fit=fit,
        other=other,
        order_is_known=order_is_known,
        yielding=_yielding(recording, servo_log, fit),
        bands=bands(servo_log, fit),
    )
    _check_explained(recording, study)
    return study


def _deviation(values: Floats) -> float:
    """Return the standard deviation of values."""
    return float(np.std(values))


def _servo_log(recording: Recording, T: float) -> ServoLog:
    """Return the columns of a recording that the fit needs, and the least noise that the encoder's rounding permits."""
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


def _unexplained(recording: Recording, what: str) -> InputError:
    header, position = recording.channels[commanded(recording)].header, recording.channels["position"].header
    message = f"{what}: is {header} the command of another axis or of another time than {position}?"
    return InputError.of(recording.source, "log-unexplained", message, key=header)


def _check_explained(recording: Recording, study: ServoStudy) -> None:
    """Refuse a recording whose motion does not follow its command, or follows it with an impossible gain."""
    command = commanded(recording)
    header, position = recording.channels[command].header, recording.channels["position"].header
    gain = study.fit.gain
    early = -max(each.delay.high for each in study.fits)
    if early > AHEAD * study.servo_log.sample_time:
        message = (
            f"{position} moves at least {1e3 * early:.3g} ms before {header} tells it to: the two were not sampled "
            "together, or the command is logged late"
        )
    elif study.fit.residual_share > MAX_RESIDUAL_SHARE:
        message = (
            f"{study.fit.residual_share:.0%} of the motion of {position} does not follow {header}: is it the command "
            "of another axis, or was the robot moved by something else?"
        )
    elif gain < 0:
        message = f"{position} moves against {header}; turn one sign by scale = -1"
    elif not GAIN_RANGE[0] < gain < GAIN_RANGE[1]:
        message = f"{position} moves {gain:.4g} times as far as {header} says; write the unit or scale of one of them"
    else:
        return
    raise InputError.of(recording.source, "log-unexplained", message, key=header)


def commanded(recording: Recording) -> str:
    """Return the role of the command that the servo received."""
    return "velocity_command" if "velocity_command" in recording.channels else "position_command"


def _yielding(recording: Recording, servo_log: ServoLog, fit: ServoFit) -> Yielding | None:
    """Return the part of the motion that follows the force, fitted together with gain, delay and bandwidth."""
    force = recording.values("hand")
    force = recording.values("force") if force is None else force
    if force is None or np.ptp(force) == 0:
        return None
    measured = np.diff(servo_log.position[fit.first :])
    pushed = np.stack([np.diff(force)[fit.first :], (force * servo_log.sample_time)[fit.first + 1 :]], axis=1)
    columns = np.column_stack([pushed, *_fit_and_derivatives(servo_log, fit)])
    scale = np.sqrt(np.mean(columns**2, axis=0))
    noise = fit.noise
    white = whitened(
        np.column_stack([fit.residual, columns / scale]), noise, fit.exposed, is_position=servo_log.is_position
    )[0]
    regressors = white[:, 1:]
    values = np.linalg.lstsq(regressors, white[:, 0], rcond=None)[0]
    residual = white[:, 0] - regressors @ values
    reach = ceil(sqrt(residual.size))
    covariance = robust_covariance(regressors * residual[:, None], regressors.T @ regressors, reach)
    sigma = np.sqrt(np.diag(covariance))
    motion = np.abs(values[:2]) * [_deviation(np.cumsum(column)) for column in (columns / scale)[:, :2].T]
    share = motion / _deviation(np.cumsum(measured))
    significant = (np.abs(values[:2]) > SIGNIFICANT * sigma[:2]) & (share > LEAST_YIELDING_SHARE)
    stronger = int(np.argmax(share * significant))
    compliance, mobility = ((float(values[i] / scale[i]), float(sigma[i] / scale[i])) for i in (0, 1))
    return Yielding(compliance, mobility, float(share[stronger]), (bool(significant[0]), bool(significant[1])))


def _fit_and_derivatives(servo_log: ServoLog, fit: ServoFit) -> list[Floats]:
    """Return the steps of the fit, and their derivatives with respect to delay and bandwidth."""
    delay, bandwidth = fit.delay.value, fit.bandwidth.value

    def steps(delay: float, bandwidth: float) -> Floats:
        return np.diff(positions(servo_log.time, servo_log.velocity, delay, bandwidth, fit.order)[fit.first :])

    change = 1e-4 * servo_log.sample_time
    fitted = steps(delay, bandwidth)
    later, faster = steps(delay + change, bandwidth) - fitted, steps(delay, 1.0001 * bandwidth) - fitted
    return [fitted, later, faster]


def servo_notes(name: str, study: ServoStudy, units: Units) -> list[Note]:
    """Return remarks on a recording of a servo."""
    fit, T, notes = study.fit, study.servo_log.sample_time, []
    if not study.order_is_known:
        text = f"{name}: orders 1 and 2 explain it equally well: the box contains both, and unmodelled covers the rest"
        notes.append(Note("remark-order", text))
    if fit.jitter > 0.01 * T:
        text = f"{name}: the delay jitters by {fit.jitter:.2g} s from command to command, which its interval includes; "
        notes.append(Note("remark-jitter", f"{text}proofs assume a constant delay"))
    if not all(servo.bandwidth_is_bounded for servo in study.fits):
        text = f"{name}: shows a latency of {fit.delay.value + fit.lag:.3g} s, and not how much of it is a low-pass: "
        notes.append(Note("remark-latency-only", f"{text}record a sweep up to a tenth of the sampling rate or higher"))
    if abs(fit.gain - 1) > max(SIGNIFICANT * fit.gain_sigma, 2e-3):
        text = f"{name}: moves {fit.gain:.4g} times as far as it is told, which a servo does not: unmodelled covers it"
        notes.append(Note("warn-gain", text))
    if study.yielding is not None and any(study.yielding.significant):
        yielding = study.yielding
        numbers = (f"{yielding.compliance[0]:.3g} {units.compliance}", f"{yielding.mobility[0]:.3g} {units.mobility}")
        significant_numbers = " and ".join(compress(numbers, yielding.significant))
        text = (
            f"{name}: the servo yields: {yielding.share:.1%} of its motion goes with the force, "
            f"{significant_numbers}. Such a device is outside the model, "
            "in which the motion follows the command alone: no claim about the file holds for it"
        )
        notes.append(Note("warn-yields", text))
    return notes
