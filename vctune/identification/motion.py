"""Fit any motion: the force that mass and friction explain, at several cut-offs (README, section 2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, floor, log, log2, pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vctune.document.recording import Floats, Recording
from vctune.document.records.identification_json import Estimate
from vctune.document.text.errors import Note, coded
from vctune.identification.box import COULOMB_SHARE, jackknife, left_to_the_hand, pulled, sizes, unexplained
from vctune.identification.checks import position_noise
from vctune.identification.response import drive
from vctune.identification.study import Complex, Curves, Study, number, record_of
from vctune.model.device import Device
from vctune.model.parts import Actuator

WAYS = ("damping_forwards", "damping_backwards", "coulomb_forwards", "coulomb_backwards")
DIRECTIONAL: tuple[str, ...] = ("mass", *WAYS)
SYMMETRIC = ("mass", "damping", "coulomb", "offset")
BOTH = {  # regressors of both ways, as sums of those of each
    "damping": {WAYS[0]: 1, WAYS[1]: 1},
    "coulomb": {WAYS[2]: 1, WAYS[3]: 1},
    "offset": {WAYS[2]: 1, WAYS[3]: -1},
}
HIGHEST, HALVINGS = 0.08, 7  # Greatest cut-off as a share of the sampling rate, and number of cut-offs
REACH = 1.1  # Reach of the low-pass's kernel in time, in units of 1/cut-off
LONGEST = 64  # Greatest stride, after the lowest cut-off
BEHIND = 1 << 16  # Number of zeros after a long column
ATTENUATION = 1e-4  # Greatest share of encoder noise in the power of the acceleration
MEMORY = 1.0  # Time over which residuals are correlated, s
SLOW = 0.05  # Share of the peak speed below which friction is not Coulomb's
LEAST_KEPT = 0.3  # Least share of samples that are not near turning points
STEPS, STRIDE = 60, 4.0  # Gauss-Newton steps, and greatest change of a delay in one, in sample times
# Relative residual of the force above which a log is refused; the same if its power is more than so many times that of
# the encoder's noise; and that above which two swapped columns are looked for
MAX_RESIDUAL_SHARE, GREATEST_SHARE, OF_NOISE, SUSPICIOUS_SHARE = 0.6, 0.25, 10.0, 0.05
SIGNIFICANT = 2.0  # Difference between the directions, in deviations, above which each has its own damping
# What pulls with the position: a spring, or gravity on a rotary device. It is there if it is this many deviations from
# 0, and leaves less than this share of the residual and makes up this share of the force, or moves the mass by this
# share
PULLS: dict[bool, tuple[tuple[str, ...], ...]] = {False: (("stiffness",),), True: (("stiffness",), ("sine", "cosine"))}
SPRUNG, EXPLAINED, FELT, MOVED = 4.0, 0.75, 0.01, 0.02
DRIVEN = 0.1  # Share of the force that a damping below 0 must make up for a log to be refused
LAGS = (0.1, 0.2, 0.35, 0.5, 0.7, 1.0)  # Lags that are tried in the place of a part of a delay, as shares of it
SHORT = 0.2  # Shortest delay of which a part may be a lag that matters, in sample times
FRICTION = coded("friction is not quite Coulomb's", "limit-friction")
MASSES = {False: (1e-4, 5e3), True: (1e-8, 5e3)}  # Masses of haptic devices, kg, or kg m2 if rotary
FORCES = (("delay", "force", 1.0), ("sensor_delay", "hand", -1.0))  # name, column, and sign of each delay


@dataclass(frozen=True, slots=True)
class Signals:
    """A recording, prepared for the regression: its columns' spectra, each followed by zeros."""

    sample_time: float
    samples: int  # number of samples of a column
    size: int  # with the zeros
    spectra: Mapping[str, Complex]
    velocity: Floats  # after the low-pass with the highest cut-off that the noise permits, m/s
    noise: float  # standard deviation of a position sample, m
    is_command: bool  # whether the force is a command, which is held between samples
    actuator: Actuator | None  # actuator after a held command

    def omega(self, every: int = 1) -> Floats:
        """Return the frequencies up to the Nyquist frequency of every `every`-th sample, rad/s."""
        numbers = np.arange(self.size // (2 * every) + 1, dtype=np.float64)
        return numbers * (2 * np.pi / (self.size * self.sample_time))

    def filtered(self, column: str, factor: Any, every: int = 1) -> Floats:
        """Return every `every`-th sample of a column after a filter, of which `factor` is the response at `omega`."""
        values = np.fft.irfft(self.spectra[column][: factor.size] * factor, self.size // every)
        return np.asarray(values[: ceil(self.samples / every)] / every)

    def edge(self, cutoff_hz: float, delay: float = 0.0) -> int:
        """Return the number of samples at each end that depend on what lies outside the log."""
        return ceil((REACH / cutoff_hz + delay) / self.sample_time) + 1

    def stride(self, cutoff_hz: float) -> int:
        """Return n of which every n-th sample suffices after a low-pass, with an aliasing of 1e-6."""
        ratio = HIGHEST * (1 + 1e-9) / (cutoff_hz * self.sample_time)
        return int(min(LONGEST, 2 ** max(0, floor(log2(ratio)))))

    def encoder_noise(self, cutoff_hz: float, order: int) -> float:
        """Return the standard deviation that the encoder alone causes in a derivative after the low-pass."""
        omega = np.linspace(0, np.pi / self.sample_time, 4096)
        return self.noise * sqrt(float(np.mean((omega**order * smooth(omega, cutoff_hz)) ** 2)))


@dataclass(frozen=True, slots=True)
class MotionFit:
    """The result of a regression."""

    value: dict[str, float]  # parameters by name, the delays last, SI units
    sigma: dict[str, float]
    apart: float  # standard deviation of the difference between the two ways' dampings
    cutoff_hz: float
    used: int  # number of used samples
    residual: float  # root mean square of residual and of force, N
    force: float
    curves: Curves | None  # of the force, N


def smooth(omega: Floats, cutoff_hz: float) -> Floats:
    """Return a Gaussian low-pass whose power is halved at its cut-off."""
    return np.exp(-0.5 * log(2) * (omega / (2 * np.pi * cutoff_hz)) ** 2)


def signals_of(recording: Recording, T: float, actuator: Actuator | None, *, swapped: bool = False) -> Signals:
    """Return the spectra of the columns that the regression needs; of force and position the other way if `swapped`."""
    from scipy.fft import next_fast_len

    # from the command, the delay includes everything up to the motion; a measured force may come much later
    held = "command" in recording.channels
    position, force = recording.channels["position"], recording.values("command" if held else "force")
    force = None if force is None or np.ptp(force) == 0 else force
    x, noise, hand = position.values, position_noise(position.values, position.quantum), recording.values("hand")
    if swapped and force is not None:
        x, force, noise, hand = force, x, 0.0, None
    size = LONGEST * next_fast_len(ceil((x.size + min(x.size, BEHIND)) / LONGEST), real=True)
    columns = {"position": x - x.mean(), "force": force, "hand": hand}
    if recording.rotary:
        columns |= {"sine": np.sin(x - x.mean()), "cosine": np.cos(x - x.mean())}
    spectra = {name: np.fft.rfft(values, size) for name, values in columns.items() if values is not None}
    found = Signals(T, x.size, size, spectra, x, noise, held, actuator if held else None)
    cutoff = HIGHEST / T
    for _ in range(HALVINGS):  # the highest cut-off at which noise is at most 1 % of the velocity
        v = found.filtered("position", 1j * found.omega() * smooth(found.omega(), cutoff))
        if found.encoder_noise(cutoff, 1) < 0.01 * _rms(v):
            break
        cutoff /= 2
    ahead, back = (v > 0).astype(float), (v < 0).astype(float)
    for name, values in zip(WAYS, (v * ahead, v * back, ahead, -back), strict=True):
        spectra[name] = np.fft.rfft(values, size)
    return replace(found, velocity=v)


def cutoffs(signals: Signals) -> list[float]:
    """Return the cut-offs, Hz, at which the encoder's noise is a small part of the acceleration."""
    usable = []
    for cutoff in (HIGHEST / signals.sample_time / 2**halvings for halvings in range(HALVINGS)):
        if signals.edge(cutoff) * 4 > signals.samples:
            break
        every = signals.stride(cutoff)
        margin = ceil(signals.edge(cutoff) / every)
        a = _regressor(signals, cutoff, "mass", every)[margin:-margin]
        if signals.encoder_noise(cutoff, 2) ** 2 < ATTENUATION * float(np.mean(a**2)):
            usable.append(cutoff)
    return usable


def motion_fit(signals: Signals, cutoff: float, names: Sequence[str], known: Mapping[str, float]) -> MotionFit:
    """Fit a recording at a cut-off. `known` are the delays that the user states."""
    T, every, used = signals.sample_time, signals.stride(cutoff), _kept(signals, cutoff)
    kept, linear = used[::every], len(names)
    delays = {name: known.get(name, 0.0) for name, column, _ in FORCES if column in signals.spectra}
    free = [name for name in delays if name not in known]
    sensitivity = np.empty((int(kept.sum()), linear + len(free)))
    for at, name in enumerate(names):
        sensitivity[:, at] = _regressor(signals, cutoff, name, every)[kept]
    moved = np.zeros(len(free))
    for _ in range(STEPS):
        force = _pushed(signals, cutoff, delays, free, kept, sensitivity[:, linear:])
        moved = np.clip(_least_squares(sensitivity, force)[linear:], -STRIDE * T, STRIDE * T)
        if not free or np.abs(moved).max() < 1e-4 * T:
            break
        delays |= {name: delays[name] + float(change) for name, change in zip(free, moved, strict=True)}
    theta = _least_squares(sensitivity[:, :linear], force)
    fitted = sensitivity[:, :linear] @ theta
    rows = np.flatnonzero(kept)
    block = int(min(max(MEMORY, 3 / cutoff) / (T * every), 0.1 * kept.size))
    starts = np.unique(rows // block, return_index=True)[1]
    covariance, found = jackknife(sensitivity, force - fitted, starts), (*names, *free)
    sigma, ways = np.sqrt(np.maximum(np.diag(covariance), 0.0)), covariance[1:3, 1:3]
    value = dict(zip(found, map(float, [*theta, *(delays[name] for name in free)]), strict=True))
    apart = sqrt(max(float(np.trace(ways) - 2 * ways[0, 1]), 0.0))
    curves = Curves(np.asarray(rows * (T * every), dtype=np.float64), force, fitted)
    unsure, left = dict(zip(found, map(float, sigma), strict=True)), _rms(force - fitted)
    return MotionFit(value, unsure, apart, cutoff, int(used.sum()), left, _rms(force), curves)


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _least_squares(sensitivity: Floats, measured: Floats) -> Floats:
    """Return the least-squares solution by the normal equations, without a copy of a long table."""
    size = np.maximum(sizes(sensitivity), 1e-300)
    normal, right = sensitivity.T @ sensitivity / np.outer(size, size), sensitivity.T @ measured / size
    return np.asarray(np.linalg.lstsq(normal, right, rcond=None)[0] / size)


def _regressor(signals: Signals, cutoff: float, name: str, every: int) -> Floats:
    if name in BOTH:
        return sum((by * _regressor(signals, cutoff, way, every) for way, by in BOTH[name].items()), np.zeros(1))
    omega = signals.omega(every)
    factor = smooth(omega, cutoff) * (-(omega**2) if name == "mass" else 1.0)
    return signals.filtered(name if name in signals.spectra else "position", factor, every)


def _pushed(
    signals: Signals, cutoff: float, delays: Mapping[str, float], free: Sequence[str], kept: NDArray[np.bool_],
    slopes: Floats,
) -> Floats:  # fmt: skip
    """Return the force at the used samples, and fill `slopes` with its derivatives with respect to free delays."""
    every = signals.stride(cutoff)
    omega, force = signals.omega(every), np.zeros(len(slopes))
    for name, column, sign in FORCES:
        if column not in signals.spectra:
            continue
        turned = np.exp(-1j * sign * omega * delays[name]) * smooth(omega, cutoff)
        if column == "force" and signals.is_command:
            turned *= drive(Device(1.0, 0.0, signals.sample_time, 0.0, actuator=signals.actuator), omega)
        force += signals.filtered(column, turned, every)[kept]
        if name in free:
            slope = 1j * sign * omega * turned
            slopes[:, free.index(name)] = signals.filtered(column, slope, every)[kept]
    return force


def _kept(signals: Signals, cutoff: float) -> NDArray[np.bool_]:
    """Return which samples to use: none near the ends of the log, and none near turning points."""
    from scipy.ndimage import maximum_filter1d

    T, v = signals.sample_time, signals.velocity
    kept = np.ones(v.size, dtype=bool)
    margin = signals.edge(cutoff, 4 * T)
    kept[:margin] = kept[-margin:] = False
    slow = np.abs(v) < SLOW * np.abs(v[kept]).max(initial=0.0)
    half = int(0.25 / cutoff / T)  # a slow sample excludes all samples within a quarter of the cut-off's period
    away = kept & ~maximum_filter1d(slow, 2 * half + 1, mode="constant")
    return away if away.sum() >= LEAST_KEPT * kept.sum() else kept


def motion_study(
    recording: Recording, T: float, actuator: Actuator | None, delays: Mapping[str, float], *, held: bool = False
) -> Study:
    """Study a recording of any motion. If `held`, a spring may pull, which stays outside the device as a hand does."""
    signals = signals_of(recording, T, actuator)
    if not signals.is_command:  # the stated delay ends at the measured force or before it
        delays = {name: late for name, late in delays.items() if name != "delay"}
    usable = cutoffs(signals)
    if not usable:
        message = "the encoder's noise hides the acceleration at every cut-off; move faster, or use a finer encoder"
        raise unexplained(recording, message, recording.channels["position"].header)
    fits = [replace(motion_fit(signals, cutoff, DIRECTIONAL, delays), curves=None) for cutoff in usable]
    fit = motion_fit(signals, min(fits, key=lambda fit: fit.sigma["mass"]).cutoff_hz, DIRECTIONAL, delays)
    pull, names, remarks = _pull(recording, signals, fit, delays, held=held), DIRECTIONAL, list[Note]()
    if pull:
        names = (*DIRECTIONAL, *pull)
        fits = [replace(motion_fit(signals, cutoff, names, delays), curves=None) for cutoff in usable]
        fit = motion_fit(signals, min(fits, key=lambda fit: fit.sigma["mass"]).cutoff_hz, names, delays)
        remarks.append(left_to_the_hand(recording, fit.value[pull[0]], fit.value["mass"]))
    chi2 = (fit.residual / (abs(fit.value["mass"]) * signals.encoder_noise(fit.cutoff_hz, 2))) ** 2
    _refuse_unexplained(recording, signals, fit, delays, chi2)
    both = motion_fit(signals, fit.cutoff_hz, (*SYMMETRIC, *pull), delays)
    free = signals.is_command and actuator is None and "delay" in fit.value
    later = _later(signals, fits, fit, names, delays) if free else 0.0
    others = [other for other in fits if other.cutoff_hz != fit.cutoff_hz and other.cutoff_hz >= fit.cutoff_hz / 8.5]
    numbers = [number(name, fit.value[name], fit.sigma[name]) for name in fit.value]
    numbers += [number(f"{name}, both ways alike", both.value[name], both.sigma[name]) for name in both.value]
    hand, coulomb = recording.values("hand"), both.value["coulomb"]
    record = record_of(
        recording, T, kind="any motion", used=fit.used, residual_share=fit.residual / fit.force, chi2=chi2,
        numbers=numbers, cutoff_hz=fit.cutoff_hz, residual=fit.residual,
    )  # fmt: skip
    return Study(
        recording,
        record,
        "force",
        _estimates(recording.name, signals, fit, both, others, later),
        curves=fit.curves,
        remarks=remarks,
        friction=coulomb if coulomb > 2 * both.sigma["coulomb"] else None,
        force_noise=None if hand is None else float(1.4826 * np.median(np.abs(np.diff(hand, 3))) / sqrt(20)),
    )


def _estimates(
    source: str, signals: Signals, fit: MotionFit, both: MotionFit, others: Sequence[MotionFit], later: float
) -> list[Estimate]:
    """Return the estimates of the parameters that a problem file states; a damping for each direction if they
    differ."""
    text = f"{source}: motion"

    def excess(name: str) -> tuple[float, float]:
        """How far the estimates at other cut-offs lie below and above, beyond two standard deviations of both."""
        beyond = [(other.value[name] - fit.value[name], 2 * (other.sigma[name] + fit.sigma[name])) for other in others]
        return max([0.0, *(-by - more for by, more in beyond)]), max([0.0, *(by - more for by, more in beyond)])

    found = [Estimate("mass", fit.value["mass"], fit.sigma["mass"], text, excess("mass"))]
    differ = abs(fit.value[WAYS[0]] - fit.value[WAYS[1]]) > SIGNIFICANT * fit.apart
    coulomb = COULOMB_SHARE * abs(both.value["coulomb"]) / _rms(signals.velocity)
    ways = [(fit, way.partition("_")[2], way) for way in WAYS[:2]] if differ else [(both, "both ways", "damping")]
    found += [
        Estimate("damping", of.value[name], of.sigma[name], f"{text}, {way}", (coulomb, coulomb), reason=FRICTION)
        for of, way, name in ways
    ]
    for name, key in (("delay", "delay"), ("sensor_delay", "force_sensor.delay")):
        if name in fit.value:
            below, above = excess(name)
            margin = (below, max(above, later)) if name == "delay" else (below, above)
            found.append(Estimate(key, fit.value[name], fit.sigma[name], text, margin))
    return found


def _later(
    signals: Signals, fits: Sequence[MotionFit], best: MotionFit, names: Sequence[str], delays: Mapping[str, float]
) -> float:
    """Return how much longer than the fitted delay the sum of a delay and an actuator's lag may be, s."""
    # a lag delays fast motions less than slow ones; it shows most at the finest cut-off
    found = 0.0
    for cutoff, fit in {each.cutoff_hz: each for each in (best, fits[0])}.items():
        alone = fit.value["delay"]
        lags = [share * alone for share in LAGS] if alone >= SHORT * signals.sample_time else []
        tried = [(fit.residual, alone)]
        for lag in lags:
            lagging = replace(signals, actuator=Actuator(1 / (2 * pi * lag)))
            lagged = motion_fit(lagging, cutoff, names, delays)
            tried.append((lagged.residual, lagged.value["delay"] + lag))
        least = int(np.argmin([residual for residual, _ in tried]))
        if least > 0:  # one step further, for what lies between the steps
            found = max(found, tried[min(least + 1, len(tried) - 1)][1] - best.value["delay"])
    return found


def _pull(
    recording: Recording, signals: Signals, fit: MotionFit, delays: Mapping[str, float], *, held: bool
) -> tuple[str, ...]:
    """Return the regressors of what pulls with the position besides motor and hand; refuse it unless it is `held`."""
    position, found = recording.channels["position"], list[tuple[MotionFit, tuple[str, ...]]]()
    for pull in PULLS[recording.rotary]:
        sprung = motion_fit(signals, fit.cutoff_hz, (*DIRECTIONAL, *pull), delays)
        stiffness, sigma = sprung.value[pull[0]], sprung.sigma[pull[0]]
        share = abs(stiffness) * float(np.std(position.values)) / fit.force
        moved = abs(sprung.value["mass"] / fit.value["mass"] - 1)
        explains = sprung.residual < EXPLAINED * fit.residual and share > FELT
        if abs(stiffness) > SPRUNG * sigma and (moved > MOVED or explains):
            found.append((sprung, pull))
    if not found:
        return ()
    sprung, pull = found[-1] if found[-1][0].residual < EXPLAINED * found[0][0].residual else found[0]
    if not held or not _restores(sprung, pull, position.values):
        raise pulled(recording, sprung.value[pull[0]], sprung.value["mass"])
    return pull


def _restores(fit: MotionFit, pull: tuple[str, ...], position: Floats) -> bool:
    """Return whether the pull is that of a spring, and not of one below 0, at each of some positions."""
    if len(pull) == 1:
        return fit.value[pull[0]] > 0
    away = position - position.mean()
    return bool(np.all(fit.value["sine"] * np.cos(away) - fit.value["cosine"] * np.sin(away) > 0))


def _refuse_unexplained(
    recording: Recording, signals: Signals, fit: MotionFit, delays: Mapping[str, float], chi2: float
) -> None:
    """Refuse a log if no mass and friction explain its force, or if only an impossible mass explains it."""
    mass, share, units = fit.value["mass"], fit.residual / fit.force, recording.units
    headers = {role: channel.header for role, channel in recording.channels.items()}
    pushed = headers.get("command", headers.get("force", headers.get("hand", "")))
    swapped = False
    if share > SUSPICIOUS_SHARE and "force" in signals.spectra:
        turned = signals_of(recording, signals.sample_time, None, swapped=True)
        for cutoff in cutoffs(turned)[:3][-1:]:
            other = motion_fit(turned, cutoff, SYMMETRIC, delays)
            swapped = other.residual / other.force < 0.3 * share
    damping, sigma = max((fit.value[way], fit.sigma[way]) for way in WAYS[:2])
    driven = -damping * float(np.std(signals.velocity)) > DRIVEN * fit.force and damping < -SPRUNG * sigma
    mass_text = f"the {units.mass_name} comes out as {mass:.3g} {units.mass}"
    if share > MAX_RESIDUAL_SHARE or swapped or (not delays and share > GREATEST_SHARE and chi2 > OF_NOISE):
        hint = f"; is {units.translated('a force')} missing (a hand's), or is one of another axis?"
        hint = ": are the two columns swapped?" if swapped else hint
        message = f"{share:.0%} of {pushed} is explained by no {units.mass_name} and friction of {headers['position']}"
        raise unexplained(recording, message + hint, pushed)
    if mass <= 0 or (driven and not delays):
        what = mass_text if mass <= 0 else f"the damping comes out as {damping:.3g} {units.damping}"
        raise unexplained(recording, f"{what}: {pushed} pushes against the motion; turn one sign by scale = -1", pushed)
    if not MASSES[recording.rotary][0] <= mass <= MASSES[recording.rotary][1]:
        question = f"is {headers['position']} or {pushed} off by 1000? write its unit or scale"
        raise unexplained(recording, f"{mass_text}, which is no haptic device: {question}", pushed)
