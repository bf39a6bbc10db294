"""Provide `vctune region` as a function."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil, inf, log2
from pathlib import Path
from typing import Any

from vctune.api.argument_ranges import RESOLUTIONS
from vctune.api.result import Files, Printed, code_of
from vctune.design.judging.judge import Status
from vctune.design.judging.kicked import buzz_of, ringing_of
from vctune.design.prepared import pose
from vctune.design.result import Solved
from vctune.design.search.optimum import Progress
from vctune.design.solve import solve
from vctune.design.variables import design_of, keys_for
from vctune.document.building import DesignSource, ProblemSource
from vctune.document.building import design_for as design_for
from vctune.document.building import problem as problem_of
from vctune.document.measured_points import MeasuredPoint
from vctune.document.measured_points import measured_points as measured_points
from vctune.document.reading import ProblemFile
from vctune.document.text.errors import InputError, Mistake
from vctune.exit_codes import ExitCode
from vctune.model.gains import AnyCoupling
from vctune.model.problem import Problem
from vctune.model.rest import read_in_steps
from vctune.running import out_of_time, seconds_left, unlimited
from vctune.running import time_limit as limited
from vctune.study.plane import Plane, plane, plane_errors
from vctune.study.region import Kind, Region
from vctune.study.region import region as divide
from vctune.study.region_check import GivenDesign, region_record

REGION_FILE, PICTURE = "region.json", "region.svg"
SOLVING = 0.5  # Greatest share of a time limit for solving the problem
DRAWING = 1.5  # Seconds reserved for the picture of the cells, at most half of the remaining time


@dataclass(frozen=True, slots=True)
class AdmissibleGains:
    """The plane of two design variables, with the verdict on each cell."""

    file: ProblemFile  # the problem
    region: Region  # the cells; `interrupted` states whether the search was stopped
    solved: Solved  # the result of solving the problem
    marked: GivenDesign | None = None
    late: bool = False  # whether the time limit ended the search
    measured: tuple[MeasuredPoint, ...] = ()  # points that the picture shows

    @property
    def areas(self) -> dict[str, float]:
        """The share of the plane for each verdict: feasible, infeasible, undecided."""
        return {kind.name.lower(): self.region.area(kind) for kind in (Kind.FEASIBLE, Kind.INFEASIBLE, Kind.UNDECIDED)}

    @property
    def designs(self) -> list[GivenDesign]:
        """The best design, if it is certified."""
        best = self.solved.judgement
        certified = best is not None and self.solved.status is Status.CERTIFIED
        return [(best.gains, best.coupling)] if best is not None and certified else []

    @property
    def status(self) -> Status:
        """The status: certified if a cell is feasible or the best design is certified, infeasible if all cells are
        infeasible or the problem is proved infeasible, undecided otherwise."""
        kinds = self.region.kinds
        if (kinds == Kind.FEASIBLE).any() or self.designs:
            return Status.CERTIFIED
        impossible = self.solved.status is Status.INFEASIBLE or (kinds == Kind.INFEASIBLE).all()
        return Status.INFEASIBLE if impossible else Status.UNDECIDED

    @property
    def exit_code(self) -> ExitCode:
        """The code of the status; undecided if the search did not examine the whole plane."""
        return ExitCode.UNDECIDED if self.region.interrupted else code_of(self.status)

    def record(self) -> dict[str, Any]:
        """Return the object of region.json."""
        return region_record(self.file, self.region, self.designs).to_json()

    def rows(self) -> Printed:
        """Yield the share of the plane for each verdict, and the axes of the plane."""
        lines = [f"{kind:10} {100 * share:7.2f} %" for kind, share in self.areas.items()]
        if self.region.interrupted:
            lines[-1] += (
                f"  {'out of time' if self.late else 'interrupted'}: the search did not examine the whole plane"
            )
        keys = self.region.plane.keys
        x, y = (keys[axis] for axis in self.region.plane.axes)
        lines.append(f"of the plane {x} by {y}")
        if self.measured:
            lines.append(agreement(self.file.problem, self.region, self.measured))
        yield from ((line,) for line in lines)

    def files(self, folder: Path) -> Files:
        """Return region.json and its picture, also of a search that the time limit or a signal has ended: then without
        contours."""
        from vctune.report.region_figure import region_figure
        from vctune.report.style import picture

        contours = not (out_of_time() or self.region.interrupted)
        with unlimited():
            shown = self.designs, self.marked, self.measured
            figure = region_figure(self.file.problem, self.region, *shown, contours=contours)
            text = json.dumps(self.record(), allow_nan=False) + "\n"
            return {folder / REGION_FILE: text, folder / PICTURE: picture(figure, Path(PICTURE).stem, "svg")}


def region(
    problem: ProblemSource,
    x: str | None = None,
    y: str | None = None,
    gains: DesignSource | None = None,
    coupling: AnyCoupling | None = None,
    *,
    resolution: float = 1 / 256,
    linear: bool = False,
    points: str | Path | Sequence[MeasuredPoint] = (),
    solved: Solved | None = None,
    time_limit: float = inf,
    stopped: Callable[[], bool] = lambda: False,
    progress: Progress = lambda stage: None,
) -> AdmissibleGains:
    """Find the gains that meet a problem's constraints, cell by cell.

    Parameters
    ----------
    problem : ProblemSource
        Path of a problem file, its tables as a dict, or the problem.
    x, y : str, optional
        Dotted keys of two free variables; None for the usual keys of the display. For other free variables, some
        values within their bounds suffice.
    gains, coupling : DesignSource, optional and AnyCoupling, optional
        A design that the picture marks, or its file.
    resolution : float
        Side of the smallest cell as a share of the plane's side, 1/2048 to 1/8, rounded down to a power of 1/2.
    linear : bool
        Whether the axes are linear instead of logarithmic.
    points : str or Path or sequence of MeasuredPoint
        Measured points that the picture shows; or a CSV file with columns of both axes and of `stable` (yes or no).
    solved : Solved, optional
        The result of `solve` for the problem; None to solve it first.
    time_limit : float
        Seconds after which the function returns the result so far.
    stopped : Callable[[], bool]
        Function that returns whether to end the search now; the remaining cells are undecided.
    progress : Progress
        Function that receives the current stage.

    Returns
    -------
    AdmissibleGains

    Raises
    ------
    InputError
        If the problem, the design or the resolution is invalid, or if x and y do not span a plane.
    """
    file = problem_of(problem)
    x, y = axes_of(file.problem, x, y)
    require_plane(file, x, y)
    finest, coarsest = RESOLUTIONS
    if not finest <= resolution <= coarsest:
        message = f"{resolution:g} is out of range: must be from 1/{1 / finest:g} to 1/{1 / coarsest:g}"
        raise InputError.of("resolution", "bad-option", message)
    levels = ceil(-log2(resolution))
    measured = measured_points(Path(points), (x, y)) if isinstance(points, str | Path) else points
    with limited(time_limit):
        marked = None
        if gains is not None or coupling is not None:
            file, marked = design_for(file, gains, coupling)
        design = None if marked is None else (marked.gains, marked.coupling)
        solved = solved or best_design(file.problem, progress)
        with limited(max(seconds_left() - DRAWING, seconds_left() / 2)):
            across = plane(file.problem, x, y, levels, linear=linear)
            cells = divide(file.problem, across, across.coarsest_squares(), progress, stopped)
            late = cells.interrupted and not stopped()
            return AdmissibleGains(file, cells, solved, design, late, tuple(measured))


def agreement(problem: Problem, region: Region, points: Sequence[MeasuredPoint]) -> str:
    """Return how many measured points agree with the cells around them, and which do not and why."""
    against, buzzing, (x, y), (a, b, c, d) = list[str](), list[str](), region.plane.edges, region.squares
    for point in points:
        around = (x[a] <= point.x) & (point.x <= x[b]) & (y[c] <= point.y) & (point.y <= y[d])
        if not point.stable and (region.kinds[around] == Kind.FEASIBLE).any():
            (buzzing if _buzzes(problem, region.plane, point) else against).append(f"({point.x:g}, {point.y:g})")
    stable = sum(point.stable for point in points)
    counted = f"measured     {stable} stable, {len(points) - stable} unstable"
    outside = sum(not (x[0] <= point.x <= x[-1] and y[0] <= point.y <= y[-1]) for point in points)
    counted += f", of which {outside} outside the plane" if outside else ""
    if not against and not buzzing:
        return f"{counted}; no unstable one is in a feasible cell"
    if buzzing:
        counted += f"; in a feasible cell and buzzing, as simulated: {', '.join(buzzing)}"
    if against:
        counted += f"; unstable in a feasible cell: {', '.join(against)}: the device is not the one of the file"
        stated = problem.device.friction is not None and read_in_steps(problem.device) is not None
        counted += (
            "" if stated else ", or its friction or the steps of its encoder, which the file does not state, buzz"
        )
    return counted


def _buzzes(problem: Problem, plane: Plane, point: MeasuredPoint) -> bool:
    """Return whether some kick keeps the design at a point moving; False where the point is no whole design."""
    values = dict(zip(plane.axes, (point.x, point.y), strict=True))
    if any(axis not in values and not bounds.fixed for axis, bounds in enumerate(plane.ranges)):
        return False
    gains, coupling = design_of(tuple(values.get(axis, bounds.min) for axis, bounds in enumerate(plane.ranges)))
    kicked = buzz_of(problem, ringing_of(pose(problem), problem.device, gains, coupling), gains, coupling)
    return kicked is not None and kicked.moving > 0


def best_design(problem: Problem, progress: Progress = lambda stage: None) -> Solved:
    """Solve a problem and return the result, whose best design a picture of the region shows."""
    with limited(SOLVING * seconds_left()):
        return solve(problem, progress)


def axes_of(problem: Problem, x: str | None, y: str | None) -> tuple[str, str]:
    """Return the axes of a problem's plane: the given keys, or the usual keys of its display."""
    kind = problem.device.kind
    usual = kind.keys[-2:] if kind.absent else kind.keys[:2]
    return x or usual[0], y or usual[1]


def require_plane(file: ProblemFile, x: str, y: str) -> ProblemFile:
    """Return a problem, or raise an error if the problem has no region in the plane of x and y."""
    keys = keys_for(file.problem)
    message = f"is no variable; there are: {', '.join(keys)}"
    unknown = [Mistake("no-plane", key, message) for key in (x, y) if key not in keys]
    if mistakes := unknown or plane_errors(file.problem, x, y):
        raise InputError(file.source, mistakes)
    return file
