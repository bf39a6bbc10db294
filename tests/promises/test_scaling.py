"""Cost grows no faster than the size of the work, on logarithmic axes of processor time."""

from __future__ import annotations

from dataclasses import replace
from statistics import median
from time import process_time

import numpy as np
import pytest
from conftest import ROOT

from vctune.bench.dense import dense, ipopt
from vctune.bench.problems import reference_problems
from vctune.design.prepared import prepare
from vctune.design.search.scan import scan
from vctune.design.solve import solve
from vctune.document.reading import read_problem
from vctune.model.gains import Coupling, Gains
from vctune.simulation.run import run
from vctune.simulation.scene import designed_scene
from vctune.study.plane import plane
from vctune.study.region import region

WHEEL = reference_problems()["friction-wheel"]
SLACK = 0.25
"""By how much a slope may be missed on a machine that others use too."""


def frequencies():
    """One constraint more costs as much as the last one."""
    prepared = prepare(WHEEL)
    start = scan(prepared.scaled).starts[0]
    for power in range(6, 12):
        given = dense(prepared, start, 2**power, 1e-6)
        yield 2**power, lambda given=given: ipopt(given)


def decades():
    """Boxes, samples and minima grow with the decades of the band, the NLP hardly."""
    high = WHEEL.stability.band.max
    for count in range(1, 8):
        band = replace(WHEEL.stability.band, min=high * 10.0**-count)
        problem = replace(WHEEL, stability=replace(WHEEL.stability, band=band))
        yield count, lambda problem=problem: solve(problem)


def cells():
    """Cells of a region are decided one by one, some together."""
    for levels in range(4, 8):
        across = plane(WHEEL, "gains.velocity", "gains.position", levels)
        count = region(WHEEL, across, across.coarsest_squares()).squares.shape[1]
        yield count, lambda across=across: region(WHEEL, across, across.coarsest_squares())


def samples():
    """A simulation goes sample by sample."""
    problem = read_problem(ROOT / "problems/friction-wheel.toml").problem
    scene = designed_scene(problem.device, Gains(150.0, 6000.0), Coupling(160.0, 0.4, 0.5), problem.experiments[0])
    for cycles in (2, 4, 8, 16):
        longer = replace(scene, operator=replace(scene.operator, cycles=cycles))
        yield cycles, lambda longer=longer: run(longer)


def seconds(work):
    """The median processor time of three runs, s, after one that compiles."""
    work()
    times = []
    for _ in range(3):
        began = process_time()
        work()
        times.append(process_time() - began)
    return median(times)


@pytest.mark.slow
@pytest.mark.parametrize("axis", [frequencies, decades, cells, samples])
def test_cost_grows_at_most_as_the_size(axis, capsys):
    sizes, costs = zip(*((size, seconds(work)) for size, work in axis()), strict=True)
    slope = np.polyfit(np.log(sizes), np.log(costs), 1)[0]
    with capsys.disabled():
        print(f"\n{axis.__name__}: run time grows with the power {slope:.2f}")  # noqa: T201
    assert slope < 1 + SLACK
