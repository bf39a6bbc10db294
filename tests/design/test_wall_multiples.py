"""The least unstable multiple of a wall, against eigenvalues of the stepped loop over hands and multiples."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import DRAWS, ROOT
from held_wall import Display, climbed, least_unstable, random_case

import vctune
from vctune.running import boxes_at_most

MOST = 300.0  # multiple up to which the oracle looks
FAST = 6  # walls by day, a third of each kind


def printed_multiple(document: dict) -> tuple[float, str]:
    """Return the least unstable multiple that vctune finds, and the verdict on the wall."""
    problem = vctune.problem(document).problem
    with boxes_at_most(3_000):
        judgement = vctune.judge(problem, *problem.fixed_design)
    return judgement.before_wall.ratio, judgement.certificate.verdict.value


def test_the_multiple_is_the_least_of_own_eigenvalues_over_hands_and_multiples():
    """Notches, springs and low-passes in turn: 2 % off at most, below 1 only where the wall itself is unstable."""
    seen = {"proved": 0, "refuted": 0, "any": 0, "finite": 0}
    for seed in range(FAST if DRAWS < 25 else 300):
        display, document, box, wall = random_case(seed)
        try:
            found, verdict = printed_multiple(document)
        except vctune.InputError:  # a section next to the circle
            continue
        rng = np.random.default_rng(seed)
        own = climbed(display, box, wall, 1.0, MOST, rng)
        own = own if own > 1 else climbed(display, box, wall, 0.0, 1.0, rng)
        assert found == pytest.approx(own, rel=0.02, abs=1e-3) or min(found, own) > MOST / 1.02, (seed, found, own)
        assert (found >= 1 or verdict != "proved") and (found < 1.02 or verdict != "refuted"), (seed, found, verdict)
        seen["any"] += found == 0
        seen["finite"] += 0 < found < MOST
        seen[verdict] = seen.get(verdict, 0) + 1
    assert seen["finite"] >= FAST // 2 and seen["proved"] >= 2 and seen["refuted"] >= 1, seen


@pytest.mark.advice
def test_a_joint_without_damping_is_unstable_at_any_multiple(tmp_path):
    """J x'' = -kp x with a sample of hold: kd must exceed kp T/2, whatever the stiffness."""
    joint = Display(8e-4, 0.0, 5e-3, 0.0)
    document = {
        "device": {
            "display": "impedance", "units": "rotary", "mass": 8e-4, "damping": 0.0, "sample_time": 5e-3,
            "velocity": {"from": "measured"},
        },
        "operator": {"mass": 0.0, "damping": 0.0, "stiffness": 0.0},
        "environment": {"stiffness": np.inf},
        "stability": {"criterion": "hands"},
        "coupling": {"stiffness": 17.11, "damping": 0.0},
    }  # fmt: skip
    assert least_unstable(joint, (0.0, 0.0, 0.0), (17.11, 0.0), 1e-3, 1.0) == 1e-3
    checked = vctune.check(document)
    assert checked.finding.judgement.before_wall.ratio == 0
    assert "unstable at any multiple" in checked.message and "more damping is needed" in checked.message
    first = checked.finding.repairs[0]
    assert first.key == "coupling.damping" and 17.11 * 5e-3 / 2 < first.new < 0.09
    assert vctune.check(document | {"coupling": {"stiffness": 17.11, "damping": first.new}}).result == "passed"


@pytest.mark.parametrize("name", ["wall", "encoder"])
def test_the_wall_of_an_example_is_at_its_limit(name):
    """A wall that was searched for is unstable just beyond the safety factor, and never below it."""
    solved = vctune.solve(ROOT / "problems" / f"{name}.toml")
    factor = solved.problem.stability.safety_factor
    assert factor <= solved.judgement.before_wall.ratio <= 1.02 * factor
