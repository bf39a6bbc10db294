"""The sampled loop and the poles of both models: against eigenvalues of 50 digits, turns, and closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arithmetic import DIGITS
from conftest import DRAWS
from devices import device_of
from draws import Tables, admittance, gains_for, scaled
from frequency import unstable_poles
from loop import Loop, matrix, radius

from vctune.analysis.sampled_loop import spectral_radius
from vctune.analysis.stability import clearly_stable
from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.sampled.circle import split_delay
from vctune.proof.claims.covered import of_design
from vctune.proof.claims.poles import model_turns, stable_loop

MANY = 12 * DRAWS


def drawn(number: int) -> tuple[Tables, tuple[float, float], bool]:
    """Return a device with any parts and gains on both sides of what is stable; whether its loop is exact in digits."""
    rng = np.random.default_rng((26, number))
    table = {key: part for key, part in admittance(rng).items() if key != "force_sensor"}
    table["damping"] *= rng.random() < 0.8
    gains = scaled(gains_for(rng, table), 10 ** rng.uniform(0, 2))
    return table, (gains[0], gains[1]), number % 3 == 0


def test_spectral_radius_and_its_proof_agree_with_matrix_exponentials():
    stable = unstable = exact = 0
    for number in range(MANY):
        table, gains, in_digits = drawn(number)
        device, loop = device_of(table), Loop(table, gains)
        if in_digits and len(matrix(loop, at_rest=True)) <= 20:  # eigenvalues of 50 digits take long
            loop, exact = replace(loop, num=DIGITS), exact + 1
        true = radius(loop, at_rest=True)
        assert spectral_radius(device, Gains(*gains)) == pytest.approx(true, rel=1e-9 if loop.num is DIGITS else 1e-6)
        if abs(true - 1) > 1e-6:
            assert stable_loop(device, Gains(*gains), model=False) is (true < 1), number
            stable, unstable = stable + (true < 1), unstable + (true > 1)
    assert stable >= MANY / 4 and unstable >= MANY / 4 and exact >= MANY / 6, (stable, unstable, exact)


@pytest.mark.parametrize("hold", ["zoh", "lag"])
def test_poles_of_the_frequency_model(hold):
    """The turns of D; what is clearly stable, or clearly not, is proved to be so."""
    stable = unstable = clear = 0
    for number in range(MANY):
        table, gains, _ = drawn(number)
        device, law = device_of(table | {"hold": hold}), Gains(*gains)
        poles = unstable_poles({"device": table | {"hold": hold}}, gains)
        if abs(poles - round(poles)) > 0.05:  # next to the axis
            continue
        demands = Demands(device, (0.0, 1.0), 1.0, 2.0)
        turned = model_turns(of_design(Design(device, law, Coupling(1.0, 1.0, 0.0)), demands)).number[0]
        assert (turned == 0) == (round(poles) == 0), number
        stable, unstable = stable + (turned == 0), unstable + (turned != 0)
        estimate = clearly_stable(device, law)
        clear += estimate is not None
        assert estimate is None or estimate == stable_loop(device, law, model=True), number
    assert min(stable, unstable) >= MANY / 6 and clear >= MANY / 3, (stable, unstable, clear)


def test_too_much_integral_action_is_not_taken_for_stable_without_damping():
    """With tau K_p > K_v the argument of F starts beyond -pi, which looks like just below pi."""
    device, gains = Device(280.0, 0.0, 1.0, 5.0, "zoh"), Gains(32.0, 9.7)
    assert stable_loop(device, gains, model=False) is False
    assert clearly_stable(device, gains) is False


def test_no_position_in_the_loop_without_position_gain():
    """With K_p = 0 the free integrator from velocity to position does not count (model/README.md, section 7)."""
    device = Device(0.4, 0.0, 1e-3, 0.0, "zoh")
    assert spectral_radius(device, Gains(100.0, 0.0)) == pytest.approx(1 - 100.0 * 1e-3 / 0.4)


def test_whole_samples_snaps_rounding_noise():
    assert split_delay(3e-4, 1e-4) == (3, 0.0)
    whole, fraction = split_delay(2.5e-4, 1e-4)
    assert (whole, fraction) == (2, pytest.approx(0.5))
