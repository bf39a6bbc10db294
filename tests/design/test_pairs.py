"""Two changes together, where no change of one value lets a design pass: both pasted into the file, it passes."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import numpy as np
import pytest
from command import run
from conftest import drawn

import vctune
from vctune.document.text.toml import toml_text

pytestmark = pytest.mark.advice

LIGHT: dict[str, Any] = {
    "device": {"sample_time": 8e-3, "servo": {"delay": 0.0605, "bandwidth_hz": 21.6, "order": 2}},
    "coupling": {"rule": "euler", "mass": 0.317, "drag": 25.9},
    "operator": {"mass": {"max": 2.0}, "stiffness": {"max": 2500.0}},
    "environment": {"mass": {"max": 0.0}, "stiffness": {"max": 0.0}},
}


def short(x: float) -> float:
    return float(f"{x:.3g}")


def drawn_arm(seed: int) -> dict[str, Any]:
    """Return an arm with a law that is often far too light."""
    rng = np.random.default_rng((97, seed))
    T = float(rng.choice([1e-3, 2e-3, 8e-3]))
    servo = {"delay": short(rng.uniform(1, 12) * T), "bandwidth_hz": short(10 ** rng.uniform(0.6, 1.4))}
    drag = short(10 ** rng.uniform(-1, 2.5))
    mass = short(max(drag * T * 1.2, 10 ** rng.uniform(-2.5, 1.5)))
    tables: dict[str, Any] = {
        "device": {"sample_time": T, "servo": servo | {"order": int(rng.integers(1, 3))}},
        "coupling": {"rule": "euler", "mass": mass, "drag": drag},
        "operator": {"mass": {"max": float(rng.choice([0.5, 2.0]))}},
    }
    tables["operator"]["stiffness"] = {"max": short(10 ** rng.uniform(2.5, 4))}
    return tables | ({"environment": {"mass": {"max": 0.0}, "stiffness": {"max": 0.0}}} if rng.random() < 0.6 else {})


def pasted(tables: dict[str, Any], repairs: Any) -> dict[str, Any]:
    """Return the tables with the values of repairs."""
    changed = deepcopy(tables)
    for repair in repairs:
        node, (*path, last) = changed, repair.key.split(".")
        for key in path:
            node = node[key]
        node[last] = repair.new
    return changed


def test_a_law_that_is_too_light_and_too_free_is_told_both(tmp_path):
    (tmp_path / "arm.toml").write_text(toml_text(LIGHT))
    done = run("check", "arm.toml", cwd=tmp_path)
    assert done.returncode == 1 and "together would pass" in done.stdout
    assert "these two together would do:\n" in run("solve", "arm.toml", cwd=tmp_path).stdout
    found = vctune.check(LIGHT).finding.found
    assert found.repairs == [] and {repair.key for repair in found.together} == {"coupling.mass", "coupling.drag"}
    assert vctune.check(pasted(LIGHT, found.together)).result == "passed"
    heavier = next(repair for repair in found.together if repair.key == "coupling.mass")
    assert vctune.check(pasted(LIGHT, [heavier])).result == "failed"
    first = run("check", "arm.toml", "--format", "github", cwd=tmp_path).stdout.split("::")[2]
    assert first.startswith("coupling.") and "together would pass" in first


def test_the_record_lists_both_as_repairs():
    """Each with its old value and its line, the words of the change, the relative size of both, and the error then."""
    checked = vctune.check(LIGHT)
    both = checked.finding.record()["together"]
    after = vctune.check(pasted(LIGHT, checked.finding.found.together)).finding.record()["transparency"]["error"]
    sizes = []
    for each in both:
        old = LIGHT["coupling"][each["key"].removeprefix("coupling.")]
        assert each["old"] == old and each["needs"] == f"{each['key']} = {each['new']}"
        assert each["change"].startswith("a greater ") and each["chooses"] and not each["assumes"]
        assert each["size"] == pytest.approx(1 - old / each["new"]) and each["error"] == pytest.approx(after, rel=1e-6)
        sizes.append(each["new"] / old)
    assert sizes[0] == pytest.approx(sizes[1], rel=0.05)  # alike, but for the rounding of both


@pytest.mark.slow
def test_a_pair_passes_as_pasted():
    found = 0
    for seed in range(drawn(300)):
        tables = drawn_arm(seed)
        repairs = getattr(vctune.check(tables).finding, "found", None)
        if repairs is not None and repairs.together:
            found += 1
            assert vctune.check(pasted(tables, repairs.together)).result == "passed", seed
    assert found >= drawn(300) / 12
