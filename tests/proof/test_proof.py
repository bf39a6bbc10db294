"""The prover against the check numbers of model/README.md and 50 digits, and at the limit of what can be told apart."""

from __future__ import annotations

from collections import Counter
from dataclasses import astuple, replace
from math import inf, pi

import numpy as np
import pytest
from arithmetic import DOUBLES, Digits
from conftest import DRAWS
from frequency import demanded, offered
from hypothesis import given
from hypothesis import strategies as st

from vctune.api.checking import check
from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.numbers.pair import Pair
from vctune.proof.certificate import certify
from vctune.proof.claims.band import PASSIVE
from vctune.proof.claims.claim import Question
from vctune.proof.claims.covered import Covered, of_design
from vctune.proof.claims.poles import turns
from vctune.proof.enclosures.taylor_functions import TAYLOR
from vctune.proof.outcome import Verdict

EXACT = Digits(120)
LAG = Device(0.5, 2.0, 1e-3, 0.0, "lag")
INTEGRAL = Gains(40.0, 4000.0)
VELOCITY = Gains(40.0, 0.0)


def tables(device):
    return {"device": {name: getattr(device, name) for name in ("mass", "damping", "sample_time", "delay", "hold")}}


def ratio(design, omega):
    """Return Re Z_c/R by the definitions, with 120 digits; inf where R is not positive."""
    s, coupling = EXACT.i * EXACT.number(omega), design.coupling
    R = demanded(tables(design.device), astuple(design.gains), s, EXACT).required
    return offered(astuple(coupling), s, EXACT).real / R if R > 0 else inf


def conditions(design, low, high, factor=1.0):
    return PASSIVE.prove(Question(design, Demands(design.device, (low, high), factor, inf)), {})


@pytest.mark.parametrize(
    ("gains", "b_c", "m_c", "band", "verdict"),
    [
        (VELOCITY, 21000.0, 8.0, (0.0, inf), Verdict.PROVED),
        (VELOCITY, 21000.0, 5.5, (0.0, inf), Verdict.PROVED),
        (VELOCITY, 21000.0, 5.4, (0.0, inf), Verdict.REFUTED),
        (VELOCITY, 19000.0, 8.0, (0.0, inf), Verdict.REFUTED),
        (INTEGRAL, 25000.0, 5.0, (0.0, inf), Verdict.REFUTED),
        (INTEGRAL, 25000.0, 5.0, (5.3411, 76.195), Verdict.PROVED),
        (INTEGRAL, 25000.0, 5.0, (284.484, inf), Verdict.PROVED),
        (INTEGRAL, 25000.0, 5.0, (5.3409, 76.195), Verdict.REFUTED),
        (INTEGRAL, 25000.0, 5.0, (5.3411, 76.197), Verdict.REFUTED),
        (INTEGRAL, 3000.0, 2.0, (4.5440, 93.851), Verdict.PROVED),
        (INTEGRAL, 3000.0, 2.0, (199.372, 3197.6), Verdict.PROVED),
        (INTEGRAL, 3000.0, 2.0, (199.370, 3197.6), Verdict.REFUTED),
        (INTEGRAL, 3000.0, 2.0, (199.372, 3197.7), Verdict.REFUTED),
    ],
)
def test_fixtures_of_the_guide(gains, b_c, m_c, band, verdict):
    assert conditions(Design(LAG, gains, Coupling(b_c, m_c, 0.0)), *band).verdict is verdict


def test_a_tiny_drag_repairs_the_low_end():
    """R -> b^2/(4 (b + K_v - tau K_p)) = 0.025 for omega -> 0 (model/README.md, section 6)."""
    for drag, verdict in ((0.0251, Verdict.PROVED), (0.0249, Verdict.REFUTED)):
        assert conditions(Design(LAG, INTEGRAL, Coupling(25000.0, 5.0, drag)), 0.0, 50.0).verdict is verdict


@pytest.mark.parametrize(("drag", "verdict"), [(1.01, Verdict.PROVED), (0.99, Verdict.REFUTED)])
def test_a_rigid_coupling_has_its_drag_on_the_whole_axis(drag, verdict):
    """R -> 2 m K_v/(b T) = 5000 for omega -> inf (section 6), above R everywhere else, and Re Z_c is the drag."""
    design = Design(LAG, Gains(10.0, 0.0), Coupling(inf, 5.0, 5000.0 * drag))
    assert conditions(design, 0.0, inf).verdict is verdict


def lag_design(rng):
    """A random design whose conditions are polynomials."""

    def decimal(low, high):
        return float(f"{10 ** rng.uniform(low, high):.6g}")

    mass, T = decimal(-3, 2), decimal(-5, -1)
    Z = mass / T
    K_v = Z * decimal(-3, 0)
    gains = Gains(K_v, 0.0 if rng.random() < 0.3 else K_v / T * decimal(-5, -0.1))
    drag = 0.0 if rng.random() < 0.5 else K_v * decimal(-4, 0)
    damping = 0.0 if rng.random() < 0.1 else Z * decimal(-6, 0)
    return Design(
        Device(mass, damping, T, 0.0, "lag"),
        gains,
        Coupling(K_v * decimal(-1, 4), mass * decimal(-1, 4), drag),
    )


def beside_its_limit(rng):
    """Such a design with its coupling a fifth beside the least that seems to suffice, where any seems to."""
    design = lag_design(rng)
    s = 1j * np.geomspace(1e-6, 1e6, 60) / design.device.sample_time
    required = demanded(tables(design.device), astuple(design.gains), s, DOUBLES).required
    ratios = offered(astuple(design.coupling), s, DOUBLES).real / np.where(required > 0, required, 1e-300)
    if not 1e-6 < ratios.min() < 1e6:
        return design
    scaled = (float(rng.choice([0.8, 1.25]) / ratios.min() * number) for number in astuple(design.coupling))
    return replace(design, coupling=Coupling(*scaled))


def test_the_whole_axis_is_decided_as_50_digits_say():
    """Next to 0 and infinity the margins have forms of their own."""
    seen = Counter[Verdict]()
    for seed in range(6 * DRAWS):
        rng = np.random.default_rng(seed)
        design = beside_its_limit(rng)
        with np.errstate(all="ignore"):  # as `certify` does
            outcome = conditions(design, 0.0, inf)
        seen[outcome.verdict] += 1
        if outcome.verdict is Verdict.REFUTED:
            assert ratio(design, outcome.witness) < 1
        elif outcome.verdict is Verdict.PROVED:
            for omega in 10 ** rng.uniform(-8, 8, 30) / design.device.sample_time:
                assert ratio(design, float(omega)) > 1 - 1e-12
    assert seen[Verdict.PROVED] >= DRAWS and seen[Verdict.REFUTED] >= DRAWS, seen


@given(st.integers(-3, 3), st.floats(0.1, 0.9))
def test_turns_are_counted(number, radius):
    def curve(case, t):
        once, also = TAYLOR.cos(t * (2 * number)), TAYLOR.sin(t * (2 * number))
        return Pair(once + TAYLOR.cos(t * 5) * (radius / 10), also + TAYLOR.sin(t * 5) * (radius / 10))

    covered = of_design(Design(LAG, VELOCITY, Coupling(1.0, 1.0, 0.0)), Demands(LAG, (0.0, 1.0), 1.0, 2.0))
    found = turns(covered, curve, Covered.around_circle, 2 * pi)
    assert found.number[0] == -number


def test_an_unstable_loop_is_refuted_although_its_sensitivity_is_small():
    """The paper leaves stable poles out: far beyond the stability limit |S| is small all over the band."""
    design = Design(Device(0.4, 2.0, 1e-3, 0.0, "zoh"), Gains(3e4, 0.0), Coupling(1e5, 1.0, 0.0))
    certificate = certify(design, Demands(design.device, (pi, 60 * pi), 1.0, 2.0))
    assert certificate.outcomes["stable"].verdict is Verdict.REFUTED
    assert certificate.outcomes["stable_model"].verdict is Verdict.REFUTED
    assert certificate.verdict is Verdict.REFUTED


@pytest.mark.parametrize(
    ("damping", "verdict"), [(0.0, "refuted"), (5.0, "proved"), ({"min": 0.0, "max": 5.0}, "refuted")]
)
def test_the_hand_with_the_least_damping_decides_of_a_servo(damping, verdict):
    servo = {"delay": 0.004, "bandwidth_hz": 15.0, "order": 2, "command": "velocity"}
    stated = {"device": {"sample_time": 0.002, "servo": servo}, "stability": {"safety_factor": 1.0}}
    stated |= {"operator": {"mass": 0.1, "damping": damping, "stiffness": 400.0}}
    found = check(stated | {"coupling": {"mass": 6.0, "drag": 6.0, "damping": inf}})
    assert found.finding.judgement.certificate.verdict.value == verdict
