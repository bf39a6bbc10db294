"""The frequencies of a scan and all quantities that do not depend on the gains, computed once for all grids of a
scan."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from math import pi

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.demands import slowest_resonance, towards_zero
from vctune.analysis.extrema import Floats, with_resonance
from vctune.analysis.loops_in_hands import (
    LoopsInAnyHand,
    LoopsInHands,
    loops_at_rest,
    loops_in_any_hand,
    loops_in_hands,
)
from vctune.analysis.stability import FIRST_ANGLE, angles, makes_no_turn, unit_circle
from vctune.design.nlp.working_set import Missed
from vctune.design.prepared import Posed
from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.loop.device_response import DeviceResponse, device_response
from vctune.model.loop.loop import LoopResponse, loop_response
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.numbers.pair import Pair
from vctune.model.problem import Problem
from vctune.model.sampled.velocity_loop import ReturnDifference
from vctune.model.transparency import log_quadrature
from vctune.running import check_time

FREQUENCIES = 64  # Least number of frequencies in the stability band, and in three decades below Nyquist
# Sampling of the hands in the scan: positions in the range of each parameter of a hand, number of angles per decade,
# and number of soft springs per two decades at angle 0
FEW, FEW_ANGLES, FEW_SPRINGS = (0.0, 0.1, 1.0), 12, 4
PANELS = 3  # Number of panels of the quadrature over the transparency band, with eight nodes each


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Frequencies, rad/s, and the response of a device at these frequencies."""

    omega: Floats
    device: DeviceResponse

    def response(self, gains: Gains) -> LoopResponse:
        """Return the velocity loop at every frequency for every pair of gains."""
        return loop_response(self.device, gains, FLOATS)


@dataclass(frozen=True, slots=True)
class Samples:
    """The frequencies of a scan."""

    device: Device  # the device whose loops are evaluated
    integrator: bool  # whether the law has the term K_p/s
    band: Spectrum  # frequencies of the stability band
    nodes: Spectrum  # nodes and weights of the transparency band's quadrature
    averages: Floats
    circles: list[ReturnDifference]
    radius: Floats | None  # radius of the unmodelled dynamics at the angles of the first circle; None if there are none
    in_hand: tuple[LoopsInHands | LoopsInAnyHand, ...]
    objective: int  # number of devices whose greatest error is the objective
    others: list[Samples]

    @property
    def everywhere(self) -> list[Samples]:
        """The samples of all devices: first these samples, then the samples of the other devices."""
        return [self, *self.others]


@lru_cache(maxsize=4)
def samples_of(posed: Posed, *, integrator: bool) -> Samples:
    """Return the samples at which the scan evaluates a dimensionless problem."""
    problem, (low, high) = posed.problem, posed.span
    band = problem.transparency.band
    first = min(FIRST_ANGLE, slowest_resonance(problem, problem.bounds.velocity.min))
    across = np.geomspace(low, high, max(FREQUENCIES, int(8 * np.log10(high / low))))
    within = np.append(towards_zero(problem), with_resonance(problem.device, across))
    within = within if problem.passive else np.zeros(0)
    nodes, averages = log_quadrature(band.min, band.max, PANELS)
    if problem.transparency.norm == "peak":  # the greatest error is often at an end of the band
        nodes = np.geomspace(band.min, band.max, nodes.size)

    radii, known = (problem.uncertainty.unmodelled if problem.uncertainty else ()), set[Device]()

    def samples(device: Device, others: list[Samples]) -> Samples:
        check_time()
        band, quadrature = (Spectrum(w, device_response(device, w, FLOATS)) for w in (within, nodes))
        new = device.modelled not in known
        loops = device.loops if new else ()
        hands: tuple[LoopsInHands | LoopsInAnyHand, ...] = ()
        if problem.hands_met is not None and new:
            box = problem.hands_met
            hands = loops_in_hands(device, box, FEW, FEW_ANGLES), loops_at_rest(device, box, FEW_SPRINGS)
            if problem.worlds is not None:
                hands = (loops_in_hands(device, box, FEW[::2], FEW_ANGLES),)
        if problem.any_hand and new:
            hands = (*hands, loops_in_any_hand(device, FEW_ANGLES))
        known.add(device.modelled)
        circles = [unit_circle(loop, first, position=integrator) for loop in loops]
        radius = FLOATS.interpolated(angles(device, first) / (2 * pi), radii) if radii and circles else None
        return Samples(
            device, integrator, band, quadrature, averages, circles, radius, hands, len(posed.objective), others
        )

    nominal, *others = (samples(case.device, []) for case in posed.cases)
    return replace(nominal, others=others)


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
