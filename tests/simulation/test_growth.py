"""A loop grows and oscillates as the oracle's matrix says: its fastest mode, its motion in time, and near a witness."""

from __future__ import annotations

from dataclasses import replace
from math import log, pi

import numpy as np
import pytest
from conftest import DRAWS
from devices import device_of
from draws import (
    Rng,
    admittance,
    built,
    built_servo,
    coupling_for,
    gains_for,
    hand_for,
    hands_for,
    impedance,
    scaled,
    spring_for,
    triple,
)
from loop import Loop, matrix

from vctune.analysis.in_worlds import growth_near
from vctune.model.experiment import Environment, Experiment, MovingHand, Sensors
from vctune.model.gains import Coupling, Gains, SpringDamper
from vctune.model.hands import Hand
from vctune.model.worlds import World
from vctune.simulation.compiled import INPUT_NAMES, SAMPLES_PER_CALL, build
from vctune.simulation.scene import Scene, designed_scene
from vctune.simulation.together import matrices_of
from vctune.simulation.two_runs import STANDING, fastest_mode

MANY = 8 * DRAWS
SOME = ("coefficient", "low-pass", "late sensor", "position", "spring", "felt sections")


def admittance_loop(rng: Rng) -> Loop:
    device = admittance(rng)
    gains = scaled(gains_for(rng, device), 10 ** rng.uniform(0, 1.2))
    return Loop(device, (gains[0], gains[1]), coupling_for(rng, device, gains[0]), hand_for(rng, device))


def springs_loop(rng: Rng) -> Loop:
    """Several springs, at times sensed at the handle."""
    parts = [part for part in ("at handle", "difference", "actuator", "low-pass") if rng.random() < 0.5]
    return replace(admittance_loop(rng), device=built(rng, "springs", *parts))


def servo_loop(rng: Rng) -> Loop:
    """At times with the filter and spring of a firmware."""
    device = built_servo(rng, *(part for part in SOME if rng.random() < 0.3), order=int(rng.integers(1, 3)))
    hand = triple(10 ** rng.uniform([-2, -1, 1], [1, 2, 4]) * (rng.random(3) < 0.7))
    return Loop(device, coupling=triple(10 ** rng.uniform([0, -2, -1], [4, 1, 2.5])), hand=hand)


def display_loop(rng: Rng) -> Loop:
    device = impedance(rng)
    coupling = scaled(spring_for(rng, device), 10 ** rng.uniform(0, 2))
    gains = (float(device["damping"] * rng.choice([0.0, 0.5])), 0.0)
    return Loop(device, gains, coupling, triple(hands_for(rng, device["mass"], device["sample_time"])[1]))


LOOPS = {"admittance": admittance_loop, "springs": springs_loop, "servo": servo_loop, "display": display_loop}


def drawn(kind: str, number: int) -> Loop:
    """Return a loop before nothing or before an environment, about as great as the coupling."""
    rng = np.random.default_rng((31, list(LOOPS).index(kind), number))
    loop = LOOPS[kind](rng)
    T = loop.device["sample_time"]
    b = loop.coupling[0] + (loop.coupling[1] * T if kind == "display" else 0.0)
    world = b * np.array([T, 1.0, 1 / T]) * 10 ** rng.uniform([-1, -2, -3], [1.5, 0, -0.5]) * (rng.random(3) < 0.6)
    return replace(loop, world=triple(world))


def law_of(loop: Loop) -> tuple[Gains, Coupling | SpringDamper]:
    return Gains(*loop.gains), (SpringDamper if loop.kind == "impedance" else Coupling)(*loop.coupling)


def scene_of(loop: Loop) -> Scene:
    hand = MovingHand("sine", 0.0, 0.02, 0.05, 1, *loop.hand)
    met = Environment(*loop.world, 0.0, False, "trapezoid")
    return designed_scene(
        device_of(dict(loop.device)),
        *law_of(loop),
        Experiment("test", met, hand, None, Sensors(0.0, 0.0, 0), None, None),
    )


def top_of(step: np.ndarray) -> complex:
    """Return the largest eigenvalue, positions that nothing holds apart."""
    values = np.linalg.eigvals(step)
    values = values[np.abs(values - 1) > STANDING]
    return complex(values[np.argmax(np.abs(values))])


@pytest.mark.parametrize("kind", LOOPS)
def test_loops_grow_and_oscillate_as_the_oracle_says(kind):
    grow = decay = 0
    for number in range(MANY):
        step, scene = matrix(loop := drawn(kind, number)), scene_of(loop)
        top, mode = top_of(step), fastest_mode(scene)
        assert mode.radius == pytest.approx(abs(top), rel=1e-9), number
        found = mode.radius * np.exp(2j * pi * mode.hz * scene.device.sample_time)
        assert np.abs(np.linalg.eigvals(step) - found).min() < 1e-5 * abs(top)  # of two that are as large, either
        grow, decay = grow + (abs(top) > 1 + 1e-9), decay + (abs(top) < 1)
    assert grow >= MANY / 8 and decay >= MANY / 8, (grow, decay)


@pytest.mark.parametrize("kind", LOOPS)
def test_motion_grows_and_turns_in_time_by_the_largest_root(kind):
    """Left to itself in the mode that grows the fastest, each sample is the last one times the oracle's root."""
    for number in range(DRAWS):
        scene, top = scene_of(loop := drawn(kind, number)), top_of(matrix(loop))
        values, vectors = np.linalg.eig(matrices_of(scene, [Hand(*loop.hand)])[0])
        mode = vectors[:, np.argmin(np.abs(values - top))]
        samples = int(min(SAMPLES_PER_CALL, 1 + 8 / abs(log(abs(top)))))
        states, _ = build(scene).chunk()(mode.real, np.zeros((len(INPUT_NAMES), SAMPLES_PER_CALL)))
        for k in (samples // 2, samples - 1):
            expected = (top ** (k + 1) * mode).real
            assert np.abs(np.asarray(states)[:, k] - expected).max() < 1e-7 * abs(top) ** (k + 1), number


def told(loop: Loop) -> bool:
    """Return whether a growth is told of a loop that clearly grows and oscillates; assert that it is of a pole."""
    roots = np.linalg.eigvals(matrix(loop).astype(float)).astype(complex)
    poles = np.log(roots[np.abs(roots) > 1e-3]) / loop.T
    top = poles[np.argmax(poles.real)]
    if top.real < 1e-3 * abs(top) or not 1e-3 * abs(top) < abs(top.imag) < 0.9 * pi / loop.T:
        return False
    met = World(*loop.world)
    found = growth_near(device_of(dict(loop.device)), *law_of(loop), Hand(*loop.hand), met, abs(top.imag))
    if found is None:
        return False
    pole = found.rate + 2j * pi * found.hz
    assert np.abs(poles - pole).min() < 1e-7 * abs(pole)
    return True


@pytest.mark.parametrize("sample_time", [1e-3, 4e-3])
def test_a_growing_motion_is_told_by_its_rate_and_frequency(sample_time):
    """log |z|/T of the stepped loop, at its angle."""
    device = {"mass": 0.4, "damping": 2.0, "sample_time": sample_time, "delay": 2 * sample_time}
    assert told(Loop(device, (60.0, 1500.0), (20.0, 0.05, 0.1), (0.2, 1.0, 1500.0), (0.0, 0.0, 3000.0)))


@pytest.mark.parametrize("kind", ["admittance", "springs", "servo"])
def test_growing_motions_are_told(kind):
    """Not all: the search begins at the frequency alone."""
    assert sum(told(drawn(kind, number)) for number in range(2 * MANY)) >= MANY / 8
