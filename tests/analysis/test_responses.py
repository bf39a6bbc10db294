"""The loop as arrays and as state space, and in the hands of python-control."""

from __future__ import annotations

import sys
from dataclasses import replace
from math import degrees, inf, pi

import control
import draws
import numpy as np
import pytest
from conftest import DEVICE, for_passive_hands, mostly_slow
from devices import device_of
from draws import combined, gains_for
from matplotlib.figure import Figure

import vctune
from vctune.analysis.margins import loop_margins
from vctune.analysis.sampled_loop import spectral_radius
from vctune.document.reading import parse_problem
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hand, LeastOperator
from vctune.model.parts import ForceSensor, Servo, Structure

SEVEN = 7  # which combinations of parts are taken: coprime to how many there are


def angles(device):
    return np.geomspace(1e-3, 1, 30) * pi / device.sample_time


def margins_of(L):
    """The gain margin as a factor and the phase margin in degrees that python-control reads off a response."""
    first = control.stability_margins(L.at().to_control(), returnall=True)
    near = np.concatenate([omega * np.linspace(0.99, 1.01, 81) for omega in (*first[3], *first[4])] or [[1.0]])
    nyquist = pi / L.device.sample_time
    omega = np.union1d(L.at().omega, near[near < nyquist])
    factors, phases, *_ = control.stability_margins(L.at(omega).to_control(), returnall=True)
    at_nyquist = L.at(np.array([nyquist])).values[0].real  # which python-control leaves out
    factors = [*factors, *([-1 / at_nyquist] if at_nyquist < 0 else [])]
    return min(factors, key=lambda x: abs(np.log(x)), default=inf), min(phases, key=abs, default=inf)


def stable_device(rng, number):
    """Return a device with a combination of parts, and gains that are stable."""
    while True:
        table = combined(rng, number)
        device, gains = device_of(table), Gains(*gains_for(rng, table))
        if spectral_radius(device, gains) < 1:
            return device, gains


@pytest.mark.parametrize("number", mostly_slow(range(50), [0, 1]))
def test_python_control_has_the_same_margins(number):
    device, gains = stable_device(np.random.default_rng((39, number)), SEVEN * number)
    loop = vctune.Loop(device, gains)
    assert loop.L.to_control().dt == device.sample_time
    ours, (factor, phase) = loop_margins(device, gains), margins_of(loop.L)
    assert ours.gain == pytest.approx(factor, rel=1e-9)
    assert degrees(ours.phase) == pytest.approx(phase, rel=1e-9)


def test_python_control_is_told_names_and_frequencies():
    loop = vctune.Device(0.4, 2.0, 1e-3, delay=1e-3).loop(Gains(100.0, 4000.0), Coupling(30.0, 0.2, 0.5))
    data = loop.Z_c.at(np.array([10.0, 20.0, 30.0, 40.0, 50.0])).to_control()
    assert isinstance(data, control.FrequencyResponseData) and data.dt == 1e-3
    assert data.frdata.ravel() == pytest.approx(loop.Z_c.at(data.omega).values, rel=1e-15)
    assert loop.Z_c.at(hz=data.omega / (2 * pi)).values == pytest.approx(data.frdata.ravel(), rel=1e-12)


@pytest.fixture(scope="module")
def wheel():
    return parse_problem(for_passive_hands(DEVICE), "wheel", "wheel")


@pytest.fixture(scope="module")
def solved(wheel):
    return vctune.solve(wheel)


def test_the_nyquist_data_are_the_page_s(wheel, solved):
    best = solved.judgement
    axes = vctune.draw_nyquist(Figure().subplots(), wheel, best.gains)
    x, y = axes.lines[0].get_data()
    L = solved.loop().L.at()
    assert np.array_equal(x, L.values.real) and np.array_equal(y, L.values.imag)
    assert L.omega[-1] == pytest.approx(pi / wheel.device.sample_time) and L.unit == "1"
    assert np.abs(solved.loop().S.at().values).max() == pytest.approx(best.peak_sensitivity, rel=1e-3)


def test_the_resistance_in_the_worst_hand_is_the_judged_one():
    held = vctune.solve(DEVICE_IN_HANDS)
    worst = held.judgement.in_hand
    loop, at = held.loop(worst.hand), np.array([worst.omega])
    ratio = loop.Z_c.at(at).values.real / -loop.Z_seen.at(at).values.real
    assert ratio == pytest.approx([worst.ratio], rel=1e-6)


DEVICE_IN_HANDS = {
    "device": {"mass": 0.4, "damping": 2.0, "sample_time": 1e-3},
    "stability": {"criterion": "hands"},
    "gains": {"velocity": {"min": 150.0, "max": 150.0}, "position": {"min": 6000.0, "max": 6000.0}},
    "coupling": {name: {"min": x, "max": x} for name, x in (("damping", 160.0), ("mass", 0.35), ("drag", 3.0))},
}


def test_what_a_loop_has_not_is_refused():
    device, nothing = Device(0.4, 2.0, 1e-3), Gains(0.0, 0.0)
    loop = vctune.Loop(device, Gains(100.0, 0.0))
    servo = vctune.Loop(device_of(draws.servo(np.random.default_rng(1))), nothing)
    impedance = vctune.Loop(replace(device, display="impedance"), nothing, hand=Hand(1.0, 0.0, 0.0))
    refused = [
        (loop, "Z_seen", "state one, hand="),
        (loop, "Z_c", "state one, coupling="),
        (loop, "motion", "is no servo"),
        (loop, "Y_seen", "take Z_seen"),
        (servo, "S", "take motion"),
        (impedance, "Z_seen", "take Y_seen"),
    ]
    for of, name, remedy in refused:
        with pytest.raises(ValueError, match=f"{name}: .*{remedy}"):
            getattr(of, name)


def test_without_gains_nothing_answers():
    idle = vctune.Loop(Device(0.4, 2.0, 1e-3), Gains(0.0, 0.0))
    assert not idle.L.at().values.any() and (idle.S.at().values == 1).all()


def test_control_is_imported_where_it_is_used_alone(monkeypatch):
    monkeypatch.setitem(sys.modules, "control", None)
    loop = vctune.Loop(Device(0.4, 2.0, 1e-3), Gains(100.0, 0.0))
    assert loop.L.at().values.size == 1600
    for take in (loop.L.to_control, loop.L.at().to_control):
        with pytest.raises(ImportError):
            take()


def test_reprs_are_short(solved):
    loop = solved.loop()
    shown = [solved, solved.judgement, loop.L, loop.L.at(), solved.problem.device]
    assert all(len(repr(each)) < 200 for each in shown), [repr(each) for each in shown]
    assert repr(vctune.Device(0.4, 2.0, 1e-3, delay=1e-4)) == (
        "Device(mass=0.4, damping=2.0, sample_time=0.001, delay=0.0001)"
    )


def test_figures_are_drawn_on_axes_that_are_given(wheel, solved):
    best = solved.judgement
    design = wheel, best.gains, best.coupling
    axes = Figure().subplots(2, 3).ravel()
    drawn = [draw(at, *design) for draw, at in zip((
        vctune.draw_required, vctune.draw_ratio, vctune.draw_error, vctune.draw_impedance,
    ), axes, strict=False)]  # fmt: skip
    assert [*drawn, vctune.draw_nyquist(axes[4], *design[:2])] == list(axes[:5])
    assert all(len(each.lines) > 1 and each.get_xlabel() for each in axes[:5])
    required = {line.get_label(): line for line in axes[0].lines}
    over = required["coupling, Re Z_c"].get_ydata() / required["required, R"].get_ydata()
    band, hz = wheel.stability.band.hz, required["coupling, Re Z_c"].get_xdata()
    shown = np.nanmin(over[(hz >= band[0]) & (hz <= band[1])])
    assert best.min_ratio <= shown < 1.03 * best.min_ratio


@pytest.mark.parametrize("structure", [None, Structure(0.1, 60.0, 0.05)], ids=["rigid", "flexible"])
@pytest.mark.parametrize("mass, damping", [(0.05, 3.0), (0.3, 0.0), (0.0, 4.0)])
def test_a_load_at_the_handle_is_a_hand_of_its_mass_and_damping(
    structure: Structure | None, mass: float, damping: float
) -> None:
    """L of a device that carries its least operator is L of the bare device in that hand."""
    device = Device(0.4, 2.0, 1e-3, 3e-4, operator=LeastOperator(mass, damping), structure=structure)
    gains, omega = Gains(100.0, 2000.0), angles(device)
    carried, held = (
        vctune.Loop(device.with_operator, gains),
        vctune.Loop(device.bare, gains, hand=Hand(mass, damping, 0.0)),
    )
    assert carried.L.at(omega).values == pytest.approx(held.L.at(omega).values, rel=1e-9)


@pytest.mark.parametrize("command", ["velocity", "position"])
def test_the_motion_of_a_servo_is_that_of_its_commands_alone(command: str) -> None:
    """Neither the firmware's own spring, nor the force sensor, nor the disc of its responses is in it."""
    plain = Device(1.0, 0.0, 2e-3, display="servo", servo=Servo(0.03, 20.0, 2, command))
    servo = replace(plain.servo, stiffness=40.0, radii=((1.0, 0.1), (100.0, 0.3)))
    full = replace(plain, servo=servo, force_sensor=ForceSensor(50.0, delay=4e-3))
    omega = angles(plain)
    one, other = (vctune.Loop(device, Gains(0.0, 0.0)).motion.at(omega).values for device in (plain, full))
    assert other == pytest.approx(one, rel=1e-12) and np.abs(one[0] - 1) < 0.1
