"""What a picture of a region shows beside its cells: limits of the literature, contours of a design's numbers, and
measured points."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from vctune.analysis.contact import drag_at_rest
from vctune.analysis.demands import transparency_error
from vctune.analysis.extrema import Floats
from vctune.design.judging.kicked import hands_at_rest
from vctune.design.variables import design_of
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import Hand
from vctune.model.loop.filters import velocity_sections
from vctune.model.loop.limits import lags
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.problem import Problem
from vctune.model.rest import greatest_at_rest
from vctune.running import out_of_time
from vctune.simulation.rings import least_damped, loop_matrices
from vctune.simulation.worlds import laws, worlds_of
from vctune.study.plane import Plane
from vctune.study.region import Kind, Region

VELOCITY, POSITION, DAMPING, MASS_OR_STIFFNESS, DRAG = range(5)  # of a design's numbers
MESH = 16  # Number of steps along each axis of the mesh for contours of single designs
SHARES = (0.0, 0.01, 0.05, 0.2, 0.5, 1.0)  # of the masses and springs of hands in which the mesh is told to ring
RATIOS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5)  # damping ratios of contours


class Line(NamedTuple):
    """A line of the plane: the values of one number over those of another."""

    label: str
    along: int  # index of the number that varies along the line
    across: int  # index of the number that the line limits
    limit: Callable[[Floats], Floats]  # the limit as a function of the number along it


def lines(problem: Problem) -> Iterator[Line]:
    """Yield the limits that the literature knows for a kind of device."""
    device, kind = problem.device, problem.device.kind
    b, T = device.damping, device.sample_time
    if kind.banded and problem.passive:
        tau = float(lags(device, FLOATS).drive)
        yield Line("τ K_p = b + K_v", VELOCITY, POSITION, lambda K_v: (b + K_v) / tau)
    greatest, stiffness = greatest_at_rest(device), MASS_OR_STIFFNESS if kind.inverse else POSITION
    if greatest is not None:
        name, along = ("k_c", DAMPING) if kind.inverse else ("K_p", VELOCITY)
        yield Line(f"{name} = 2 f/q, rests below", along, stiffness, lambda B: np.full_like(B, greatest))
    estimated = velocity_sections(device, FLOATS) or device.actuator is not None or device.structure is not None
    if kind.inverse and problem.rigid and not estimated:  # the literature's wall: a spring and a differenced position
        late = float(device.loop_lag)
        if device.delay == 0 and device.differences:
            yield Line("k_c = 2 (b - b_c)/T, passive below", DAMPING, stiffness, lambda B: 2 * (b - B) / T)
        yield Line("k_c = (b + b_c)/(T/2 + t_d), limit without a hand", DAMPING, stiffness, lambda B: (b + B) / late)
    if device.servo is not None and problem.hands_met is not None and problem.worlds is None:
        rest = problem.stability.safety_factor * drag_at_rest([device], problem.hands_met)
        yield Line("D = K L, infeasible below", MASS_OR_STIFFNESS, DRAG, lambda M: np.full_like(M, rest))
    if device.rule == "euler":
        yield Line("M = D T", DRAG, MASS_OR_STIFFNESS, lambda D: D * T)


def drawable(plane: Plane, line: Line) -> tuple[Floats, Floats] | None:
    """Return a line as the values of x and y; None if the plane is of other numbers."""
    if {line.along, line.across} != set(plane.axes):
        return None
    first, last = plane.edges[plane.axes.index(line.along)][[0, -1]]
    along = np.union1d(plane.edges[plane.axes.index(line.along)], np.linspace(first, last, 256))
    limit = line.limit(along)
    return (along, limit) if plane.axes[0] == line.along else (limit, along)


class Mesh(NamedTuple):
    """The numbers of single designs on a mesh of a plane; nan outside feasible cells."""

    at: Floats  # positions along both axes, as shares
    error: Floats  # shape (x, y)
    ratio: Floats  # least damping ratio of an oscillation, in some hands; inf where none oscillates


def mesh_of(problem: Problem, region: Region) -> Mesh | None:
    """Return the numbers of the designs of a plane that fixes all others; None for other planes."""
    plane = region.plane
    free = [index for index, bounds in enumerate(plane.ranges) if not bounds.fixed]
    if set(free) != set(plane.axes):
        return None
    marks = np.unique(np.linspace(0, plane.side, MESH + 1).astype(int))
    feasible = np.zeros((plane.side + 1,) * 2, bool)
    for x_low, x_high, y_low, y_high in region.squares[:, region.kinds == Kind.FEASIBLE].T:
        feasible[x_low : x_high + 1, y_low : y_high + 1] = True
    error, ratio = (np.full((len(marks), len(marks)), np.nan) for _ in range(2))
    hands = _some_hands(problem)
    values = [bounds.min for bounds in plane.ranges]
    for i, j in np.argwhere(feasible[np.ix_(marks, marks)]).tolist():
        if out_of_time():
            break
        values[plane.axes[0]], values[plane.axes[1]] = float(plane.edges[0][marks[i]]), float(plane.edges[1][marks[j]])
        design = design_of(tuple(values))
        error[i, j] = transparency_error(problem, *design).error
        ratio[i, j] = _least_ratio(problem, *design, hands)
    return Mesh(marks / plane.side, error, ratio)


def _least_ratio(problem: Problem, gains: Gains, coupling: AnyCoupling, hands: Sequence[Hand]) -> float:
    device, worlds = problem.device.undisturbed.bare, worlds_of(problem.worlds, rigid=problem.rigid)
    each = [loop_matrices(device, law, hands) for _, law in laws(device, gains, coupling, worlds)]
    return float(min(least_damped(matrices, device.sample_time)[0].min() for matrices in each))


def _some_hands(problem: Problem) -> list[Hand]:
    box = hands_at_rest(problem)
    low, high = box.low, box.high

    def spread(a: float, b: float) -> list[float]:
        return sorted({float(a + share * (b - a)) for share in SHARES})

    masses, springs = spread(low.mass, high.mass), spread(low.stiffness, high.stiffness)
    return [Hand(mass, float(low.damping), spring) for mass in masses for spring in springs]
