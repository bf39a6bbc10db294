"""Devices with parts: vctune's formulas in doubles against the oracles, for parts of any size."""

from __future__ import annotations

from dataclasses import astuple, replace
from math import inf, pi
from typing import Any

import frequency
import numpy as np
import pytest
from agreement import all_to_all_digits, to_all_digits
from arithmetic import DOUBLES, Digits
from conftest import drawn
from devices import NUM, Case, cases, device_of
from draws import built, gains_for
from frequency import demanded, estimate, low_pass, offered
from loop import Loop, sensitivity

from vctune.analysis.sampled_loop import sensitivity_of
from vctune.analysis.sampled_loop import spectral_radius as proved_radius
from vctune.model.device import Device
from vctune.model.gains import Gains
from vctune.model.loop.device_response import device_response
from vctune.model.loop.limits import low_frequency_limit
from vctune.model.loop.llewellyn import required_resistance
from vctune.model.loop.loop import G_hh_abs2, LoopResponse, loop_response, tracking_abs2
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.parts import Actuator, ForceSensor, Structure, VelocityEstimate

FURTHER = Digits(400)
"""For what is left at 1e-60 of the sampling rate."""
TURN = 1e-4
"""How near, relative, a frequency may be to one at which Im q, the resistance or R changes its sign: what is left of a
difference is rounded there."""
LOST = 1e4
"""Up to which attenuation by a device's low-passes R is asked for to `DIGITS_OF_R`: vctune works out what a filter
takes away, not what it leaves, and of that as many digits are lost as it is small."""
DIGITS_OF_R = 1e-10


def loop_of(device: Device, gains: Gains, omega: Any) -> LoopResponse:
    """Return vctune's velocity loop at frequencies in rad/s, in doubles."""
    return loop_response(device_response(device, np.asarray(omega), FLOATS), gains, FLOATS)


def frequencies(case: Case, rng: np.random.Generator, count: int) -> np.ndarray:
    """Return frequencies between nine decades below Nyquist and Nyquist, rad/s; one of them next to a resonance."""
    device = case.tables["device"]
    nyquist = pi / device["sample_time"]
    omega = nyquist * 10 ** rng.uniform(-9, 0, count)
    if "structure" in device:
        omega[-1] = min(2 * pi * device["structure"]["frequency_hz"] * rng.uniform(0.9, 1.1), nyquist)
    return omega


def relative(found: Any, true: Any) -> float:
    return float(abs(NUM.number(float(found)) / true - 1))


def attenuation(case: Case, omega: float) -> float:
    """Return 1 over the least gain of a device's low-passes and of its velocity estimate at a frequency."""
    s, device = NUM.i * NUM.number(omega), case.tables["device"]
    filters = [low_pass(device.get(part, {}), s, NUM) for part in ("actuator", "force_sensor")]
    return 1 / min(float(abs(gain)) for gain in (*filters, estimate(device, s, NUM)))


def turns(case: Case, omega: float) -> bool:
    """Return whether Im q, the resistance or R changes its sign next to a frequency."""
    beside = [omega * (1 + share) for share in (-TURN, TURN)]
    pairs = [(at.q.imag, at.resistance, at.required) for at in map(case.at, beside)]
    return any((below > 0) != (above > 0) for below, above in zip(*pairs, strict=True))


LONG = [pytest.param(*case, marks=pytest.mark.slow) for case in (("far apart", drawn(120)), ("ordinary", drawn(80)))]


@pytest.mark.parametrize(("kind", "count"), [("ordinary", 12), *LONG])
def test_model_agrees_with_the_definitions(kind, count):
    """R, |G_hh| and |1 - G_he|; far above a low-pass R loses what that takes away, which is bounded too."""
    compared, worst = 0, {"R": (0.0, ""), "R/attenuation": (0.0, ""), "G_hh": (0.0, ""), "tracking": (0.0, "")}
    for case, rng in cases(kind, 21, count):
        for omega in frequencies(case, rng, 6).tolist():
            true, ours, where = case.at(omega), loop_of(case.device, case.gains, omega), f"{case}, omega {omega!r}"
            found = {
                "G_hh": relative(np.sqrt(G_hh_abs2(ours)), abs(true.G_hh)),
                "tracking": relative(np.sqrt(tracking_abs2(ours)), abs(true.tracking)),
            }
            if not turns(case, omega):
                compared += 1
                missed, lost = relative(required_resistance(ours, FLOATS), true.required), attenuation(case, omega)
                found |= {"R": missed} if lost < LOST else {"R/attenuation": missed / lost}
            worst |= {name: max(worst[name], (error, where)) for name, error in found.items()}
    assert worst["R"][0] < DIGITS_OF_R, worst["R"]
    assert compared >= 4 * count, compared
    assert worst["R/attenuation"][0] < 1e-14, worst["R/attenuation"]
    assert worst["G_hh"][0] < 1e-12, worst["G_hh"]
    assert worst["tracking"][0] < 1e-12, worst["tracking"]


def test_springs_agree_with_the_definitions():
    """R, |G_hh|, |1 - G_he| and |S| of two or three springs, sensed at the motor or at the handle."""
    at_motor = at_handle = 0
    for seed in range(12):
        rng = np.random.default_rng((41, seed))
        parts = [part for part in ("at handle", "difference", "actuator", "low-pass", "delay") if rng.random() < 0.5]
        table = built(rng, "springs", *parts)
        device, gains = device_of(table), Gains(*gains_for(rng, table, float(rng.choice([0.0, 0.5]))))
        resonances = np.concatenate(frequency.resonances(table))
        for omega in np.concatenate([resonances * 1.01, 10 ** rng.uniform(-3, 0, 6) / device.sample_time]).tolist():
            true = demanded({"device": table}, astuple(gains), NUM.i * NUM.number(omega), NUM)
            ours = loop_of(device, gains, omega)
            assert relative(np.sqrt(G_hh_abs2(ours)), abs(true.G_hh)) < 1e-9
            assert relative(np.sqrt(tracking_abs2(ours)), abs(true.tracking)) < 1e-9
            if not device.at_handle:
                assert relative(ours.resistance / D_abs2(ours), true.resistance) < 1e-8
                assert relative(required_resistance(ours, FLOATS), true.required) < 1e-7
        at = np.geomspace(1e-3, 3.1, 40)
        let_go = {key: value for key, value in table.items() if key != "force_sensor"}
        expected = np.abs([sensitivity(Loop(let_go, astuple(gains)), np.exp(1j * theta)) for theta in at])
        assert sensitivity_of(device, gains)(at / device.sample_time) == pytest.approx(expected, rel=1e-6)
        at_motor, at_handle = at_motor + (not device.at_handle), at_handle + device.at_handle
    assert at_motor >= 3 and at_handle >= 3, (at_motor, at_handle)


def D_abs2(loop: Any) -> float:
    return float(loop.D_scaled.abs2() / loop.scale2)


@pytest.mark.slow
def test_required_resistance_next_to_where_im_q_changes_its_sign():
    """At 1.1e-4 and at 1e-2 from each such frequency above 1e-4 of Nyquist; relative to what low-passes leave."""
    worst, looked_at = (0.0, ""), 0
    for kind in ("far apart", "ordinary"):
        for case, _ in cases(kind, 22, drawn(40)):
            for turn in im_q_turns(case):
                for share in (-1e-2, -1.1e-4, 1.1e-4, 1e-2):
                    omega = turn * (1 + share)
                    if turns(case, omega) or attenuation(case, omega) > LOST:
                        continue
                    looked_at += 1
                    ours = required_resistance(loop_of(case.device, case.gains, omega), FLOATS)
                    missed = relative(ours, case.at(omega).required) / attenuation(case, omega)
                    worst = max(worst, (missed, f"{case}, omega {omega!r}"))
    assert looked_at > 150 * drawn(40) / 40
    assert worst[0] < DIGITS_OF_R, worst


def im_q_turns(case: Case) -> list[float]:
    """Return frequencies at which Im q changes its sign, to 1e-9."""
    grid = pi / case.device.sample_time * np.geomspace(1e-4, 1, 400)
    with np.errstate(all="ignore"):  # of R, which is not looked at
        q = demanded(case.tables, case.law, 1j * grid, DOUBLES).q
    found = []
    for index in np.flatnonzero(np.diff(np.sign(q.imag))):
        low, high = grid[index : index + 2].tolist()
        rises = case.at(high).q.imag > 0
        if (case.at(low).q.imag > 0) == rises:
            continue
        while high / low - 1 > 1e-9:
            middle = (low * high) ** 0.5
            low, high = (low, middle) if (case.at(middle).q.imag > 0) == rises else (middle, high)
        found.append(low)
    return found


@pytest.mark.parametrize("count", [3, pytest.param(drawn(60), marks=pytest.mark.slow)])
@pytest.mark.parametrize(("kind", "digits"), [("far apart", 1e-7), ("ordinary", 1e-11)])
def test_sampled_sensitivity(kind, count, digits):
    """To 1e-11; where an actuator is 1e5 times as slow as the structure rings, the step's determinant cancels."""
    worst = (0.0, "")
    for case, rng in cases(kind, 23, count):
        ours = sensitivity_of(case.device.bare, case.gains)
        T = case.device.sample_time
        for omega in (pi / T * 10 ** rng.uniform(-4, 0, 3)).tolist():
            missed = relative(ours(np.array(omega)), abs(case.sensitivity(NUM.number(omega) * NUM.number(T))))
            worst = max(worst, (missed, f"{case}, omega {omega!r}"))
    assert worst[0] < digits, worst


BARE = Device(0.4, 2.0, 1e-3, 3e-4)
WITH_FILTERS = replace(
    BARE,
    actuator=Actuator(500.0),
    velocity=VelocityEstimate("difference", 200.0),
    force_sensor=ForceSensor(500.0),
)
ON_A_SPRING = replace(BARE, structure=Structure(0.1, 120.0, 0.02))


@pytest.mark.parametrize(
    ("device", "required", "sensitivity", "radius"),
    [
        (
            WITH_FILTERS,
            ".0193672709, .630671644, 22.5219784, 348.805630",
            ".00643075252, .164876966, 1.04935817, 1.88997878, .963973612, .963576622",
            ".9797662915784",
        ),
        (
            ON_A_SPRING,
            ".0117964596, 1.01671854, 23.5807568, 55.8623927",
            ".00644114239, .165865196, .797931623, 1.01709167, 1.15184488, 1.11299713",
            ".9793483461890",
        ),
    ],
    ids=["a", "b"],
)
def test_check_numbers(device, required, sensitivity, radius):
    """R at 1 to 100 Hz, |S| at 1 to 500 Hz and the spectral radius, as model/README.md, section 12, has them."""
    gains, omega = Gains(150.0, 3000.0), 2 * pi * np.array([1.0, 10.0, 50.0, 100.0, 400.0, 500.0])
    assert all_to_all_digits(required, list(required_resistance(loop_of(device, gains, omega[:4]), FLOATS)))
    assert all_to_all_digits(sensitivity, list(sensitivity_of(device, gains)(omega)))
    assert to_all_digits(radius, proved_radius(device, gains))


def test_low_frequency_limits():
    """At 1e-60 of the sampling rate, with 400 digits: with operator, with K_p = 0, without damping, on a spring."""
    kinds = set()
    for made, rng in cases("far apart", 25, 150):
        undamped = made.tables | {"device": made.tables["device"] | {"damping": 0.0}}
        case = replace(made, tables=undamped) if rng.random() < 0.2 else made
        s = FURTHER.i * FURTHER.number("1e-60") / FURTHER.number(case.tables["device"]["sample_time"])
        true = demanded(case.tables, case.law, s, FURTHER)
        Z_c, resistance = offered(case.offers, s, FURTHER), true.resistance
        limit = low_frequency_limit(case.device, case.gains, case.coupling)
        integral = case.gains.position > 0
        damped = case.device.operator is not None and case.device.operator.damping > 0
        kinds.add((integral, damped, case.device.structure is not None, case.coupling.drag > 0))
        if limit.required == inf:
            assert resistance < 1e-30 * abs(true.G_hh), case
        elif limit.required == 0:
            assert abs(true.required) < 1e-9 * Z_c.real, case
        elif integral or damped:
            assert float(true.required) == pytest.approx(limit.required, rel=1e-12), case
            assert limit.coupling == case.coupling.drag or not case.coupling.drag, case
        else:
            assert float(Z_c.real / true.required) == pytest.approx(limit.coupling / limit.required, rel=1e-12), case
    assert len(kinds) == 16
