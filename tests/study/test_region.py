"""Regions: no cell claims what a point of it refutes, closed forms, invariances."""

from __future__ import annotations

from functools import cache
from math import exp, inf
from pathlib import Path

import numpy as np
import pytest
from conftest import DEVICE, ROOT, for_passive_hands, mostly_slow
from dense import best_damping, surpluses

import vctune
from vctune.bench.evaluator import cases
from vctune.design.prepared import pose
from vctune.design.variables import ranges
from vctune.document.reading import problem_file
from vctune.model.design import Design
from vctune.model.gains import Coupling, Gains
from vctune.model.numbers.units import KEYS
from vctune.proof.certificate import certify
from vctune.proof.outcome import Verdict
from vctune.report.region_figure import region_figure
from vctune.study.plane import plane
from vctune.study.region import Kind, free_damping, region

K_V, K_P, B_C, M_C, B_0 = KEYS
GAINS = "[gains]\nvelocity = { min = 1.0, max = 1000.0 }\nposition = { min = 0.0, max = 1e6 }\n"
"""Bounds that the admissible loops fill well enough to be seen at a coarse resolution."""
LAG = '[device]\nmass = 0.5\ndamping = 2.0\nsample_time = 1e-3\nhold = "lag"\n'
PROBLEMS = {
    "friction-wheel": ((ROOT / "problems/friction-wheel.toml").read_text(), K_V, K_P),
    "late": ((ROOT / "problems/extremes/late.toml").read_text(), K_P, K_V),
    "a hundred samples late": (DEVICE + "delay = 0.1\n[gains]\nposition = { min = 0.01, max = 20.0 }\n", K_V, K_P),
    "coupling": (
        (ROOT / "problems/keemink.toml").read_text()
        + "[coupling]\ndamping = { min = 1e3, max = 1e5 }\nmass = { min = 1.0, max = 1e3 }\n",
        B_C, M_C,
    ),
    "no position": ((ROOT / "problems/extremes/velocity-only.toml").read_text(), K_V, B_C),
    "undamped, next to K_p = 0": (
        "[device]\nmass = 0.4\ndamping = 0.0\nsample_time = 1e-3\n"
        "[gains]\nposition = { min = 0.0, max = 1.0 }\n[stability]\nband_hz = [0.01, 100.0]\n",
        K_V, K_P,
    ),
    "fixed coupling": (DEVICE + GAINS + "[coupling]\ndamping = 160.0\nmass = 0.35\n", K_V, K_P),
    "grams and days": (
        "[device]\nmass = 4e-6\ndamping = 2e-11\nsample_time = 1e3\ndelay = 300.0\n"
        "[coupling]\ndamping = { min = 1e-11, max = 1e-6 }\nmass = { min = 1e-6, max = 1e-4 }\n"
        "[stability]\nband_hz = [1e-6, 4.999e-4]\nsafety_factor = 1.0\nmax_sensitivity = 1.5\n",
        K_V, K_P,
    ),
    "drag": (
        LAG + "[gains]\nvelocity = 40.0\nposition = { min = 0.0, max = 3e4 }\n"
        "[coupling]\ndamping = 3000.0\nmass = 5.0\ndrag = { min = 0.0, max = 20.0 }\n"
        "[stability]\nband_hz = [0.01, 60.0]\nmax_sensitivity = 10.0\n",
        K_P, B_0,
    ),
    "every gain from 0, swapped": (
        "[device]\nmass = 22800.0\ndamping = 5.63e7\nsample_time = 2.03e-6\ndelay = 3.04e-6\n"
        "[gains]\nvelocity = { min = 0.0, max = 1.14e10 }\nposition = { min = 0.0, max = 1.4e14 }\n"
        "[coupling]\ndamping = { min = 5.08e6, max = 9.95e9 }\nmass = 19800.0\n"
        "[stability]\nband_hz = [1970.0, 9870.0]\nsafety_factor = 1.0\nmax_sensitivity = 4.0\n",
        K_P, K_V,
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


def designs_in(region, bounds, count, seed):
    """Random designs in decided cells, many next to corners and edges: the cells and the designs.

    What is free has its upper bound, and b_c the cell's witness.
    """
    rng, across = np.random.default_rng(seed), region.plane
    decided = np.flatnonzero(region.kinds != Kind.UNDECIDED)
    size = np.maximum(*(region.squares[[1, 3]] - region.squares[[0, 2]]))[decided]
    cell = np.concatenate((rng.choice(decided, count // 3), rng.choice(decided[size <= 2], count - count // 3)))
    designs = np.repeat([[b.max] for b in bounds], count, axis=1).astype(float)
    for place, axis in enumerate(across.axes):
        low, high = (across.edges[place][region.squares[2 * place + k, cell]] for k in (0, 1))
        near = np.abs(rng.integers(0, 2, count) - 10.0 ** rng.uniform(-13, -0.3, count))
        share = np.where(rng.random(count) < 0.3, rng.integers(0, 2, count), near)
        share = np.where((share == 0) & (low == 0) & (high > 0) & across.has_line(place), 1e-12, share)
        designs[axis] = np.clip(low + (high - low) * share, low, high)
    if free_damping(across):
        feasible = region.kinds[cell] == Kind.FEASIBLE
        designs[2, feasible] = region.damping[cell[feasible]]
    return cell, designs


def contradictions(text, x, y, levels, count, seed=0):
    """Return the designs that refute their cells, and how many there were of each kind."""
    problem, region = posed(text), found(text, x, y, levels)
    cell, designs = designs_in(region, ranges(problem), count, seed)
    infeasible = np.flatnonzero(region.kinds[cell] == Kind.INFEASIBLE)
    if free_damping(region.plane):
        designs[2, infeasible] = best_damping(problem, designs[:, infeasible])
    holds = (surpluses(problem, cases(problem.device, designs)) > 0).all(axis=0)
    wrong = holds != (region.kinds[cell] == Kind.FEASIBLE)
    return designs[:, wrong].T.tolist(), (count - len(infeasible), len(infeasible))


@pytest.mark.slow
@pytest.mark.parametrize("name", PROBLEMS)
def test_no_point_of_many_refutes_its_cell(name):
    wrong, counts = contradictions(*PROBLEMS[name], 7, 4000, seed=1)
    assert wrong == []
    assert min(counts) > 100 and found(*PROBLEMS[name], 7).area(Kind.UNDECIDED) < 0.06


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
def test_the_low_frequency_limits_bound_the_region():
    """Hold lag (model/README.md, section 6): no K_p > (b + K_v)/tau is feasible, and all of it is infeasible."""
    text = LAG + "[stability]\nband_hz = [0.001, 400.0]\nmax_sensitivity = 100.0\nsafety_factor = 1.0\n"
    cells = found(text, K_V, K_P, 6)
    x, y = cells.plane.edges
    x_low, x_high, y_low, y_high = x[cells.squares[0]], x[cells.squares[1]], y[cells.squares[2]], y[cells.squares[3]]
    tau = 0.5e-3
    beyond = tau * y_low > 2.0 + x_high
    within = tau * y_high < 2.0 + x_low
    assert beyond.sum() > 20 and (cells.kinds[beyond] == Kind.INFEASIBLE).all()
    assert within[cells.kinds == Kind.FEASIBLE].all() and within.sum() > 20


def test_without_position_the_coupling_needs_inertia():
    """Hold lag, K_v = 40, K_p = 0 (model/README.md, section 6): (21000, 5.5) is feasible and (21000, 5.4) is not."""
    text = (
        LAG + "[gains]\nvelocity = 40.0\nposition = 0.0\n[coupling]\ndamping = { min = 20500.0, max = 21500.0 }\n"
        "mass = { min = 5.3, max = 5.7 }\n"
        "[stability]\nband_hz = [1e-3, 499.0]\nsafety_factor = 1.0\nmax_sensitivity = 10.0\n"
    )
    cells = found(text, B_C, M_C, 6)
    x, y = cells.plane.edges
    least = 40 * (0.5 + 2.0 * 0.5e-3) ** 2 / (4 * 42.0**2)
    above = y[cells.squares[2]] ** 2 / x[cells.squares[1]] > least * (1 + 1e-6)
    below = y[cells.squares[3]] ** 2 / x[cells.squares[0]] < least * (1 - 1e-6)
    assert above[cells.kinds == Kind.FEASIBLE].all() and below[cells.kinds == Kind.INFEASIBLE].all()
    assert 0.3 < cells.area(Kind.FEASIBLE) < 0.6 and cells.area(Kind.UNDECIDED) < 0.05


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


@pytest.mark.parametrize("name", mostly_slow(["friction-wheel", "late"], []))
def test_witnesses_are_certified_by_arb(name):
    text, x, y = PROBLEMS[name]
    problem, cells = posed(text), found(text, x, y, 6)
    feasible = np.flatnonzero(cells.kinds == Kind.FEASIBLE)
    assert np.isnan(cells.damping[cells.kinds != Kind.FEASIBLE]).all()
    for cell in feasible[:: len(feasible) // 5]:
        for corner in ((0, 2), (1, 2), (0, 3), (1, 3)):
            v = [bounds.max for bounds in ranges(problem)]
            v[2] = cells.damping[cell]
            for place, axis in enumerate(cells.plane.axes):
                v[axis] = float(cells.plane.edges[place][cells.squares[corner[place], cell]])
            design = Design(problem.device, Gains(*v[:2]), Coupling(*v[2:]))
            assert certify(design, pose(problem).demands).verdict is Verdict.PROVED


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
