"""Record each claim; for a failed one, also the frequency, device and hand where it fails."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from vctune.design.verdict.judge import Judgement
from vctune.design.verdict.uncertainty_record import device_record
from vctune.document.records.certificate_json import ClaimRecord, HandRecord
from vctune.model.numbers.frequency import finite_hertz
from vctune.model.problem import Problem
from vctune.proof.claims.registry import CLAIMS, ClaimId
from vctune.proof.engine.interval import Outcome


def claim_records(problem: Problem, judgement: Judgement) -> list[ClaimRecord]:
    """Return the record of each claim."""
    outcomes = judgement.certificate.outcomes
    return [_claim(problem, judgement, claim, outcome) for claim, outcome in outcomes.items()]


def _claim(problem: Problem, judgement: Judgement, claim: ClaimId, outcome: Outcome) -> ClaimRecord:
    also: dict[str, Any] = {"cut": True} if outcome.cut else {}
    if outcome.device is not None:
        also["witness_device"] = device_record(outcome.device, problem)
    if outcome.hand is not None:
        also["witness_hand"] = HandRecord(**asdict(outcome.hand))
    return ClaimRecord(
        id=claim,
        claim=CLAIMS[claim].said_of(problem.device.kind),
        verdict=outcome.verdict.value,
        witness_hz=finite_hertz(outcome.witness),
        **also,
    )
