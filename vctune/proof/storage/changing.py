"""The claim that the damping of the hand may change from sample to sample (model/README.md, section 21)."""

from __future__ import annotations

from typing import NamedTuple

from vctune.model.sampled.changing.storage_function import Held
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.engine.interval import Outcome, Verdict
from vctune.proof.storage.candidates import candidate, grid, hand_without, joined, vertices
from vctune.proof.storage.storage_proof import prove_storage


class Effort(NamedTuple):
    """How much a proof may cost.

    Attributes
    ----------
    rounds : candidates that are tried, each with a hand more in which the last one failed; most proofs take the first
    boxes : boxes before a candidate is given up
    """

    rounds: int
    boxes: int


ASKED = Effort(4, 20_000)
"""For a design that asks for the claim. Half and twice it: the same proofs."""


def prove_changing(design: Design, box: Held, effort: Effort = ASKED) -> Outcome:
    """Prove the loop stable with every passive environment while the damping of the hand changes at every sample.

    Parameters
    ----------
    design : taken as the decimals that it is written as; its device has the states of every device of the box
    box : hands and devices; only the damping changes
    effort : how much it may cost

    Returns
    -------
    Outcome
        Proved with the storage function, or undecided; never refuted, because another storage function may exist.
    """
    if candidate(design, box, vertices(box)) is None:
        return Outcome(Verdict.UNDECIDED, 0, hand=hand_without(design, box))
    boxes, at, open_ = 0, grid(design, box), None
    for _ in range(effort.rounds):
        storage = candidate(design, box, at)
        if storage is None:
            break
        found = prove_storage(design, storage, effort.boxes)
        boxes += found.boxes
        if found.open is None:
            return Outcome(Verdict.PROVED, boxes, storage=storage)
        open_ = box.on(design.device, found.open.tolist())[0]
        if not found.fails:
            break
        at = joined(at, found.open, box)
    return Outcome(Verdict.UNDECIDED, boxes, hand=open_)
