"""What a picture of a region shows beside its cells: each limit of the literature where its condition changes."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.axes import Axes

import vctune
from vctune.report.region_figure import region_figure
from vctune.report.region_lines import lines, mesh_of
from vctune.study.region import Kind

PADDLE = {
    "device": {
        "display": "impedance", "mass": 0.05, "damping": 0.4, "sample_time": 1e-3, "friction": 0.1,
        "velocity": {"resolution": 1e-3},
    },
    "environment": {"stiffness": np.inf},
    "stability": {"safety_factor": 1.0},
    "coupling": {"damping": {"min": 0.0, "max": 0.3}, "stiffness": {"min": 1.0, "max": 1000.0}},
}  # fmt: skip


def limits(tables):
    """Return the limits that are drawn for a problem, by the names of their labels."""
    return {line.label: line.limit for line in lines(vctune.problem(tables).problem)}


def verdict(tables, damping, stiffness):
    problem = vctune.problem(tables).problem
    return vctune.judge(problem, vctune.Gains(0.0, 0.0), vctune.SpringDamper(damping, stiffness)).status.value


@pytest.mark.parametrize("damping", [0.0, 0.1, 0.25])
def test_colgate_and_schenkels_line_is_where_a_wall_stops_being_passive(damping):
    passive = PADDLE | {"stability": {"safety_factor": 1.0, "criterion": "passive"}}
    passive["device"] = {key: value for key, value in passive["device"].items() if key != "velocity"}
    passive["device"]["velocity"] = {"from": "difference"}
    (most,) = limits(passive)["k_c = 2 (b - b_c)/T, passive below"](np.array([damping]))
    assert most == pytest.approx(2 * (0.4 - damping) / 1e-3)
    assert verdict(passive, damping, 0.99 * most) == "certified"
    assert verdict(passive, damping, 1.01 * most) == "violated"


def test_gil_and_hulins_line_is_near_the_limit_of_a_wall_without_a_hand():
    """(b + B)/(T/2 + t_d) is exact for little damping, where the oscillation is slow."""
    free = {"mass": {"max": 0.0}, "damping": {"max": 0.0}, "stiffness": {"max": 0.0}}
    late = PADDLE | {"operator": free, "stability": {"safety_factor": 1.0, "criterion": "hands"}}
    late["device"] = late["device"] | {"mass": 1.0, "delay": 2e-3}
    (most,) = limits(late)["k_c = (b + b_c)/(T/2 + t_d), limit without a hand"](np.array([0.1]))
    assert most == pytest.approx(0.5 / 2.5e-3)
    assert verdict(late, 0.1, 0.95 * most) == "certified" and verdict(late, 0.1, 1.05 * most) == "violated"


def test_a_filter_of_the_velocity_has_no_line_of_walls_without_one():
    filtered = PADDLE | {"device": PADDLE["device"] | {"velocity": {"filter_hz": 30.0}}}
    assert not [label for label in limits(filtered) if label.startswith(("k_c = 2 (b", "k_c = (b"))]


def test_a_picture_of_walls_shows_limits_points_and_contours(tmp_path):
    (tmp_path / "points.csv").write_text("stiffness, damping, stable\n100, 0.1, yes\n900, 0.25, no\n2, 0.01, no\n")
    found = vctune.region(PADDLE, resolution=1 / 8, linear=True, points=tmp_path / "points.csv")
    x, y = found.region.plane.edges
    assert np.ptp(np.diff(x)) < 1e-9 and np.ptp(np.diff(y)) < 1e-9
    figure = region_figure(found.file.problem, found.region, found.designs, None, found.measured)
    axes: Axes = figure.axes[0]
    drawn = {str(line.get_label()): line for line in axes.lines}
    assert {"error", "k_c = 2 f/q, rests below"} <= drawn.keys()
    assert np.ptp(drawn["k_c = 2 f/q, rests below"].get_ydata()) == 0
    across = np.interp(2 * 0.1 / 1e-3, y, np.linspace(0, 1, len(y)))
    assert drawn["k_c = 2 f/q, rests below"].get_ydata()[0] == pytest.approx(across)
    marks = {str(each.get_label()): np.asarray(each.get_offsets()) for each in axes.collections}
    assert len(marks["measured stable"]) == 1 and len(marks["measured unstable"]) == 2
    said = [cells[0] for cells in found.rows()][-1]
    assert said.startswith("measured     1 stable, 2 unstable") and "(0.01, 2)" in said


def test_the_contours_are_of_the_numbers_of_single_designs():
    """The error as judged; the damping ratio of some hands, which is not below that of all."""
    hands = {"operator": {"mass": {"max": 0.1}, "damping": {"max": 1.0}, "stiffness": {"max": 100.0}}}
    found = vctune.region(PADDLE | hands | {"stability": {"criterion": "hands"}}, resolution=1 / 8)
    mesh, problem = mesh_of(found.file.problem, found.region), found.file.problem
    assert mesh is not None
    some = np.argwhere(np.isfinite(mesh.error) & np.isfinite(mesh.ratio))[::25]
    assert len(some) > 2
    for i, j in some.tolist():
        edges = found.region.plane.edges
        values = (float(edges[k][round(mesh.at[at] * found.region.plane.side)]) for k, at in ((0, i), (1, j)))
        record = vctune.check(problem, vctune.Gains(0.0, 0.0), vctune.SpringDamper(*values)).finding.record()
        assert mesh.error[i, j] == pytest.approx(record["transparency"]["error"], rel=1e-6)
        least = record["ringing"]["damping_ratio"]
        assert least * (1 - 1e-6) <= mesh.ratio[i, j] <= least * 1.5 + 0.02


def test_a_picture_of_an_arm_shows_its_least_drag():
    tables = {
        "device": {"sample_time": 2e-3, "servo": {"delay": 0.02, "bandwidth_hz": 15.0}},
        "operator": {"stiffness": {"max": 1000.0}},
        "coupling": {"rule": "euler", "mass": {"min": 0.5, "max": 20.0}, "drag": {"min": 10.0, "max": 300.0}},
    }
    (rest,) = limits(tables)["D = K L, infeasible below"](np.array([1.0]))
    found = vctune.region(tables, resolution=1 / 16).region
    below = found.plane.edges[1][found.squares[3]] < rest
    assert below.any() and not (found.kinds[below] == Kind.FEASIBLE).any()
    assert rest == pytest.approx(1.05 * 1000.0 * (1e-3 + 0.02 + 1 / (2 * np.pi * 15.0)), rel=1e-6)
