"""Certificates of devices with parts: what the oracles know is proved or refused, however near the demand it is."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable
from dataclasses import astuple, dataclass

import conftest
import numpy as np
import pytest
from device_arithmetic import DIGITS
from device_pairs import real_of
from device_scan import exact, peak, sensitivity
from random_devices import decimal
from random_loops import drawn

from vctune.model.problem import Demands
from vctune.proof.certificate import Certificate, certify
from vctune.proof.claims.many_designs import prove
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.engine.boxes import Cells
from vctune.proof.engine.interval import Verdict

FACTOR = 1.05
SIDES = (1e-3, -1e-3, 1e-5, -1e-5)
"""By how much the least ratio is above or below the factor."""
FEW, SOME, MANY = (0, 2, 3, 6, 9), range(10), range(conftest.drawn(300))
"""Numbers of designs: of the few, too, one is unstable and one louder than it may be."""


@dataclass(frozen=True)
class Posed:
    """A design, and what the oracles say of it.

    Attributes
    ----------
    expected : the verdict on each claim
    """

    design: Design
    demands: Demands
    expected: dict[str, Verdict]


def verdict(met: bool) -> Verdict:
    return Verdict.PROVED if met else Verdict.REFUTED


def posed(number: int) -> Posed:
    """Return the number-th design, whose least ratio is at an interior frequency and next to the factor."""
    rng = np.random.default_rng((41, number))
    side, loud = SIDES[number % 4], (1 + 1e-4) if number % 8 < 6 else (1 - 1e-4)
    found = drawn(rng, FACTOR * (1 + side), inside=True, stable=number % 10 != 9)
    device, gains = found.design.device, found.design.gains
    limit = decimal(peak(real_of(device), gains)[0] * loud)
    expected = {
        "passive": verdict(side > 0),
        "sensitivity": verdict(loud > 1),
        "stable_model": verdict(found.stable_model),
        "stable": verdict(found.stable),
    }
    return Posed(found.design, Demands(device, found.band, FACTOR, limit), expected)


def check_witnesses(case: Posed, certificate: Certificate) -> None:
    """Assert that where a claim is refused, 50 digits say so too."""
    real, gains = real_of(case.design.device), case.design.gains
    outcome = certificate.outcomes["passive"]
    if outcome.verdict is Verdict.REFUTED:
        low, high = case.demands.band
        assert low * (1 - 1e-12) <= outcome.witness <= high * (1 + 1e-12)
        there, resistance = exact(real, gains, case.design.coupling, outcome.witness)
        assert there < FACTOR or resistance < 0, case
    outcome = certificate.outcomes["sensitivity"]
    if outcome.verdict is Verdict.REFUTED:
        assert sensitivity(real, gains, outcome.witness, DIGITS) > case.demands.max_sensitivity, case


def judged(numbers: Iterable[int]) -> Counter[tuple[str, Verdict]]:
    """Certify designs, and prove them on arrays; return how often each claim got each verdict. None may be wrong."""
    found: Counter[tuple[str, Verdict]] = Counter()
    for number in numbers:
        case = posed(number)
        certificate = certify(case.design, case.demands)
        for claim, expected in case.expected.items():
            said = certificate.outcomes[claim].verdict
            assert said in (expected, Verdict.UNDECIDED), (number, claim, case)
            found[claim, said] += 1
        found["ALL", certificate.verdict] += 1
        check_witnesses(case, certificate)
        values = np.array([(*astuple(case.design.gains), *astuple(case.design.coupling))]).T
        proved = bool(prove(case.demands, Cells(values, values)).proved[0])
        assert not proved or set(case.expected.values()) == {Verdict.PROVED}, (number, case)
        found["ARRAYS", verdict(proved)] += 1
    return found


@pytest.mark.parametrize("numbers", [FEW, pytest.param(SOME, marks=pytest.mark.slow)], ids=["few", "some"])
def test_no_verdict_is_wrong(numbers):
    found, count = judged(numbers), len(numbers)
    assert found["ALL", Verdict.UNDECIDED] == 0, found
    assert found["ALL", Verdict.PROVED] > count / 4 and found["passive", Verdict.REFUTED] > count / 3, found


@pytest.mark.slow
def test_no_verdict_of_many_is_wrong(capsys):
    found, count = judged(MANY), len(MANY)
    with capsys.disabled():
        for (name, said), count in sorted(found.items()):
            sys.stdout.write(f"\n{name:14} {said.value:10} {count:4}")
        sys.stdout.write("\n")
    assert found["ALL", Verdict.UNDECIDED] < 0.02 * count, found
    assert found["ALL", Verdict.PROVED] > count / 4 and found["passive", Verdict.REFUTED] > count / 3, found
    assert found["stable", Verdict.REFUTED] > 0 and found["stable_model", Verdict.REFUTED] > 0, found
