"""The sound core of the prover: it proves what is true of simple margins, and no verdict depends on how it halves."""

from __future__ import annotations

import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import DRAWS, WHOLE
from kinds import KINDS, LONG

import vctune
from vctune.model.numbers.pair import Pair
from vctune.proof import halving
from vctune.proof.box_tests import (
    beside_zero,
    either,
    lower_bound_over,
    misses_zero,
    positive,
    sufficient,
    turned_angles,
)
from vctune.proof.boxes import FREQUENCY, first_boxes
from vctune.proof.enclosures.taylor import variables
from vctune.proof.enclosures.taylor_functions import TAYLOR
from vctune.proof.halving import Effort, Guide
from vctune.proof.prover import narrowed, negative_at, prove

EFFORT = Effort(max_halvings=40, max_boxes=3000)
ROOT = Path(__file__).parent.parent.parent


def boxes(low, high, owners=1):
    """Return a box of a frequency and a number y for each owner."""
    rows = (np.array([end] * owners, float).T for end in (low, high))
    return first_boxes((FREQUENCY, "y"), *rows, np.arange(owners), np.zeros(owners, np.intp))


def bowl(least, x=0.3, y=0.6):
    """Return a margin with a known least value inside the unit square, and a saddle-free rest."""
    return lambda at, v: (at - x) * (at - x) + 2 * (v["y"] - y) * (v["y"] - y) + least


def proofs(test, first=None, **options):
    first = boxes((0, 0), (1, 1)) if first is None else first
    return prove(test, first, int(first.owner.max()) + 1, EFFORT, **options)


def verdict(found, owner=0):
    return "proved" if found.proved[owner] else "refuted" if np.isfinite(found.failing[0, owner]) else "undecided"


@pytest.mark.parametrize(("least", "expected"), [(1e-3, "proved"), (-1e-3, "refuted"), (0.0, "undecided")])
def test_a_margin_is_proved_where_it_is_positive_and_refuted_where_it_is_negative(least, expected):
    found = proofs(positive(bowl(least), {}))
    assert verdict(found) == expected
    if expected == "refuted":
        at, y = found.failing[:, 0]
        assert bowl(least)(at, {"y": y}) < 0 and 0 <= at <= 1 and 0 <= y <= 1
    if expected == "undecided":
        assert np.allclose(found.open[:, 0], (0.3, 0.6), atol=0.05)


def test_a_point_at_which_a_margin_is_0_stays_open():
    assert verdict(proofs(positive(bowl(0.0), {}), boxes((0.3, 0.6), (0.3, 0.6)))) == "undecided"


def test_an_owner_without_boxes_is_not_proved():
    found = prove(positive(bowl(1e-3), {}), boxes((0, 0), (1, 1)), 2, EFFORT)
    assert [verdict(found, owner) for owner in range(2)] == ["proved", "undecided"]


def test_what_fails_somewhere_is_not_proved_by_a_bound():
    def both(part):
        found = positive(bowl(1e-3), {})(part)
        return replace(found, fails=found.proved)

    assert verdict(proofs(both)) == "refuted"
    assert not proofs(both).proved[0]


def test_a_place_that_is_no_number_proves_nothing(monkeypatch):
    guide = halving.guide_of
    nowhere = lambda found: replace(found, point=np.full_like(found.point, np.nan))  # noqa: E731
    monkeypatch.setattr(halving, "guide_of", lambda *args, **options: nowhere(guide(*args, **options)))
    assert [verdict(proofs(positive(bowl(least), {}))) for least in (-1e-3, 0.0)] == ["undecided"] * 2


@pytest.mark.parametrize("corner", [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_every_corner_of_the_boxes_is_covered(corner):
    x, y = corner
    found = proofs(positive(bowl(-1e-3, x, y), {}))
    assert verdict(found) != "proved"
    band = [boxes((low, 0), (low + 0.25, 1)) for low in (0, 0.25, 0.5, 0.75)]
    assert sum(verdict(proofs(positive(bowl(-1e-3, x, y), {}), part)) != "proved" for part in band) == 1


def test_what_fails_only_beside_the_boxes_is_proved():
    assert verdict(proofs(positive(bowl(-1e-3, 1.2, 0.5), {}))) == "proved"


def test_each_owner_has_a_verdict_of_its_own():
    first = boxes((0, 0), (1, 1), owners=3)
    first.high[1] = 0.3, 0.5, 1.0  # the least value of the bowl is in the third box alone
    found = proofs(positive(bowl(-1e-3), {}), first)
    assert [verdict(found, owner) for owner in range(3)] == ["proved", "proved", "refuted"]


def test_one_of_several_margins_has_to_be_positive_at_each_point():
    def one_of(gap):
        return lambda at, v: (at - 0.5 + gap, 0.5 + gap - at, bowl(-1.0)(at, v))

    assert verdict(proofs(positive(one_of(1e-3), {}))) == "proved"
    assert verdict(proofs(positive(one_of(-1e-3), {}))) == "refuted"


def test_a_claim_fails_at_a_point_only_if_all_its_margins_are_negative_there():
    point = boxes((-1, 1), (-1, 1))
    negative, positive_ = variables(point.rows(), [True, True])
    assert negative_at([negative]).all() and not negative_at([negative, positive_]).any()


def test_a_sufficient_margin_proves_and_never_refutes():
    assert verdict(proofs(sufficient(bowl(1e-3), {}))) == "proved"
    assert verdict(proofs(sufficient(bowl(-1e-3), {}))) == "undecided"


def test_a_test_of_its_own_serves_only_the_boxes_that_begin_at_zero():
    near, hole = sufficient(lambda at, v: 1 + 0 * at, {}), positive(bowl(-1e-3), {})
    assert verdict(proofs(beside_zero(near, hole), boxes((0.1, 0), (1, 1)))) == "refuted"
    assert verdict(proofs(beside_zero(near, hole))) == "proved"  # the box as a whole
    assert verdict(proofs(beside_zero(near, hole, (FREQUENCY, "y")), boxes((0, 0.1), (1, 1)))) == "refuted"


@pytest.mark.parametrize("signs", [(1, 1), (1, -1), (-1, 1)])
def test_another_test_needs_both_of_its_margins(signs):
    first, second = (lambda at, v, sign=sign: sign * 1e-3 + 0 * at for sign in signs)
    test = either(positive(bowl(0.0), {}), lambda at, v: (first(at, v), second(at, v)), {})
    expected = "proved" if signs == (1, 1) else "undecided"
    assert verdict(proofs(test, boxes((0.1, 0), (1, 1)))) == expected
    later = prove(positive(bowl(0.0), {}), boxes((0.1, 0), (1, 1)), 1, Effort(40, 3000, easy=100), later=test)
    assert verdict(later) == expected and later.boxes[0] > 100
    assert verdict(proofs(test, boxes((0, 0), (0, 1)))) == "proved"  # by the first alone, at frequency 0


def test_narrowed_boxes_lose_only_the_points_they_must():
    def above(limit):
        def narrow(part):
            low = part.low.copy()
            low[1] = np.maximum(low[1], limit)
            return replace(part, low=low), low[1] > part.high[1]

        return narrow

    assert verdict(proofs(narrowed(positive(bowl(-1e-3), {}), above(0.7)))) == "proved"
    assert verdict(proofs(narrowed(positive(bowl(-1e-3), {}), above(0.5)))) == "refuted"
    assert verdict(proofs(narrowed(positive(bowl(0.0), {}), above(0.5)))) == "undecided"


def test_a_row_that_must_not_be_halved_leaves_the_claim_open():
    found = proofs(positive(lambda at, v: at * (v["y"] - 0.5) + 0.1, {}), halved=[True, False])
    assert not found.proved[0]


def circle(radius, turns):
    """Return the curve 1 + radius e^(j turns frequency)."""
    return lambda at, v: Pair(1 + radius * TAYLOR.cos(turns * at), radius * TAYLOR.sin(turns * at))


def test_a_curve_that_misses_zero_has_counted_turns():
    for radius, turns in ((0.9, 0), (1.1, 3)):
        first, curve = boxes((0, 0), (6 * np.pi, 0)), circle(radius, 1.0)
        found = proofs(misses_zero(curve, {}), first, measure=turned_angles(curve, {}))
        assert found.proved[0] and round(found.total[0] / (2 * np.pi)) == turns
    assert not proofs(misses_zero(circle(1.0, 1.0), {}), boxes((0, 0), (6 * np.pi, 0))).proved[0]


def test_an_angle_may_be_obtuse():
    around = turned_angles(lambda at, v: Pair(TAYLOR.cos(at), TAYLOR.sin(at)), {})
    assert around(boxes((0, 0), (2, 0)))[0] == pytest.approx(2.0)


def test_a_curve_of_no_known_sign_has_no_angle():
    still = Pair(-1.0, 0.0)
    turn = turned_angles(lambda at, v: Pair(still.re + 0 * at, 0 * at), {})(boxes((0, 0), (1, 0)))
    opposite = turned_angles(lambda at, v: Pair(1 - 2 * at, 0 * at), {})(boxes((0, 0), (1, 0)))
    assert turn[0] == 0 and np.isnan(opposite[0])


def test_a_lower_bound_is_below_and_near_the_least_value():
    bound = lower_bound_over(bowl(0.25), boxes((0, 0), (1, 1)), {})[0]
    assert 0.24 < bound <= 0.25


def test_a_proof_ends_at_its_number_of_boxes_and_halvings():
    found = prove(positive(bowl(0.0), {}), boxes((0, 0), (1, 1)), 1, Effort(40, 200))
    assert verdict(found) == "undecided" and found.boxes[0] < 600
    saddle = positive(lambda at, v: 0.13 + (at - 0.5) * (v["y"] - 0.5) * (at + v["y"]) / 2, {})
    assert verdict(prove(saddle, boxes((0, 0), (1, 1)), 1, Effort(0, 200))) == "undecided"
    assert verdict(prove(saddle, boxes((0, 0), (1, 1)), 1, Effort(9, 200))) == "proved"


# Each of these in the core makes a test above fail: path in proof/, text, planted text
FAULTS = [
    ("prover.py", "least.bound > 0, np", "least.estimate > 0, np"),
    ("prover.py", "least.bound > 0, np", "least.bound > -1e-2, np"),
    ("prover.py", "least.bound > 0, np", "least.bound >= -np.inf, np"),
    ("prover.py", "np.all([number.enclosed().negative()", "np.any([number.enclosed().negative()"),
    ("prover.py", "number.enclosed().negative()", "~number.enclosed().positive()"),
    ("prover.py", "stays = ~found.proved & ~goes_on", "stays = ~found.proved & ~goes_on & ~hopeful[boxes.owner]"),
    ("prover.py", "failing[:, boxes.owner[found.fails]] = found.guide.point[:, found.fails]", "pass"),
    ("prover.py", "unproved[boxes.owner[stays]] = True", "pass"),
    ("prover.py", "unproved = boxes.count(owners) == 0", "unproved = np.zeros(owners, bool)"),
    ("prover.py", "~unproved & ~fails, failing", "np.isnan(open_[0]) & ~fails, failing"),
    ("prover.py", "~unproved & ~fails, failing", "~unproved, failing"),
    ("prover.py", "by_kind(empty, without_points", "by_kind(np.ones(len(boxes), bool), without_points"),
    ("prover.py", "failing[:, boxes.owner[found.fails]]", "failing[:, 0 * boxes.owner[found.fails]]"),
    ("prover.py", "boxes = boxes.halved(row)", "boxes = boxes.halved(row).subset(slice(len(boxes)))"),
    ("prover.py", "later is None or count.sum() <= effort.easy", "True"),
    ("prover.py", "& (again < effort.max_halvings)", ""),
    ("box_tests.py", "proved=found.proved & sure", "proved=found.proved"),
    ("box_tests.py", "np.any([each.proved for each in found], axis=0)", "np.ones(len(guide.room), bool)"),
    ("box_tests.py", "np.maximum(weight, 0.0) for weight", "weight - 1 for weight"),
    ("box_tests.py", "np.all(begin, axis=0), near", "np.any(begin, axis=0), near"),
    ("box_tests.py", "return np.where(sided, np.arctan2", "return np.where(True, np.arctan2"),
    ("box_tests.py", "np.arctan2(cross.mid, dot.mid)", "np.arctan2(cross.mid, np.abs(dot.mid))"),
    ("boxes.py", "joined(replace(self, high=left), replace(self, low=right))", "replace(self, high=left)"),
    ("boxes.py", "left[axis, at] = right[axis, at] = middle", "left[axis, at], right[axis, at] = middle, high"),
]


@pytest.mark.slow
@pytest.mark.parametrize("number", range(-1, len(FAULTS)))
def test_faults_planted_in_the_core_are_seen(number, tmp_path):
    """The tests above fail with each of them, and pass without one."""
    shutil.copytree(ROOT / "vctune", tmp_path / "vctune", ignore=shutil.ignore_patterns("__pycache__"))
    if number >= 0:
        path, old, new = FAULTS[number]
        file = tmp_path / "vctune" / "proof" / path
        text = file.read_text()
        assert text.count(old) == 1, f"{path} has changed: {old}"
        file.write_text(text.replace(old, new))
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-m", "not slow"]
    command += ["-c", str(ROOT / "pyproject.toml"), "--rootdir", str(ROOT), __file__]
    # the copy is in the current folder, which Python looks at first
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == (number >= 0), done.stdout[-2000:]
    assert (" failed" in done.stdout) == (number >= 0)


def bisected(monkeypatch):
    """Replace every choice of `halving`: every row of a box is bisected, and its middle is tried."""

    def guide(number, boxes, least, *, alone):
        middle, wide = 0.5 * (boxes.low + boxes.high), (boxes.high > boxes.low).astype(float)
        return Guide(middle, wide, np.isfinite(least.bound), np.full(len(boxes), -1.0))

    def each(cost, may, few):
        for row in np.flatnonzero(may & cost.any(axis=1)):
            yield np.full(cost.shape[1], row)
            cost = np.tile(cost, 2)

    monkeypatch.setattr(halving, "guide_of", guide)
    monkeypatch.setattr(halving, "rows_to_halve", each)
    monkeypatch.setattr(halving, "may_help", lambda boxes, guide, may: np.any(boxes.low < boxes.high, axis=0))
    monkeypatch.setattr(halving, "weights_of_mean", lambda a, b: (0.5 + 0 * a.coefficients[0],) * 2)
    monkeypatch.setattr(
        halving, "direction", lambda value: np.stack((value.re.coefficients[0], value.im.coefficients[0]))
    )


@pytest.mark.slow
@pytest.mark.parametrize("kind", [kind for kind in KINDS if DRAWS >= WHOLE or kind not in LONG])
def test_no_verdict_depends_on_how_boxes_are_halved(kind, monkeypatch):
    drawn = [KINDS[kind](np.random.default_rng([number, 7])) for number in ((0, 2) if DRAWS >= WHOLE else (0,))]
    posed = [vctune.problem(each.tables(side)).problem for each in drawn for side in (0.5, -0.5)]

    def verdicts():
        return [vctune.judge(each, *each.fixed_design).certificate.outcomes[drawn[0].claim].verdict for each in posed]

    first = verdicts()
    bisected(monkeypatch)
    assert verdicts() == first
