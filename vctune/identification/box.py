"""Combine the estimates of several recordings and directions into one device and a box around it (README, section
4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from vctune.document.recording import Floats
from vctune.document.text.codes import Note

TOGETHER = 0.95  # Probability with which all intervals of a box hold at the same time
DELAY_FLOOR = 0.1  # Least half-width of a delay, in sample times
WIDEST = 0.99  # Relative half-width of an interval that reaches 0
# Least relative half-widths by key
FLOORS = {
    "mass": 0.01,
    "structure.handle_mass": 0.01,
    "damping": 0.01,
    "actuator.bandwidth_hz": 0.01,
    "structure.damping_ratio": 0.01,
    "structure.frequency_hz": 0.005,
    "servo.bandwidth_hz": 0.01,
}
COULOMB_SHARE = 0.1  # Share of the Coulomb friction that may in fact be viscous, because Coulomb's law is not exact
BAND = Note("limit-band", "model error: the band that is kept changes it")


@dataclass(frozen=True, slots=True)
class Estimate:
    """The estimate of one parameter of the device from one recording, or from one direction of it."""

    key: str  # key of the parameter in the device's table
    value: float  # estimate and standard deviation, SI units, frequencies in Hz
    sigma: float
    source: str  # the recording and the method
    excess: tuple[float, float] = (0.0, 0.0)  # how far the interval extends beyond the standard deviations
    stated: bool = False  # whether the user stated the parameter, in which case no recording determines it
    reason: Note = BAND  # reason for the excess


@dataclass(frozen=True, slots=True)
class Bounded:
    """A parameter of the device with its interval."""

    key: str
    value: float  # middle of the interval
    low: float
    high: float
    sampled: float  # half-width that follows from the standard deviation of the least certain estimate
    limits: tuple[Note, ...]  # reasons for the interval's ends
    estimates: tuple[Estimate, ...]  # estimates that the interval contains

    @property
    def share(self) -> float:
        """The relative half-width, as the file states it."""
        return WIDEST if self.low <= 0 else (self.high - self.low) / (self.high + self.low)

    @property
    def limit(self) -> str:
        """The reasons for the interval's ends, as one text."""
        return "; ".join(note.line for note in self.limits)


def joint_factor(count: int) -> float:
    """Return the number of standard deviations with which `count` intervals hold together."""
    return max(2.0, NormalDist().inv_cdf(0.5 + 0.5 * TOGETHER ** (1 / max(count, 1))))


def sizes(table: Floats) -> Floats:
    """Return the Euclidean norm of each column of a long table, without a copy of it."""
    return np.sqrt(np.einsum("ij,ij->j", table, table))


def jackknife(sensitivity: Floats, residual: Floats, starts: NDArray[np.integer]) -> Floats:
    """Return the covariance of estimates by leaving out, to first order, one block of neighbouring rows at a time."""
    size = sizes(sensitivity)
    inverse = np.linalg.pinv(sensitivity.T @ sensitivity / np.outer(size, size), hermitian=True) / np.outer(size, size)
    scores = [np.add.reduceat(column * residual, starts) for column in sensitivity.T]
    left_out = inverse @ np.array(scores)
    return np.asarray(left_out @ left_out.T) * len(starts) / max(len(starts) - 1, 1)


def box(estimates: Sequence[Estimate], sample_time: float) -> tuple[Bounded, ...]:
    """Return the least box that contains every interval of every estimate, without negative values and with least
    widths."""
    keys = list(dict.fromkeys(estimate.key for estimate in estimates))
    factor = joint_factor(len(keys))
    return tuple(
        _bounded(key, [estimate for estimate in estimates if estimate.key == key], factor, sample_time) for key in keys
    )


def _bounded(key: str, estimates: list[Estimate], factor: float, sample_time: float) -> Bounded:
    low = min(estimate.value - factor * estimate.sigma - estimate.excess[0] for estimate in estimates)
    high = max(estimate.value + factor * estimate.sigma + estimate.excess[1] for estimate in estimates)
    sampled = factor * max(estimate.sigma for estimate in estimates)
    limit = _widest(estimates, sampled)
    low, high = max(low, 0.0), max(high, 0.0)
    if high == 0 and not key.endswith("delay"):  # the error of a negative value is at least its magnitude
        high = max(abs(estimate.value) for estimate in estimates)
    middle = 0.5 * (low + high)
    least = DELAY_FLOOR * sample_time if key.endswith("delay") else FLOORS.get(key, 0.0) * middle
    if high - low < 2 * least:
        low, high = max(middle - least, 0.0), middle + least
        middle, limit = 0.5 * (low + high), Note("limit-floor", "floor")
    limits = (limit, Note("limit-zero", "may be 0")) if low == 0 else (limit,)
    return Bounded(key, middle, low, high, sampled, limits, tuple(estimates))


def _widest(estimates: list[Estimate], sampled: float) -> Note:
    """Return the reason that widens an interval the most."""
    spread = max(estimate.value for estimate in estimates) - min(estimate.value for estimate in estimates)
    excess = max(max(estimate.excess) for estimate in estimates)
    if all(estimate.stated for estimate in estimates):
        return Note("limit-stated", "what was stated")
    if spread / 2 > max(sampled, excess):
        return Note("limit-differ", "records, directions or models differ")
    if excess <= sampled:
        return Note("limit-residuals", "residuals")
    return max(estimates, key=lambda estimate: max(estimate.excess)).reason
