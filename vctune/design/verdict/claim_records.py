"""Record each claim; for a failed one, also record its place, and a hand and environment that destabilise the loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from vctune.analysis.destabilising import GrowingEnvironment, destabilising, growing_in_worlds
from vctune.analysis.lossless_hand import growing_in_any_hand
from vctune.analysis.worlds.growing_in_time import growing_in_time
from vctune.design.verdict.judge import Judgement
from vctune.design.verdict.uncertainty_record import device_record
from vctune.document.records.certificate_json import ClaimRecord, EnvironmentRecord, HandRecord, ResonatorRecord
from vctune.document.records.changing_json import ChangingRecord, ExaminedRecord, StorageRecord
from vctune.model.device import Device
from vctune.model.gains import Coupling, SpringDamper
from vctune.model.hands import Hands, LeastOperator
from vctune.model.numbers.frequency import finite_hertz, hertz
from vctune.model.numbers.units import UNITS
from vctune.model.problem import Problem
from vctune.model.sampled.changing.loop_states import Law, states_of
from vctune.model.sampled.changing.storage_function import Storage, terms_of
from vctune.proof.claims.registry import CLAIMS, ClaimId
from vctune.proof.engine.interval import Outcome, Verdict
from vctune.proof.storage.changing import Examined


def claim_records(problem: Problem, judgement: Judgement) -> list[ClaimRecord]:
    """Return the record of each claim."""
    outcomes = judgement.certificate.outcomes
    return [_claim(problem, judgement, claim, outcome) for claim, outcome in outcomes.items()]


def changing_record(problem: Problem, judgement: Judgement) -> dict[str, ChangingRecord]:
    """Return the record of the claim on hands whose damping changes; empty if the problem does not make this claim."""
    hands, outcome = problem.changing_hands, judgement.certificate.outcomes.get("changing")
    if hands is None or outcome is None:
        return {}
    return {"changing": ChangingRecord(**_changing(judgement, hands, outcome))}


def examined_record(judgement: Judgement, examined: Examined) -> ExaminedRecord:
    """Return the record of hands whose damping changes, for a problem that does not require the claim."""
    return ExaminedRecord(**_changing(judgement, *examined))


def _changing(judgement: Judgement, hands: Hands, outcome: Outcome) -> dict[str, Any]:
    also: dict[str, Any] = {}
    if outcome.storages:
        assert isinstance(judgement.coupling, Coupling)
        law = Law(judgement.gains, judgement.coupling)
        also["storages"] = [_storage(found, law) for found in outcome.storages]
    box = {name: list(ends) for name, ends in hands.ranges.items()}
    return {"verdict": outcome.verdict.value, "box": box, "boxes": outcome.boxes, **also}


def _storage(found: Storage, law: Law) -> StorageRecord:
    device = {each.key: [each.low, each.high] for each in found.box.numbers}
    matrices = [[list(row) for row in term] for term in found.terms]
    also: dict[str, Any] = {"device": device} if device else {}
    return StorageRecord(states=states_of(found.plain, law), terms=terms_of(found.box), matrices=matrices, **also)


def _claim(problem: Problem, judgement: Judgement, claim: ClaimId, outcome: Outcome) -> ClaimRecord:
    also: dict[str, Any] = {"cut": True} if outcome.cut else {}
    if outcome.device is not None:
        also["witness_device"] = device_record(outcome.device, problem)
    if outcome.hand is not None:
        also["witness_hand"] = HandRecord(**asdict(outcome.hand))
    if outcome.verdict is Verdict.REFUTED and claim in GROWING:
        also |= GROWING[claim](problem, judgement, outcome)
    return ClaimRecord(
        id=claim,
        claim=CLAIMS[claim].said_of(problem.device.kind),
        verdict=outcome.verdict.value,
        witness_hz=finite_hertz(outcome.witness),
        **also,
    )


def _environment(problem: Problem, judgement: Judgement, outcome: Outcome) -> dict[str, EnvironmentRecord]:
    """Return an environment with which the loop is unstable, in the hand of the witness or the worst hand."""
    device, held, places = outcome.device or problem.device, judgement.in_hand, []
    if outcome.hand is not None and outcome.witness is not None:
        places.append((outcome.hand, outcome.witness))
    if outcome.device is None and held is not None:
        places.append((held.hand, held.omega))
    law = judgement.gains, judgement.coupling
    if problem.worlds is not None:
        worlds = problem.worlds
        growing_with = growing_in_worlds if worlds.lossless else growing_in_time
        tried = [(hand, growing_with(device, *law, hand, at, worlds)) for hand, at in places]
    else:
        tried = [(hand, destabilising(device, *law, hand, at)) for hand, at in places]
    growing = [(hand, found) for hand, found in tried if found is not None]
    if not growing:
        return {}
    hand, found = max(growing, key=lambda pair: pair[1].growth)
    return _environment_record(device, HandRecord(**asdict(hand)), found)


def _environment_of_any_hand(problem: Problem, judgement: Judgement, outcome: Outcome) -> dict[str, EnvironmentRecord]:
    """Return a lossless hand and an environment with which the loop is unstable; empty if the function finds none."""
    device = outcome.device or problem.device
    assert isinstance(judgement.coupling, SpringDamper)
    found = growing_in_any_hand(device, judgement.gains, judgement.coupling)
    if found is None:
        return {}
    hand, environment = found
    held = device.operator or LeastOperator(0.0, 0.0)
    resonators = [ResonatorRecord(mass=mass, stiffness=stiffness) for mass, stiffness in hand.resonators]
    also: dict[str, Any] = {"resonators": resonators} if resonators else {}
    record = HandRecord(mass=hand.mass + held.mass, damping=held.damping, stiffness=hand.stiffness, **also)
    return _environment_record(device, record, environment)


# Functions that find an environment with which the loop of a refuted design is unstable, by the identifier of the claim
GROWING: dict[ClaimId, Callable[[Problem, Judgement, Outcome], dict[str, EnvironmentRecord]]] = {
    "hands": _environment,
    "worlds": _environment,
    "any_hand": _environment_of_any_hand,
}


def _environment_record(device: Device, hand: HandRecord, found: GrowingEnvironment) -> dict[str, EnvironmentRecord]:
    record = EnvironmentRecord(
        hand=hand,
        kind=found.kind,
        value=found.value,
        unit=UNITS[device.units].of(found.quantity),
        damping=found.damping,
        hz=hertz(found.omega),
        growth_per_s=found.growth,
        **({"stiffness": found.stiffness} if found.stiffness else {}),
        rule=None if found.rule == "trapezoid" else found.rule,
        late=found.late or None,
    )
    return {"environment": record}
