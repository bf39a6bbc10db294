"""M a + D v = F by Euler, the law of most robots: its mass and drag are the numbers of the file and of the answer."""

from __future__ import annotations

import itertools
import tomllib

import numpy as np
import pytest
from command import run as vctune
from conftest import mostly_slow
from draws import servo
from loop import Loop
from loop import radius as stepped

from vctune import Coupling, Gains, check, problem, simulate, solve
from vctune.document.text.toml import toml_text
from vctune.exit_codes import ExitCode
from vctune.simulation.simulation_record import trace_arrays

ARM = {
    "device": {"sample_time": 2e-3, "servo": {"delay": 0.03, "bandwidth_hz": 22.0, "order": 2}},
    "environment": {"mass": {"max": 0.0}, "stiffness": {"max": 0.0}},
}
NAMES = ("mass", "damping", "stiffness")
EULER = {"rule": "euler"}


def random_arm(rng):
    """Return a servo, often with a filter, its hands and a tool, and the hands that are tried."""
    device, weight = servo(rng), float(rng.uniform(0, 10)) * float(rng.random() < 0.8)
    if rng.random() < 0.5:
        device["force_sensor"] = device.get("force_sensor", {}) | {"filter_coefficient": float(rng.uniform(0.1, 0.9))}
    most = np.array([0.5, 30.0, 10 ** rng.uniform(2, 3.6)])
    hands = {name: {"min": 0.0, "max": float(x)} for name, x in zip(NAMES, most, strict=True)}
    shares = itertools.product((0, 0.2, 0.5, 1), (0, 1), (0, 0.03, 0.1, 0.25, 0.5, 1))
    tables = {"device": device, "operator": hands, "tool": {"mass": weight}, "environment": ARM["environment"]}
    return tables | {"stability": {"safety_factor": 1.0}}, [tuple(share * most + (weight, 0, 0)) for share in shares]


def stable(tables, hands, rule, mass, drag):
    """Return whether the stepped loop of a law is stable in every hand: the controller's own steps, or trapezoids."""
    if rule == "euler":
        loops = (Loop(tables["device"], hand=hand, rule=(mass, drag, 0.0)) for hand in hands)
    else:
        loops = (Loop(tables["device"], (0.0, 0.0), (np.inf, mass, drag), hand) for hand in hands)
    return all(stepped(loop) < 1 - 1e-12 for loop in loops)


def limit(tables, hands, rule, mass, drag):
    """Return the least multiple of a law beyond which it stays stable."""
    low, high = 1e-3, 1e3
    for _ in range(24):
        middle = (low * high) ** 0.5
        low, high = (low, middle) if stable(tables, hands, rule, middle * mass, middle * drag) else (middle, high)
    return high


@pytest.mark.parametrize("seed", mostly_slow(range(25), []))
def test_an_arm_with_a_tool_is_judged_as_it_steps(seed):
    """By Euler and by trapezoids, next to the limit of its own steps: proved above, refuted below."""
    rng = np.random.default_rng(seed)
    tables, hands = random_arm(rng)
    late = tables["device"]["servo"]["delay"] + tables["device"]["sample_time"]
    for rule in ("euler", "trapezoid"):
        drag, mass = 1.0, late * 10 ** rng.uniform(0, 1)
        share = limit(tables, hands, rule, mass, drag)
        stated = EULER if rule == "euler" else {"damping": np.inf}
        for by, verdict in ((1.03, "passed"), (0.97, "failed")):
            law = stated | {"mass": float(by * share * mass), "drag": float(by * share * drag)}
            assert check(tables | {"coupling": law}).result == verdict, (rule, law)


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 12))])
def test_the_law_that_is_solved_for_is_the_lightest(seed):
    rng = np.random.default_rng(seed)
    tables, hands = random_arm(rng)
    found = solve(tables | {"coupling": EULER})
    assert found.status == "certified"
    mass, drag = found.judgement.coupling.mass, found.judgement.coupling.drag
    assert stable(tables, hands, "euler", mass, drag)
    assert mass <= 1.02 * drag * tables["device"]["sample_time"] or not stable(
        tables, hands, "euler", 0.97 * mass, 0.97 * drag
    )


def test_an_arm_before_every_passive_environment_is_solved():
    found = solve({"device": ARM["device"], "coupling": EULER})
    assert found.status == "certified"


@pytest.mark.slow
def test_the_law_stands_in_files_and_answers_in_its_own_words(tmp_path):
    (tmp_path / "arm.toml").write_text(toml_text(ARM | {"coupling": EULER}))
    (tmp_path / "plain.toml").write_text(toml_text(ARM))
    done = vctune("solve", "arm.toml", cwd=tmp_path)
    assert done.returncode == ExitCode.OK
    for words in ("rule", "euler", "M a + D v = F", "mass M", "drag D"):
        assert words in done.stdout
    assert "b_c" not in done.stdout and "m_c" not in done.stdout
    gains = tmp_path / "results/arm/gains.toml"
    law = tomllib.loads(gains.read_text())["coupling"]
    assert law["rule"] == "euler" and set(law) == {"rule", "mass", "drag"}
    for file in ("arm.toml", "plain.toml"):  # the gains bring their rule
        assert vctune("check", file, gains, cwd=tmp_path).returncode == ExitCode.OK
    assert vctune("export", "plain.toml", gains, cwd=tmp_path).returncode == ExitCode.OK


def test_a_law_by_trapezoids_may_have_no_damper(tmp_path):
    (tmp_path / "arm.toml").write_text(toml_text(ARM))
    (tmp_path / "law.toml").write_text('[coupling]\nrule = "trapezoid"\ndamping = inf\nmass = 6.0\ndrag = 120.0\n')
    assert vctune("check", "arm.toml", "law.toml", cwd=tmp_path).returncode == ExitCode.OK


def test_the_simulation_steps_the_law():
    """Pushed by a hand, the commanded velocity follows v += T (F - D v)/M to rounding."""
    hand = {"from": 0.0, "to": 0.01, "speed": 0.05, "cycles": 1, "damping": 5.0, "stiffness": 200.0}
    tables = ARM | {"coupling": EULER, "experiment": [{"name": "pushed", "operator": hand}]}
    M, D, T = 6.0, 120.0, ARM["device"]["sample_time"]
    found = trace_arrays(simulate(tables, Gains(0.0, 0.0), Coupling(np.inf, M, D)).experiments)
    sensed, desired = (next(found[key] for key in found if key.endswith(name)) for name in ("sensed", "desired"))
    expected = desired[:-1] + T * (sensed[1:] - D * desired[:-1]) / M
    assert np.abs(desired[1:] - expected).max() < 1e-12 * np.abs(desired).max()


def test_a_problem_keeps_its_rule():
    file = problem(ARM | {"coupling": EULER | {"mass": 6.0, "drag": {"min": 1.0, "max": 200.0}}})
    again = problem(file.problem)
    assert again.problem == file.problem and again.sha256 == file.sha256
