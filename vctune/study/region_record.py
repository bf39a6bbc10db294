"""Make the record of a region for region.json."""

from __future__ import annotations

from dataclasses import asdict
from math import isfinite
from typing import Any

import numpy as np

from vctune.document.reading import ProblemFile
from vctune.document.records.gains_json import ProblemRecord, coupling_record, stated_units
from vctune.document.records.region_json import (
    AxesRecord,
    DemandsRecord,
    DesignPoint,
    EdgesRecord,
    RegionDocument,
)
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.problem import Problem
from vctune.study.region import Kind, Region
from vctune.version import versions

Design = tuple[Gains, AnyCoupling]


def region_record(file: ProblemFile, region: Region, designs: list[Design]) -> RegionDocument:
    """Return the record of a region."""
    plane, stability = region.plane, file.problem.stability
    x, y = (plane.keys[axis] for axis in plane.axes)
    x_edges, y_edges = (edges.tolist() for edges in plane.edges)
    damping = [None if np.isnan(b_c) else b_c for b_c in region.damping.tolist()]
    cells = zip(region.squares.T.tolist(), region.kinds.tolist(), damping, strict=True)
    return RegionDocument(
        problem=ProblemRecord(
            name=file.problem.name, sha256=file.sha256, text=file.text, **stated_units(file.problem.device)
        ),
        demands=DemandsRecord(
            safety_factor=stability.safety_factor, max_sensitivity=stability.max_sensitivity, **_of_hands(file.problem)
        ),
        axes=AxesRecord.model_validate({"x": x, "y": y}),
        others={
            key: (bounds.min if isfinite(bounds.min) else None)
            if bounds.fixed
            else {end: x for end, x in asdict(bounds).items() if isfinite(x)}
            for index, (key, bounds) in enumerate(zip(plane.keys, plane.ranges, strict=True))
            if index not in plane.axes
        },
        areas={kind.name.lower(): region.area(kind) for kind in Kind},
        **({"interrupted": True} if region.interrupted else {}),
        designs=[
            DesignPoint.model_validate({"gains": asdict(gains), "coupling": coupling_record(coupling).model_dump()})
            for gains, coupling in designs
        ],
        edges=EdgesRecord(x=x_edges, y=y_edges),
        cells=[(*square, Kind(kind).name.lower(), b_c) for square, kind, b_c in cells],
        versions=versions(None),
    )


def _of_hands(problem: Problem) -> dict[str, Any]:
    """Return the record's fields on the constraint in hands; none if the problem has no such constraint."""
    if problem.hands_met is None:
        return {}
    low, high = asdict(problem.hands.low), asdict(problem.hands.high)
    return {"criterion": problem.stability.criterion, "hands": {name: [low[name], high[name]] for name in low}}
