"""The oracle of the frequency model, and vctune's model, against every number that was printed of it beforehand."""

from __future__ import annotations

from dataclasses import astuple, replace
from math import pi

import numpy as np
import pytest
from agreement import all_to_all_digits, to_all_digits
from device_arithmetic import DIGITS, DOUBLES
from device_fixtures import GAINS, LATE, LATE_GAINS, REAL_A, REAL_B, WHEEL, WHEEL_COUPLING, WHEEL_GAINS
from device_oracle import Coupling, Gains, LowPass, Real, coupling_impedance, laplace, ratio, response
from device_pairs import device_of, loop, open_over_closed

from vctune.analysis.demands import stability_ratio
from vctune.model import gains
from vctune.model.loop.impedances import tracking_abs2
from vctune.model.loop.limits import low_frequency_limit
from vctune.model.loop.llewellyn import required_resistance
from vctune.model.numbers.arithmetic import FLOATS

HERTZ = (1, 10, 50, 100)
TWO_PI = 2 * DIGITS.pi
LAG = Real(mass=0.5, damping=2.0, sample_time=1e-3, hold="lag")


def at(rad_per_s: float) -> str:
    """Return a frequency in Hz, of 45 digits."""
    return DIGITS.context.nstr(DIGITS.number(rad_per_s) / TWO_PI, 45)


@pytest.mark.parametrize(
    ("device", "required", "sensitivity", "tracking"),
    [
        (
            REAL_A,
            "1.93672709e-2, 6.30671644e-1, 22.5219784, 348.805630",
            ".00643075, .16487697, 1.04936358, 1.88937839",
            ".00519733, .10969966, .78830565, 1.7452126",
        ),
        (
            REAL_B,
            "1.17964596e-2, 1.01671854, 23.5807568, 55.8623927",
            ".00644114, .16584637, .79676843, 1.0222842",
            None,
        ),
    ],
    ids=["a", "b"],
)
def test_devices_a_and_b(device: Real, required: str, sensitivity: str, tracking: str | None) -> None:
    """R, |1/Delta| and |1 - G_he| at 1, 10, 50, 100 Hz: of the oracle, and of vctune."""
    found = [response(device, GAINS, hertz) for hertz in HERTZ]
    assert all_to_all_digits(required, [r.required for r in found])
    assert all_to_all_digits(sensitivity, [1 / abs(r.Delta) for r in found])
    assert tracking is None or all_to_all_digits(tracking, [abs(r.tracking) for r in found])
    ours, omega = device_of(device), 2 * pi * np.array(HERTZ)
    at = loop(ours, GAINS, omega)
    assert all_to_all_digits(required, list(required_resistance(at, FLOATS)))
    assert all_to_all_digits(sensitivity, list(open_over_closed(ours, GAINS, omega)))
    assert tracking is None or all_to_all_digits(tracking, list(np.sqrt(tracking_abs2(at))))


@pytest.mark.parametrize("device", [REAL_A, REAL_B, LATE, replace(LATE, operator_damping=0.5)])
def test_doubles_are_the_same_formulas(device: Real) -> None:
    for hertz in (1, 50, 300):
        exact, quick = response(device, GAINS, hertz), response(device, GAINS, hertz, DOUBLES)
        assert complex(exact.G_hh) == pytest.approx(quick.G_hh, rel=1e-12)
        assert complex(exact.tracking) == pytest.approx(quick.tracking, rel=1e-9)
        assert float(exact.required) == pytest.approx(quick.required, rel=1e-9)


def test_low_frequency_limit_with_a_late_force_sensor() -> None:
    assert to_all_digits("0.0206759", response(LATE, LATE_GAINS, 1e-7).required)
    assert to_all_digits("0.0206759", low_frequency_limit(device_of(LATE), LATE_GAINS, WHEEL_COUPLING).required)


def test_where_the_plain_formula_loses_every_digit() -> None:
    device = Real(mass=0.5, damping=1.0, sample_time=1e-3, hold="lag")
    assert to_all_digits("5.5543e-5", response(device, Gains(5000.0, 1e6), at(0.01)).required)


@pytest.mark.parametrize(
    ("hold", "printed"),
    [("lag", "14.1276, 394.645, 1140.27, 2215.64"), ("zoh", "14.1121, 411.113, 1619.22, 13078.68")],
)
def test_required_resistance_with_either_hold(hold: str, printed: str) -> None:
    device = replace(LAG, hold=hold)
    found = [response(device, Gains(40.0, 4000.0), at(w)).required for w in (100, 1000, 2000, 3000)]
    assert all_to_all_digits(printed, found)


@pytest.mark.parametrize(
    ("coupling", "crossings"),
    [
        (Coupling(25000.0, 5.0), ((5.3410, 1e-4), (76.1960, 1e-4), (284.483, 1e-3))),
        (Coupling(3000.0, 2.0), ((4.5439, 1e-4), (93.8517, 1e-4), (199.371, 1e-3), (3197.672, 1e-3))),
    ],
)
def test_crossings(coupling: Coupling, crossings: tuple[tuple[float, float], ...]) -> None:
    """The ratio passes 1 within one unit of the last digit printed."""
    for omega, digit in crossings:
        sides = [ratio(LAG, Gains(40.0, 4000.0), coupling, at(omega + side * digit)) - 1 for side in (-1, 1)]
        assert sides[0] * sides[1] < 0


def test_velocity_loop_alone() -> None:
    omegas = [10 ** (k / 40) for k in range(-120, 241)]

    def holds(damping: float, mass: float) -> bool:
        return all(ratio(LAG, Gains(40.0, 0.0), Coupling(damping, mass), at(w)) >= 1 for w in omegas)

    assert holds(21000, 8)
    assert holds(21000, 5.5)
    assert not holds(21000, 5.4)
    assert not holds(19000, 8)


def test_friction_wheel_with_slow_force_sensors() -> None:
    """Ratio at 0.5 Hz: ideal, 500 Hz sensor, 100 Hz sensor."""
    devices = [replace(WHEEL, force_sensor=sensor) for sensor in (LowPass(), LowPass(500.0), LowPass(100.0))]
    coupling = gains.Coupling(*astuple(WHEEL_COUPLING))
    for of in (
        lambda device: ratio(device, WHEEL_GAINS, WHEEL_COUPLING, 0.5),
        lambda device: stability_ratio(device_of(device), WHEEL_GAINS, coupling, np.array(pi)),
    ):
        found = [of(device) for device in devices]
        assert to_all_digits("1.05", found[0])
        assert float(found[1]) == pytest.approx(0.067, abs=1e-3)  # 0.06753: the print cuts it off
        assert to_all_digits("0.0042", found[2])


def test_rigid_device_is_the_limit_of_a_stiff_one() -> None:
    stiff = replace(REAL_B, structure=replace(REAL_B.structure, frequency_hz=1e9))
    rigid = replace(REAL_B, structure=None)
    for hertz in HERTZ:
        one, other = response(stiff, GAINS, hertz), response(rigid, GAINS, hertz)
        assert float(one.required) == pytest.approx(float(other.required), rel=1e-9)


def test_operator_is_part_of_a_hand() -> None:
    """With Z_h inside, the two-port [v_h; f_s] from (f, v_e) solved as a 2x2 system gives the same R."""
    device = replace(LATE, operator_damping=0.5, operator_mass=0.02, operator_stiffness=30.0)
    for hertz in HERTZ:
        s = laplace(hertz)
        bare, found = response(LATE, LATE_GAINS, hertz), response(device, LATE_GAINS, hertz)
        Z_h = DIGITS.number(0.02) * s + DIGITS.number(0.5) + 30 / s
        F_s = bare.q / bare.G_he
        h11 = 1 / (1 / bare.G_hh + Z_h)
        h12 = -bare.G_he * (1 - Z_h * h11)
        h21 = F_s * (1 - Z_h * h11)
        h22 = F_s * Z_h * bare.G_he * (1 - Z_h * h11)  # what the hand adds to Z_c
        expected = (abs(h12 * h21) - (-h12 * h21).real) / (2 * h11.real) - h22.real
        assert abs(found.required / expected - 1) < 1e-40


def test_coupling_is_a_mass_behind_a_damper() -> None:
    s = laplace(3.0)
    found = coupling_impedance(Coupling(20.0, 0.5, 1.0), s)
    assert abs(found - (1 + 1 / (DIGITS.number(1) / 20 + 2 / s))) < 1e-40
