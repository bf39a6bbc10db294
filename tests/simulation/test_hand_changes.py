"""Hands that change during a simulated run: the growth of a period is that of an independent calculation."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from conftest import ROOT
from in_time import Environment as World
from switching_hands import growth, matrices, regripped

import vctune
from vctune.document.records.simulation_json import simulation_of
from vctune.document.text.digest import experiments_digest
from vctune.proof.claims.margins_of_claims import Design
from vctune.report.figures.experiment_figures import dwell_line
from vctune.simulation.mechanics.scene_stability import fastest_mode
from vctune.simulation.mechanics.step import columns
from vctune.simulation.run import DIVERGENCE, POSITION, has_diverged, run, traces_of
from vctune.simulation.scene import designed_scene

TEXT = (ROOT / "problems/friction-wheel-hands.toml").read_text()
GAINS = tomllib.loads((ROOT / "results/friction-wheel-hands/gains.toml").read_text())
HAND = {"to": 0.002, "speed": 0.02, "cycles": 1, "damping": 0.0, "stiffness": 3000.0}
SPRING = {"stiffness": 10000.0, "rule": "trapezoid"}


def problem_with(*operators, environment=SPRING, **more):
    """Return the problem with its published gains, and with an experiment for each hand."""
    experiments = [
        {"name": f"{number}", "environment": environment, "operator": HAND | operator, **more}
        for number, operator in enumerate(operators)
    ]
    document = tomllib.loads(TEXT) | {key: GAINS[key] for key in ("gains", "coupling")}
    return vctune.problem(document | {"experiment": experiments})


def scene_of(file, number=0):
    return designed_scene(file.problem.device, *file.problem.fixed_design, file.problem.experiments[number])


def published():
    problem = problem_with({}).problem
    return Design(problem.device, *problem.fixed_design)


@pytest.mark.parametrize(("samples", "damping"), [(6, 0.0), (6, 1.0), (30, 0.0), (1, 0.5)])
def test_a_hand_that_grips_again_grows_as_in_exact_time(samples, damping):
    scene = scene_of(problem_with({"dwell": samples * 1e-3, "regrip": True, "damping": damping, "stiffness": 3000.0}))
    expected = regripped(published(), 3000.0, damping, 1e4, samples)
    assert fastest_mode(scene).radius ** samples == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("samples", [1, 4])
def test_a_damping_that_alternates_grows_as_in_exact_time(samples):
    scene = scene_of(problem_with({"dwell": samples * 1e-3, "other_damping": 30.0}))
    steps = matrices(published(), 0.0, (0.0, 30.0), 3000.0, World(stiffness=1e4))
    expected = growth(steps, np.array([[0] * samples + [1] * samples]))[0]
    assert fastest_mode(scene).radius ** (2 * samples) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("change", [{"regrip": True}, {"other_damping": 30.0}])
def test_given_times_are_those_of_a_dwell_time(change):
    alike = [{"dwell": 0.05, **change}, {"changes_at": [0.05 * k for k in range(1, 40)], **change}]
    one, other = (run(scene_of(problem_with(more))) for more in alike)
    for name in ("position", "force", "motor"):
        assert np.array_equal(getattr(one, name), getattr(other, name))


def test_a_hand_that_changes_at_given_times_is_before_and_after_one_that_stays():
    """After a damping of 30 ms the motion soon is again that without it; with the other damping it stays another."""
    change = {"other_damping": 30.0, "damping": 3.0, "cycles": 3}
    never, once, twice = (
        run(scene_of(problem_with(change | times if times else {"damping": 3.0, "cycles": 3})))
        for times in ({}, {"changes_at": [0.2]}, {"changes_at": [0.2, 0.23]})
    )
    assert np.array_equal(never.position[:201], once.position[:201]) and never.position[201] != once.position[201]
    assert np.array_equal(once.position[:231], twice.position[:231])
    assert (
        np.abs(never.position - twice.position)[-20:].max() < 1e-6 < np.abs(never.position - once.position)[-20:].max()
    )


def test_the_column_loop_of_given_times_is_that_of_the_worse_hand():
    scene = scene_of(problem_with({"changes_at": [0.1], "other_damping": 30.0}))
    held = [scene_of(problem_with({"damping": damping})) for damping in (0.0, 30.0)]
    assert fastest_mode(scene).radius == max(fastest_mode(each).radius for each in held)


@pytest.mark.parametrize(
    ("operator", "said"),
    [
        ({"changes_at": [0.1]}, "nothing changes"),
        ({"changes_at": [0.1], "dwell": 0.1, "regrip": True}, "leave one of them out"),
        ({"changes_at": [0.1, 0.05], "regrip": True}, "increasing times"),
        ({"changes_at": [0.1, 0.1001], "regrip": True}, "at least 0.001 s apart"),
    ],
)
def test_times_that_contradict_each_other_are_refused(operator, said):
    with pytest.raises(vctune.InputError, match=said):
        problem_with(operator)


def test_a_change_after_the_run_changes_nothing():
    late, never = (run(scene_of(problem_with(more))) for more in ({"dwell": 10.0, "regrip": True}, {}))
    for name in ("position", "force", "motor"):
        assert np.allclose(getattr(late, name), getattr(never, name), rtol=0, atol=1e-12)


def test_the_force_is_sensed_before_the_hand_takes_hold_again():
    traces = run(scene_of(problem_with({"dwell": 0.02, "regrip": True, "damping": 3.0})))
    never = run(scene_of(problem_with({"damping": 3.0})))
    assert np.array_equal(traces.force[:21], never.force[:21]) and traces.position[21] != never.position[21]
    before, after = abs(traces.force[20]), abs(traces.force[21])
    assert after < 0.5 * before, "the spring of the new grip is loose"


def test_friction_and_parts_change_too():
    friction = {"friction": {"coulomb": 0.3}}
    traces = run(scene_of(problem_with({"dwell": 0.01, "regrip": True, "damping": 3.0}, **friction)))
    assert traces.diverged is None and np.abs(traces.position).max() < 0.01
    file = problem_with({"dwell": 0.01, "other_damping": 9.0, "damping": 3.0})
    device = replace(
        file.problem.device,
        actuator=vctune.problem(
            tomllib.loads(TEXT) | {"device": tomllib.loads(TEXT)["device"] | {"actuator": {"bandwidth_hz": 400.0}}}
        ).problem.device.actuator,
    )
    scene = replace(scene_of(file), device=device)
    assert run(scene).diverged is None


def test_the_line_says_from_which_dwell_time_on():
    file = problem_with(*({"dwell": dwell, "regrip": True} for dwell in (0.006, 0.03, 0.05)), {})
    record = simulation_of(vctune.simulate(file).record())
    line = dwell_line(record)
    assert line == (
        "Simulated, not proved: hands that changed every 30 ms or slower stayed at rest; every 6 ms one grew."
    )
    assert len(line.split()) <= 20
    assert dwell_line(record.model_copy(update={"experiments": record.experiments[3:]})) == ""
    assert "loop grew" in dwell_line(record.model_copy(update={"experiments": record.experiments[:1]}))
    assert dwell_line(record.model_copy(update={"experiments": record.experiments[1:]})).endswith("stayed at rest.")


@pytest.mark.parametrize(
    ("operator", "said"),
    [
        ({"dwell": 0.1}, "nothing changes; write regrip = true or other_damping"),
        ({"regrip": True}, "needs the time between two changes; write dwell"),
        ({"other_damping": 3.0}, "needs the time between two changes; write dwell"),
        ({"dwell": 1e-4, "regrip": True}, "shorter than a sample time; write at least 0.001"),
    ],
)
def test_contradictions_are_refused(operator, said):
    with pytest.raises(vctune.InputError, match=said):
        problem_with(operator)


def test_experiments_without_changes_keep_their_digest():
    known = vctune.problem(tomllib.loads((ROOT / "problems/friction-wheel.toml").read_text())).problem
    stored = json.loads((ROOT / "results/friction-wheel/simulation.json").read_text())
    assert experiments_digest(known.experiments) == stored["problem"]["experiments_sha256"]


def test_a_grip_is_part_of_the_position_at_which_a_hand_aims():
    scene = scene_of(problem_with({}))
    far = 2 * DIVERGENCE * HAND["to"]
    recorded, aims = np.zeros((3, len(columns(scene)))), np.array([0.0, far, far])
    assert columns(scene)[POSITION] == "position"
    recorded[:, POSITION] = aims
    assert not has_diverged(scene, recorded, aims) and has_diverged(scene, recorded, np.zeros(3))


def test_a_run_that_diverges_far_from_its_aim_ends_at_its_last_sample_within_reach():
    scene = scene_of(problem_with({}))
    recorded = np.zeros((4, len(columns(scene))))
    recorded[:, POSITION] = np.array([2.0, 3.0, 4.0, 2 * DIVERGENCE]) * HAND["to"]
    traces = traces_of(scene, recorded, np.zeros(4), np.zeros(4), diverged=True)
    assert len(traces.time) == 3 and traces.diverged == pytest.approx(3 * scene.device.sample_time)
