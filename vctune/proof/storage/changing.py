"""The claim that the damping of the hand may change from sample to sample (model/README.md, section 21)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from vctune.model.device import Device
from vctune.model.hands import Hands
from vctune.model.sampled.changing.loop_states import Law, states_of
from vctune.model.sampled.changing.storage_function import Holding, Storage
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.device_box import DeviceBox
from vctune.proof.engine.interval import Outcome, Verdict
from vctune.proof.storage.alike_devices import parts_alike
from vctune.proof.storage.candidates import candidate, grid, hand_without, joined, vertices
from vctune.proof.storage.storage_proof import prove_storage


class Effort(NamedTuple):
    """The effort after which the prover stops."""

    rounds: int  # greatest number of candidates
    boxes: int  # number of boxes after which the prover gives up on a candidate


ASKED = Effort(4, 5_000)  # Effort if the problem requires the claim
IN_PASSING = Effort(1, 150)  # Effort if the problem does not require the claim
FEW_STATES = 7  # Greatest number of states of a loop that vctune examines if the problem does not require the claim
# Least masses of the hands that `examine_changing` tries, as shares of the greatest mass
LEAST_MASSES = (0.0, 0.1, 0.5)


def prove_changing(design: Design, hands: Hands, devices: DeviceBox | None = None) -> Outcome:
    """Prove the loop stable with every passive environment while the damping of the hand changes at every sample."""
    boxes, storages = 0, list[Storage]()
    parts = parts_alike(design.device, devices)
    for device, numbers in parts:
        found = _proved(replace(design, device=device), Holding(hands, numbers), ASKED)
        boxes += found.boxes
        if found.verdict is not Verdict.PROVED:
            own = design.device if devices is None else device
            without = found.hand or hand_without(replace(design, device=own), Holding(hands))
            return replace(found, boxes=boxes, hand=without)
        storages += found.storages
    return Outcome(Verdict.PROVED if parts else Verdict.UNDECIDED, boxes, storages=tuple(storages))


class Examined(NamedTuple):
    """The result of `examine_changing` for a design whose problem does not require the claim."""

    hands: Hands  # box of hands that the proof covers; without a proof, the box of the problem
    outcome: Outcome  # proved or undecided


def examine_changing(design: Design, hands: Hands, beside: Sequence[Device] = ()) -> Examined | None:
    """Examine with little effort whether the damping of the hand may change at every sample."""
    if len(states_of(design.device, Law(design.gains, design.series))) > FEW_STATES:
        return None
    masses = {max(hands.low.mass, float(f"{share * hands.high.mass:.3g}")) for share in LEAST_MASSES}
    for least in sorted(masses):
        box = Holding(replace(hands, low=replace(hands.low, mass=least)))
        if candidate(design, box, vertices(box)) is not None:
            others = (replace(design, device=device) for device in beside)
            found = _proved(design, box, IN_PASSING)
            if any(_proved(each, box, IN_PASSING).verdict is not Verdict.PROVED for each in others):
                found = Outcome(Verdict.UNDECIDED, found.boxes)
            return Examined(box.hands if found.verdict is Verdict.PROVED else hands, found)
    return Examined(hands, Outcome(Verdict.UNDECIDED, 0))


def _proved(design: Design, box: Holding, effort: Effort) -> Outcome:
    """Return the outcome for a design and a box whose devices all have the states of the design's own device."""
    boxes, at, open_ = 0, grid(design, box), None
    for _ in range(effort.rounds):
        storage = candidate(design, box, at)
        if storage is None:
            break
        found = prove_storage(design, storage, effort.boxes)
        boxes += found.boxes
        if found.open is None:
            return Outcome(Verdict.PROVED, boxes, storages=(storage,))
        open_ = box.on(design.device, found.open.tolist())[0]
        if not found.fails:
            break
        at = joined(at, found.open, box)
    return Outcome(Verdict.UNDECIDED, boxes, hand=open_)
