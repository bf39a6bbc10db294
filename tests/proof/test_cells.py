"""Cells of a plane: beyond a limit none is feasible and well within all are; their points are what they say."""

from __future__ import annotations

from collections import Counter
from functools import cache

import numpy as np
import pytest
from conftest import DRAWS, mostly_slow
from kinds import KINDS
from loop import radius
from meaning import Case
from posed import POSED
from sentences import SENTENCES

import vctune
from vctune.study.region import Kind

WIDE, NEXT_TO_0 = 1e-5, 1e-9
"""Half-width of a plane, relatively, and its end where a gain is 0."""
INSIDE, OUTSIDE = 0.15, -2e-3
ROOMY = {"limp hands": (3.0, 1)}
"""Kinds that are proved with more room, with the number of a problem whose proof is short."""
KIND = (
    "passive",
    "hands",
    "limp hands",
    "servo",
    "whole sample",
    "display",
    "any hand",
    "passive, sections",
    "unstable",
    "loud",
)
STEPPED = (
    "wall in hands", "wall in any hand", "wall in any hand, parts", "measured wall, filtered", "box of environments",
    "servo, box of environments", "servo, nothing behind", "damped servo",
)  # fmt: skip


@cache
def posed(kind):
    """Return a problem as a function of the room that it leaves."""
    if kind in STEPPED:
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


@pytest.mark.parametrize(
    "kind", mostly_slow((*KIND, *STEPPED), [*KIND[:3], "servo", "display", *STEPPED[:2], "damped servo"])
)
def test_cells_within_the_limit_are_feasible_and_cells_beyond_are_not(kind):
    assert verdicts(kind, ROOMY.get(kind, (INSIDE, 0))[0]) == {"feasible"}
    assert "feasible" not in verdicts(kind, OUTSIDE)


DUALS = ("display", "display, both", "wall", "wall in any hand")
SERVOS = ("servo", "servo, nothing behind", "servo, environments", "servo, disc", "servo, spring")
WHERE = {
    "both": ("coupling.damping", "coupling.drag"), "band": ("gains.velocity", "gains.position"),
    "hands": ("gains.velocity", "coupling.drag"),
    **dict.fromkeys(DUALS, ("coupling.damping", "coupling.stiffness")),
    **dict.fromkeys(SERVOS, ("coupling.mass", "coupling.drag")),
}  # fmt: skip
"""By kind, two numbers that span a plane."""
FREE = ("band", "hands")
"""Kinds that leave b_c free, which a feasible cell names."""
FAR, NEAR = 32.0, 1 + 1e-6
"""How far a plane reaches; a radius up to which a loop is at rest, of double eigenvalues on the circle, rounded."""
POINTS, MOST = 4, 6
"""Points of a plane that are tried of each kind; planes, until both kinds have been there."""


def with_number(tables, key, number):
    table, _, name = key.partition(".")
    return tables | {table: tables[table] | {name: number}}


def grows(tables, rng):
    """Return whether the stepped loop of a design grows in some hands of the box before some environments."""
    law = tables["coupling"]
    gains = {"velocity": 0.0, "position": 0.0} | tables.get("gains", {})
    case = Case(tables, {"gains": gains, "coupling": law, "rule": law.get("rule")}, rng)
    if case.criterion == "passive":
        return radius(case.loop(), at_rest=True) > NEAR
    return any(radius(case.loop(hand, world=environment(case))) > NEAR for hand in case.some_hands(4))


def environment(case):
    """Return an environment at a corner of the box, or a spring or a mass where any passive one is met."""
    rng, stiff = case.rng, case.coupling[0] if case.dual else case.coupling[2] + 1e-3
    if case.rigid:
        measured = case.device.get("velocity", {}).get("from") == "measured"
        return (0.0, 0.0 if measured else 1e9 * (case.coupling[0] + case.coupling[1] * case.T), 0.0)
    if "environment" in case.tables:
        low, high = case.met
        mass, stiffness = (float(rng.choice([low[k], high[k]])) for k in (0, 2))
        return mass, float(low[1]), stiffness
    size = stiff * 10 ** rng.uniform(-2, 2)
    return (float(size * case.T), 0.0, 0.0) if rng.random() < 0.5 else (0.0, 0.0, float(size / case.T))


def points(found, kind, rng):
    """Yield points of cells of a kind, many of them at corners, with the b_c that the cell names."""
    at, edges = np.flatnonzero(found.kinds == kind), found.plane.edges
    for cell in rng.choice(at, POINTS) if at.size else ():
        x_low, x_high, y_low, y_high = found.squares[:, cell]
        ends = ((edges[0][x_low], edges[0][x_high]), (edges[1][y_low], edges[1][y_high]))
        yield [float(a + rng.choice([0.0, 1.0, rng.random()]) * (b - a)) for a, b in ends], float(found.damping[cell])


def contradiction(kind, tables, rng, counts):
    """Return a point of a cell that is not what the cell says; count how the points are judged."""
    free, wide = kind in FREE, tables
    for key in (*WHERE[kind], *(["coupling.damping"] if free else [])):
        table, _, name = key.partition(".")
        middle = tables[table][name] or 1e-3
        wide = with_number(wide, key, {"min": middle / FAR, "max": middle * FAR})
    found = vctune.region(wide, *WHERE[kind], resolution=1 / 8).region
    for said, never in ((Kind.FEASIBLE, "violated"), (Kind.INFEASIBLE, "certified")):
        for place, named in points(found, said, rng):
            posed = with_number(with_number(tables, WHERE[kind][0], place[0]), WHERE[kind][1], place[1])
            tried = [posed]
            if free:
                b_c = [named] if said is Kind.FEASIBLE else posed["coupling"]["damping"] * FAR ** np.linspace(-1, 1, 5)
                tried = [with_number(posed, "coupling.damping", float(number)) for number in b_c]
            for design in tried:
                problem = vctune.problem(design).problem
                status = vctune.judge(problem, *problem.fixed_design).status.value
                counts[status] += 1
                if status == never or (said is Kind.FEASIBLE and grows(design, rng)):
                    return design
    return None


@pytest.mark.parametrize("kind", mostly_slow(WHERE, ["band", "servo", "display"]))
def test_points_of_cells_are_what_their_cells_say(kind):
    """No certificate contradicts one, and in some hands before some environments a feasible point does not grow."""
    counts, number = Counter(), 0
    while number < DRAWS or (min(counts["certified"], counts["violated"]) < 3 and number < MOST):
        rng = np.random.default_rng((103, list(POSED).index(kind), number))
        assert contradiction(kind, POSED[kind](rng), rng, counts) is None, number
        number += 1
    assert counts["certified"] >= 3 and counts["violated"] >= 3, counts
