"""The judges on dense grids, against a closed form."""

from __future__ import annotations

from dataclasses import replace
from math import log, sqrt

import dense
import pytest

from vctune.bench.evaluator import case_of
from vctune.bench.solvers import reference_problems
from vctune.model.gains import Coupling, Gains
from vctune.model.transparency import Terms


def test_error_of_the_bare_device():
    """With Z_0 |G_hh| alone and no loop the mean square is an elementary integral."""
    wheel = reference_problems()["friction-wheel"]
    band, b, m = wheel.transparency.band, wheel.device.damping, wheel.device.mass
    alone = replace(wheel, transparency=replace(wheel.transparency, weights=Terms(1.0, 0.0, 0.0)))
    grown = [log(w * w / (b * b + (m * w) ** 2)) / (2 * b * b) for w in (band.min, band.max)]
    expected = wheel.transparency.reference_impedance * sqrt((grown[1] - grown[0]) / log(band.max / band.min))
    still = case_of(wheel.device, Gains(0.0, 0.0), Coupling(1.0, 1.0, 0.0))
    assert dense.error(alone, still) == pytest.approx(expected, rel=1e-9)
