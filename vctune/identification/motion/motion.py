"""Regress any motion: the force that mass, viscous and Coulomb friction explain (README, section 2)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from vctune.document.recording import Floats
from vctune.identification.motion.covariance import least_squares, robust_covariance
from vctune.identification.motion.signals import Signals, acceleration
from vctune.identification.motion.spectral_filters import Complex, edge, filtered, smooth, stride

DIRECTIONAL = ("mass", "damping_forwards", "damping_backwards", "coulomb_forwards", "coulomb_backwards")
SYMMETRIC = ("mass", "damping", "coulomb", "offset")
MEMORY = 1.0  # Time over which residuals are correlated, s
# Share of the peak speed below which friction does not follow Coulomb's law and the sign of the velocity is unclear
SLOW = 0.05
LEAST_KEPT = 0.3  # Least share of samples that are not near turning points
STEPS = 60  # Greatest number of Gauss-Newton steps
STRIDE = 4.0  # Greatest change of a delay in one step, in sample times
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class MotionFit:
    """The result of a regression."""

    names: tuple[str, ...]  # names of the parameters in the order of `values`, with the delays last
    values: Floats  # estimates, SI units, shape (p,)
    covariance: Floats  # covariance for correlated residuals, shape (p, p)
    cutoff_hz: float  # cut-off of the low-pass on both sides, Hz
    samples: tuple[int, int]  # number of used samples, and number of samples in the log
    residual: float  # root mean square of residual and of force, N
    force: float

    def value(self, name: str) -> float:
        """Return a parameter by its name."""
        return float(self.values[self.names.index(name)])

    def sigma(self, name: str) -> float:
        """Return the standard deviation of a parameter by its name."""
        at = self.names.index(name)
        return sqrt(max(float(self.covariance[at, at]), 0.0))


@dataclass(frozen=True, slots=True)
class FittedSamples:
    """The data of a regression and its result, at as many samples as the cut-off requires."""

    rows: NDArray[np.int64]  # indices of the samples among every `stride`-th sample of the log
    step: float  # time between two neighbouring strided samples, s
    measured: Floats  # measured and fitted force, N
    fitted: Floats

    @property
    def time(self) -> Floats:
        """The times of the samples, s."""
        return np.asarray(self.rows * self.step, dtype=np.float64)

    @property
    def left(self) -> Floats:
        """The force that the fit leaves unexplained, N."""
        return self.measured - self.fitted


def motion_fit(
    signals: Signals, cutoff_hz: float, names: Sequence[str], known_delays: Mapping[str, float]
) -> tuple[MotionFit, FittedSamples]:
    """Fit a recording."""
    delays = _delays(signals, known_delays)
    free = [name for name in delays if name not in known_delays]
    every, used = stride(cutoff_hz, signals.sample_time), _kept(signals, cutoff_hz)
    kept = used[::every]
    step, linear = signals.sample_time, len(names)
    sensitivity = np.empty((int(kept.sum()), linear + len(free)))
    for at, column in enumerate(_regressors(signals, cutoff_hz, names, every)):
        sensitivity[:, at] = column[kept]
    for _ in range(STEPS):
        force = _pushed(signals, cutoff_hz, delays, free, kept, sensitivity[:, linear:])
        moved = least_squares(sensitivity, force)[linear:]
        delays = {
            **delays,
            **{
                name: delays[name] + float(np.clip(change, -STRIDE * step, STRIDE * step))
                for name, change in zip(free, moved, strict=True)
            },
        }
        if not free or np.abs(moved).max() < 1e-4 * step:
            break
    force = _pushed(signals, cutoff_hz, delays, free, kept, sensitivity[:, linear:])
    theta = least_squares(sensitivity[:, :linear], force)
    residual = force - sensitivity[:, :linear] @ theta
    information = sensitivity.T @ sensitivity
    fit = MotionFit(
        names=(*names, *free),
        values=np.array([*theta, *(delays[name] for name in free)]),
        covariance=_covariance(sensitivity, residual, information, kept, cutoff_hz, step * every),
        cutoff_hz=cutoff_hz,
        samples=(int(used.sum()), signals.position.size),
        residual=float(np.sqrt(np.mean(residual**2))),
        force=float(np.sqrt(np.mean(force**2))),
    )
    return fit, FittedSamples(np.flatnonzero(kept), step * every, force, force - residual)


def _delays(signals: Signals, known_delays: Mapping[str, float]) -> dict[str, float]:
    """Return the delay of each recorded force, s: the known delay, or 0 as the start of the search."""
    wanted = {"delay": signals.command, "sensor_delay": signals.hand}
    return {name: known_delays.get(name, 0.0) for name, column in wanted.items() if column is not None}


def _covariance(
    sensitivity: Floats, residual: Floats, information: Floats, kept: Flags, cutoff_hz: float, step: float
) -> Floats:
    """Return the covariance with the residuals at their original times. A dropped sample counts as 0."""
    reach = int(min(max(MEMORY, 3 / cutoff_hz) / step, 0.1 * kept.size))
    scores = PlacedScores(sensitivity, residual, np.flatnonzero(kept), kept.size)
    return robust_covariance(scores, information, reach)


@dataclass(frozen=True, slots=True)
class PlacedScores:
    """Residual times sensitivity at every sample of the log. The object computes the rows block by block to save
    memory."""

    sensitivity: Floats  # values at the used samples
    residual: Floats
    places: NDArray[np.int64]  # indices of the used samples, in ascending order
    count: int  # number of all samples

    @property
    def shape(self) -> tuple[int, int]:
        return self.count, self.sensitivity.shape[1]

    def __getitem__(self, rows: slice) -> Floats:
        first, last = np.searchsorted(self.places, (rows.start, rows.stop))
        placed = np.zeros((rows.stop - rows.start, self.sensitivity.shape[1]))
        placed[self.places[first:last] - rows.start] = (
            self.sensitivity[first:last] * self.residual[first:last, np.newaxis]
        )
        return placed


def _pushed(
    signals: Signals,
    cutoff_hz: float,
    delays: Mapping[str, float],
    free: Sequence[str],
    kept: Flags,
    slopes: Floats,
) -> Floats:
    """Return the force at the used samples, and fill `slopes` with its derivatives with respect to free delays."""
    every = stride(cutoff_hz, signals.sample_time)
    force = np.zeros(len(slopes))
    for name, column, sign in (("delay", "command", -1j), ("sensor_delay", "hand", 1j)):
        if column not in signals.spectra:
            continue
        late = delays[name]

        def through(omega: Floats, late: float = late, sign: complex = sign) -> Complex:
            return np.asarray(np.exp(sign * omega * late) * smooth(omega, cutoff_hz))

        def slope(omega: Floats, late: float = late, sign: complex = sign) -> Complex:
            return np.asarray(-sign * omega * np.exp(sign * omega * late) * smooth(omega, cutoff_hz))

        force += filtered(signals.spectra[column], through, every)[kept]
        if name in free:
            slopes[:, free.index(name)] = filtered(signals.spectra[column], slope, every)[kept]
    return force


def _kept(signals: Signals, cutoff_hz: float) -> Flags:
    """Return flags that mark the samples to use. Samples near the ends of the log and near turning points are not
    used."""
    T, v = signals.sample_time, signals.velocity
    kept = np.ones(v.size, dtype=bool)
    margin = edge(cutoff_hz, 4 * T, T)
    kept[:margin] = kept[-margin:] = False
    slow = np.abs(v) < SLOW * np.abs(v[kept]).max(initial=0.0)
    half = int(0.25 / cutoff_hz / T)  # a slow sample excludes all samples within a quarter of the cut-off's period
    counted = np.concatenate([np.zeros(half + 1, dtype=np.int64), np.cumsum(slow)])
    counted = np.append(counted, np.full(half, counted[-1]))
    away = kept & (counted[2 * half + 1 :] == counted[: -2 * half - 1])
    return away if away.sum() >= LEAST_KEPT * kept.sum() else kept


def _regressors(signals: Signals, cutoff_hz: float, names: Sequence[str], every: int) -> Iterator[Floats]:
    """Yield the regressor of each parameter in `names`."""
    a = acceleration(signals.spectra["position"], cutoff_hz, every)

    def behind(way: str) -> Floats:
        return filtered(signals.spectra[way], lambda w: smooth(w, cutoff_hz), every)

    regressor_of: dict[str, Callable[[], Floats]] = {
        "mass": lambda: a,
        "damping": lambda: behind("forwards") + behind("backwards"),
        "damping_forwards": lambda: behind("forwards"),
        "damping_backwards": lambda: behind("backwards"),
        "coulomb": lambda: behind("ahead") - behind("back"),
        "coulomb_forwards": lambda: behind("ahead"),
        "coulomb_backwards": lambda: -behind("back"),
        "offset": lambda: behind("always"),
        "stiffness": lambda: filtered(signals.spectra["position"], lambda w: smooth(w, cutoff_hz), every),
    }
    return (regressor_of[name]() for name in names)
