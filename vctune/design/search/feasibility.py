"""Estimate which velocity loops violate the constraints that do not depend on the coupling, at fixed frequencies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats
from vctune.analysis.stability import makes_no_turn
from vctune.design.search.samples import Samples
from vctune.design.search.start import Missed
from vctune.model.gains import Gains
from vctune.model.loop.loop import LoopResponse
from vctune.model.numbers.pair import Pair
from vctune.model.problem import Problem

Kinds = NDArray[np.int8]  # Array of values of `Missed`


@dataclass(frozen=True, slots=True)
class LoopFeasibility:
    """The violations of loops: arrays with one entry for each pair of gains."""

    missed: Kinds  # the most serious violated constraint, over all devices
    violation: Floats  # amount of that violation
    peak_sensitivity: Floats  # greatest |S| up to Nyquist on any device

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """Flags of the loops without a violation."""
        feasible: NDArray[np.bool_] = self.missed == Missed.NOTHING
        return feasible


def loop_feasibility(problem: Problem, samples: Samples, gains: Gains, bands: list[LoopResponse]) -> LoopFeasibility:
    """Return the constraints that loops violate, each on the device with the most serious violation."""
    worst, *others = (
        _on_one_device(problem, there, gains, band) for there, band in zip(samples.everywhere, bands, strict=True)
    )
    for other in others:
        worse = (other.missed > worst.missed) | ((other.missed == worst.missed) & (other.violation > worst.violation))
        worst = LoopFeasibility(
            np.where(worse, other.missed, worst.missed),
            np.where(worse, other.violation, worst.violation),
            np.maximum(other.peak_sensitivity, worst.peak_sensitivity),
        )
    return worst


def spread(gains: Gains) -> Gains:
    """Return gains with a new last axis, so that they broadcast with an array of frequencies."""
    return Gains(gains.velocity[..., None], gains.position[..., None])


def _on_one_device(problem: Problem, samples: Samples, gains: Gains, band: LoopResponse) -> LoopFeasibility:
    device = samples.device
    scale = device.damping + gains.velocity + gains.position * device.loop_lag
    deficit = np.maximum(-band.resistance, 0).max(axis=-1, initial=0.0) / np.maximum(scale, 1e-300)
    if not samples.circles:
        missed = np.where(deficit > 0, np.int8(Missed.RESISTANCE), np.int8(Missed.NOTHING))
        return LoopFeasibility(missed, deficit, np.zeros_like(deficit))
    closed = [circle.closed(spread(gains)) for circle in samples.circles]
    greatest = np.sqrt((samples.circles[0].open.abs2() / closed[0].abs2()).max(axis=-1))
    strength = np.log1p((gains.velocity + gains.position * device.loop_lag) * device.loop_lag / device.mass)
    stable = np.all([makes_no_turn(F) for F in closed], axis=0)
    too_sensitive = np.log(np.maximum(greatest / problem.stability.max_sensitivity, 1.0))
    if samples.radius is not None:
        open_loop, F = samples.circles[0].open, closed[0]
        loop = Pair(F.re - open_loop.re, F.im - open_loop.im)
        off = (samples.radius * np.sqrt(loop.abs2() / F.abs2())).max(axis=-1)
        too_sensitive = np.maximum(too_sensitive, np.log(np.maximum(off, 1.0)))
    tests = (~stable, deficit > 0, too_sensitive > 0)  # most serious first, because `select` takes the first
    missed = np.select(tests, (Missed.STABILITY, Missed.RESISTANCE, Missed.SENSITIVITY), Missed.NOTHING)
    violation = np.select(tests, (strength, deficit, too_sensitive), 0.0)
    return LoopFeasibility(missed.astype(np.int8), violation, greatest)
