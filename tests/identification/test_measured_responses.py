"""Measured responses of servos and mechanisms in closed form, identified: the truth is in the box."""

from __future__ import annotations

import numpy as np
import pytest

from vctune import identify
from vctune.document.text.errors import InputError

HERTZ = np.geomspace(0.5, 60.0, 40)
T = 4e-3


def written(folder, response, *, decibels=False):
    """Write a response and its log.toml; return their paths."""
    columns = {"frequency_Hz": HERTZ, "real": response.real, "imag": response.imag}
    if decibels:
        phase = np.degrees(np.angle(response))
        columns = {"hertz": HERTZ, "gain_db": 20 * np.log10(np.abs(response)), "phase_deg": phase}
    table = np.column_stack(list(columns.values()))
    np.savetxt(folder / "response.csv", table, "%.9g", ",", header=",".join(columns), comments="")
    (folder / "log.toml").write_text(f"sample_time = {T}\n")
    return folder / "response.csv", folder / "log.toml"


def servo(order, delay=0.017, bandwidth_hz=6.0):
    x = 1j * HERTZ / bandwidth_hz
    return np.exp(-2j * np.pi * HERTZ * delay) / (1 + x if order == 1 else 1 + np.sqrt(2) * x + x**2)


def mechanism(handle=0.0, lag=0.0, stiffness=0.0, mass=0.5, damping=1.2, delay=5e-3):
    """Position over force, behind a spring of 30 Hz."""
    s = 2j * np.pi * HERTZ
    motor, held = mass * (1 - handle), s * mass * handle
    reduced = motor * handle
    between = reduced * (2 * np.pi * 30) ** 2 / s + 0.08 * reduced * 2 * np.pi * 30
    load = held * between / (held + between) if handle else 0.0
    return np.exp(-s * delay) / (1 + lag * s) / (s * (damping + s * motor + load) + stiffness)


def noisy(response, share=0.01):
    random = np.random.default_rng(2)
    return response * (1 + share * (random.normal(size=HERTZ.size) + 1j * random.normal(size=HERTZ.size)))


def holds(record, **truth):
    numbers = {each.key.rpartition(".")[2]: each for each in record.numbers}
    return {key: numbers[key].low <= value <= numbers[key].high for key, value in truth.items()}


@pytest.mark.parametrize("decibels", [False, True])
@pytest.mark.parametrize("order", [1, 2])
def test_a_servo_is_in_its_box(order, decibels, tmp_path):
    found = identify(*written(tmp_path, noisy(servo(order)), decibels=decibels), servo=True)
    assert all(holds(found.record, delay=0.017, bandwidth_hz=6.0).values())
    assert found.found.device.servo.order == order
    assert 0.01 < max(radius for _, radius in found.record.unmodelled) < 0.05  # three deviations of the noise


@pytest.mark.slow
@pytest.mark.parametrize("parts", [{}, {"lag": 3e-3}, {"handle": 0.4}])
def test_a_mechanism_is_in_its_box(parts, tmp_path):
    record = identify(*written(tmp_path, noisy(mechanism(**parts)))).record
    truth = {"mass": 0.5, "damping": 1.2, "delay": 5e-3}
    truth |= {"bandwidth_hz": 1 / (2 * np.pi * 3e-3)} if "lag" in parts else {}
    truth |= {"handle_mass": 0.2, "frequency_hz": 30.0} if "handle" in parts else {}
    assert all(holds(record, **truth).values()), record.numbers
    assert len(record.numbers) == len(truth) + ("handle" in parts)  # and its damping ratio


@pytest.mark.slow
@pytest.mark.parametrize(
    ("response", "servo", "message"),
    [
        (1.4 * servo(1), True, "moves 1.4 times as far as it is told"),
        (np.conj(servo(1)), True, "is the sign of the phase turned?|phase of a lag negative?"),
        (servo(1), False, "is not a mechanism's response"),
        (mechanism(stiffness=60.0), False, "follows the position by about 60 N/m"),
    ],
)
def test_a_response_of_no_such_device_is_refused(response, servo, message, tmp_path):
    with pytest.raises(InputError, match=message):
        identify(*written(tmp_path, response), servo=servo)


def test_what_is_left_of_a_response_is_its_noise_but_for_another_structure(tmp_path):
    (recording,) = identify(*written(tmp_path, noisy(servo(1))), servo=True).record.recordings
    right, other = recording.candidates
    assert (right.structure, right.chosen, right.chi2) == ("order 1", True, 1.0) and not other.chosen
    assert recording.residual_share == pytest.approx(0.01 * np.sqrt(2), rel=0.1)
    assert right.model_error == pytest.approx([recording.residual_share])
    # what is best of order 2 differs by a lag of order 1 from one of order 2 of the same corner, give or take
    assert other.chi2 > 50 and 0.1 < other.model_error[0] < 0.5
