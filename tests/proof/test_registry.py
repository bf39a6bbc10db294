"""Claims have identifiers that stay; everything that is said of a claim hangs on its identifier."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from importlib import import_module
from typing import get_args

import numpy as np
import pytest
from conftest import DEVICE, for_passive_hands

from vctune import problem, solve
from vctune.api.explaining import explain
from vctune.design.search.working_set import WorkingSet
from vctune.design.verdict.claim_records import GROWING
from vctune.model.display import DISPLAYS
from vctune.proof.claims.many_designs import ON_ARRAYS, prove
from vctune.proof.claims.registry import CLAIMS, ClaimId, Quantity
from vctune.proof.engine.boxes import Cells
from vctune.proof.provers import PROVERS
from vctune.report.page.tables import VALUE_AND_LIMIT

PUBLIC = [
    "passive",
    "sensitivity",
    "stable_model",
    "stable",
    "unmodelled",
    "any_hand",
    "hands",
    "worlds",
    "walls",
    "changing",
]
"""Stand in files that others have: a new one may be added, none of these may change or go."""


def test_identifiers_stay():
    assert list(CLAIMS) == list(get_args(ClaimId)) == PUBLIC
    assert all(claim.id == name for name, claim in CLAIMS.items())


def test_what_hangs_on_a_claim_is_of_a_claim():
    assert list(PROVERS) == PUBLIC
    assert set(VALUE_AND_LIMIT) == set(PUBLIC) - {"stable_model", "changing"}, "which have no number to show"
    assert {*GROWING, *ON_ARRAYS} <= set(PUBLIC)


def test_every_quantity_is_one_that_a_search_constrains():
    known = WorkingSet()
    assert {name for name in get_args(Quantity) if known.points(name) is None} == {"poles", "storage"}
    constrained = set(get_args(Quantity)) - {"storage"}
    assert len({id(known.points(name)) for name in constrained}) == len(constrained)


@pytest.mark.parametrize("name", PUBLIC)
def test_every_claim_is_said_and_explained(name):
    claim = CLAIMS[name]
    sentences = set(map(claim.said_of, DISPLAYS.values()))
    assert all(sentence and "{" not in sentence for sentence in sentences)
    assert min(map(len, (claim.label, claim.witness))) > 5 and claim.explain.endswith(".")
    module, _, function = claim.margin.rpartition(".")
    assert callable(getattr(import_module(f"vctune.{module}"), function))
    for asked in (name, claim.label):
        (page,) = (entry.text for entry in explain(asked).entries if entry.kind == "claim")
        assert claim.explain in page and all(sentence in page for sentence in sentences)


def test_sentences_and_labels_tell_claims_apart():
    for kind in DISPLAYS.values():
        assert len({claim.said_of(kind) for claim in CLAIMS.values()}) == len(CLAIMS)
    assert len({claim.label for claim in CLAIMS.values()}) == len(CLAIMS)


def test_a_certificate_is_asked_by_identifier():
    outcomes = solve(tomllib.loads(for_passive_hands(DEVICE))).judgement.certificate.outcomes
    assert list(outcomes) == ["passive", "sensitivity", "stable_model", "stable"]


def test_no_cell_is_proved_where_a_claim_is_asked_that_cells_do_not_know(monkeypatch):
    demands = problem(tomllib.loads(for_passive_hands(DEVICE))).problem.demands
    design = np.array([[150.0], [6000.0], [160.0], [0.37], [0.0]])
    assert prove(demands, Cells(design, design)).proved.all()
    monkeypatch.setitem(CLAIMS, "unmodelled", replace(CLAIMS["unmodelled"], asked=lambda demands, box: True))
    assert not prove(demands, Cells(design, design)).proved.any()
