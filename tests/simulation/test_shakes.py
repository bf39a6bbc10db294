"""How a design rings and whether it buzzes, against eigenvalues and strikes of the oracles, which share no code."""

from __future__ import annotations

import json
import os
import re
from dataclasses import replace
from math import pi

import numpy as np
import pytest
from command import run as command
from draws import admittance, coupling_for, gains_for, hands_for, impedance, servo, spring_for, stated, triple
from loop import Loop, slowest
from rubbing import Rubbing, run

import vctune
from vctune.design.judging.kicked import hands_at_rest
from vctune.simulation.kicks import buzz
from vctune.simulation.rings import ringing
from vctune.simulation.worlds import NOTHING, RIGID, worlds_of

DRAWS = int(os.environ.get("VCTUNE_DRAWS", "2"))
IMMOVABLE = (0.0, 1e12, 0.0)


def drawn(kind: str, seed: int):
    """Return a device, its gains, a coupling and a box of hands."""
    rng = np.random.default_rng([seed, 991])
    device = {"admittance": admittance, "servo": servo, "impedance": impedance}[kind](rng)
    T = device["sample_time"]
    if kind == "admittance":
        gains = gains_for(rng, device)
        return device, gains, coupling_for(rng, device, gains[0]), hands_for(rng, device["mass"], T)
    box = hands_for(rng, device.get("mass", 5.0), T)
    if kind == "servo":
        drag = float(box[1][2]) * 5 * (T + device["servo"]["delay"] + 0.2 / device["servo"]["bandwidth_hz"])
        return device, None, (drag * 2, drag * 0.2, drag), box
    return device, (0.0, 0.0), spring_for(rng, device), box


def dense(device, gains, coupling, box, many: int, rng) -> tuple[float, float, float]:
    """Return the least damped oscillation over corners and many hands, before nothing and a rigid world."""
    low, high = box
    corners = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1).T
    shares = np.concatenate(
        [corners, rng.random((many, 3)) ** rng.choice([1, 4], (many, 3)) * (rng.random((many, 3)) > 0.2)]
    )
    found = []
    for share in shares:
        hand = triple(low + (high - low) * share)
        for rigid in (False, True):
            loop = Loop(device, gains or (0.0, 0.0), coupling, hand)
            if device.get("display") == "impedance":
                loop = Loop(device, gains, coupling, hand, IMMOVABLE) if rigid else loop
                found.append(slowest(loop, at_rest=not rigid))
            else:
                found.append(slowest(loop, at_rest=rigid))
    return min(found)


@pytest.mark.parametrize("seed", range(DRAWS))
@pytest.mark.parametrize("kind", ["admittance", "servo", "impedance"])
def test_the_least_damping_ratio_is_that_of_eigenvalues_over_many_hands(kind, seed):
    device, gains, coupling, box = drawn(kind, seed)
    tables = stated(device, gains, coupling, {"criterion": "hands"}, box)
    problem = vctune.problem(tables).problem
    law = problem.fixed_design
    worlds = tuple(worlds_of(problem.worlds, rigid=problem.rigid))
    found = ringing((problem.device,), hands_at_rest(problem), *law, worlds)
    own = dense(device, gains, coupling, box, 60, np.random.default_rng(seed))
    assert found is not None
    assert found.damping_ratio <= own[0] + 1e-6 + 0.005 * abs(own[0])
    hand = (found.hand.mass, found.hand.damping, found.hand.stiffness)
    rigid = found.world == RIGID
    loop = Loop(device, gains or (0.0, 0.0), coupling, hand)
    if kind == "impedance":
        loop = Loop(device, gains, coupling, hand, IMMOVABLE) if rigid else loop
    at_its_place = slowest(loop, at_rest=rigid if kind != "impedance" else not rigid)
    assert (found.damping_ratio, found.frequency / (2 * pi), found.time_constant) == pytest.approx(
        at_its_place, rel=2e-3, abs=1e-9
    )


def wall_of(seed: int) -> tuple[Rubbing, float]:
    """Return a wall with an encoder and friction that is stable without them and holds a step, and its speed unit."""
    rng = np.random.default_rng([seed, 5])
    while True:
        m, T = 10 ** rng.uniform(-3.5, -0.5), 10 ** rng.uniform(-3.5, -2.7)
        b = m / T * 10 ** rng.uniform(-3, -1.5)
        k, q = m / T**2 * 10 ** rng.uniform(-2.5, -0.6), 10 ** rng.uniform(-5, -3)
        hz = None if rng.random() < 0.5 else 10 ** rng.uniform(-1.5, -0.6) / T
        wall = Rubbing(m, b, T, k, k * T * 10 ** rng.uniform(-0.5, 1), q, hz=hz, delay=T * rng.choice([0.0, 0.5, 1.0]))
        wall = replace(wall, f=k * q * 10 ** rng.uniform(-0.3, 0.7))
        if wall.radius() < 1 - 1e-3:
            return wall, q / T + wall.f / (b + wall.b_c)


def struck(wall: Rubbing, speed: float, count: int, seed: int):
    """Return the half ways, half forces and frequencies of kicks that keep a wall moving, by the oracle."""
    rng = np.random.default_rng([seed, 6])
    speeds, held = speed * rng.uniform(0, 16, count), wall.f * rng.uniform(-1.25, 1.25, count)
    seen = run([wall] * count, wall.q * rng.uniform(-0.5, 0.5, count), speeds, held, 3.0, 0.5, parts=40)
    moving = seen.moved > 1e-3 * wall.q
    trace = seen.trace[:, moving] - seen.trace[:, moving].mean(axis=0)
    lines = np.abs(np.fft.rfft(trace * np.hanning(len(trace))[:, None], 8 * len(trace), axis=0))
    return seen.moved[moving], seen.pushed[moving], np.argmax(lines, axis=0) / (8 * len(trace) * wall.T)


@pytest.mark.parametrize("seed", range(DRAWS))
def test_a_wall_buzzes_after_kicks_as_the_oracle_steps_it(seed):
    """A wall that no kick keeps moving rests after nearly all of others' kicks; one that buzzes does so in some."""
    wall, speed = wall_of(seed)
    device = {"display": "impedance", "mass": wall.m, "damping": wall.b, "sample_time": wall.T, "delay": wall.delay}
    device |= {"friction": wall.f, "velocity": {"resolution": wall.q}}
    if wall.hz is not None:
        device["velocity"] |= {"filter_hz": wall.hz}
    hand = {name: {"min": 0.0, "max": 0.0} for name in ("mass", "damping", "stiffness")}
    problem = vctune.problem({
        "device": device, "environment": {"stiffness": float("inf")}, "operator": hand,
        "coupling": {"stiffness": wall.k, "damping": wall.b_c}, "stability": {"criterion": "hands"},
    }).problem  # fmt: skip
    found = buzz(problem.device, hands_at_rest(problem), *problem.fixed_design, (RIGID,), 0.3)
    assert found is not None
    ways, forces, hertz = struck(wall, speed, 200, seed)
    if not found.moving:
        assert len(ways) <= 4
    elif found.moving > 0.02 * found.kicks:  # a rarer one, others may not find
        assert len(ways) > 0
        assert ways.min() * 0.9 < found.amplitude < ways.max() * 1.1
        assert forces.min() * 0.9 < found.force < forces.max() * 1.1
        assert hertz.min() * 0.9 < found.frequency < hertz.max() * 1.1


def test_a_motion_that_friction_stops_late_is_no_buzz():
    """Two cycles a second of .5 kg on 60 N/m, from which friction takes 4 f/k a cycle: it outlasts the run."""
    device = {"display": "impedance", "mass": 0.075, "damping": 0.13, "sample_time": 4e-3, "friction": 0.01}
    device |= {"velocity": {"resolution": 3e-5}}
    hand = {name: {"min": value, "max": value} for name, value in (("mass", 0.5), ("damping", 0.0), ("stiffness", 0.0))}
    problem = vctune.problem({
        "device": device, "environment": {"stiffness": float("inf")}, "operator": hand,
        "coupling": {"stiffness": 60.0, "damping": 0.0}, "stability": {"criterion": "hands"},
    }).problem  # fmt: skip
    wall = Rubbing(0.075, 0.13, 4e-3, 60.0, 0.0, 3e-5, 0.01, hand=(0.5, 0.0, 0.0))
    begins, speed = np.zeros(1), np.ones(1)
    halfway, late = (run([wall], begins, speed, begins, seconds, 1.0).moved[0] for seconds in (6.0, 12.0))
    assert wall.q < late < 0.9 * halfway
    found = buzz(problem.device, hands_at_rest(problem), *problem.fixed_design, (RIGID,), 100.0)
    assert found is not None and found.moving == 0


def coupled_kicks(f: float, K: float, count: int) -> tuple[float, np.ndarray]:
    """Kick a mass on a velocity loop, with an encoder, friction, and a coupling with nothing behind, held by a spring.

    Return the share of kicks that keep moving and half of their ways, by steps of a hundredth of a sample.
    """
    m, b, T, q, K_v, (b_c, m_c, b_0) = 0.4, 2.0, 1e-3, 1e-6, 280.62733, (165.62434, 0.10202111, 0.94904712)
    rng, samples, dt = np.random.default_rng(3), 2500, T / 100
    x, v = rng.uniform(-q / 2, q / 2, count), rng.uniform(0, 16 * (q / T + f / (K_v + b)), count)
    place, before, v_e, branch = rng.uniform(-30 * q, 30 * q, count), np.zeros(count), np.zeros(count), np.zeros(count)
    a, trace = T * b_c / (2 * m_c), []
    for k in range(samples):
        read = q * np.floor(x / q + 0.5)
        speed, before = (read - before) / T, read
        left = ((1 - a) * branch - b_c * v_e) / (1 + a)  # the branch b_c, m_c by the trapezoidal rule
        v_e = (K * (place - x) - left) / (b_0 + b_c / (1 + a))
        branch, u = left + b_c * v_e / (1 + a), K_v * (v_e - speed)
        trace += [x] if k >= samples - 500 else []
        for _ in range(100):
            pushed = v + dt * (u - b * v + K * (place - x)) / m
            v = np.sign(pushed) * np.maximum(np.abs(pushed) - dt * f / m, 0)
            x = x + dt * v
    t = np.linspace(-1, 1, 500)[:, None]
    drift = (trace * t).sum(axis=0) / (t * t).sum()
    ways = np.ptp(trace - drift * t, axis=0) / 2
    moving = (ways > 1e-3 * q) & (np.abs(drift) <= ways)
    return float(moving.mean()), ways[moving]


@pytest.mark.parametrize(("f", "K", "buzzes"), [(0.0, 3000.0, True), (0.05, 3000.0, True), (0.05, 300.0, False)])
def test_a_coupled_handle_buzzes_as_small_steps_have_it(f, K, buzzes):
    """Nearly every kick, or none; the worst way is that of others' kicks."""
    device = {"mass": 0.4, "damping": 2.0, "sample_time": 1e-3, "velocity": {"resolution": 1e-6, "from": "difference"}}
    hand = {name: {"min": value, "max": value} for name, value in (("mass", 0.0), ("damping", 0.0), ("stiffness", K))}
    problem = vctune.problem({
        "device": device | ({"friction": f} if f else {}), "operator": hand, "stability": {"criterion": "hands"},
        "environment": {"mass": {"max": 0.0}, "stiffness": {"max": 0.0}},
        "gains": {"velocity": 280.62733, "position": 0.0},
        "coupling": {"damping": 165.62434, "mass": 0.10202111, "drag": 0.94904712},
    }).problem  # fmt: skip
    found = buzz(problem.device, hands_at_rest(problem), *problem.fixed_design, (NOTHING,), 0.2)
    share, ways = coupled_kicks(f, K, 60)
    assert found is not None
    assert (share > 0.9) == buzzes
    assert (found.moving / found.kicks > 0.9) == buzzes
    assert (found.moving == 0) == (share == 0)
    if buzzes:
        assert np.median(ways) < found.amplitude < 1.1 * ways.max()


BUZZING = """
[device]
display = "impedance"
units = "rotary"
mass = 5e-4
damping = 1e-3
friction = 0.02
sample_time = 1e-3
velocity = { resolution = 3.1416e-4 }
[environment]
stiffness = inf
[operator]
mass = { max = 5e-4 }
damping = { max = 0.05 }
stiffness = { max = 5.0 }
[stability]
criterion = "hands"
[coupling]
stiffness = 127.32365
damping = 0.811153
"""


@pytest.mark.parametrize("buzzing", [True, False])
def test_a_wall_that_buzzes_says_so_everywhere(tmp_path, buzzing):
    """In the table, the record, the line of `check`, the warning and the page, which is not green."""
    text = BUZZING
    if not buzzing:
        text = text.replace("e-4 }\n[env", "e-4, filter_hz = 30.0 }\n[env").replace("127.32365", "41.406426")
        text = text.replace("0.811153", "0.257882")
    (tmp_path / "wall.toml").write_text(text)
    checked = command("check", "wall.toml", cwd=tmp_path).stdout
    assert ("buzzes after" in checked and "[warn-buzzes]" in checked) == buzzing
    assert "rings with a damping ratio of " + ("0.016" if buzzing else "0.0046") in checked
    solved = command("solve", "wall.toml", "--out", "out", cwd=tmp_path, report=True).stdout
    assert re.search(r"comes to rest +(no|open)", solved)[1] == ("no" if buzzing else "open")
    assert re.search(r"buzzes +(yes|no)", solved)[1] == ("yes" if buzzing else "no")
    record = json.loads((tmp_path / "out/wall/design.json").read_text())
    assert record["buzz"]["kicks"] >= 40 and (record["buzz"]["moving"] > 0) == buzzing
    page = (tmp_path / "out/wall/report.html").read_text()
    assert ("certified, buzzes" in page) == buzzing
