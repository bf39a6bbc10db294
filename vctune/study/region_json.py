"""A region as the object of region.json."""

from __future__ import annotations

from typing import Any

import numpy as np

from vctune.design.record import versions
from vctune.document.reading import ProblemFile
from vctune.document.region import SCHEMA
from vctune.model.keys import KEYS
from vctune.model.quantities import Coupling, Gains
from vctune.study.region import Kind, Region

Design = tuple[Gains, Coupling]


def region_record(file: ProblemFile, region: Region, designs: list[Design]) -> dict[str, Any]:
    """Return the JSON object of a region; every number in it is finite or null.

    Parameters
    ----------
    file : the problem and its text
    region : what was found
    designs : proved gain sets to keep with it
    """
    plane, stability = region.plane, file.problem.stability
    damping: list[float | None] = [None if np.isnan(b_c) else b_c for b_c in region.damping.tolist()]
    cells = zip(region.squares.T.tolist(), region.kinds.tolist(), damping, strict=True)
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
        "areas": {kind.name.lower(): region.area(kind) for kind in Kind},
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
