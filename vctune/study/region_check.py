"""The record of a region, and `vctune check --region`: the cells and gain sets of an earlier region, the baseline,
proved for the present problem."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from vctune.design.check import OUT_OF_TIME, Checked, CheckVerdict
from vctune.design.judging.judge import Status, judge_all
from vctune.design.variables import keys_for, point, ranges
from vctune.document.reading import ProblemFile, require_record_of
from vctune.document.records.gains_json import ProblemRecord, stated_units
from vctune.document.records.region_json import (
    AxesRecord,
    DemandsRecord,
    DesignPoint,
    EdgesRecord,
    RegionDocument,
    read_region,
)
from vctune.document.text import toml
from vctune.document.text.errors import InputError, Note
from vctune.document.text.json import printed
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.problem import Range
from vctune.study.plane import Plane, Squares, plane_errors
from vctune.study.region import Kind, Progress, Region, region
from vctune.version import versions

OTHER_REGION = Note("other-version", "the region was found for another version of the problem (sha256 differs)")
NOTHING_PROVED = Note(
    "nothing-proved", "the region lists neither a feasible cell nor gains, so that nothing was to be proved"
)

GivenDesign = tuple[Gains, AnyCoupling]


def region_record(file: ProblemFile, region: Region, designs: list[GivenDesign]) -> RegionDocument:
    """Return the record of a region for region.json."""
    plane, problem, stability = region.plane, file.problem, file.problem.stability
    damping = [None if np.isnan(b_c) else b_c for b_c in region.damping.tolist()]
    cells = zip(region.squares.T.tolist(), region.kinds.tolist(), damping, strict=True)
    also: dict[str, Any] = {"interrupted": True} if region.interrupted else {}
    hands: dict[str, Any] = {}
    if problem.hands_met is not None:
        box = {name: list(ends) for name, ends in problem.hands.ranges.items()}
        hands = {"criterion": stability.criterion, "hands": box}
    return RegionDocument(
        problem=ProblemRecord(name=problem.name, sha256=file.sha256, text=file.text, **stated_units(problem.device)),
        demands=DemandsRecord(
            safety_factor=stability.safety_factor, max_sensitivity=stability.max_sensitivity, **hands
        ),
        axes=_axes(plane),
        others={
            key: _stated(bounds)
            for index, (key, bounds) in enumerate(zip(plane.keys, plane.ranges, strict=True))
            if index not in plane.axes
        },
        areas={kind.name.lower(): region.area(kind) for kind in Kind},
        **also,
        designs=[DesignPoint(gains=gains, coupling=coupling) for gains, coupling in designs],
        edges=EdgesRecord(x=plane.edges[0].tolist(), y=plane.edges[1].tolist()),
        cells=[(*square, Kind(kind).name.lower(), b_c) for square, kind, b_c in cells],
        versions=versions(None),
    )


def _axes(plane: Plane) -> AxesRecord:
    return AxesRecord.model_validate(dict(zip("xy", (plane.keys[axis] for axis in plane.axes), strict=True)))


def _stated(bounds: Range) -> float | dict[str, float] | None:
    """Return a range as in a file: a number, null for infinity, or its finite ends."""
    if bounds.fixed:
        return bounds.min if isfinite(bounds.min) else None
    return {end: x for end, x in asdict(bounds).items() if isfinite(x)}


@dataclass(frozen=True, slots=True)
class RegionFinding:
    """The verdicts of a renewed check of a baseline."""

    file: ProblemFile  # the present problem
    region: Region  # the cells that the baseline lists as feasible, divided further if they are not proved as a whole
    designs: list[GivenDesign]  # the gain sets that the baseline lists, and whether each is still certified
    certified: list[bool]
    cut: bool  # whether the time limit ended the check
    warnings: list[str]  # warnings for the user

    @property
    def lost_cells(self) -> Squares:
        """The cells that are not proved again."""
        return self.region.squares[:, self.region.kinds != Kind.FEASIBLE]

    @property
    def lost_area(self) -> float:
        """Their share of the plane."""
        return float(self.region.plane.areas(self.lost_cells).sum())

    @property
    def lost(self) -> bool:
        """Whether a cell or a gain set is not proved again."""
        return bool(self.lost_cells.size) or not all(self.certified)

    def record(self) -> dict[str, Any]:
        """Return the areas, and the cells and gain sets that are not proved again, in SI units."""
        plane, (x, y) = self.region.plane, self.region.plane.edges
        lost_designs = [design for design, holds in zip(self.designs, self.certified, strict=True) if not holds]
        return printed(
            "region-check",
            problem={"name": self.file.problem.name, "sha256": self.file.sha256},
            status="undecided" if self.cut else "lost" if self.lost else "kept",
            axes=_axes(plane).model_dump(),
            areas={"kept": self.region.area(Kind.FEASIBLE), "lost": self.lost_area},
            lost_cells=[[float(each) for each in (x[a], x[b], y[c], y[d])] for a, b, c, d in self.lost_cells.T],
            lost_designs=[dict(zip(plane.keys, point(*design), strict=True)) for design in lost_designs],
            warnings=self.warnings,
        )

    def message(self) -> str:
        """Return a phrase that states what is proved again, or what is not."""
        kept, plane, designs = self.region.area(Kind.FEASIBLE), self.region.plane, len(self.certified)
        if not self.lost:
            return f"proved again: {100 * kept:.4g} % of the plane and the listed gain sets, {designs}"
        what = "not proved again in time" if self.cut else "lost their proof"
        message = f"{what}: {self.certified.count(False)} of {designs} listed gain sets"
        if (squares := self.lost_cells).size:
            spans = [
                f"{plane.keys[axis]} from {edges[squares[k]].min():g} to {edges[squares[k + 1]].max():g}"
                for axis, edges, k in zip(plane.axes, plane.edges, (0, 2), strict=True)
            ]
            share = f"{100 * self.lost_area:.4g} of {100 * (kept + self.lost_area):.4g} % of the plane"
            message += f", and {share}, with {spans[0]} and {spans[1]}"
        return message


def check_region_file(file: ProblemFile, baseline: Path, progress: Progress = lambda stage: None) -> Checked:
    """Prove the feasible cells and the gain sets of a region file again for the present problem."""
    old = read_region(baseline)
    require_record_of(file, old.problem, str(baseline), "region")
    if mistakes := plane_errors(file.problem, old.axes.x, old.axes.y):
        raise InputError(file.source, mistakes)
    again = _again(file, old, progress)
    verdict = CheckVerdict.UNDECIDED if again.cut else CheckVerdict.FAILED if again.lost else CheckVerdict.PASSED
    line = toml.Lines(file.text).locate(("device",)) or 1
    return Checked(Path(file.source), file.problem.name, verdict, again.message(), line, again)


def _again(file: ProblemFile, old: RegionDocument, progress: Progress) -> RegionFinding:
    problem, keys = file.problem, keys_for(file.problem)
    axes = (keys.index(old.axes.x), keys.index(old.axes.y))
    plane = Plane(axes, (np.array(old.edges.x), np.array(old.edges.y)), ranges(problem))
    feasible = [cell[:4] for cell in old.cells if cell[4] == "feasible"]
    cells = region(problem, plane, np.array(feasible, dtype=np.intp).reshape(-1, 4).T, progress)
    designs: list[GivenDesign] = [listed.design for listed in old.designs]
    judged = judge_all(problem, designs) if designs else []
    cut = cells.interrupted or any(judgement.certificate.cut for judgement in judged)
    notes = [] if old.problem.sha256 == file.sha256 else [OTHER_REGION]
    notes += [OUT_OF_TIME] if cut else [] if judged or cells.kinds.size else [NOTHING_PROVED]
    certified = [judgement.status is Status.CERTIFIED for judgement in judged]
    return RegionFinding(file, cells, designs, certified, cut, [note.line for note in notes])
