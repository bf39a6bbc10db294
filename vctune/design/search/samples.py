"""The frequencies of a scan and all quantities that do not depend on the gains, computed once for all grids of a
scan."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from math import pi

import numpy as np

from vctune.analysis.demands import slowest_resonance, towards_zero
from vctune.analysis.extrema import Floats
from vctune.analysis.loops_in_hands import (
    LoopsInAnyHand,
    LoopsInHands,
    loops_at_rest,
    loops_in_any_hand,
    loops_in_hands,
)
from vctune.analysis.resonance import with_resonance
from vctune.analysis.stability import FIRST_ANGLE, angles, unit_circle
from vctune.design.prepared import Posed
from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.loop.device_response import DeviceResponse, device_response
from vctune.model.loop.loop import LoopResponse, loop_response
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.sampled.velocity_loop import ReturnDifference
from vctune.model.transparency import log_quadrature

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
