"""Study a recording of a periodic excitation: measure the response, choose a structure, and return the results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot, pi, sqrt

import numpy as np

from vctune.document.recording import Floats
from vctune.document.schema.device_contradictions import FASTEST
from vctune.identification.box import COULOMB_SHARE, Bounded, Estimate, box
from vctune.identification.motion.drive_fit import DriveFit
from vctune.identification.response.response import Response
from vctune.identification.response.response_fit import ResponseFit
from vctune.model.device import Device

SIGNIFICANT = 3.0  # Least significance, in standard deviations, of a lag that the file states


@dataclass(frozen=True, slots=True)
class PeriodicStudy:
    """The results of a periodic recording."""

    measured: Response  # the averaged response
    fit: ResponseFit  # fit of the chosen structure, and fits of all structures
    candidates: tuple[ResponseFit, ...]
    drive: DriveFit | None  # lag and delay from command to force; None unless both command and force were recorded

    @property
    def left(self) -> Floats:
        """The relative difference of the fit from each line of the position."""
        return np.abs(self.fit.position / self.measured.position.ratio - 1)

    @property
    def lag(self) -> tuple[float, float] | None:
        """The actuator's lag and its standard deviation, s; None if no lag was fitted."""
        if self.drive is not None:
            return self.drive.lag, self.drive.lag_sigma
        return (self.fit.numbers["lag"], self.fit.sigma("lag")) if "lag" in self.fit.numbers else None

    @property
    def lag_significant(self) -> bool:
        """Whether the lag is significant, and long enough to have an effect."""
        if self.lag is None:
            return False
        lag, sigma = self.lag
        return lag > max(SIGNIFICANT * sigma, self.measured.sample_time / (2 * pi * FASTEST))


def periodic_estimates(study: PeriodicStudy, source: str, T: float) -> list[Estimate]:
    """Return the estimates of the parameters that a problem file states."""
    fit, estimates = study.fit, []
    numbers, text = fit.numbers, f"{source}: response"

    def add(key: str, value: float, sigma: float, suffix: str = "", excess: float = 0.0) -> None:
        estimates.append(Estimate(key, value, sigma, text + suffix, (excess, excess)))

    add("mass", numbers["mass"], fit.sigma("mass"))
    delay, sigma = numbers["delay"], fit.sigma("delay")
    if study.drive is not None:
        delay, sigma = delay + study.drive.delay - T / 2, hypot(sigma, study.drive.delay_sigma)
    if study.lag is not None and study.lag_significant:
        add("actuator.bandwidth_hz", *_bandwidth(*study.lag))
    elif study.lag is not None:
        delay, sigma = delay + study.lag[0], hypot(sigma, study.lag[1])
    add("delay", delay, sigma)
    fits = [fit]
    if fit.candidate.damped_handle:
        fits += [other for other in study.candidates if other.candidate == replace(fit.candidate, damped_handle=False)]
    for fit_of_damping in fits:
        suffix = f", {fit_of_damping.candidate}" if len(fits) > 1 else ""
        extra = fit_of_damping.numbers.get("handle_damping", 0.0)
        variance = fit_of_damping.sigma("damping") ** 2 + (
            fit_of_damping.sigma("handle_damping") ** 2 if fit_of_damping.candidate.damped_handle else 0.0
        )
        coulomb = COULOMB_SHARE * fit_of_damping.numbers["coulomb"] / fit_of_damping.speed
        add("damping", fit_of_damping.numbers["damping"] + extra, sqrt(variance), suffix, coulomb)
        if "damping_ratio" in fit_of_damping.numbers:
            add(
                "structure.damping_ratio",
                fit_of_damping.numbers["damping_ratio"],
                fit_of_damping.sigma("damping_ratio"),
                suffix,
            )
    if "handle_mass" in numbers:
        add("structure.handle_mass", numbers["handle_mass"], fit.sigma("handle_mass"))
        add("structure.frequency_hz", numbers["frequency_hz"], fit.sigma("frequency_hz"))
    return estimates


def _bandwidth(lag: float, sigma: float) -> tuple[float, float]:
    return 1 / (2 * pi * lag), sigma / (2 * pi * lag * lag)


def behind_force(
    study: PeriodicStudy, T: float, device: Device, bounds: Sequence[Bounded]
) -> tuple[Device, list[Bounded]]:
    """Return device and box without the parts before the recorded force, unless the response has the command as
    input."""
    if study.measured.input == "command":
        return device, list(bounds)
    force_estimates = periodic_estimates(replace(study, drive=None), "", T)
    delay = box([number for number in force_estimates if number.key == "delay"], T)[0]
    others = [number for number in bounds if number.key not in ("delay", "actuator.bandwidth_hz")]
    return replace(device, delay=delay.value, actuator=None), [*others, delay]
