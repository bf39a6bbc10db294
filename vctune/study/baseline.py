"""A region as the object of region.json, and a region of yesterday proved again for the problem of today."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vctune.design.judge import Status, judge_all
from vctune.design.record import versions
from vctune.design.variables import KEYS, ranges
from vctune.document.reading import ProblemFile
from vctune.document.region import SCHEMA, RegionDocument
from vctune.model.problem import Problem
from vctune.model.quantities import Coupling, Gains
from vctune.study.plane import Plane
from vctune.study.region import Kind, Region, region

Design = tuple[Gains, Coupling]


def region_record(file: ProblemFile, found: Region, designs: list[Design]) -> dict[str, Any]:
    """Return the JSON object of a region; every number in it is finite or null.

    Parameters
    ----------
    file : the problem and its text
    found : the region
    designs : proved gain sets to keep with it
    """
    plane, stability = found.plane, file.problem.stability
    damping: list[float | None] = [None if np.isnan(b_c) else b_c for b_c in found.damping.tolist()]
    cells = zip(found.squares.T.tolist(), found.kinds.tolist(), damping, strict=True)
    return {
        "schema": SCHEMA,
        "problem": {"name": file.problem.name, "sha256": file.sha256, "text": file.text},
        "demands": {"safety_factor": stability.safety_factor, "max_sensitivity": stability.max_sensitivity},
        "axes": {"x": KEYS[plane.axes[0]], "y": KEYS[plane.axes[1]]},
        "others": {
            key: bounds.min if bounds.fixed else {"min": bounds.min, "max": bounds.max}
            for index, (key, bounds) in enumerate(zip(KEYS, plane.ranges, strict=True))
            if index not in plane.axes
        },
        "areas": {kind.name.lower(): found.area(kind) for kind in Kind},
        "designs": [
            {
                "gains": {"velocity": gains.velocity, "position": gains.position},
                "coupling": {"damping": coupling.damping, "mass": coupling.mass, "drag": coupling.drag},
            }
            for gains, coupling in designs
        ],
        "edges": {"x": plane.edges[0].tolist(), "y": plane.edges[1].tolist()},
        "cells": [[*square, Kind(kind).name.lower(), b_c] for square, kind, b_c in cells],
        "versions": versions(None),
    }


@dataclass(frozen=True, slots=True)
class Recheck:
    """What became of a baseline's proofs.

    Attributes
    ----------
    region : the cells that the baseline had proved feasible, divided further where they are not as a whole
    designs : the gain sets that the baseline lists
    certified : which of them still are
    """

    region: Region
    designs: list[Design]
    certified: list[bool]

    @property
    def lost(self) -> bool:
        """Whether anything has lost its proof."""
        return bool((self.region.kinds != Kind.FEASIBLE).any()) or not all(self.certified)


def recheck(problem: Problem, baseline: RegionDocument) -> Recheck:
    """Prove again, for today's problem, the cells and the gain sets that a baseline had proved to be admissible.

    The axes keep the baseline's edges; fixed numbers and bounds of the other variables are today's.
    """
    axes = (KEYS.index(baseline.axes.x), KEYS.index(baseline.axes.y))
    plane = Plane(axes, (np.array(baseline.edges.x), np.array(baseline.edges.y)), ranges(problem.bounds))
    feasible = [cell[:4] for cell in baseline.cells if cell[4] == "feasible"]
    found = region(problem, plane, np.array(feasible, dtype=np.intp).reshape(-1, 4).T)
    designs = [
        (Gains(d.gains.velocity, d.gains.position), Coupling(d.coupling.damping, d.coupling.mass, d.coupling.drag))
        for d in baseline.designs
    ]
    certified = [judgement.status is Status.CERTIFIED for judgement in judge_all(problem, designs)] if designs else []
    return Recheck(found, designs, certified)
