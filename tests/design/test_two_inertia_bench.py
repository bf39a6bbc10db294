"""A motor bench that others measured, designed for as one rigid mass and as what it is: two on a spring.

The numbers are those of the two-inertia bench of the FdiTools toolbox (Beauduin and Ohnishi), identified from its
recording of multisines ("bench a" of the data that `vctune identify` is tried on), in units of the torque constant.
Damping does not repeat between its recordings: it is chosen here, and the resonance's is of several sizes.
"""

from __future__ import annotations

from math import pi
from typing import Any

import numpy as np
import pytest
from conftest import mostly_slow
from device_pairs import real_of
from device_scan import exact, frequencies, least, ratio
from in_time import Loop, cancelling
from sampled_device_oracle import Hand
from test_coupled_devices import DIGITS, GROWS, Handle, resonant_hand, worst_environment

from vctune import check, problem
from vctune.design.solve import solve
from vctune.design.verdict.checked import CheckVerdict
from vctune.design.verdict.design_record import warnings
from vctune.design.verdict.judge import Status

MOTOR, LOAD = 0.004832, 0.004800
STIFFNESS, RESONANCE = 552.6, 76.24
ANTIRESONANCE = 54.00
SAMPLE_TIME = 1 / 2500
TO_ANGLE, TO_CURRENT, LAG = 115e-6, 173e-6, 335e-6
"""Delays from current to angle and from reference to current, and the current's lag, s."""
DAMPING = 0.02
"""b, 2 rad/s of the mass. A tenth and ten times of it change no verdict below."""
BANDS = {"transparency": {"band_hz": [0.5, 30.0]}, "stability": {"criterion": "passive", "band_hz": [0.5, 100.0]}}
"""The stability band has the resonance in it."""
RATIOS = (0.002, 0.005, 0.01)
"""Damping ratios of the resonance."""


def bench(damping_ratio: float | None, **tables: Any) -> dict[str, Any]:
    """Return the bench as a problem: rigid, or with a damping ratio on its spring."""
    device: dict[str, Any] = {
        "mass": MOTOR + LOAD, "damping": DAMPING, "sample_time": SAMPLE_TIME, "delay": TO_ANGLE + TO_CURRENT,
        "actuator": {"bandwidth_hz": 1 / (2 * pi * LAG)},
    }  # fmt: skip
    if damping_ratio is not None:
        device["structure"] = {"handle_mass": LOAD, "frequency_hz": RESONANCE, "damping_ratio": damping_ratio}
    return {"device": device, "coupling": {"drag": {"min": 0.0, "max": 1.0}}} | BANDS | tables


@pytest.fixture(scope="module")
def rigid():
    """The design for one rigid mass."""
    solved = solve(problem(bench(None)).problem)
    assert solved.status is Status.CERTIFIED
    return solved.judgement


def test_the_numbers_belong_together():
    """The measured resonance and antiresonance are those of the measured masses and stiffness."""
    assert np.sqrt(STIFFNESS * (1 / MOTOR + 1 / LOAD)) / (2 * pi) == pytest.approx(RESONANCE, rel=1e-3)
    assert np.sqrt(STIFFNESS / LOAD) / (2 * pi) == pytest.approx(ANTIRESONANCE, rel=1e-3)


@pytest.mark.parametrize("damping_ratio", mostly_slow(RATIOS, [0.005]))
def test_a_design_for_one_rigid_mass_is_refuted_on_two(rigid, damping_ratio):
    posed = problem(bench(damping_ratio)).problem
    checked = check(posed, rigid.gains, rigid.coupling)
    assert checked.result is CheckVerdict.FAILED
    assert "refuted at" in checked.message
    outcome = checked.finding.judgement.certificate.outcomes["passive"]
    real = real_of(posed.device)
    there, resistance = exact(real, rigid.gains, rigid.coupling, outcome.witness)
    assert there < posed.stability.safety_factor or resistance < 0
    grid = frequencies(real, posed.stability.band.min, posed.stability.band.max)
    smallest, _ = least(lambda omega: ratio(real, rigid.gains, rigid.coupling, omega), grid)
    assert checked.finding.judgement.min_ratio == pytest.approx(smallest, rel=1e-6)
    assert smallest < 0.1


def test_a_lossless_pair_makes_it_grow_on_the_bench_and_not_on_a_rigid_one(rigid):
    """In exact time, just above the resonance: in the band on which the rigid one is proved."""
    hertz = 1.1 * RESONANCE
    omega = 2 * pi * hertz
    real, stiff = (real_of(problem(bench(damping_ratio)).problem.device) for damping_ratio in (0.005, None))
    handle = Handle(real, rigid.gains, rigid.coupling)
    environment = worst_environment(handle, omega)
    lossless = resonant_hand(handle, environment, omega)
    hand = Hand(float(lossless.mass), 0.0, float(lossless.stiffness))
    discrete = cancelling(real, -float(environment.at(DIGITS.i * DIGITS.number(omega)).imag), hertz)
    low, high = rigid.certificate.proved_band_hz
    grows = []
    for device in (real, stiff):
        values = np.linalg.eigvals(Loop(device, rigid.gains, rigid.coupling, hand, discrete).matrix())
        places = np.abs(np.angle(values[np.abs(values) > GROWS])) / (2 * pi * SAMPLE_TIME)
        grows.append(places[(low <= places) & (places <= high)])
    assert grows[0] == pytest.approx([hertz] * 2, rel=1e-2)
    assert grows[1].size == 0


@pytest.mark.parametrize("damping_ratio", mostly_slow(RATIOS, [0.005]))
def test_with_the_resonance_in_the_band_a_design_hardly_uses_its_loop(rigid, damping_ratio):
    """It is certified, for the loop may be as slow as one likes; that it does little is said."""
    posed = problem(bench(damping_ratio)).problem
    solved = solve(posed)
    assert solved.status is Status.CERTIFIED
    assert "warn-idle" in [note.code for note in warnings(posed, solved.judgement)]
    assert solved.judgement.gains.velocity < 0.1 * rigid.gains.velocity
    assert solved.judgement.transparency.error > 1.2 * rigid.transparency.error


@pytest.mark.slow
def test_asked_for_half_of_the_rigid_design_s_gain_it_says_what_cannot_be_had(rigid):
    free = {"gains": {"velocity": {"min": 0.6 * rigid.gains.velocity, "max": 40.0}}}
    solved = solve(problem(bench(0.005, **free)).problem)
    assert solved.status is Status.INFEASIBLE
    assert "|S|" in solved.infeasibility.cause or "Re Z_c" in solved.infeasibility.cause
