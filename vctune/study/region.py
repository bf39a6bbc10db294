"""The feasible gains as a set of cells: each is proved feasible throughout, proved infeasible throughout, or
undecided."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from vctune.analysis.extrema import Floats
from vctune.analysis.hardest_hands import hardest_near
from vctune.design.prepared import of_one_device, pose, problems_beside
from vctune.design.variables import coupling_from
from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.hands import PlacesInHands
from vctune.model.numbers.units import KEYS
from vctune.model.problem import Problem
from vctune.proof.boxes import Cells
from vctune.proof.cells import Places, no_damping, proved_cells, refuted
from vctune.proof.claims.hands import HANDS
from vctune.proof.enclosures.intervals import Flags
from vctune.running import OutOfTimeError, ended_by, out_of_time
from vctune.study.plane import Plane, Squares, halved
from vctune.study.region_estimate import COUPLING_DAMPING, changes, estimate

CELLS_AT_ONCE = 64  # Number of cells that the search judges together, and loses when it is interrupted
EASING = "coupling.mass", "coupling.drag"  # Variables whose growth makes the constraints easier to meet

Progress = Callable[[str], None]
Kinds = NDArray[np.intp]


class Kind(IntEnum):
    """The verdict on a cell."""

    UNDECIDED = 0
    FEASIBLE = 1
    INFEASIBLE = 2


@dataclass(frozen=True, slots=True)
class Region:
    """The cells of a plane, each with its verdict."""

    plane: Plane  # the variables and their edges
    squares: Squares  # the cells, shape (4, n)
    kinds: Kinds  # verdict on each cell, `Kind`
    damping: Floats  # b_c that meets the constraints throughout a feasible cell; nan elsewhere and if b_c is given
    interrupted: bool = False  # whether undecided cells remain that were not examined or could be divided further

    def area(self, kind: Kind) -> float:
        """Return the share of the plane with a given verdict."""
        return float(self.plane.areas(self.squares)[self.kinds == kind].sum())


def region(
    problem: Problem,
    plane: Plane,
    squares: Squares,
    progress: Progress = lambda stage: None,
    stopped: Callable[[], bool] = lambda: False,
) -> Region:
    """Divide cells of a plane of gains until each is decided or as small as the plane's edges permit."""
    of_device = of_one_device(problem)
    assert of_device is not None
    problems = [of_device, *problems_beside(of_device)]
    done, decided = list[tuple[Squares, Kinds, Floats]](), 0.0
    while squares.shape[1] and not (stopped() or out_of_time()):
        progress(f"{decided:.1%} of the plane decided, {squares.shape[1]} cells open")
        first, remaining = np.split(squares, [CELLS_AT_ONCE], axis=1)
        try:
            with ended_by(stopped):
                kinds, damping = _judged(problems, plane, first)
        except OutOfTimeError:
            break
        squares = remaining
        decided += plane.areas(first)[kinds != Kind.UNDECIDED].sum()
        settled = (kinds != Kind.UNDECIDED) | ((first[[1, 3]] - first[[0, 2]]).max(axis=0) == 1)
        done.append((first[:, settled], kinds[settled], damping[settled]))
        open_ones = first[:, ~settled]
        if open_ones.size:
            squares = np.concatenate((squares, halved(open_ones, _across(problems, plane, open_ones))), axis=1)
    undecided = squares.shape[1]
    done.append((squares, np.full(undecided, Kind.UNDECIDED, np.intp), np.full(undecided, np.nan)))
    cells, kinds, damping = (np.concatenate(part, axis=-1) for part in zip(*done, strict=True))
    return Region(plane, cells, kinds, damping, interrupted=undecided > 0)


def free_damping(plane: Plane) -> bool:
    """Return whether each cell may have its own b_c."""
    return plane.at_full_width(KEYS[COUPLING_DAMPING])


def easiest(cells: Cells, plane: Plane) -> Cells:
    """Return the cells with m_c and b_0 at their upper bounds where these are free and not axes."""
    low = cells.low.copy()
    for index in (KEYS.index(key) for key in EASING if plane.at_full_width(key)):
        low[index] = cells.high[index]
    return Cells(low, cells.high)


@np.errstate(all="ignore")
def _judged(problems: Sequence[Problem], plane: Plane, squares: Squares) -> tuple[Kinds, Floats]:
    """Return the verdict on each cell, and the b_c of a feasible cell if b_c is free."""
    free, cells = free_damping(plane), easiest(plane.cells(squares), plane)
    estimated = estimate(problems, cells, free=free)
    met, with_b_c = ~np.isnan(estimated.damping), Cells(cells.low.copy(), cells.high.copy())
    if free:
        with_b_c.low[COUPLING_DAMPING, met] = with_b_c.high[COUPLING_DAMPING, met] = estimated.damping[met]
    hopeful, kinds = np.flatnonzero(met), np.full(len(cells), Kind.UNDECIDED)
    for problem in problems:
        hopeful = hopeful[proved_cells(pose(problem).demands, with_b_c.subset(hopeful))]
    kinds[hopeful] = Kind.FEASIBLE
    beyond = _beyond_rest(problems[0].device, cells)
    kinds[beyond[0] & (kinds == Kind.FEASIBLE)] = Kind.UNDECIDED
    kinds[beyond[1]] = Kind.INFEASIBLE
    for problem, hardest in zip(problems, estimated.places, strict=True):
        undecided = np.flatnonzero(kinds == Kind.UNDECIDED)
        lost = _proved_infeasible(problem, cells.subset(undecided), _of_cells(hardest, undecided), free=free)
        kinds[undecided[lost]] = Kind.INFEASIBLE
    return kinds, np.where((kinds == Kind.FEASIBLE) & free, estimated.damping, np.nan)


def _beyond_rest(device: Device, cells: Cells) -> tuple[Flags, Flags]:
    """Return the cells of which some law, and every law, goes beyond rest in a step by Euler: M <= D T, which a file
    may not state."""
    none = np.zeros(len(cells), bool)
    if device.rule != "euler":
        return none, none
    mass, drag = KEYS.index("coupling.mass"), KEYS.index("coupling.drag")
    T = device.sample_time
    return cells.low[mass] <= T * cells.high[drag], cells.high[mass] <= T * cells.low[drag]


def _across(problems: Sequence[Problem], plane: Plane, squares: Squares) -> Flags:
    """Return the cells to halve in x: the requirements change more with x than with y, or as much in a longer side."""
    longer = squares[1] - squares[0] > squares[3] - squares[2]
    if (
        problems[0].worlds is not None or problems[0].stability.damping_ratio
    ):  # whose limits take long, and change with both
        return longer
    cells, free = easiest(plane.cells(squares), plane), free_damping(plane)
    with_x, with_y = (changes(problems, cells, axis, free=free) for axis in plane.axes)
    return np.where(with_x == with_y, longer, with_x > with_y)


def _proved_infeasible(problem: Problem, cells: Cells, places: Places, *, free: bool) -> Flags:
    """Return the cells that are proved to contain no design that meets a problem's constraints."""
    demands = pose(problem).demands
    infeasible = refuted(demands, cells, places)
    if free:
        return infeasible | no_damping(demands, cells, places)
    if HANDS.id in places and not infeasible.all():
        near = np.flatnonzero(~infeasible)
        some = cells.subset(near)
        infeasible[near] = refuted(demands, some, _refined_places(problem, some, _of_cells(places, near)))
    return infeasible


def _of_cells(places: Places, at: NDArray[np.intp]) -> Places:
    return {claim: [place[at] for place in each] for claim, each in places.items()}


def _refined_places(problem: Problem, cells: Cells, places: Places) -> Places:
    """Return the hands and angles near given places that require the most of the designs at the cells' centres."""
    first = places[HANDS.id][0]
    assert problem.hands_met is not None and isinstance(first, PlacesInHands)
    K_v, K_p, *of_coupling = cells.centres().low[:, :, None, None]
    coupling = coupling_from(of_coupling)
    _, closer = hardest_near(problem.device, problem.hands_met, Gains(K_v, K_p), coupling, first)
    return {**places, HANDS.id: [closer]}
