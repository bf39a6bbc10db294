"""`vctune check --region`: prove the cells and gain sets of an earlier region, the baseline, for the present
problem."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vctune.design.variables import keys_for, point, ranges
from vctune.design.verdict.checked import OUT_OF_TIME, Checked, CheckVerdict
from vctune.design.verdict.judge import Status, judge_all
from vctune.document.reading import ProblemFile
from vctune.document.records.region_json import (
    AxesRecord,
    CheckedProblemRecord,
    RegionCheckRecord,
    RegionDocument,
    read_region,
)
from vctune.document.schema.kinds import require_record_of
from vctune.document.text import toml
from vctune.document.text.codes import Note
from vctune.document.text.errors import InputError
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.numbers.units import Units
from vctune.model.problem import Problem
from vctune.study.plane import Plane, Squares, plane_errors
from vctune.study.region import Kind, Progress, Region, region
from vctune.study.region_record import Design

OTHER_REGION = Note("other-version", "the region was found for another version of the problem (sha256 differs)")
NOTHING = Note("nothing-proved", "the region lists neither a feasible cell nor gains, so that nothing was to be proved")


@dataclass(frozen=True, slots=True)
class Recheck:
    """The verdicts of a renewed check of a baseline."""

    region: Region  # the cells that the baseline lists as feasible, divided further if they are not proved as a whole
    designs: list[Design]  # the gain sets that the baseline lists
    certified: list[bool]  # for each listed gain set, whether it is still certified
    units: Units  # units of the problem
    cut: bool = False  # whether the time limit ended the check

    @property
    def lost(self) -> bool:
        """Whether a cell or a gain set is not proved again."""
        return bool((self.region.kinds != Kind.FEASIBLE).any()) or not all(self.certified)


def recheck(problem: Problem, baseline: RegionDocument, progress: Progress = lambda stage: None) -> Recheck:
    """Prove the feasible cells and the gain sets of a baseline again for the present problem."""
    keys = keys_for(problem)
    axes = (keys.index(baseline.axes.x), keys.index(baseline.axes.y))
    plane = Plane(axes, (np.array(baseline.edges.x), np.array(baseline.edges.y)), ranges(problem))
    rechecked = region(problem, plane, _feasible(baseline), progress)
    designs: list[tuple[Gains, AnyCoupling]] = [listed.design for listed in baseline.designs]
    judged = judge_all(problem, designs) if designs else []
    certified = [judgement.status is Status.CERTIFIED for judgement in judged]
    cut = rechecked.interrupted or any(judgement.certificate.cut for judgement in judged)
    return Recheck(rechecked, designs, certified, problem.units, cut)


def _feasible(baseline: RegionDocument) -> Squares:
    """Return the feasible cells of a baseline."""
    feasible = [cell[:4] for cell in baseline.cells if cell[4] == "feasible"]
    return np.array(feasible, dtype=np.intp).reshape(-1, 4).T


@dataclass(frozen=True, slots=True)
class RegionFinding:
    """The result of a renewed check of a baseline."""

    file: ProblemFile  # the present problem
    again: Recheck  # verdicts on cells and gain sets
    warnings: list[str]  # warnings for the user

    def record(self) -> dict[str, Any]:
        """Return the areas, and the cells and gain sets that are not proved again, in SI units."""
        again, plane = self.again, self.again.region.plane
        x, y = (plane.keys[axis] for axis in plane.axes)
        x_edges, y_edges = plane.edges
        lost_designs = [design for design, holds in zip(again.designs, again.certified, strict=True) if not holds]
        cells = _lost(again).T.tolist()
        return RegionCheckRecord(
            problem=CheckedProblemRecord(name=self.file.problem.name, sha256=self.file.sha256),
            status="undecided" if again.cut else "lost" if again.lost else "kept",
            axes=AxesRecord.model_validate({"x": x, "y": y}),
            areas={"kept": again.region.area(Kind.FEASIBLE), "lost": _lost_area(again)},
            lost_cells=[[x_edges[a], x_edges[b], y_edges[c], y_edges[d]] for a, b, c, d in cells],
            lost_designs=[dict(zip(plane.keys, point(*design), strict=True)) for design in lost_designs],
            warnings=self.warnings,
        ).to_json()


def check_region_file(file: ProblemFile, baseline: Path, progress: Progress = lambda stage: None) -> Checked:
    """Prove the cells and gain sets of a region file again for the present problem."""
    old = read_region(baseline)
    require_record_of(file, old.problem, str(baseline), "region")
    if mistakes := plane_errors(file.problem, old.axes.x, old.axes.y):
        raise InputError(file.source, mistakes)
    again = recheck(file.problem, old, progress)
    notes = [] if old.problem.sha256 == file.sha256 else [OTHER_REGION]
    notes += [OUT_OF_TIME] if again.cut else [] if again.certified or again.region.kinds.size else [NOTHING]
    finding = RegionFinding(file, again, [note.line for note in notes])
    verdict = CheckVerdict.UNDECIDED if again.cut else CheckVerdict.FAILED if again.lost else CheckVerdict.PASSED
    line = toml.Lines(file.text).locate(("device",)) or 1
    return Checked(Path(file.source), file.problem.name, verdict, _message(again), line, finding)


def _lost(again: Recheck) -> Squares:
    return again.region.squares[:, again.region.kinds != Kind.FEASIBLE]


def _lost_area(again: Recheck) -> float:
    return float(again.region.plane.areas(_lost(again)).sum())


def _message(again: Recheck) -> str:
    """Return a phrase that states what is proved again, or what is not."""
    kept, lost, designs = again.region.area(Kind.FEASIBLE), _lost_area(again), len(again.certified)
    if not again.lost:
        return f"proved again: {100 * kept:.4g} % of the plane and the listed gain sets, {designs}"
    what = "not proved again in time" if again.cut else "lost their proof"
    message = f"{what}: {again.certified.count(False)} of {designs} listed gain sets"
    squares, plane = _lost(again), again.region.plane
    if squares.size:
        spans = [
            f"{plane.keys[axis]} from {edges[squares[k]].min():g} to {edges[squares[k + 1]].max():g}"
            for axis, edges, k in zip(plane.axes, plane.edges, (0, 2), strict=True)
        ]
        share = f"{100 * lost:.4g} of {100 * (kept + lost):.4g} % of the plane"
        message += f", and {share}, with {spans[0]} and {spans[1]}"
    return message
