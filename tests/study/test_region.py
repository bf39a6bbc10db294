"""Regions: what is left open, tiles, invariances, rigid couplings. That points are what cells say: proof/test_cells."""

from __future__ import annotations

from functools import cache
from math import exp, inf
from pathlib import Path

import numpy as np
import pytest
from conftest import DEVICE, ROOT, for_passive_hands

import vctune
from vctune.document.reading import problem_file
from vctune.model.gains import Coupling, Gains
from vctune.model.numbers.units import KEYS
from vctune.report.region_figure import region_figure
from vctune.study.plane import plane
from vctune.study.region import Kind, region

K_V, K_P, B_C, M_C, B_0 = KEYS
GAINS = "[gains]\nvelocity = { min = 1.0, max = 1000.0 }\nposition = { min = 0.0, max = 1e6 }\n"
"""Bounds that the admissible loops fill well enough to be seen at a coarse resolution."""
LAG = '[device]\nmass = 0.5\ndamping = 2.0\nsample_time = 1e-3\nhold = "lag"\n'
PROBLEMS = {
    "friction-wheel": ((ROOT / "problems/friction-wheel.toml").read_text(), K_V, K_P),
    "coupling": (
        (ROOT / "problems/keemink.toml").read_text()
        + "[coupling]\ndamping = { min = 1e3, max = 1e5 }\nmass = { min = 1.0, max = 1e3 }\n",
        B_C, M_C,
    ),
    "fixed coupling": (DEVICE + GAINS + "[coupling]\ndamping = 160.0\nmass = 0.35\n", K_V, K_P),
    "drag": (
        LAG + "[gains]\nvelocity = 40.0\nposition = { min = 0.0, max = 3e4 }\n"
        "[coupling]\ndamping = 3000.0\nmass = 5.0\ndrag = { min = 0.0, max = 20.0 }\n"
        "[stability]\nband_hz = [0.01, 60.0]\nmax_sensitivity = 10.0\n",
        K_P, B_0,
    ),
}  # fmt: skip


def posed(text):
    return problem_file(for_passive_hands(text), Path("p.toml")).problem


@cache
def found(text, x, y, levels):
    problem = posed(text)
    across = plane(problem, x, y, levels)
    return region(problem, across, across.coarsest_squares())


def painted(region):
    """The kinds on the finest cells of the plane, and on those of the line K_p = 0; how often each is covered."""
    side = len(region.plane.edges[0]) - 1
    kinds, covered = np.zeros((2, side + 1, side + 1), int), np.zeros((2, side + 1, side + 1), int)
    for (a, b, c, d), kind in zip(region.squares.T, region.kinds, strict=True):
        flat = int(a == b or c == d)
        at = (flat, slice(a, b + (a == b)), slice(c, d + (c == d)))
        kinds[at], covered[at] = kind, covered[at] + 1
    line = covered[1].sum()
    assert line in (0, side)
    return kinds[0, :side, :side], covered[0, :side, :side], kinds[1][covered[1] > 0]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["friction-wheel", "coupling"])
def test_little_is_undecided_at_the_default_resolution(name):
    assert found(*PROBLEMS[name], 8).area(Kind.UNDECIDED) < 0.03


@pytest.mark.slow
@pytest.mark.parametrize("name", ["friction-wheel", "drag"])
def test_cells_tile_the_plane_and_finer_ones_only_decide_more(name):
    coarse, fine = (painted(found(*PROBLEMS[name], levels)) for levels in (5, 6))
    for kinds, covered, line in (coarse, fine):
        assert (covered == 1).all()
        assert kinds.shape == (len(kinds), len(kinds)) and line.size in (0, len(kinds))
    once, twice = (np.concatenate((kinds.ravel(), line)) for kinds, _, line in (coarse, fine))
    repeated = np.concatenate((coarse[0].repeat(2, 0).repeat(2, 1).ravel(), coarse[2].repeat(2)))
    assert (repeated == twice)[repeated != Kind.UNDECIDED].all()
    assert (once == Kind.UNDECIDED).mean() > (twice == Kind.UNDECIDED).mean()
    for levels in (5, 6):
        assert sum(found(*PROBLEMS[name], levels).area(kind) for kind in Kind) == pytest.approx(1, abs=1e-12)


@pytest.mark.slow
def test_swapped_axes_give_the_transpose():
    text = PROBLEMS["fixed coupling"][0]
    upright, swapped = painted(found(text, K_V, K_P, 6)), painted(found(text, K_P, K_V, 6))
    assert (upright[0] == swapped[0].T).all()
    assert (upright[2] == swapped[2]).all()
    assert len(set(upright[0].ravel())) == 3


@pytest.mark.slow
def test_the_velocity_loop_alone_is_stable_up_to_a_gain():
    """z = a - K_v (1 - a)/b on the line K_p = 0, the only limit when |S| hardly is one."""
    text = (
        DEVICE + "[gains]\nvelocity = { min = 600.0, max = 1000.0 }\nposition = 0.0\n"
        "[stability]\nband_hz = [0.5, 1.0]\nmax_sensitivity = 1e4\n"
    )
    cells = found(text, K_V, B_C, 6)
    a = exp(-2.0 * 1e-3 / 0.4)
    limit = 2.0 * (1 + a) / (1 - a)
    x = cells.plane.edges[0]
    assert x[cells.squares[1, cells.kinds == Kind.FEASIBLE]].max() <= limit
    assert x[cells.squares[0, cells.kinds == Kind.INFEASIBLE]].max() > limit
    assert (cells.kinds[x[cells.squares[0]] > limit] == Kind.INFEASIBLE).all()


def test_no_loop_is_judged_and_takes_no_memory():
    """Without gains C = 0, and with b = 0 every margin is exactly 0."""
    text = "[gains]\nvelocity = 0.0\nposition = 0.0\n"
    text += "[coupling]\ndamping = { min = 1.0, max = 2.0 }\nmass = { min = 1.0, max = 2.0 }\n"
    assert found(DEVICE + text, B_C, M_C, 4).area(Kind.FEASIBLE) == 1
    assert found(DEVICE.replace("2.0", "0.0") + text, B_C, M_C, 4).area(Kind.FEASIBLE) == 0
    assert found(DEVICE + text.replace("position = 0.0", "position = { min = 0.0, max = 1.0 }"), K_P, B_C, 4).kinds.size


# couplings that are rigid, the law of most robots

RIGID = {
    "device": {"sample_time": 2e-3, "servo": {"delay": 0.032, "bandwidth_hz": 20.0, "order": 2}},
    "operator": {"mass": {"min": 0, "max": 2}, "damping": {"min": 0, "max": 30}, "stiffness": {"min": 0, "max": 1000}},
    "coupling": {"damping": inf, "mass": {"min": 0.5, "max": 20.0}, "drag": {"min": 10.0, "max": 1000.0}},
}


def test_a_rigid_coupling_has_a_region():
    found = vctune.region(RIGID, resolution=1 / 16)
    areas = {kind: found.region.area(kind) for kind in Kind}
    assert areas[Kind.FEASIBLE] > 0.2
    assert areas[Kind.INFEASIBLE] > 0.2
    assert areas[Kind.UNDECIDED] < 0.1
    assert all(design[1].rigid for design in found.designs)


def test_a_given_design_is_marked_where_it_lies():
    """The mass and drag that run on a robot today, on the map of those that are feasible."""
    found = vctune.region(RIGID, None, None, Gains(0.0, 0.0), Coupling(inf, 5.0, 90.0), resolution=1 / 8)
    drawn = region_figure(found.file.problem, found.region, found.designs, found.marked)
    marks = [each for each in drawn.axes[0].collections if not str(each.get_label()).startswith("_")]
    places = {each.get_label(): each.get_offsets()[0] for each in marks}
    assert places.keys() == {"optimum", "given gains"}
    for place, edges, value in zip(places["given gains"], found.region.plane.edges, (5.0, 90.0), strict=True):
        assert np.interp(place, np.linspace(0, 1, len(edges)), edges) == pytest.approx(value)


ARM = {
    "device": {"sample_time": 2e-3, "servo": {"delay": 0.024, "bandwidth_hz": 14.0, "order": 2}},
    "tool": {"mass": 1.5},
    "environment": {"mass": {"max": 0.0}, "stiffness": {"max": 0.0}},
    "coupling": {"rule": "euler", "mass": {"min": 0.5, "max": 10.0}, "drag": {"min": 20.0, "max": 300.0}},
}


def test_a_law_that_goes_beyond_rest_in_a_step_is_infeasible():
    """M <= D T: also without environments, where the region of the continuous law would go on."""
    late = ARM | {"coupling": ARM["coupling"] | {"mass": {"min": 0.05, "max": 10.0}}}
    for tables in (late, {key: late[key] for key in ("device", "tool", "coupling")}):
        found = vctune.region(tables, resolution=1 / 8).region
        x, y = found.plane.edges
        beyond = x[found.squares[1]] <= 2e-3 * y[found.squares[2]]
        assert beyond.any() and (found.kinds[beyond] == Kind.INFEASIBLE).all()
        touched = x[found.squares[0]] <= 2e-3 * y[found.squares[3]]
        assert not (found.kinds[touched] == Kind.FEASIBLE).any()
