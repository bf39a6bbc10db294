"""What a hand feels of each display is what a loop answers that is stepped."""

from __future__ import annotations

from math import inf, pi
from typing import Any

import numpy as np
import pytest
from pushed_handle import Stepped

import vctune
from vctune import Coupling, Gains, InputError, felt_impedance
from vctune.model.gains import SpringDamper

NOTCH = [[0.9408092961815945, -1.749484722589444, 0.9408092961815944, 1.0, -1.749484722589444, 0.881618592363189]]
RIGID = {"mass": 0.4, "damping": 2.0, "sample_time": 1e-3}
DUAL = {"display": "impedance", "mass": 0.1, "damping": 0.5, "sample_time": 1e-3}
SERVO = {"sample_time": 2e-3, "servo": {"delay": 5.3e-3, "bandwidth_hz": 12.0}}
FLEXIBLE = {"structure": {"handle_mass": 0.03, "frequency_hz": 90.0, "damping_ratio": 0.05}}
CASES = {
    "ideal": (RIGID, (60.0, 500.0), (20.0, 0.1, 1.0), (0.1, 1.0, 300.0)),
    "every part": (
        RIGID | {"delay": 1.7e-3, "velocity": {"from": "difference", "filter_hz": 200.0, "filter_order": 2}}
        | {"actuator": {"bandwidth_hz": 300.0}, "force_sensor": {"bandwidth_hz": 150.0, "filter_coefficient": 0.4}},
        (30.0, 200.0), (20.0, 0.2, 2.0), (0.0, 0.0, 200.0),
    ),
    "flexible": (RIGID | FLEXIBLE | {"velocity": {"sections": NOTCH}}, (40.0, 0.0), (inf, 0.3, 1.0), (0.2, 3.0, 0.0)),
    "handle sensed": (
        RIGID | FLEXIBLE | {"velocity": {"from": "difference", "at": "handle"}, "delay": 4e-4},
        (4.0, 0.0), (20.0, 0.3, 1.0), (0.2, 3.0, 0.0),
    ),
    "display, handle sensed": (
        DUAL | FLEXIBLE | {"velocity": {"filter_hz": 80.0, "at": "handle"}},
        (0.1, 0.0), (0.1, 30.0), (0.05, 1.0, 100.0),
    ),
    "rigid world": (RIGID | {"delay": 4e-4}, (60.0, 500.0), (20.0, 0.1, 1.0), (0.0, 0.0, inf)),
    "display": (DUAL | {"delay": 6e-4, "velocity": {"filter_hz": 80.0}}, (0.3, 0.0), (0.5, 300.0), (0.05, 1.0, 100.0)),
    "display, free": (DUAL | {"velocity": {"sections": NOTCH}}, (0.3, 0.0), (0.5, 300.0), (0.0, 0.0, 0.0)),
    "display, wall": (DUAL | FLEXIBLE | {"velocity": {"sections": NOTCH}}, (0.0, 0.0), (0.5, 300.0), (0.0, 0.0, inf)),
    "measured wall": (
        DUAL | {"delay": 1.4e-3, "velocity": {"from": "measured", "filter_coefficient": 0.7}},
        (0.0, 0.0), (2.0, 300.0), (0.0, 0.0, inf),
    ),
    "measured, rendered": (
        DUAL | {"velocity": {"from": "measured", "sections": NOTCH}},
        (0.0, 0.0), (2.0, 300.0), (0.3, 2.0, 80.0),
    ),
    "servo": (SERVO | {"force_sensor": {"sections": NOTCH}}, (0.0, 0.0), (inf, 4.0, 60.0), (1.0, 2.0, 300.0)),
    "servo, euler": (SERVO, (0.0, 0.0), (2.0, 60.0), (0.0, 0.0, 0.0)),
    "servo, euler, position": (
        SERVO | {"servo": {"delay": 4e-3, "bandwidth_hz": 12.0, "command": "position"}},
        (0.0, 0.0), (2.0, 60.0), (0.0, 0.0, 0.0),
    ),
    "servo, position and spring": (
        SERVO | {"servo": {"delay": 5.3e-3, "bandwidth_hz": 12.0, "command": "position", "stiffness": 150.0}},
        (0.0, 0.0), (80.0, 4.0, 60.0), (0.0, 2.0, 0.0),
    ),
}  # fmt: skip


def judged(device: dict[str, Any], gains: tuple[float, float], coupling: tuple[float, ...], world: Any) -> Any:
    """Return a problem with a given design, as `solve` would."""
    dual = device.get("display") == "impedance"
    euler = len(coupling) == 2 and not dual
    names = ("damping", "stiffness") if dual else ("mass", "drag") if euler else ("damping", "mass", "drag")
    law: dict[str, Any] = dict(zip(names, coupling, strict=True)) | ({"rule": "euler"} if euler else {})
    hand = {name: {"min": 0.0, "max": 1.0} for name in ("mass", "damping", "stiffness")}
    tables: dict[str, Any] = {"device": device, "coupling": law, "operator": hand, "stability": {"criterion": "hands"}}
    if "servo" not in device:
        rigid = dual and (world[2] == inf or device["velocity"].get("from") == "measured")
        tables["gains"] = {"velocity": gains[0]} if dual else {"velocity": gains[0], "position": gains[1]}
        tables |= {"environment": {"stiffness": inf}} if rigid else {}
    problem = vctune.problem(tables).problem
    made = SpringDamper(*coupling) if dual else Coupling(*(inf, *coupling)[-3:])
    return vctune.Solved(problem=problem, judgement=vctune.judge(problem, Gains(*gains), made))


@pytest.mark.parametrize("name", CASES)
def test_it_is_what_a_stepped_loop_answers(name):
    device, gains, coupling, world = CASES[name]
    solved = judged(device, gains, coupling, world)
    hertz = np.array([0.7, 10.0, 70.0, 0.41 / device["sample_time"]])
    found = felt_impedance(solved, hertz, **dict(zip(("mass", "damping", "stiffness"), world, strict=True)))
    expected = [Stepped(device, gains, coupling, world, 2 * pi * hz).felt() for hz in hertz]
    assert np.abs(found / np.array(expected) - 1).max() < 1e-6


def test_of_a_slow_motion_it_is_mass_and_damping_of_coupling_and_environment():
    solved = judged(RIGID, (60.0, 5000.0), (inf, 0.5, 1.0), (0.0, 0.0, 0.0))
    assert felt_impedance(solved, 0.1, damping=3.0).real == pytest.approx(4.0, rel=1e-3)
    in_series = 1 / (1 / 200.0 + 1 / 5000.0)  # with K_p
    assert abs(felt_impedance(solved, 0.01, stiffness=200.0)) * 2 * pi * 0.01 == pytest.approx(in_series, rel=1e-4)


@pytest.mark.parametrize(
    ("given", "said"),
    [({"hertz": 0.0}, "hertz"), ({"hertz": 1.0, "mass": -1.0}, "mass"), ({"hertz": 1.0, "damping": inf}, "damping")],
)
def test_what_cannot_be_felt_is_told(given, said):
    solved = judged(RIGID, (60.0, 500.0), (20.0, 0.1, 1.0), (0.0, 0.0, 0.0))
    with pytest.raises(InputError, match=said):
        felt_impedance(solved, **given)
