"""Pairs of hands and environments that were hard: an uncertain servo before a box of environments, a wall of a measured
velocity in any passive hand, and cells of a flexible impedance display."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from math import exp, log

import pytest
from loop import Loop, radius

import vctune

SERVO = {"delay": 0.02, "bandwidth_hz": 8.0, "order": 2}
SHARE = 0.1
HAND = {"mass": (0.0, 2.0), "damping": (0.0, 20.0), "stiffness": (0.0, 400.0)}
WORLD = {"mass": (0.5, 5.0), "damping": (1.0, 1.0), "stiffness": (0.0, 2000.0)}
COUPLING = {"damping": 400.0, "mass": 4.0, "drag": 40.0}


def coupled(times):
    """Return a problem whose coupling is a multiple of `COUPLING`."""
    return {
        "device": {"sample_time": 4e-3, "servo": SERVO},
        "operator": {name: {"min": low, "max": high} for name, (low, high) in HAND.items()},
        "environment": {
            "mass": {"min": 0.5, "max": 5.0}, "stiffness": {"max": 2000.0}, "damping": {"min": 1.0},
        },
        "coupling": {name: times * value for name, value in COUPLING.items()},
        "uncertainty": {f"servo.{name}": SHARE for name in ("delay", "bandwidth_hz")},
        "stability": {"safety_factor": 1.0},
    }  # fmt: skip


def grows(times):
    """Return whether a motion grows on a device at a vertex, in a hand and with an environment at vertices."""
    coupling = tuple(times * value for value in COUPLING.values())
    for a, b in product((1 - SHARE, 1 + SHARE), repeat=2):
        servo = {**SERVO, "delay": a * SERVO["delay"], "bandwidth_hz": b * SERVO["bandwidth_hz"]}
        loop = Loop({"sample_time": 4e-3, "servo": servo}, coupling=coupling)
        for hand, world in product(product(*HAND.values()), product(*WORLD.values())):
            if radius(replace(loop, hand=hand, world=world)) > 1 + 1e-9:
                return True
    return False


@pytest.mark.slow
def test_an_uncertain_servo_before_a_box_of_environments():
    """Half a per cent below the least coupling at which nothing grows it is not certified, with half more it is."""
    low, high = log(0.05), log(1.0)
    assert grows(exp(low)) and not grows(exp(high))
    for _ in range(14):
        middle = (low + high) / 2
        low, high = (middle, high) if grows(exp(middle)) else (low, middle)
    assert vctune.check(coupled(0.995 * exp(low))).finding.judgement.status.value == "violated"
    assert vctune.check(coupled(1.5 * exp(low))).finding.judgement.status.value == "certified"


DISPLAY = {
    "display": "impedance", "mass": 0.3, "damping": 1.0, "sample_time": 1e-3,
    "structure": {"handle_mass": 0.08, "frequency_hz": 90.0, "damping_ratio": 0.03},
}  # fmt: skip
FINGERS = {"mass": (0.0, 0.1), "damping": (0.0, 5.0), "stiffness": (0.0, 300.0)}
BEHIND = [*product((0.0, 0.05, 1.0), (0.0,), (0.0, 50.0, 2e4))]
"""Passive environments of several sizes, without a damper."""


@pytest.mark.slow
def test_no_cell_of_a_flexible_display_is_feasible_where_a_motion_grows():
    tables = {
        "device": DISPLAY, "stability": {"criterion": "hands", "safety_factor": 1.0},
        "operator": {name: {"max": high} for name, (_, high) in FINGERS.items()},
        "coupling": {"damping": {"min": 0.01, "max": 200.0}, "stiffness": {"min": 1.0, "max": 1e6}},
    }  # fmt: skip
    found = vctune.region(tables, resolution=1 / 16).record()
    x, y = found["edges"]["x"], found["edges"]["y"]
    assert {cell[4] for cell in found["cells"]} >= {"feasible", "infeasible"}

    def unstable(b_c, k_c):
        loop = Loop(DISPLAY, coupling=(b_c, k_c))
        cases = product(product(*FINGERS.values()), BEHIND)
        return any(radius(replace(loop, hand=hand, world=world)) > 1 + 1e-9 for hand, world in cases)

    feasible = [cell[:4] for cell in found["cells"] if cell[4] == "feasible"]
    corners = {(x[i], y[j]) for x0, x1, y0, y1 in feasible for i in (x0, x1) for j in (y0, y1)}
    assert not any(unstable(*corner) for corner in corners)
