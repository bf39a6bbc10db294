"""Every kind of claim next to its limit: no verdict is wrong, where a frequency decides and where a step grows."""

from __future__ import annotations

import re
import sys
from collections import Counter
from dataclasses import replace
from functools import cache
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pytest
from conftest import DRAWS, WHOLE, mostly_slow
from draws import Tables, in_units
from kinds import KINDS, LONG, Drawn, Witness, walled
from loop import Loop
from sentences import NEAR, SENTENCES, Sentence
from walls import condition, grows, random_wall, speeds, with_share

import vctune
from vctune.design.ros.admittance_check import check_admittance
from vctune.document import reading
from vctune.document.ros import Admittance, AdmittanceFile
from vctune.document.text.toml import toml_text
from vctune.proof.outcome import worst_verdict
from vctune.running import time_limit

SIDES = (1e-3, -1e-3, 1e-5, -1e-5)
MANY = max(DRAWS, 2)
"""Problems of each kind in a slow run."""
OFTEN = ("passive", "hands", "any hand")
"""Kinds that are tried each time."""


@cache
def drawn(kind: str, number: int) -> Drawn:
    return KINDS[kind](np.random.default_rng((97, list(KINDS).index(kind), number)))


def outcome(tables: Tables, claim: str) -> Any:
    problem = vctune.problem(tables).problem
    return vctune.judge(problem, *problem.fixed_design).certificate.outcomes[claim]


def witness_of(found: Any, problem: Tables) -> Witness:
    hand = None if found.hand is None else (found.hand.mass, found.hand.damping, found.hand.stiffness)
    keys = problem.get("uncertainty", {}) if found.device is not None else {}
    return Witness(found.witness, hand, {key: found.device.number(key) for key in keys if key != "unmodelled"} or None)


def said(kind: str, number: int, side: float) -> str:
    """Return what a proof says beside the limit of a problem, and assert that it is not wrong."""
    case = drawn(kind, number)
    tables = case.tables(side)
    found = outcome(tables, case.claim)
    verdict = found.verdict.value
    assert verdict != "proved" or side > 0, (kind, number, side)
    if verdict == "refuted":  # on the other side only where the search of the oracle has missed the worst place
        assert case.missed(tables, witness_of(found, tables)), (kind, number, side, found)
        return "refuted" if side < 0 else "refuted, and the search had missed it"
    return verdict


def tried(kind: str, numbers: range) -> Counter[str]:
    counts: Counter[str] = Counter()
    for number in numbers:
        sides = SIDES if kind not in LONG or DRAWS >= WHOLE else SIDES[:2]
        counts.update(said(kind, number, side) for side in sides)
    return counts


@pytest.mark.parametrize("kind", mostly_slow(KINDS, OFTEN))
def test_no_verdict_is_wrong(kind):
    counts = tried(kind, range(2))
    assert counts["undecided"] <= 1 and counts["proved"] and counts["refuted"], counts


LEAST_DECIDED = 0.85
QUICK = ("wall in hands", "wall in any hand, parts")
"""Sentences that are tried each time."""
SECONDS = 20.0
"""For each verdict."""


@cache
def at_limit(kind: str, number: int) -> Sentence:
    return SENTENCES[kind](np.random.default_rng((197, list(SENTENCES).index(kind), number)))


def judged(case: Sentence, side: float) -> tuple[str, Any]:
    """Return the verdict on a problem at t, and where it is refuted."""
    file = reading.problem_file(toml_text(case.tables(side)), Path("drawn.toml"))
    with time_limit(SECONDS):
        if case.rule is not None:
            mass, stiffness, rate, coefficient = case.rule(side)
            axis = AdmittanceFile((Admittance("x", mass, 0.0, stiffness, rate, 1),), coefficient, 1, {})
            (found,) = check_admittance(file, Path("ros.yaml"), axis)
            named = {"passed": "proved", "failed": "refuted"}.get(found.verdict.name.lower(), "undecided")
            return named, found.message
        outcomes = vctune.judge(file.problem, *file.problem.fixed_design).certificate.outcomes
    asked = [outcomes[case.claim]] if case.claim else list(outcomes.values())
    verdict = worst_verdict(each.verdict for each in asked)
    return verdict.value, next(each for each in asked if each.verdict is verdict)


def grows_there(case: Sentence, side: float, found: Any) -> bool:
    """Return whether the stepped loop grows where a proof says that it fails."""
    if isinstance(found, str):
        hand = re.search(r"in the hand of (\S+) [^,]+, (\S+) [^,]+, (\S+) ", found)
        return hand is not None and case.grows(side, [float(x) for x in hand.groups()], None, 0.0)
    hand = (0.0, 0.0, 0.0) if found.hand is None else (found.hand.mass, found.hand.damping, found.hand.stiffness)
    tables = case.tables(side)
    if found.hand is not None and "operator" in tables:
        ends = (tables["operator"][name] for name in ("mass", "damping", "stiffness"))
        if not all(end["min"] * (1 - 1e-9) <= x <= end["max"] * (1 + 1e-9) for x, end in zip(hand, ends, strict=True)):
            return False  # a hand that is not of the box
    keys = tables.get("uncertainty", {}) if found.device is not None else {}
    numbers = [found.device.number(key) for key in keys if key != "unmodelled"]
    return case.grows(side, hand, numbers or None, found.witness or 0.0)


@pytest.mark.parametrize("kind", mostly_slow(SENTENCES, QUICK))
def test_no_sentence_is_wrong(kind, capsys):
    """Half a per cent on the stable side of a limit that is stepped nothing is refuted, on the other nothing proved."""
    counts, wrong, took = Counter[str](), [], 0.0
    for number in range(MANY):
        case = at_limit(kind, number)
        for name, side in (("inside", 1 + NEAR), ("outside", 1 - NEAR)):
            began = perf_counter()
            verdict, found = judged(case, side)
            took += perf_counter() - began
            if name == "inside" and verdict == "refuted" and grows_there(case, side, found):
                verdict = "missed by the search"
            elif (name, verdict) in (("inside", "refuted"), ("outside", "proved")):
                text = toml_text(case.tables(side))
                wrong.append(f"{name} {verdict}, number {number}, limit {case.limit}: {found}\n{text}{case.rule}")
            counts[f"{name} {verdict}"] += 1
    with capsys.disabled():
        sys.stdout.write(f"\n{kind}: {dict(sorted(counts.items()))}, {took:.1f} s")
    assert not wrong, "\n".join(wrong)
    open_outside = 0 if at_limit(kind, 0).on_edge else counts["outside undecided"]
    assert counts["inside undecided"] + open_outside <= max(1, (1 - LEAST_DECIDED) * 2 * MANY), counts


UNITS = [(2.0**40, 2.0**-40), (2.0**-40, 2.0**-40), (32.0, 0.125), (2.0**-40, 2.0**40)][: 4 if DRAWS >= WHOLE else 2]
"""Units of mass and time; a unit of length is in no number of a linear device."""


@pytest.mark.parametrize("kind", mostly_slow(KINDS, OFTEN))
@pytest.mark.parametrize("units", mostly_slow(UNITS, UNITS[:1]))
def test_units_change_nothing(kind, units):
    """But whether a proof ends within its boxes, of which other numbers take a few more or less."""
    for number in range(1 if kind not in LONG else MANY // 4):
        case = drawn(kind, number)
        for side in (1e-3, -1e-3):
            tables = case.tables(side)
            verdicts = {outcome(posed, case.claim).verdict.value for posed in (tables, in_units(tables, *units))}
            assert len(verdicts - {"undecided"}) == 1, (kind, number, side)


def posed_with_walls(number: int) -> tuple[Tables, Loop]:
    """Return the number-th problem with walls, with enough of its coupling for linear environments."""
    rng = np.random.default_rng((99, number))
    while True:
        found = walled(rng)
        for by in (1.0, 4.0, 16.0):
            tables, loop = found[0], with_share(found[1], by)
            coupling = dict(zip(tables["coupling"], loop.coupling, strict=True))
            if outcome(tables | {"coupling": coupling}, "worlds").verdict.value == "proved":
                return tables | {"coupling": coupling}, loop


def numbers_of(tables: Tables, table: str, end: str) -> np.ndarray:
    return np.array([tables[table][name].get(end, 0.0) for name in ("mass", "damping", "stiffness")])


@pytest.mark.parametrize("number", mostly_slow(range(3 * MANY), [0]))
def test_walls(number):
    """A proof holds by brute force and in time, a refutation names a place where the multiplier's condition fails."""
    tables, free = posed_with_walls(number)
    found, rng = outcome(tables, "walls"), np.random.default_rng((100, number))
    T, factor = tables["device"]["sample_time"], tables["stability"]["safety_factor"]
    box = numbers_of(tables, "operator", "min"), numbers_of(tables, "operator", "max")
    least, most = numbers_of(tables, "environment", "min"), numbers_of(tables, "environment", "max")
    corner = 2 * np.pi * tables["environment"]["corner_hz"]

    def left(hand: np.ndarray, theta: np.ndarray, share: float) -> float:
        loop = with_share(replace(free, hand=tuple(map(float, hand))), share)
        return float(condition(loop, theta, tuple(least), (most[0], most[2]), corner).min())

    shares = [1.0] if factor == 1 else [1.0, 1 / factor, 1 / rng.uniform(1, factor)]
    if found.verdict.value == "refuted":
        hand = np.array([found.hand.mass, found.hand.damping, found.hand.stiffness])
        theta = np.array([min(found.witness * T, np.pi * (1 - 1e-7))])
        assert min(left(hand, theta, share) for share in np.linspace(1 / factor, 1.0, 51)) <= 0
    elif found.verdict.value == "proved":
        theta = np.concatenate((np.geomspace(1e-3, 3.14, 200), rng.uniform(1e-3, 3.14, 100)))
        for trial in range(8):
            chance = rng.uniform(size=3)
            hand = box[0] + np.where(rng.random(3) < 0.7, np.round(chance), chance) * (box[1] - box[0])
            assert min(left(hand, theta, share) for share in shares) > 0
            mass = least[0] + rng.choice([0.0, rng.random() ** 3, 1.0]) * (most[0] - least[0])
            world = (float(mass), float(least[1] + rng.choice([0.0, rng.random()])), 0.0)
            loop = replace(with_share(free, shares[trial % len(shares)]), hand=tuple(map(float, hand)), world=world)
            assert not grows(speeds(loop, random_wall(least[2], most[2], 1e-3, rng), 2000, rng)), trial
