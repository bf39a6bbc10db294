"""Friction and the steps of an encoder: where a device rests, and how much it may chatter."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from math import inf

import numpy as np
import pytest
from conftest import DRAWS
from rubbing import Rubbing, run

import vctune
from vctune import Coupling, Gains
from vctune.model.gains import SpringDamper

T = 1e-3
STILL = 1e-12  # Speed below which a handle rests, m/s


def stated(wall: Rubbing, **stability: object) -> dict[str, object]:
    """Return the problem of a wall, as a file states it."""
    velocity = {"resolution": wall.q} | (
        {} if wall.hz is None else {"filter_hz": wall.hz, "filter_order": wall.low_passes}
    )
    actuator = {} if wall.actuator_hz is None else {"actuator": {"bandwidth_hz": wall.actuator_hz, "order": wall.order}}
    ends = {
        name: {"min": 0.0, "max": high} for name, high in zip(("mass", "damping", "stiffness"), wall.hand, strict=True)
    }
    return {
        "device": {
            "display": "impedance", "mass": wall.m, "damping": wall.b, "sample_time": wall.T, "delay": wall.delay,
            "friction": wall.f, "velocity": velocity, **actuator,
        },
        "environment": {"stiffness": inf},
        "operator": ends,
        "stability": {"criterion": "hands", **stability},
        "coupling": {"stiffness": wall.k, "damping": wall.b_c},
    }  # fmt: skip


def rest_of(wall: Rubbing, **stability: object) -> dict[str, object]:
    """Return what `check` records of a wall at rest."""
    return vctune.check(stated(wall, **stability)).finding.record()["rest"]


PADDLE = Rubbing(0.05, 0.3, T, 285.0, 0.06, 2e-5, 0.003)


@pytest.mark.slow
def test_whether_it_rests_is_exact_in_the_decimals_of_the_file():
    rng = np.random.default_rng(0)
    for _ in range(20):
        q, f = float(f"{10 ** rng.uniform(-7, -4):.3g}"), float(f"{10 ** rng.uniform(-4, -1):.3g}")
        k = float(f"{2 * f / q * rng.choice([0.9, 1.0, 1.0, 1.1]):.12g}")
        holds = Fraction(repr(k)) * Fraction(repr(q)) <= 2 * Fraction(repr(f))
        m = max(1.0, k * T * T)
        assert rest_of(Rubbing(m, 0.1 * m / T, T, k, 0.0, q, f))["rests"] is holds
    assert rest_of(replace(PADDLE, k=300.0))["rests"] is True
    assert rest_of(replace(PADDLE, k=300.0000001))["rests"] is False


@pytest.mark.parametrize(
    "wall",
    [
        PADDLE,
        Rubbing(0.05, 0.3, T, 1000.0, 3.0, 2e-5, 0.0, delay=5e-4, hz=100.0),
        Rubbing(0.2, 1.0, T, 500.0, 2.0, 1e-5, 0.1, delay=1.7e-3, hz=200.0, low_passes=2),
        Rubbing(0.3, 4.0, T, 1000.0, 0.0, 1e-5, 0.1, actuator_hz=150.0, order=2),
    ],
)
def test_the_chatter_is_half_a_step_times_the_sum_of_the_impulse_response(wall):
    chatter = rest_of(wall)["encoder"]
    assert (chatter["chatter_m"], chatter["chatter_N"]) == pytest.approx(wall.bounds(), rel=2e-3)


def random_walls(rng: np.random.Generator, count: int) -> list[Rubbing]:
    """Return stable walls with filters, delays and actuators, in the softest and in random hands."""
    found = list[Rubbing]()
    while len(found) < count:
        m, filtered = 10 ** rng.uniform(-2, 0.3), rng.random() < 0.6
        wall = Rubbing(
            m, m / T * 10 ** rng.uniform(-3.5, -0.3), T, m / T**2 * 10 ** rng.uniform(-4, -0.3),
            rng.choice([0.0, m / T * 10 ** rng.uniform(-3, 0)]), 2e-5, delay=rng.choice([0.0, 5e-4, 1e-3, 1.7e-3]),
            hz=10 ** rng.uniform(1.3, 2.6) if filtered else None, low_passes=rng.choice([1, 1, 2]),
            actuator_hz=rng.choice([None, None, 10 ** rng.uniform(1.8, 2.6)]), order=rng.choice([1, 2]),
            hand=tuple(rng.choice([0.0, 1.0]) * x for x in (0.1, 3.0, 300.0)),
        )  # fmt: skip
        wall = replace(
            wall, f=rng.uniform(0, 5) * wall.k * wall.q / 2, low_passes=int(wall.low_passes), order=int(wall.order)
        )
        if all(replace(wall, hand=hand).radius() < 0.997 for hand in ((0.0, 0.0, 0.0), wall.hand)):
            found.append(wall)
    return found


@pytest.mark.night
@pytest.mark.parametrize("draw", range(max(DRAWS - 1, 1)))
def test_no_handle_moves_more_than_the_bound_and_settled_ones_rest(draw):
    """The bound holds in every hand of the box; with `settles` nothing moves whatever the constant force."""
    rng, walls, bounds, settled = np.random.default_rng(draw), list[Rubbing](), [], []
    for wall in random_walls(rng, 40):
        found = vctune.check(stated(wall, criterion="both"))
        if found.verdict != "passed":
            continue
        rest, inside = found.finding.record()["rest"], rng.random() ** 2
        walls.append(replace(wall, hand=tuple(inside * x for x in wall.hand)))
        bounds.append([rest["encoder"]["chatter_m"], rest["encoder"]["chatter_N"]])
        settled.append(rest.get("settles") is True)
    moved, pushed = np.array(bounds).T
    q, k = walls[0].q, np.array([wall.k for wall in walls])
    for kick in (0.0, 3.0, 50.0):
        start, held = rng.uniform(-3, 3, len(walls)) * q, rng.uniform(-2, 2, len(walls)) * k * q
        speed = kick * q / T * rng.uniform(0.5, 2, len(walls))
        seen = run(walls, start, speed, held, 10.0, 1.0, parts=8)
        assert (seen.moved <= moved).all()
        assert (seen.pushed <= pushed).all()
        slow = np.flatnonzero(settled & (seen.speed > STILL))  # creeps to the next step of the reading
        if slow.size:
            again = run([walls[i] for i in slow], start[slow], speed[slow], held[slow], 100.0, 1.0, parts=8)
            assert (again.speed < STILL).all()
    assert sum(settled) > 0


@pytest.mark.slow
def test_a_problem_that_demands_rest_has_the_stiffest_coupling_that_rests():
    problem = stated(replace(PADDLE, f=0.0025), rest=True)
    free = problem | {"coupling": {"damping": 0.06}}
    solved = vctune.solve(free)
    assert solved.status == "certified"
    design = solved.judgement
    assert design.coupling.stiffness == 250.0
    stiffer = vctune.check(free, design.gains, replace(design.coupling, stiffness=252.5))
    assert stiffer.verdict == "failed"
    assert stiffer.finding.judgement.certificate.outcomes["rests"].verdict == "refuted"


def test_an_admittance_display_answers_the_steps_of_its_force_sensor_as_it_is_simulated():
    """The sum is that of the simulation's own steps, which share no formula with it."""
    device = {
        "mass": 0.4,
        "damping": 2.0,
        "sample_time": T,
        "delay": 7e-4,
        "force_sensor": {"resolution": 0.1, "delay": 4e-4},
    }
    hand = {"mass": 0.2, "damping": 1.0, "stiffness": 100.0}
    problem = {
        "device": device,
        "operator": hand,
        "environment": {"mass": {"min": 0.05, "max": 0.05}, "stiffness": {"min": 300.0, "max": 300.0}},
        "experiment": [
            {
                "name": "impulse",
                "environment": {"mass": 0.05, "stiffness": 300.0, "rule": "trapezoid"},
                "operator": hand,
                "sensors": {"force_noise": 1.0},
            }
        ],
    }
    gains, coupling = Gains(60.0, 300.0), Coupling(40.0, 0.3, 5.0)
    chatter = vctune.check(problem, gains, coupling).finding.record()["rest"]["force_sensor"]
    speed, force = impulse_sums(vctune.problem(problem).problem, gains, coupling)
    assert (chatter["chatter_m_s"], chatter["chatter_N"]) == pytest.approx((0.05 * speed, 0.05 * force), rel=2e-3)


def impulse_sums(problem: vctune.Problem, gains: Gains, coupling: Coupling) -> tuple[float, float]:
    """Return the sums of |velocity| and |motor force| after an error of 1 N of one sample of the sensed force."""
    from vctune.simulation.compiled import INPUT_NAMES, NOISE, build
    from vctune.simulation.scene import designed_scene

    scene = designed_scene(problem.device, gains, coupling, problem.experiments[0])
    step = build(replace(scene, force_resolution=0.0))
    still, state, rows = np.zeros(len(INPUT_NAMES)), np.zeros(len(step.start)), []
    for k in range(6000):
        inputs = still.copy()
        inputs[NOISE] = k == 0
        after, row = step.advance(state, inputs)
        state, rows = np.asarray(after).ravel(), [*rows, np.asarray(row).ravel()]
    found = np.array(rows)
    return float(np.abs(np.diff(found[:, 0])).sum() / T), float(np.abs(found[:, 6]).sum())


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["kick", "hold"])
@pytest.mark.parametrize("share", [0.2, 1.5])
def test_a_kick_and_a_hold_are_simulated_as_stepped(kind, share):
    """Amplitude and frequency in a hand that stays, with friction below and above what rests, by other code."""
    wall = replace(PADDLE, k=1200.0, b_c=3.0, hz=100.0, delay=5e-4, hand=(0.0, 0.4, 300.0))
    wall = replace(wall, f=share * wall.k * wall.q / 2)
    hand = dict(zip(("mass", "damping", "stiffness"), wall.hand, strict=True))
    to, speed = 2.3 * wall.q, 0.02
    operator = hand | {"motion": kind, "from": 0.0, "to": to, "speed": speed}
    experiment = {"name": "one", "environment": {"stiffness": inf}, "operator": operator}
    gains, coupling = Gains(0.0, 0.0), SpringDamper(wall.b_c, wall.k)
    done = vctune.simulate(stated(wall) | {"experiment": [experiment]}, gains, coupling).experiments[0].design.motion
    start = (300.0 * to / (300.0 + wall.k), 0.0) if kind == "hold" else (0.0, speed)
    at, begun, held = (np.array([number]) for number in (*start, 300.0 * to))
    seen = run([wall], at, begun, held, 10.0, 2.0, parts=32)
    assert done.rests is bool(seen.speed[0] < STILL)
    if done.rests:
        assert done.kind == "rests"
        return
    assert done.amplitude_m == pytest.approx(seen.moved[0], rel=0.05)
    padded = 16 * len(seen.trace)
    turns = np.abs(np.fft.rfft((seen.trace[:, 0] - seen.trace.mean()) * np.hanning(len(seen.trace)), padded))
    assert done.frequency_hz == pytest.approx((1 + np.argmax(turns[1:])) / (padded * T), rel=0.05)


def test_a_kick_against_dry_friction_stops_where_its_energy_is_spent():
    """m v^2/2 = f x, and it stays there."""
    device = {"display": "impedance", "mass": 0.2, "damping": 0.0, "sample_time": T, "friction": 0.1}
    operator = {"motion": "kick", "from": 0.0, "to": 1.0, "speed": 0.3, "damping": 1e-6, "stiffness": 0.0}
    problem = {
        "device": device,
        "environment": {"stiffness": inf},
        "stability": {"criterion": "hands"},
        "experiment": [{"name": "slides", "environment": {}, "operator": operator}],
    }
    done = vctune.simulate(problem, Gains(0.0, 0.0), SpringDamper(0.0, 1e-9)).experiments[0].design
    assert done.traces.position[-1] == pytest.approx(0.2 * 0.3**2 / 2 / 0.1, rel=1e-3)
    assert done.motion.rests


def test_a_region_shows_where_it_rests():
    from vctune.report.region_figure import region_figure

    free = stated(replace(PADDLE, f=0.003), criterion="both")
    free["coupling"] = {"damping": {"min": 0.0, "max": 0.1}, "stiffness": {"min": 1.0, "max": 1000.0}}
    found = vctune.region(free, resolution=1 / 8)
    figure = region_figure(found.file.problem, found.region, found.designs, contours=False)
    lines = {line.get_label(): line.get_ydata()[0] for line in figure.axes[0].lines}
    (at,) = (place for label, place in lines.items() if label.startswith("k_c = 2 f/q"))
    edges = found.region.plane.edges[1]
    assert np.interp(at, np.linspace(0, 1, len(edges)), edges) == pytest.approx(300.0, rel=0.02)
    with_rest = vctune.region(free | {"stability": {"criterion": "both", "rest": True}}, resolution=1 / 8)
    assert with_rest.region.plane.edges[1][-1] == 300.0


@pytest.mark.parametrize(("share", "expected"), [(0.0, True), (0.3, None)])
def test_a_device_comes_to_rest_with_every_filter_of_its_box(share, expected):
    """At the upper filter half of the spring's step and the damper's, 1.1585 N, exceed the friction of 1 N."""
    device = {
        "display": "impedance", "mass": 0.0306, "damping": 85.0, "sample_time": 1e-3, "delay": 7e-3, "friction": 1.0,
        "velocity": {"filter_hz": 47.95, "resolution": 1e-4},
    }  # fmt: skip
    tables = {
        "device": device,
        "environment": {"stiffness": inf},
        "stability": {"criterion": "passive"},
        "coupling": {"stiffness": 7102.0, "damping": 24.79},
    }
    file = vctune.problem(tables | ({"uncertainty": {"velocity.filter_hz": share}} if share else {}))
    record = vctune.design_record(file, vctune.solve(file))
    assert record["rest"].get("settles") is expected
