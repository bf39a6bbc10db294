"""A region of couplings that are rigid, the law of most robots."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest

from vctune import problem, region
from vctune.model.gains import Coupling, Gains
from vctune.report.region_figure import region_figure
from vctune.study.region import Kind

ARM = {
    "device": {"sample_time": 2e-3, "servo": {"delay": 0.032, "bandwidth_hz": 20.0, "order": 2}},
    "operator": {"mass": {"min": 0, "max": 2}, "damping": {"min": 0, "max": 30}, "stiffness": {"min": 0, "max": 1000}},
    "coupling": {"damping": inf, "mass": {"min": 0.5, "max": 20.0}, "drag": {"min": 10.0, "max": 1000.0}},
}


def test_a_rigid_coupling_has_a_region():
    found = region(problem(ARM), resolution=1 / 16)
    areas = {kind: found.region.area(kind) for kind in Kind}
    assert areas[Kind.FEASIBLE] > 0.2
    assert areas[Kind.INFEASIBLE] > 0.2
    assert areas[Kind.UNDECIDED] < 0.1
    assert all(design[1].rigid for design in found.designs)


def test_a_given_design_is_marked_where_it_lies():
    """The mass and drag that run on a robot today, on the map of those that are feasible."""
    found = region(ARM, None, None, Gains(0.0, 0.0), Coupling(inf, 5.0, 90.0), resolution=1 / 8)
    drawn = region_figure(found.file.problem, found.region, found.designs, found.marked)
    places = {each.get_label(): each.get_offsets()[0] for each in drawn.axes[0].collections}
    assert places.keys() == {"optimum", "given gains"}
    for place, edges, value in zip(places["given gains"], found.region.plane.edges, (5.0, 90.0), strict=True):
        assert np.interp(place, np.linspace(0, 1, len(edges)), edges) == pytest.approx(value)
