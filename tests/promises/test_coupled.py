"""Coupled stability: certified designs in random passive hands on random passive environments, and without coupling.

A certificate speaks of a band. A mode of the sampled loop that grows must therefore lie outside it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import ROOT

from vctune.design.judging.judge import Status, judge
from vctune.document.reading import read_gains, read_problem
from vctune.model.experiment import Environment, Experiment, MovingHand, Sensors
from vctune.model.gains import Coupling, Gains
from vctune.model.problem import Problem
from vctune.simulation.scene import Scene, designed_scene
from vctune.simulation.two_runs import fastest_mode

DESIGNS = (
    "friction-wheel",
    "friction-wheel-gripped",
    "friction-wheel-held",
    "friction-wheel-paper",
    "fixed-gains",
    "cobot-wrist",
    "desktop",
    "keemink",
    "flexible-handle",
    "friction-wheel-real",
    "cobot-wrist-real",
)
GROWS = 1 + 1e-9


Designed = tuple[Problem, Gains, Coupling]


def certified(name: str) -> Designed:
    """Return a problem of the gallery with its recorded design."""
    problem = read_problem(ROOT / f"problems/{name}.toml").problem
    design = read_gains(ROOT / f"tests/gains/{name}.toml")
    assert judge(problem, design.gains, design.coupling).status is Status.CERTIFIED
    return problem, design.gains, design.coupling


def passive(rng: np.random.Generator) -> tuple[MovingHand, Environment]:
    """Return a hand and a wall (to 1e5 N/m), a mass or a resonator."""

    def decades(low: float, high: float) -> float:
        return float(10.0 ** rng.uniform(low, high))

    hand = MovingHand(
        "sine", 0.0, 0.05, 0.05, 1, float(rng.choice([0.0, decades(-3, 1)])), float(rng.choice([0.0, decades(-2, 2)])),
        decades(1, 4),
    )  # fmt: skip
    environments = (
        Environment(0.0, float(rng.choice([0.0, decades(-1, 2)])), decades(2, 5), 0.0, False),
        Environment(decades(-3, 1), 0.0, 0.0, 0.0, False),
        Environment(decades(-3, 1), 0.0, decades(1, 5), 0.0, False),
    )
    return hand, environments[rng.integers(3)]


def scenes(design: Designed, count: int) -> list[Scene]:
    rng, (problem, *law) = np.random.default_rng(1), design
    made = []
    for _ in range(count):
        hand, environment = passive(rng)
        if (least := problem.device.operator) is not None:
            hand = replace(hand, mass=hand.mass + least.mass, damping=hand.damping + least.damping)
        experiment = Experiment("random", environment, hand, None, Sensors(0.0, 0.0, 0), None, None)
        made.append(designed_scene(problem.device, *law, experiment))
    return made


def growing(loops: list[Scene]) -> list[float]:
    """Return the frequencies of the modes that grow, Hz."""
    return [mode.hz for mode in map(fastest_mode, loops) if mode.radius > GROWS]


def uncoupled(scene: Scene) -> Scene:
    return replace(scene, law=replace(scene.law, coupling=None))


def outside(problem: Problem, modes: list[float]) -> bool:
    low, high = problem.stability.band.hz
    return all(not low <= hz <= high for hz in modes)


BORNE = [(0.0, 2.0, True), (0.0, 50.0, True), (0.03, 2.0, True)]
NOT_BORNE = [(0.0, 80.0, False), (0.05, 2.0, False), (0.5, 10.0, False)]


@pytest.mark.parametrize(("mass", "damping", "stable"), BORNE + NOT_BORNE)
def test_what_hands_the_friction_wheel_bears(mass, damping, stable):
    """Proved to 102.8 Hz it oscillates at 500 Hz in a hand that is firm up there; proved to 300 Hz it does not."""
    for name, bears in (("friction-wheel", stable), ("friction-wheel-gripped", True)):
        problem, *law = certified(name)
        experiment = problem.experiments[0]
        held = replace(experiment, operator=replace(experiment.operator, mass=mass, damping=damping))
        mode = fastest_mode(designed_scene(problem.device, *law, held))
        assert (mode.radius < 1) == bears
        if not bears:
            assert mode.hz == pytest.approx(500)
            assert outside(problem, [mode.hz])


FAST = ("friction-wheel", "friction-wheel-held", "fixed-gains")


@pytest.mark.parametrize(
    "name, count",
    [(name, 40) for name in FAST] + [pytest.param(name, 200, marks=pytest.mark.slow) for name in DESIGNS],
)
def test_growing_modes_lie_outside_the_band(name, count):
    """Of the loops of a design in passive hands on passive environments; without the coupling more of them grow."""
    design = certified(name)
    loops = scenes(design, count)
    coupled, bare = growing(loops), growing([uncoupled(scene) for scene in loops])
    assert outside(design[0], coupled)
    assert len(coupled) < len(bare) if name in FAST else len(coupled) <= len(bare)
    if name == "friction-wheel-gripped":
        assert not coupled
