"""Study a recording of any motion with fits at several cut-offs, for each direction and for both directions. See
README, section 2."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi, sqrt

import numpy as np

from vctune.document.log import LogMap
from vctune.document.recording import Floats, Recording
from vctune.document.text.codes import Note
from vctune.document.text.errors import InputError, Mistake
from vctune.identification.box import COULOMB_SHARE, Estimate
from vctune.identification.known import SENSOR, known_delays
from vctune.identification.motion.motion import DIRECTIONAL, SYMMETRIC, FittedSamples, MotionFit, motion_fit
from vctune.identification.motion.signals import Signals, acceleration_noise, cutoffs, signals_of, speed
from vctune.identification.motion.signals import signals as turned_signals
from vctune.identification.motion.spectral_filters import HIGHEST, smooth, spectrum
from vctune.model.parts import Actuator

# Greatest relative residual of the force with which the study accepts a mass with friction as the explanation of a log
MAX_RESIDUAL_SHARE = 0.6
# The same for a residual whose power is more than so many times that of the encoder's noise, which explains no more
GREATEST_SHARE, OF_NOISE = 0.25, 10.0
# Relative residual of the force above which the study tests whether the user swapped two columns
SUSPICIOUS_SHARE = 0.05
# Difference between the directions, in standard deviations, above which each direction gets its own parameters
SIGNIFICANT = 2.0
# A spring is there if it is this many deviations from 0, and leaves less than this share of the residual and makes up
# this share of the force, or moves the mass by this share
SPRUNG, EXPLAINED, FELT, MOVED = 4.0, 0.75, 0.01, 0.02
DRIVEN = 0.1  # Share of the force that a damping below 0 must make up for a log to be refused
LAGS = (0.1, 0.2, 0.35, 0.5, 0.7, 1.0)  # Lags that are tried in the place of a part of a delay, as shares of it
SHORT = 0.2  # Shortest delay of which a part may be a lag that matters, in sample times
FRICTION = Note("limit-friction", "friction is not quite Coulomb's")
MASSES = {False: (1e-4, 5e3), True: (1e-8, 5e3)}  # Range of masses of a haptic device, kg, or kg m2 if it is rotary


@dataclass(frozen=True, slots=True)
class MotionStudy:
    """The results of a recording of any motion."""

    directional: MotionFit  # fits with separate friction for each direction, and with the same friction for both
    symmetric: MotionFit
    samples: FittedSamples  # samples of the directional fit
    others: tuple[MotionFit, ...]  # directional fits at higher cut-offs, and at cut-offs up to three octaves lower
    force_noise: float | None  # standard deviation of a sample of the sensed force, N
    friction: float | None  # Coulomb friction, N; None if the recording shows no friction
    speed: float  # root mean square speed, m/s
    position_noise: float  # standard deviation of a position sample, m
    chi2: float  # power of the residual divided by the power that the encoder's noise causes in the residual
    later: float = 0.0  # how much longer than the fitted one the delay may be if a part of it is a lag, s

    def encoder_noise(self, hertz: Floats, sample_time: float) -> Floats:
        """Return the root mean square of the encoder's noise in the force, for each bin of a spectrum, N."""
        omega = 2 * np.pi * hertz
        share = smooth(omega, self.directional.cutoff_hz) * omega**2 * abs(self.directional.value("mass"))
        return share * self.position_noise / np.sqrt(0.5 / sample_time / (hertz[1] - hertz[0]))

    def estimates(self, source: str) -> list[Estimate]:
        """Return the estimates of the parameters that a problem file states."""
        fit, text = self.directional, f"{source}: motion"
        found = [Estimate("mass", fit.value("mass"), fit.sigma("mass"), text, self._excess("mass"))]
        found += self._dampings(text)
        for name, key in (("delay", "delay"), ("sensor_delay", f"{SENSOR}.delay")):
            if name in fit.names:
                below, above = self._excess(name)
                excess = (below, max(above, self.later)) if name == "delay" else (below, above)
                found.append(Estimate(key, fit.value(name), fit.sigma(name), text, excess))
        return found

    def _excess(self, name: str) -> tuple[float, float]:
        """Return how far the estimates at other cut-offs lie below and above this estimate, beyond two standard
        deviations of both."""
        value, below, above = self.directional.value(name), 0.0, 0.0
        for fit in self.others:
            beyond = abs(fit.value(name) - value) - 2 * fit.sigma(name) - 2 * self.directional.sigma(name)
            if beyond > 0:
                below, above = (max(below, beyond), above) if fit.value(name) < value else (below, max(above, beyond))
        return float(below), float(above)

    def _dampings(self, text: str) -> list[Estimate]:
        """Return the estimate of the damping, or one estimate for each direction if the dampings differ."""
        fit = self.directional
        ways = [fit.names.index(f"damping_{way}") for way in ("forwards", "backwards")]
        difference = fit.values[ways[0]] - fit.values[ways[1]]
        C = fit.covariance
        variance = C[ways[0], ways[0]] + C[ways[1], ways[1]] - 2 * C[ways[0], ways[1]]
        coulomb = float(COULOMB_SHARE * abs(self.symmetric.value("coulomb")) / self.speed)
        if abs(difference) > SIGNIFICANT * sqrt(max(variance, 0.0)):
            dampings = [
                (fit.value(f"damping_{way}"), fit.sigma(f"damping_{way}"), way) for way in ("forwards", "backwards")
            ]
        else:
            dampings = [(self.symmetric.value("damping"), self.symmetric.sigma("damping"), "both ways")]
        return [
            Estimate("damping", value, sigma, f"{text}, {way}", (coulomb, coulomb), reason=FRICTION)
            for value, sigma, way in dampings
        ]


def motion_study(recording: Recording, sample_time: float, actuator: Actuator | None, log_map: LogMap) -> MotionStudy:
    """Study a recording."""
    signals = signals_of(recording, sample_time, actuator)
    delays = known_delays(log_map)
    if not signals.is_command:  # the stated delay ends at the measured force or before it
        delays.pop("delay", None)
    usable = cutoffs(signals)
    if not usable:
        message = "the encoder's noise hides the acceleration at every cut-off; move faster, or use a finer encoder"
        raise InputError.of(recording.source, "log-unexplained", message, key=recording.channels["position"].header)
    fits = {cutoff: motion_fit(signals, cutoff, DIRECTIONAL, delays)[0] for cutoff in usable}
    best = min(fits, key=lambda cutoff: fits[cutoff].sigma("mass"))
    samples = motion_fit(signals, best, DIRECTIONAL, delays)[1]  # keeping the samples of all fits takes too much memory
    _check_explained(recording, signals, fits[best], delays)
    hand = recording.values("hand")
    symmetric = motion_fit(signals, best, SYMMETRIC, delays)[0]
    coulomb = symmetric.value("coulomb")
    return MotionStudy(
        directional=fits[best],
        symmetric=symmetric,
        samples=samples,
        others=tuple(fit for cutoff, fit in fits.items() if cutoff != best and cutoff >= best / 8.5),
        force_noise=None if hand is None else force_noise(hand),
        friction=coulomb if coulomb > 2 * symmetric.sigma("coulomb") else None,
        speed=float(np.sqrt(np.mean(signals.velocity**2))),
        position_noise=signals.noise,
        chi2=_chi2(signals, fits[best]),
        later=_later(recording, sample_time, fits, best, delays) if signals.is_command and actuator is None else 0.0,
    )


def refuse_spring(recording: Recording, sample_time: float, actuator: Actuator | None, log_map: LogMap) -> None:
    """Refuse a log in which something besides the motor and the hand pulls with the position: no device has that."""
    signals = signals_of(recording, sample_time, actuator)
    delays = known_delays(log_map) if signals.is_command else {}
    fits = {cutoff: motion_fit(signals, cutoff, DIRECTIONAL, delays)[0] for cutoff in cutoffs(signals)}
    if not fits:
        return
    best = min(fits.values(), key=lambda fit: fit.sigma("mass"))
    sprung = motion_fit(signals, best.cutoff_hz, (*DIRECTIONAL, "stiffness"), delays)[0]
    stiffness, moved = sprung.value("stiffness"), abs(sprung.value("mass") / best.value("mass") - 1)
    if abs(stiffness) < SPRUNG * sprung.sigma("stiffness"):
        return
    share = abs(stiffness) * float(np.std(signals.position)) / best.force
    if moved < MOVED and (sprung.residual > EXPLAINED * best.residual or share < FELT):
        return
    header, units = recording.channels["position"].header, recording.units
    message = (
        f"the {units.force_name} follows the position by about {stiffness:.2g} {units.stiffness}: gravity, a return "
        "spring or a cable pulls, which no device here has; record where it is balanced, or without it"
    )
    raise InputError.of(recording.source, "log-unexplained", message, key=header)


def _later(
    recording: Recording, T: float, fits: Mapping[float, MotionFit], best: float, delays: Mapping[str, float]
) -> float:
    """Return how much longer than the fitted delay the sum of a delay and an actuator's lag may be, s.

    A lag delays fast motions less than slow ones, so that a fitted delay alone is too short. At the finest cut-off,
    where a lag shows most, and at the one of the estimate, the lag that explains the force best is found on a grid.
    """
    if "delay" not in fits[best].names:
        return 0.0
    found, fitted = 0.0, fits[best].value("delay")
    for cutoff in {best, max(fits)}:
        alone = fits[cutoff].value("delay")
        if alone < SHORT * T:
            continue
        tried = [(fits[cutoff].residual, alone)]
        for share in LAGS:
            lagging = signals_of(recording, T, Actuator(1 / (2 * pi * share * alone)))
            fit = motion_fit(lagging, cutoff, DIRECTIONAL, delays)[0]
            tried.append((fit.residual, fit.value("delay") + share * alone))
        least = min(range(len(tried)), key=lambda k: tried[k][0])
        if least > 0:  # one step further, for what lies between the steps
            found = max(found, tried[min(least + 1, len(tried) - 1)][1] - fitted)
    return found


def _chi2(signals: Signals, fit: MotionFit) -> float:
    """Return the power of the residual divided by the power of the encoder's noise in the force."""
    return (fit.residual / (abs(fit.value("mass")) * acceleration_noise(signals, fit.cutoff_hz))) ** 2


def _check_explained(recording: Recording, signals: Signals, fit: MotionFit, delays: Mapping[str, float]) -> None:
    """Refuse a log if no mass and friction explain its force, or if only an impossible mass explains it."""
    mass, residual_share = fit.value("mass"), fit.residual / fit.force
    headers = {role: channel.header for role, channel in recording.channels.items()}
    pushed = headers.get("command", headers.get("force", headers.get("hand", "")))
    faults, units = [], recording.units
    mass_text = f"the {units.mass_name} comes out as {mass:.3g} {units.mass}"
    swapped_share = _residual_if_swapped(signals, delays) if residual_share > SUSPICIOUS_SHARE else None
    swapped = swapped_share is not None and swapped_share < 0.3 * residual_share
    beyond_noise = not delays and residual_share > GREATEST_SHARE and _chi2(signals, fit) > OF_NOISE
    if residual_share > MAX_RESIDUAL_SHARE or swapped or beyond_noise:
        hint = f"; is {units.translated('a force')} missing (a hand's), or is one of another axis?"
        hint = ": are the two columns swapped?" if swapped else hint
        position = f"{units.mass_name} and friction of {headers['position']}"
        message = f"{residual_share:.0%} of {pushed} is explained by no {position}{hint}"
        faults.append(Mistake("log-unexplained", pushed, message))
    elif mass <= 0 or (not delays and _driven_by_damping(signals, fit)):
        mass_text = mass_text if mass <= 0 else f"the damping comes out as {_dampings(fit)[0]:.3g} {units.damping}"
        message = f"{mass_text}: {pushed} pushes against the motion; turn one sign by scale = -1"
        faults.append(Mistake("log-unexplained", pushed, message))
    elif not MASSES[recording.rotary][0] <= mass <= MASSES[recording.rotary][1]:
        message = (
            f"{mass_text}, which is no haptic device: is {headers['position']} or {pushed} off by 1000? "
            "write its unit or scale"
        )
        faults.append(Mistake("log-unexplained", pushed, message))
    if faults:
        raise InputError(recording.source, faults)


def _dampings(fit: MotionFit) -> tuple[float, float]:
    """Return the greater of the two ways' dampings and its standard deviation."""
    ways = ("damping_forwards", "damping_backwards")
    return max((fit.value(way), fit.sigma(way)) for way in ways)


def _driven_by_damping(signals: Signals, fit: MotionFit) -> bool:
    """Return whether the damping is below 0 both ways, for certain and with a good part of the force."""
    damping, sigma = _dampings(fit)
    return damping < -SPRUNG * sigma and -damping * float(np.std(signals.velocity)) > DRIVEN * fit.force


def _residual_if_swapped(signals: Signals, delays: Mapping[str, float]) -> float | None:
    """Return the relative residual of a fit with force and position swapped."""
    if signals.command is None:
        return None
    T, position = signals.sample_time, signals.command
    v = speed(spectrum(position - position.mean(), T), HIGHEST / T)
    swapped = turned_signals(position, signals.position, T, 0.0, v, is_command=signals.is_command)
    usable = cutoffs(swapped)
    if not usable:
        return None
    fit = motion_fit(swapped, usable[min(2, len(usable) - 1)], SYMMETRIC, delays)[0]
    return fit.residual / fit.force


def force_noise(hand: Floats) -> float:
    """Return the standard deviation of a force sample, computed from the third difference."""
    third = np.diff(hand, 3)
    return float(1.4826 * np.median(np.abs(third)) / sqrt(20))
