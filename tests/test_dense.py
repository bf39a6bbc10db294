"""The judges on dense grids, against a closed form and 50 digits."""

from __future__ import annotations

from dataclasses import replace
from math import log, sqrt

import dense
import digits
import numpy as np
import pytest

from vctune.bench.evaluator import Case, case_of, stable
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


@pytest.mark.parametrize("seed", range(50))
def test_stable_is_what_50_digits_say(seed):
    rng = np.random.default_rng(seed)
    m, T = 10 ** rng.uniform(-3, 3), 10 ** rng.uniform(-5, 0)
    late = T * rng.choice([0.0, 1.0, rng.uniform(0, 5), rng.uniform(0, 100)])
    K_v = m / (T + late) * 10 ** rng.uniform(-3, 1)
    K_p = rng.choice([0.0, K_v / (T + late) * 10 ** rng.uniform(-6, 1)])
    case = Case(m, m / T * 10 ** rng.uniform(-8, 0), T, late, "zoh", K_v, K_p)
    assert stable(case) is digits.stable(case)
