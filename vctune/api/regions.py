"""`vctune region`, as a function."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from math import ceil, inf, log2
from pathlib import Path
from typing import Any

from vctune.api.argument_ranges import RESOLUTIONS
from vctune.design.result import Solved
from vctune.design.search.optimum import Progress
from vctune.design.solve import solve
from vctune.design.variables import keys_for
from vctune.design.verdict.judge import Status
from vctune.document.building import ProblemSource
from vctune.document.building import problem as problem_of
from vctune.document.reading import ProblemFile
from vctune.document.records.region_json import read_region
from vctune.document.text.errors import InputError, Mistake
from vctune.document.text.output_files import previous, write_together
from vctune.markup import html_facts
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.problem import Problem
from vctune.running import OutOfTimeError, seconds_left, unlimited
from vctune.running import time_limit as limited
from vctune.study.plane import plane, plane_errors
from vctune.study.region import Kind, Region
from vctune.study.region import region as divide
from vctune.study.region_record import region_record

REGION_FILE, PICTURE = "region.json", "region.svg"
SOLVING = 0.5
"""The share of a time limit that solving takes at most, whose design a region shows and does not need."""
DRAWING = 1.5
"""Seconds reserved for the picture of the cells, at most half of the remaining time. Half leaves regions without a
picture on a slow machine, twice as much leaves cells undecided."""
LOADING = 0.5
"""Seconds to load the drawing packages, which nothing interrupts: with less time left no picture is begun. Half ends
late."""


@dataclass(frozen=True, slots=True)
class AdmissibleGains:
    """The plane of two design variables, with the verdict on each cell.

    Attributes
    ----------
    file : the problem
    region : the cells; `interrupted` if the search was stopped
    solved : the problem's best design, if it has one
    """

    file: ProblemFile
    region: Region
    solved: Solved

    @property
    def areas(self) -> dict[str, float]:
        """The share of the plane by verdict: feasible, infeasible, undecided."""
        return {kind.name.lower(): self.region.area(kind) for kind in (Kind.FEASIBLE, Kind.INFEASIBLE, Kind.UNDECIDED)}

    @property
    def designs(self) -> list[tuple[Gains, AnyCoupling]]:
        """Designs that are certified on their own."""
        best = self.solved.judgement
        certified = best is not None and self.solved.status is Status.CERTIFIED
        return [(best.gains, best.coupling)] if best is not None and certified else []

    @property
    def status(self) -> Status:
        """Certified if there are feasible gains, infeasible if there are none, undecided if neither is proved."""
        kinds = self.region.kinds
        if (kinds == Kind.FEASIBLE).any() or self.designs:
            return Status.CERTIFIED
        impossible = self.solved.status is Status.INFEASIBLE or (kinds == Kind.INFEASIBLE).all()
        return Status.INFEASIBLE if impossible else Status.UNDECIDED

    def record(self) -> dict[str, Any]:
        """Return the object of region.json."""
        return region_record(self.file, self.region, self.designs).to_json()

    def _repr_html_(self) -> str:
        shares = {f"{kind}, %": 100 * share for kind, share in self.areas.items()}
        return html_facts(f"{self.file.problem.name}: {self.status.value}", shares)


def region(
    problem: ProblemSource,
    x: str | None = None,
    y: str | None = None,
    *,
    resolution: float = 1 / 256,
    solved: Solved | None = None,
    time_limit: float = inf,
    stopped: Callable[[], bool] = lambda: False,
    progress: Progress = lambda stage: None,
) -> AdmissibleGains:
    """Find the set of gains that meet a problem's constraints, cell by cell.

    Parameters
    ----------
    problem : path of a problem file, its tables as a dict, or the problem
    x, y : dotted keys of two variables that are free; None for K_v and K_p, or of an impedance display b_c and k_c. If
        others are free, feasible means that some of their values within their bounds suffice
    resolution : side of the smallest cell as a share of the plane's, 1/2048 to 1/8
    solved : the result of `solve` for the problem; None to solve it first
    time_limit : s, after which the function returns the result so far
    stopped : whether to give up now; the remaining cells are undecided
    progress : function that receives the current stage

    Returns
    -------
    AdmissibleGains

    Raises
    ------
    InputError
        If the problem is invalid, or x and y span no plane.
    """
    file = problem_of(problem)
    x, y = axes_of(file.problem, x, y)
    require_plane(file, x, y)
    finest, coarsest = RESOLUTIONS
    if not finest <= resolution <= coarsest:
        message = f"{resolution:g} is out of range: must be from 1/{1 / finest:g} to 1/{1 / coarsest:g}"
        raise InputError.of("resolution", "bad-option", message)
    across = plane(file.problem, x, y, ceil(-log2(resolution)))
    with limited(time_limit):
        solved = solved or best_design(file.problem, progress)
        with limited(max(seconds_left() - DRAWING, seconds_left() / 2)):
            cells = divide(file.problem, across, across.coarsest_squares(), progress, stopped)
        return AdmissibleGains(file, cells, solved)


def best_design(problem: Problem, progress: Progress = lambda stage: None) -> Solved:
    """Return the best design of a problem, to show it in its region; it takes the share `SOLVING` of a time limit.

    Parameters
    ----------
    problem : problem in SI units
    progress : function that receives the current stage
    """
    with limited(SOLVING * seconds_left()):
        return solve(problem, progress)


def axes_of(problem: Problem, x: str | None, y: str | None) -> tuple[str, str]:
    """Return the axes of a problem's plane: those that are named, or the usual ones of its display.

    Parameters
    ----------
    problem : its display decides the usual axes
    x, y : dotted keys; None for the usual one
    """
    kind = problem.device.kind
    usual = kind.keys[-2:] if kind.absent else kind.keys[:2]
    return x or usual[0], y or usual[1]


def require_plane(file: ProblemFile, x: str, y: str) -> ProblemFile:
    """Return a problem that has a region in the plane of x and y.

    Parameters
    ----------
    file : the problem
    x, y : dotted keys of its variables

    Raises
    ------
    InputError
        If it has none.
    """
    keys = keys_for(file.problem)
    said = f"is no variable; there are: {', '.join(keys)}"
    unknown = [Mistake("no-plane", key, said) for key in (x, y) if key not in keys]
    if mistakes := unknown or plane_errors(file.problem, x, y):
        raise InputError(file.source, mistakes)
    return file


def write_region(found: AdmissibleGains, folder: Path) -> tuple[Path | None, bool]:
    """Write region.json and its picture, if there is time to draw it.

    Parameters
    ----------
    found : the region; if its search was interrupted, an earlier complete region is kept
    folder : an existing folder

    Returns
    -------
    kept : new name of an earlier search's region.json, None if it was not renamed
    drawn : whether the picture was

    Raises
    ------
    InputError
        If the folder cannot be written.
    """
    with unlimited():
        text = json.dumps(found.record(), allow_nan=False) + "\n"
    pictures: dict[Path, str] = {}
    with suppress(OutOfTimeError):
        pictures = _picture(found, folder)
    place, picture = folder / REGION_FILE, folder / PICTURE
    kept = [picture, place] if found.region.interrupted and place.exists() and not _interrupted(place) else []
    write_together({place: text, **pictures}, () if pictures or kept else (picture,), kept)
    return previous(place) if kept else None, bool(pictures)


def _picture(found: AdmissibleGains, folder: Path) -> dict[Path, str]:
    if seconds_left() < LOADING:
        raise OutOfTimeError
    from vctune.report.figures.region_figure import region_figure
    from vctune.report.page.page import svg

    figure = region_figure(found.file.problem, found.region, found.designs)
    return {folder / PICTURE: svg(figure, Path(PICTURE).stem)}


def _interrupted(place: Path) -> bool:
    try:
        return read_region(place).interrupted
    except InputError:
        return False
