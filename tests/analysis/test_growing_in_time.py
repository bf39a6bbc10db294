"""Environments in time with which a refuted loop grows: the member of the box that holds the pole at the witness."""

from __future__ import annotations

from dataclasses import astuple, replace
from math import inf, log, pi

import numpy as np
import pytest

from vctune.analysis.worlds.growing_in_time import environment_factors, growing_in_time, member_of_impedance
from vctune.model.device import Device
from vctune.model.experiment import Environment, Experiment, Operator, Sensors
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hand
from vctune.model.worlds import WORLD_RULES, World, WorldRule, Worlds
from vctune.simulation.mechanics.scene_stability import fastest_mode
from vctune.simulation.scene import designed_scene

T = 1e-3
PASSIVE = Worlds(World(0.0, 0.0, 0.0), World(2.0, inf, 1000.0), rule="implicit")
"""Environments on time by implicit Euler, which have no greatest damping."""


@pytest.mark.parametrize("high", [World(2.0, inf, 1000.0), World(inf, inf, inf), World(2.0, 30.0, 1000.0)])
@pytest.mark.parametrize("rule", WORLD_RULES)
def test_the_member_has_the_impedance(rule: WorldRule, high: World) -> None:
    """Every member's impedance belongs to a member of the box, which has it, with and without limits."""
    rng, worlds = np.random.default_rng(1), Worlds(World(0.1, 0.5, 0.0), high, rule=rule)
    low, most = np.array(astuple(worlds.low)), np.minimum(astuple(high), (5.0, 100.0, 4000.0))
    for theta in (0.02, 0.3, 1.5, 3.0):
        factors = environment_factors(theta, T, worlds)
        for _ in range(10):
            impedance = complex((low + rng.uniform(0, 1, 3) * (most - low)) @ factors)
            member = member_of_impedance(impedance, factors, worlds)
            assert member is not None
            assert np.array(member) @ factors == pytest.approx(impedance, rel=1e-7)
            assert np.all(np.array(member) >= low) and np.all(np.array(member) <= astuple(high))


@pytest.mark.parametrize("impedance", [-50 + 10j, -1e-6 + 0j, 1e6j])
def test_no_member_of_a_box_without_greatest_damping_has_too_little(impedance: complex) -> None:
    """An impedance that needs less than the least damping, or more than the greatest mass, belongs to no member."""
    assert member_of_impedance(impedance, environment_factors(0.3, T, PASSIVE), PASSIVE) is None


def test_a_box_without_greatest_numbers_has_the_environment_with_which_the_loop_grows() -> None:
    """The loop in that environment grows as fast in exact time."""
    device, hand = Device(mass=1.2, damping=1.0, sample_time=T, delay=2e-3), Hand(0.0, 0.0, 500.0)
    law = Gains(150.0, 0.0), Coupling(3.0, 0.07, 0.0)
    every = replace(PASSIVE, high=World(inf, inf, inf))
    made = growing_in_time(device, *law, hand, 97.0, every)
    assert made is not None and made.kind == "mass"
    experiment = Experiment(
        name="refuted",
        environment=Environment(made.value, made.damping, made.stiffness, 0.0, wall=False, rule="backward"),
        operator=Operator("sine", 0.0, 0.01, 0.1, 3, hand.mass, hand.damping, hand.stiffness),
        friction=None,
        sensors=Sensors(0.0, 0.0, 0),
        limit=None,
        baseline=None,
    )
    mode = fastest_mode(designed_scene(device, *law, experiment))
    assert log(mode.radius) / T == pytest.approx(made.growth, rel=1e-6)
    assert 2 * pi * mode.hz == pytest.approx(made.omega, rel=1e-6)
