"""Prove the best design that an estimate offers; refuted, the estimate sees more and offers again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import pi
from typing import NamedTuple

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.analysis.worst_hand import BESIDE
from vctune.design.judging.judge import PROVING, Judgement, Status, certified, judgement_of
from vctune.design.prepared import Posed
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import Hand
from vctune.proof.certificate import Certificate
from vctune.proof.claims.registry import claims_about
from vctune.proof.outcome import Verdict
from vctune.running import OutOfTimeError, boxes_at_most, seconds_left, time_limit

ROUNDS, RESERVE = 12, 1e-4  # proofs, and the reserve of the first; it doubles with each
MOST_BOXES = 100_000  # of one proof
RATIO_RESERVE = 0.01  # of a damping ratio, so that the first proof mostly succeeds: an arm needs 0.3 % more drag
UNDECIDED = 3  # Factor of the reserve after an undecided proof, which takes much longer than a refuted one
OF_COUPLING = claims_about("ratio", "in_hand", "damping_ratio")

Law = tuple[Gains, AnyCoupling]


@dataclass(frozen=True, slots=True)
class LookedAt:
    """Where an estimate looks, and the share beyond the safety factor that it keeps for what it does not see."""

    devices: Sequence[Device]
    hands: Sequence[Hand]
    angles: Floats = field(default_factory=lambda: np.empty(0))  # rad, beside places where designs were refuted
    reserve: float = RESERVE

    def with_refuted(self, certificate: Certificate) -> LookedAt:
        """Return this with the places at which a design was refuted, and twice the reserve, or more after an undecided
        proof."""
        lost = [each for each in certificate.outcomes.values() if each.verdict is Verdict.REFUTED]
        hands = [each.hand for each in lost if each.hand is not None]
        devices = [each.device for each in lost if each.device is not None]
        T = certificate.design.device.sample_time
        beside = [np.minimum(each.witness * T * BESIDE, pi) for each in lost if each.witness]
        return LookedAt(
            list(dict.fromkeys([*self.devices, *devices])),
            list(dict.fromkeys([*self.hands, *hands])),
            np.unique(np.concatenate([self.angles, *beside])),
            (UNDECIDED if certificate.verdict is Verdict.UNDECIDED else 2) * self.reserve,
        )


class Proved(NamedTuple):
    """A design that was proved, or the last that was tried, and where the estimate had looked."""

    judgement: Judgement
    seen: LookedAt

    @property
    def certified(self) -> bool:
        """Whether the design is proved."""
        return self.judgement.status is Status.CERTIFIED


def first_proved(posed: Posed, seen: LookedAt, best: Callable[[LookedAt, Law | None], Law | None]) -> Proved | None:
    """Return the first proved design of those that are best as far as is seen, or else the last that was tried; None if
    there is none. `best` is given the last design."""
    bounds, law = posed.problem.bounds, None
    given = bounds.velocity.fixed and bounds.position.fixed
    tried: tuple[Certificate, LookedAt] | None = None
    for _ in range(ROUNDS):
        try:
            law = best(seen, law)
        except OutOfTimeError:
            if tried is None or tried[0].verdict is Verdict.REFUTED:  # another design may be proved
                raise
            break
        if law is None:
            break
        with boxes_at_most(MOST_BOXES), time_limit(PROVING * seconds_left()):
            tried = certified(Design(posed.demands.device, *law), posed.demands, posed.box), seen
        claims = [claim for claim in tried[0].outcomes if claim in OF_COUPLING or not given]
        if all(tried[0].outcomes[claim].verdict is Verdict.PROVED for claim in claims):
            break  # certified, or given gains fail
        seen = seen.with_refuted(tried[0])
    if tried is None:
        return None
    certificate, seen = tried
    return Proved(judgement_of(posed, certificate.design.gains, certificate.design.coupling, certificate), seen)
