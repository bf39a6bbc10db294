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
    """How much a proof may cost.

    Attributes
    ----------
    rounds : candidates that are tried, each with a hand more in which the last one failed; most proofs take the first
    boxes : boxes before a candidate is given up
    """

    rounds: int
    boxes: int


ASKED = Effort(4, 5_000)
"""For a design that asks for the claim. A flexible handle takes 3,067 boxes, a rigid device some hundred."""
IN_PASSING = Effort(1, 150)
"""For a design that does not: .1 s for a rigid device and .3 s for one with parts, in the median."""
FEW_STATES = 7
"""Greatest number of states of a loop that is examined although nobody asks. A storage for 9 states takes seconds."""
LEAST_MASSES = (0.0, 0.1, 0.5)
"""Least masses of the hands that are tried where nobody states one, as shares of the greatest mass."""


def prove_changing(design: Design, hands: Hands, devices: DeviceBox | None = None) -> Outcome:
    """Prove the loop stable with every passive environment while the damping of the hand changes at every sample.

    Parameters
    ----------
    design : taken as the decimals that it is written as
    hands : box of hands; mass and stiffness of each stay as they are
    devices : box of devices, which stay as they are; None for the design's own device

    Returns
    -------
    Outcome
        Proved with its storage functions, one for each number of whole samples of the delays, or undecided. Never
        refuted, because another storage function may exist.
    """
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
    """What is known of changing hands of a design that does not ask for the claim.

    Attributes
    ----------
    hands : box of hands; if nothing is proved, the box of the problem
    outcome : proved or undecided
    """

    hands: Hands
    outcome: Outcome


def examine_changing(design: Design, hands: Hands, beside: Sequence[Device] = ()) -> Examined | None:
    """Look whether the damping of the hand may change at every sample, with little effort.

    Parameters
    ----------
    design : taken as the decimals that it is written as
    hands : box of hands; the least mass is raised if the lightest hands fail
    beside : devices for which the same must hold, on both sides of a whole number of samples of delay

    Returns
    -------
    Examined or None
        None if the loop has too many states for a quick answer.
    """
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
    """Return the outcome for one design whose states are those of every device of a box."""
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
