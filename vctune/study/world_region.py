"""What may be rendered: the environments that given gains bear, as cells of a plane of their numbers.

A cell is a box of environments. It is feasible where the claim about a box of environments is proved of it, and
infeasible where each of its members holds a pole on the unit circle in some hand (`vctune.proof.claims.world_cells`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, replace
from math import inf

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.analysis.reactions import Reactions, reactions
from vctune.design.prepared import pose, problems_beside
from vctune.document.text.errors import Mistake
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.numbers.keys import WORLD
from vctune.model.problem import Demands, Problem, Range
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.claims.world_cells import OpenInHands, Witnesses, WorldCells, open_in_hands, refuted_in_worlds
from vctune.proof.enclosures.array_intervals import Flags
from vctune.proof.engine.boxes import Integers
from vctune.running import OutOfTimeError
from vctune.study.plane import DIGITS, Plane, Squares
from vctune.study.region import Kind, Kinds, Progress, Region, divided

MASS, DAMPING, STIFFNESS = range(3)
DECADES = (3.5, 1.5)
"""How many decades the plane reaches below and above the stiffest hand, and the others by what goes with it: for a
human hand springs of 1 N/m to 100 kN/m, masses of a gram to a hundred kilograms."""
PERIOD = 0.01
"""Time that relates a mass to a stiffness and a damping where no hand of the box states the others, s."""
AT_ONCE = 64
"""Cells compared with all curves together; their arrays stay in memory."""


def in_hands(problem: Problem) -> Problem:
    """Return a problem with every hand of its box to be met, and every passive environment."""
    return replace(problem, stability=replace(problem.stability, criterion="hands"), worlds=None)


def world_plane_errors(problem: Problem, x: str, y: str) -> list[Mistake]:
    """Return why there is no plane of environments of x and y.

    Parameters
    ----------
    problem : whose hands are to be met
    x, y : dotted keys, of which one at least is that of an environment
    """
    others = [key for key in (x, y) if key not in WORLD]
    said = f"is no number of an environment; those are {', '.join(WORLD)}"
    found = [Mistake("no-plane", key, said) for key in others]
    if x == y:
        found.append(Mistake("no-plane", x, "is both axes of the plane; choose another for x or y"))
    if problem.uncertainty is not None and problem.uncertainty.unmodelled:
        said = "is not proved with environments of a box; leave it out of this problem"
        found.append(Mistake("no-plane", "uncertainty.unmodelled", said))
    return found


def world_plane(problem: Problem, x: str, y: str, levels: int) -> Plane:
    """Return a plane of environments, from 0 and in logarithms; the number that is no axis has its stated range.

    A mass or a stiffness that is not stated is 0: the springs alone, or the masses.

    Parameters
    ----------
    problem : whose hands are to be met
    x, y : two of `WORLD`
    levels : the finest cell is 2^-levels of a side
    """
    stated = problem.worlds
    ranges = [Range(0.0, 0.0), Range(0.0, inf), Range(0.0, 0.0)]
    if stated is not None:
        ends = zip(astuple(stated.low), astuple(stated.high), strict=True)
        ranges = [Range(low, high) for low, high in ends]
    axes = WORLD.index(x), WORLD.index(y)
    spans = _spans(problem)
    for axis in axes:
        reach = [end for end in (ranges[axis].min, ranges[axis].max) if 0 < end < inf]
        low, high = spans[axis]
        spans[axis] = min([low, *(end / 10 for end in reach)]), max([high, *(10 * end for end in reach)])
        ranges[axis] = Range(0.0, spans[axis][1])
    first, second = (_edges(*spans[axis], 2**levels) for axis in axes)
    return Plane(axes, (first, second), tuple(ranges))


def _spans(problem: Problem) -> list[tuple[float, float]]:
    """Return the least mass, damping and stiffness that a plane divides, and the greatest."""
    hand = problem.hands.high
    stiffness = hand.stiffness or hand.mass / PERIOD**2 or problem.device.mass / PERIOD**2
    mass = hand.mass or stiffness * PERIOD**2
    damping = hand.damping or stiffness * PERIOD
    below, above = DECADES
    return [(_round(size * 10**-below), _round(size * 10**above)) for size in (mass, damping, stiffness)]


def _round(value: float) -> float:
    return float(f"{value:.1g}")


def _edges(low: float, high: float, count: int) -> Floats:
    inner = [float(f"{x:.{DIGITS}g}") for x in np.geomspace(low, high, count)[:-1]]
    return np.array([0.0, *inner, high])


@dataclass(frozen=True, slots=True)
class Rendered:
    """A design whose environments are looked at, in every hand of its problem.

    Attributes
    ----------
    gains, coupling : the design
    demands : the device's own
    loops : of each problem that is posed: the device's own, and those of delays next to a whole sample
    devices : whose witnesses are looked for
    curves : on which environments hold poles, in double precision
    """

    gains: Gains
    coupling: AnyCoupling
    demands: Demands
    loops: tuple[OpenInHands, ...]
    devices: tuple[Device, ...]
    curves: Reactions

    @property
    def every(self) -> bool:
        """Whether every environment is proved."""
        return all(loop.nothing for loop in self.loops)

    def judged(self, plane: Plane, squares: Squares) -> tuple[Kinds, Floats]:
        """Return what can be proved of each cell of a plane of environments.

        Parameters
        ----------
        plane, squares : the cells
        """
        kinds = np.full(squares.shape[1], Kind.FEASIBLE if self.every else Kind.UNDECIDED)
        if not self.every:
            cells = plane.cells(squares)
            hopeful, lost, witnesses = self._estimated(plane, cells.low, cells.high)
            at = np.flatnonzero(hopeful)
            kinds[at[self._proved(_met(cells.low[:, at], cells.high[:, at]))]] = Kind.FEASIBLE
            at = np.flatnonzero(lost)
            kinds[at[self._refuted(_missed(plane, cells.low[:, at], cells.high[:, at]), witnesses)]] = Kind.INFEASIBLE
        return kinds, np.full(squares.shape[1], np.nan)

    def proves(self, low: Floats, high: Floats) -> bool:
        """Return whether one box of environments is proved, of its least and greatest numbers, shape (3,)."""
        return self.every or bool(self._proved(_met(low[:, None], high[:, None]))[0])

    def _proved(self, cells: WorldCells) -> Flags:
        proved = np.ones(len(cells), bool)
        for loop in self.loops:
            at = np.flatnonzero(proved)
            proved[at] = loop.proved(cells.subset(at))
        return proved

    def _refuted(self, cells: WorldCells, found: list[tuple[int, int, int]]) -> Flags:
        """Return which cells are refuted by the curve and the two angles that were found for each."""
        refuted = np.zeros(len(cells), bool)
        which = np.array(found, np.intp).reshape(-1, 3).T
        for k, device in enumerate(self.devices):
            at = np.flatnonzero(self.curves.device[which[0]] == k)
            if at.size:
                curve, start, end = which[:, at]
                hand = np.array([number[curve] for number in astuple(self.curves.hands)])
                theta = self.curves.theta
                there = Witnesses(theta[start], theta[end], hand, self.curves.share[curve])
                design = Design(device, self.gains, self.coupling)
                refuted[at] = refuted_in_worlds(design, self.demands, cells.subset(at), there)
        return refuted

    def _estimated(self, plane: Plane, low: Floats, high: Floats) -> tuple[Flags, Flags, list[tuple[int, int, int]]]:
        """Return of which cells nothing is found that refutes them, of which a witness is, and those witnesses."""
        hopeful, lost, found = np.ones(low.shape[1], bool), np.zeros(low.shape[1], bool), []
        met, missed = _met(low, high), _missed(plane, low, high)
        points = _Points.of(self.curves, float(met.low[DAMPING].min(initial=inf)))
        for i in range(0, low.shape[1], AT_ONCE):
            part = slice(i, i + AT_ONCE)
            hopeful[part] = ~points.hit(met.low[:, part], met.high[:, part])
        for damping in np.unique(missed.low[DAMPING]):
            at = np.flatnonzero(~hopeful & (missed.low[DAMPING] == damping))
            points = _Points.of(self.curves, float(damping))
            for some in np.split(at, range(AT_ONCE, at.size, AT_ONCE)):
                between = points.between(missed.low[:, some], missed.high[:, some])
                for cell, place in zip(some, between, strict=True):
                    if place is not None:
                        lost[cell] = True
                        found.append((cell, place))
        found.sort(key=lambda each: each[0])
        return hopeful, lost, [place for _, place in found]


def rendered(problem: Problem, gains: Gains, coupling: AnyCoupling) -> Rendered:
    """Return a design whose environments are to be looked at.

    Parameters
    ----------
    problem : its device and hands, its uncertainty and safety factor; SI units
    gains, coupling : the design
    """
    held = in_hands(problem)
    posed = [pose(each) for each in [held, *problems_beside(held)]]
    hands = held.hands_met
    assert hands is not None
    devices = tuple(dict.fromkeys(case.device.modelled for case in posed[0].hand_cases))
    curves = reactions(devices, hands, gains, coupling, problem.stability.safety_factor)
    damping = problem.worlds.low.damping if problem.worlds else 0.0
    loops = tuple(
        open_in_hands(Design(each.demands.device, gains, coupling), each.demands, each.box, damping) for each in posed
    )
    return Rendered(gains, coupling, posed[0].demands, loops, devices, curves)


def world_region(
    problem: Problem,
    gains: Gains,
    coupling: AnyCoupling,
    plane: Plane,
    progress: Progress = lambda stage: None,
    stopped: Callable[[], bool] = lambda: False,
) -> Region:
    """Divide a plane of environments until each cell is decided or as small as the plane's edges allow.

    Parameters
    ----------
    problem : its device and hands, its uncertainty and safety factor; SI units
    gains, coupling : the design
    plane : of environments
    progress : told what share of the plane is decided
    stopped : whether to give up now
    """
    try:
        found = rendered(problem, gains, coupling)
    except OutOfTimeError:
        none = np.full(plane.coarsest_squares().shape[1], Kind.UNDECIDED, np.intp)
        return Region(plane, plane.coarsest_squares(), none, np.full(none.size, np.nan), interrupted=True)
    return divided(plane, plane.coarsest_squares(), lambda some: found.judged(plane, some), progress, stopped)


def _met(low: Floats, high: Floats) -> WorldCells:
    """Return the environments of cells: their damping has no upper limit."""
    most = high.copy()
    most[DAMPING] = inf
    return WorldCells(low, most)


def _missed(plane: Plane, low: Floats, high: Floats) -> WorldCells:
    """Return what each member of a cell has: of a number that is no axis each has the whole range, the other way round.

    Parameters
    ----------
    plane : says what is an axis
    low, high : the cells
    """
    least, most = low.copy(), high.copy()
    least[DAMPING] = high[DAMPING] if DAMPING in plane.axes else low[DAMPING]
    most[DAMPING] = inf
    for number in {MASS, STIFFNESS} - set(plane.axes):
        least[number], most[number] = high[number], low[number]
    return WorldCells(least, most)


@dataclass(frozen=True, slots=True)
class _Points:
    """The points of curves at which environments with enough damping hold poles, run by run.

    Attributes
    ----------
    curve, angle : numbers of the curve and of the angle, shape (n,)
    u, damping, reactance : there
    starts : where a new run begins
    """

    curve: Integers
    angle: Integers
    u: Floats
    damping: Floats
    reactance: Floats
    starts: Integers

    @classmethod
    def of(cls, curves: Reactions, least: float) -> _Points:
        """Return the points with more than a least damping."""
        curve, angle = np.nonzero(curves.damping > least)
        new = np.ones(curve.size, bool)
        new[1:] = (np.diff(curve) != 0) | (np.diff(angle) != 1)
        damping, reactance = curves.damping[curve, angle], curves.reactance[curve, angle]
        return cls(curve, angle, curves.u[angle], damping, reactance, np.flatnonzero(new))

    def hit(self, low: Floats, high: Floats) -> Flags:
        """Return of which boxes of environments a member holds a pole at a point."""
        least, most = self._reactances(low, high)
        enough = self.damping >= low[DAMPING][:, None]
        return np.any(enough & (self.reactance >= least) & (self.reactance <= most), axis=1)

    def between(self, low: Floats, high: Floats) -> list[tuple[int, int, int] | None]:
        """Return for each box a curve and two of its angles between which every member holds a pole; None for none."""
        if not self.starts.size:
            return [None] * low.shape[1]
        below, above = self._reactances(low, high)
        over, under = self.reactance > above, self.reactance < below
        both = np.logical_or.reduceat(over, self.starts, axis=1) & np.logical_or.reduceat(under, self.starts, axis=1)
        runs = np.column_stack((self.starts, np.append(self.starts[1:], self.curve.size)))
        return [self._nearest(over[cell], under[cell], runs[both[cell]].tolist()) for cell in range(low.shape[1])]

    def _nearest(self, over: Flags, under: Flags, runs: Sequence[Sequence[int]]) -> tuple[int, int, int] | None:
        """Return, of runs, the two neighbouring points on different sides between which the damping is greatest."""
        best, found = -inf, None
        for start, end in runs:
            flagged = start + np.flatnonzero(over[start:end] | under[start:end])
            for k in np.flatnonzero(over[flagged[:-1]] != over[flagged[1:]]):
                first, last = flagged[k], flagged[k + 1]
                least = float(self.damping[first : last + 1].min())
                if least > best:
                    best, found = least, (int(self.curve[first]), int(self.angle[first]), int(self.angle[last]))
        return found

    def _reactances(self, low: Floats, high: Floats) -> tuple[Floats, Floats]:
        """Return the least and the greatest reactance of boxes at the points, shape (boxes, n)."""
        least = low[MASS][:, None] * self.u - high[STIFFNESS][:, None] / self.u
        return least, high[MASS][:, None] * self.u - low[STIFFNESS][:, None] / self.u
