"""A region of couplings that are rigid, the law of most robots."""

from __future__ import annotations

from vctune import problem, region
from vctune.study.region import Kind

ARM = {
    "device": {"sample_time": 2e-3, "servo": {"delay": 0.032, "bandwidth_hz": 20.0, "order": 2}},
    "operator": {"mass": {"min": 0, "max": 2}, "damping": {"min": 0, "max": 30}, "stiffness": {"min": 0, "max": 1000}},
    "coupling": {"damping": float("inf"), "mass": {"min": 0.5, "max": 20.0}, "drag": {"min": 10.0, "max": 1000.0}},
}


def test_a_rigid_coupling_has_a_region():
    found = region(problem(ARM), resolution=1 / 16)
    areas = {kind: found.region.area(kind) for kind in Kind}
    assert areas[Kind.FEASIBLE] > 0.2
    assert areas[Kind.INFEASIBLE] > 0.2
    assert areas[Kind.UNDECIDED] < 0.1
    assert all(design[1].rigid for design in found.designs)
