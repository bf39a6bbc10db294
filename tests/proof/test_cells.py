"""Cells of gains next to a limit: those beyond are not called feasible, those well within are."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from conftest import mostly_slow
from kinds import KINDS
from sentences import SENTENCES

import vctune

WIDE, NEXT_TO_0 = 1e-5, 1e-9
"""Half-width of a plane, relatively, and its end where a gain is 0."""
INSIDE, OUTSIDE = 0.15, -2e-3
ROOMY = {"limp hands": (3.0, 1)}
"""Kinds that are proved with more room, with the number of a problem whose proof is short."""
KIND = ("passive", "hands", "limp hands", "servo", "whole sample", "display", "any hand", "passive, sections")
WALLS = ("wall in hands", "wall in any hand", "wall in any hand, parts")


@cache
def posed(kind):
    """Return a problem as a function of the room that it leaves."""
    if kind in WALLS:
        case = SENTENCES[kind](np.random.default_rng((197, list(SENTENCES).index(kind), 0)))
        return lambda room: case.tables(1 + room)
    number = ROOMY.get(kind, (0.0, 0))[1]
    return KINDS[kind](np.random.default_rng((97, list(KINDS).index(kind), number))).tables


def verdicts(kind, room):
    """Return the verdicts on the cells of a small plane around the design of a problem."""
    tables = {name: dict(table) for name, table in posed(kind)(room).items()}
    device = tables["device"]
    axes = ("gains.velocity", "gains.position")
    if device.get("display") == "impedance":
        axes = ("coupling.damping", "coupling.stiffness")
    elif "servo" in device:
        axes = ("coupling.drag", "coupling.mass")
    for key in axes:
        table, _, name = key.partition(".")
        middle = tables[table][name]
        ends = {"min": middle * (1 - WIDE), "max": middle * (1 + WIDE)}
        tables[table][name] = ends if middle else {"min": 0.0, "max": NEXT_TO_0}
    return {cell[4] for cell in vctune.region(tables, *axes, resolution=1 / 8).record()["cells"]}


@pytest.mark.parametrize("kind", mostly_slow((*KIND, *WALLS), [*KIND[:3], "servo", "display", *WALLS[:2]]))
def test_cells_within_the_limit_are_feasible_and_cells_beyond_are_not(kind):
    assert verdicts(kind, ROOMY.get(kind, (INSIDE, 0))[0]) == {"feasible"}
    assert "feasible" not in verdicts(kind, OUTSIDE)
