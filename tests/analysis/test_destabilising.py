"""What a design that is refused in a hand grows with: in the record, in exact time, and in `vctune simulate`."""

from __future__ import annotations

from dataclasses import astuple, replace
from math import log, pi
from pathlib import Path

import numpy as np
import pytest
from device_arithmetic import DOUBLES
from device_oracle import Coupling, Gains
from device_pairs import real_of
from in_time import Environment as Rendered
from in_time import Loop
from sampled_device_oracle import Hand as Held

from vctune.analysis.destabilising import GrowingEnvironment, destabilising
from vctune.design.verdict.claim_records import claim_records
from vctune.design.verdict.judge import judge
from vctune.document.reading import problem_file
from vctune.model import gains
from vctune.model.device import Device
from vctune.model.experiment import Environment, Experiment, Operator, Sensors
from vctune.model.hands import Hand
from vctune.model.numbers.units import LINEAR
from vctune.model.parts import Actuator, ForceSensor, Structure, VelocityEstimate
from vctune.simulation.mechanics.scene_stability import fastest_mode
from vctune.simulation.scene import designed_scene

PLAIN = Device(0.4, 2.0, 1e-3)
WHOLE = Device(
    0.4,
    2.0,
    1e-3,
    3e-4,
    velocity=VelocityEstimate("difference", 300.0, 1),
    actuator=Actuator(500.0, 2),
    force_sensor=ForceSensor(400.0, 1, 4e-4),
    structure=Structure(0.1, 120.0, 0.02),
)
GAINS = gains.Gains(150.0, 3000.0)
COUPLING = gains.Coupling(5.0, 0.05, 0.1)
CASES = {
    "spring": (PLAIN, Hand(0.0, 0.0, 2e4), 2 * pi * 160.0),
    "mass": (PLAIN, Hand(0.2, 1.0, 800.0), 2 * pi * 300.0),
    "Nyquist": (PLAIN, Hand(0.1, 5.0, 500.0), pi / 1e-3),
    "spring and damper, parts": (WHOLE, Hand(0.3, 0.0, 5e3), 2 * pi * 119.0),
    "mass, parts": (WHOLE, Hand(0.0, 5.0, 3000.0), 2 * pi * 80.0),
}


def radius(device: Device, hand: Hand, made: GrowingEnvironment) -> float:
    """Return the spectral radius of the loop in exact time, of the oracles."""
    rendered = Rendered(damping=made.damping, **{"stiffness" if made.kind == "spring" else "mass": made.value})
    law = Gains(*astuple(GAINS)), Coupling(*astuple(COUPLING))
    return float(Loop(real_of(device), *law, Held(*astuple(hand)), rendered, DOUBLES).spectral_radius())


def simulated(device: Device, hand: Hand, made: GrowingEnvironment, rule: str = "trapezoid"):
    """Return the mode of a simulated loop that grows the fastest."""
    mass, stiffness = (made.value, 0.0) if made.kind == "mass" else (0.0, made.value)
    experiment = Experiment(
        name="refused",
        environment=Environment(mass, made.damping, stiffness, 0.0, wall=False, rule=rule),
        operator=Operator("sine", 0.0, 0.01, 0.1, 3, *astuple(hand)),
        friction=None,
        sensors=Sensors(0.0, 0.0, 0),
        limit=None,
        baseline=None,
    )
    return fastest_mode(designed_scene(device, GAINS, COUPLING, experiment))


@pytest.mark.parametrize("name", CASES)
def test_a_refused_loop_grows_as_fast_as_said(name):
    device, hand, omega = CASES[name]
    made = destabilising(device, GAINS, COUPLING, hand, omega)
    assert made is not None
    assert (made.damping > 0) == ("damper" in name)
    assert made.value == 0 if name == "Nyquist" else made.kind in name
    T = device.sample_time
    assert made.growth == pytest.approx(log(radius(device, hand, made)) / T, rel=1e-8)
    mode = simulated(device, hand, made)
    assert log(mode.radius) / T == pytest.approx(made.growth, rel=1e-8)
    assert 2 * pi * mode.hz == pytest.approx(made.omega, rel=1e-8)


def test_backward_euler_hides_it():
    """The same spring with the damping of the rule that `simulate` runs by default."""
    device, hand, omega = CASES["spring"]
    made = destabilising(device, GAINS, COUPLING, hand, omega)
    assert simulated(device, hand, made, "backward").radius < simulated(device, hand, made).radius


def test_nothing_grows_where_the_demand_is_met():
    stiff = replace(COUPLING, damping=5000.0, mass=50.0, drag=500.0)
    for device, hand, omega in CASES.values():
        assert destabilising(device, GAINS, stiff, hand, omega) is None


@pytest.mark.parametrize("kind", ["mass", "spring"])
@pytest.mark.parametrize("device", [PLAIN, WHOLE], ids=["plain", "parts"])
def test_simulated_environments_by_the_trapezoidal_rule_are_the_oracles(kind, device):
    """Whatever their size, and a mass on a spring: the spectral radius of the loop in exact time."""
    hand = Hand(0.1, 5.0, 500.0)
    for value in np.geomspace(1e-3, 1e4, 5):
        made = GrowingEnvironment(kind, float(value), 0.0, 1.0, 1.0)
        assert simulated(device, hand, made).radius == pytest.approx(radius(device, hand, made), rel=1e-9)


REFUSED = """
[device]
mass = 0.4
damping = 2.0
sample_time = 1e-3
[gains]
velocity = 150.0
position = 3000.0
[coupling]
damping = 5.0
mass = 0.05
drag = 0.1
[stability]
criterion = "hands"
"""


def test_the_record_of_a_refusal_names_it():
    file = problem_file(REFUSED, Path("refused.toml"))
    problem = file.problem
    judgement = judge(problem, *problem.fixed_design)
    claims = {claim.id: claim for claim in claim_records(problem, judgement)}
    claim = claims["hands"]
    found = claim.environment
    assert claim.verdict == "refuted" and found is not None
    hand = found.hand
    made = GrowingEnvironment(found.kind, found.value, found.damping, found.growth_per_s, 2 * pi * found.hz)
    grown = log(radius(problem.device, Hand(hand.mass, hand.damping, hand.stiffness), made)) * 1e3
    assert found.growth_per_s == pytest.approx(grown, rel=1e-6)
    assert LINEAR.of(made.quantity) == found.unit
    rows = [row.unit for row in claim.rows(LINEAR)]
    assert any(row.startswith("grows at ") and "e-fold in" in row for row in rows)
    assert all(other.environment is None for other in claims.values() if other is not claim)
