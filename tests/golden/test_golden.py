"""The answers that were right stay: verdicts near the limit and errors, through public names."""

from __future__ import annotations

import json

import pytest
from answers import DESIGNS, FILE, answer, bad_files, coupling_of, name_of, near
from conftest import ROOT, mostly_slow
from limits import BESIDE, HANDS, LIMITS, WHEEL, passes

import vctune
from vctune.document.reading import parse_problem

FAST = DESIGNS[::16]
"""Problems whose answers are asked for each time."""
OPEN = WHEEL + "[gains]\nvelocity = 60.0\nposition = 0.0\n[coupling]\ndamping = 40.0\nmass = 0.3\ndrag = 0.0\n" + HANDS
GOLDEN = json.loads(FILE.read_text())
WORSE = 1e-4
"""Relative increase of an error above which an answer is worse; better ones are welcome."""


def agree(then: str, now: str) -> bool:
    """Return whether a verdict is the recorded one, or decides what was undecided."""
    return then in (now, "undecided")


@pytest.mark.parametrize("path", mostly_slow(DESIGNS, FAST), ids=name_of)
def test_a_design_is_as_good_as_it_was(path):
    then, now = GOLDEN[name_of(path)], answer(path)
    assert agree(then["status"], now["status"])
    assert now.get("proved") == then.get("proved")
    if "error" in then:
        assert now["error"] <= then["error"] * (1 + WORSE)
        assert now["claims"].keys() == then["claims"].keys()
        assert all(agree(verdict, now["claims"][claim]) for claim, verdict in then["claims"].items())


@pytest.mark.parametrize(
    "path", mostly_slow([path for path in DESIGNS if "near" in GOLDEN[name_of(path)]], FAST), ids=name_of
)
def test_recorded_gains_and_gains_near_them_are_judged_as_they_were(path):
    then = GOLDEN[name_of(path)]
    now = near(path, then)
    assert {place: verdict for place, verdict in now.items() if not agree(then["near"][place], verdict)} == {}


EXPECTED = {
    f"tests/reference/{folder}{name}.toml": (known.get("error", known.get("coupling")), worse)
    for folder, worse in (("hands/", 5e-3), ("real/", 3e-3), ("servo/", 1e-3), ("worlds/", 1e-2))
    for name, known in json.loads((ROOT / f"tests/reference/{folder}expected.json").read_text()).items()
}
"""Least errors of searches on grids that share nothing with vctune, and by how much a design may be worse."""


@pytest.mark.parametrize("name", EXPECTED)
def test_recorded_designs_are_as_good_as_those_of_independent_searches(name):
    """That they are found is asserted where they are recorded."""
    (least, worse), known = EXPECTED[name], GOLDEN[name]
    judged = vctune.judge(vctune.read_problem(ROOT / name).problem, vctune.Gains(*known["gains"]), coupling_of(known))
    assert judged.status.value == "certified"
    assert (judged.transparency.coupling if "servo" in name else judged.error) <= least * (1 + worse)


@pytest.mark.parametrize("name", mostly_slow(LIMITS, list(LIMITS)[::3]))
def test_the_limit_of_a_number_is_where_it_was(name):
    """To .2 % on either side, with the other numbers of the design fixed."""
    greater, at = LIMITS[name].greater, GOLDEN["limits"][name]
    assert passes(name, at * (1 + BESIDE if greater else 1 - BESIDE))
    assert not passes(name, at * (1 - BESIDE if greater else 1 + BESIDE))


@pytest.mark.slow
def test_what_is_left_open_is_not_called_proved():
    """Without K_p and drag the margin vanishes at 0 Hz in a hand of nothing; all other claims are proved."""
    problem = parse_problem(OPEN, "open", "open")
    judgement = vctune.judge(problem, *problem.fixed_design)
    assert judgement.status.value == "undecided"
    verdicts = [outcome.verdict.value for outcome in judgement.certificate.outcomes.values()]
    assert sorted(verdicts) == ["proved", "proved", "undecided"]


def test_a_mistake_has_its_code_its_key_and_its_line():
    assert bad_files() == GOLDEN["bad files"]
