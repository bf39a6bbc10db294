"""Find the environments that a design can render in every hand, beyond the environments that the problem requires."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, replace
from math import ceil, floor, inf, log10

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.design.prepared import Posed, pose, problems_beside
from vctune.design.reactions import LimitPoints, Reactions, reactions
from vctune.design.verdict.judge import Judgement, Status
from vctune.document.records.rendered_json import RenderedRecord
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.problem import Demands, Problem
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.claims.worlds.world_cells import OpenInHands, Witnesses, WorldCells, open_in_hands, refuted_in_worlds
from vctune.proof.enclosures.array_intervals import Flags
from vctune.proof.engine.boxes import Integers
from vctune.running import OutOfTimeError

AT_ONCE = 64  # Number of cells that the search compares with all curves at once, so that the arrays fit into memory

# Relative distances between the value to prove and the limit in double precision. vctune tries the next distance if the
# proof fails with the one before
RESERVES = (5e-3, 0.03, 0.1)
DIGITS = 3  # Number of significant digits of a stated limit
# Relative distance by which a limit must be better than the value that is already proved; otherwise vctune does not
# prove the limit
WORTH = 0.01
MASS, STIFFNESS = 0, 2


Between = tuple[int, int, int]  # Index of a curve, and indices of two of its angles


def in_hands(problem: Problem) -> Problem:
    """Return a problem that requires stability in every hand of its box with every passive environment."""
    return replace(problem, stability=replace(problem.stability, criterion="hands"), worlds=None)


@dataclass(frozen=True, slots=True)
class Rendered:
    """A design, prepared for proofs of its stability with boxes of environments in every hand of its problem."""

    gains: Gains  # the design
    coupling: AnyCoupling
    demands: Demands  # constraints for the device itself
    loops: tuple[OpenInHands, ...]
    devices: tuple[Device, ...]  # devices on which the search looks for witnesses
    curves: Reactions  # curves along which environments have poles, in double precision

    @property
    def every(self) -> bool:
        """Whether the design is proved stable with every passive environment."""
        return all(loop.nothing for loop in self.loops)

    def proves(self, low: Floats, high: Floats) -> bool:
        """Return whether the design is proved stable with each environment of one box."""
        return self.every or bool(self.proved(met(low[:, None], high[:, None]))[0])

    def proved(self, cells: WorldCells) -> Flags:
        """Return for which boxes of environments the design is proved stable."""
        proved = np.ones(len(cells), bool)
        for loop in self.loops:
            at = np.flatnonzero(proved)
            proved[at] = loop.proved(cells.subset(at))
        return proved

    def refuted(self, missed: WorldCells, found: Sequence[Between]) -> Flags:
        """Return a flag for each box: whether its curve and its two angles provably refute every environment of the
        box."""
        refuted = np.zeros(len(missed), bool)
        which = np.array(found, np.intp).reshape(-1, 3).T
        for k, device in enumerate(self.devices):
            at = np.flatnonzero(self.curves.device[which[0]] == k)
            if at.size:
                curve, start, end = which[:, at]
                hand = np.array([number[curve] for number in self.curves.hands.by_key.values()])
                theta = self.curves.theta
                there = Witnesses(theta[start], theta[end], hand, self.curves.share[curve])
                design = Design(device, self.gains, self.coupling)
                refuted[at] = refuted_in_worlds(design, self.demands, missed.subset(at), there)
        return refuted

    def estimated(self, cells: WorldCells, missed: WorldCells) -> tuple[Flags, Integers, list[Between]]:
        """Look for curves and angles that refute boxes of environments, in double precision."""
        hopeful, found = np.ones(len(cells), bool), dict[int, Between]()
        points = LimitPoints.of(self.curves, float(cells.low[1].min(initial=inf)))
        for i in range(0, len(cells), AT_ONCE):
            part = slice(i, i + AT_ONCE)
            hopeful[part] = ~points.hit(cells.low[:, part], cells.high[:, part])
        for damping in np.unique(missed.low[1]):
            at = np.flatnonzero(~hopeful & (missed.low[1] == damping))
            points = LimitPoints.of(self.curves, float(damping))
            for some in np.split(at, range(AT_ONCE, at.size, AT_ONCE)):
                between = points.between(missed.low[:, some], missed.high[:, some])
                found |= {cell: place for cell, place in zip(some.tolist(), between, strict=True) if place is not None}
        lost = sorted(found)
        return hopeful, np.array(lost, np.intp), [found[cell] for cell in lost]


def rendered(problem: Problem, gains: Gains, coupling: AnyCoupling, damping: float = 0.0) -> Rendered:
    """Return a design, prepared for proofs of its stability with boxes of environments in every hand of its problem."""
    posed = _posed(problem)
    devices, curves = _curves(posed[0], gains, coupling)
    loops = tuple(
        open_in_hands(Design(each.demands.device, gains, coupling), each.demands, each.box, damping) for each in posed
    )
    return Rendered(gains, coupling, posed[0].demands, loops, devices, curves)


def _posed(problem: Problem) -> list[Posed]:
    held = in_hands(problem)
    return [pose(each) for each in [held, *problems_beside(held)]]


def _curves(posed: Posed, gains: Gains, coupling: AnyCoupling) -> tuple[tuple[Device, ...], Reactions]:
    demands, devices = posed.demands, tuple(dict.fromkeys(case.device.modelled for case in posed.hand_cases))
    assert demands.hands is not None
    return devices, reactions(devices, demands.hands, gains, coupling, demands.factor)


def met(low: Floats, high: Floats) -> WorldCells:
    """Return boxes of environments whose damping has no upper limit."""
    most = high.copy()
    most[1] = inf
    return WorldCells(low, most)


def rendered_record(problem: Problem, judgement: Judgement) -> RenderedRecord | None:
    """Return the stiffest spring and the lightest tool with which a design is proved stable in every hand."""
    worlds, certified = problem.worlds, judgement.status is Status.CERTIFIED
    if problem.hands_met is None or worlds is None or not worlds.lossless:
        return None
    low, high = np.array(astuple(worlds.low)), np.array(astuple(worlds.high))
    law = judgement.gains, judgement.coupling
    known = {STIFFNESS: float(high[STIFFNESS]), MASS: float(low[MASS])} if certified else {}
    try:
        points = LimitPoints.with_edges(_curves(_posed(problem)[0], *law)[1], float(low[1]))
        ends = {number: _ends_beyond(points, low, high, number, known.get(number)) for number in (STIFFNESS, MASS)}
        found = rendered(problem, *law, float(low[1])) if any(ends.values()) else None
        proved = {
            number: next((x for x, *box in tried if found and found.proves(*box)), known.get(number))
            for number, tried in ends.items()
        }
    except OutOfTimeError:
        return None
    return RenderedRecord(
        stiffest_spring=proved[STIFFNESS],
        tools=[float(low[MASS]), float(high[MASS])],
        lightest_tool=proved[MASS],
        springs=[float(low[STIFFNESS]), float(high[STIFFNESS])],
    )


def _ends_beyond(
    points: LimitPoints, low: Floats, high: Floats, number: int, known: float | None
) -> list[tuple[float, Floats, Floats]]:
    """Return the stiffnesses or the masses to prove, one for each reserve, each with the box whose range ends there."""
    stiff, found = number == STIFFNESS, []
    if not stiff and high[MASS] == 0:
        high = np.array([inf, *high[1:]])
    limit = points.stiffest(low, high) if stiff else points.lightest(low, high)
    for reserve in RESERVES:
        value = _rounded(limit * (1 - reserve), floor) if stiff else _rounded(limit * (1 + reserve), ceil)
        least, most = low.copy(), high.copy()
        (most if stiff else least)[number] = value
        beyond = known is None or (value > known * (1 + WORTH) if stiff else value < known * (1 - WORTH))
        if beyond and (value > 0 or not stiff) and np.all(least <= most):
            found.append((value, least, most))
    return found


def _rounded(value: float, whole: Callable[[float], int]) -> float:
    """Return a number rounded to `DIGITS` digits in one direction."""
    if not 0 < value < inf:
        return value
    unit = 10.0 ** (floor(log10(value)) + 1 - DIGITS)
    return float(f"{whole(value / unit) * unit:.{DIGITS}g}")
