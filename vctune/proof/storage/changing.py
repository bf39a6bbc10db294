"""The claim that the damping of the hand may change from sample to sample (model/README.md, section 21)."""

from __future__ import annotations

from vctune.model.hands import Hands
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.engine.interval import Outcome, Verdict
from vctune.proof.storage.candidates import candidate, grid, hand_without
from vctune.proof.storage.storage_proof import prove_storage

ROUNDS = 4
"""Greatest number of candidates. For each further candidate, the search adds the hand in which the last one failed.
Most proofs need only the first."""
MAX_BOXES = 20_000
"""Number of boxes after which the prover gives up on a candidate. A design with a large margin takes some hundred. Half
or twice this number leads to the same proofs."""


def prove_changing(design: Design, hands: Hands) -> Outcome:
    """Prove the loop stable with every passive environment while the damping of the hand changes at every sample.

    Parameters
    ----------
    design : design; its floats stand for the decimals that they print as
    hands : box of hands; mass and stiffness of each hand are constant

    Returns
    -------
    Outcome
        Proved with the storage function, or undecided; never refuted, because another storage function may exist.
    """
    boxes = 0
    at = grid(hands)
    for _ in range(ROUNDS):
        storage = candidate(design, hands, at)
        if storage is None:
            return Outcome(Verdict.UNDECIDED, boxes, hand=hand_without(design, hands))
        found = prove_storage(design, storage, MAX_BOXES)
        boxes += found.boxes
        if found.open is None:
            return Outcome(Verdict.PROVED, boxes, storage=storage)
        if not found.fails:
            break
        at = at.with_hand(found.open, hands)
    return Outcome(Verdict.UNDECIDED, boxes, hand=found.open)
