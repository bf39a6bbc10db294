"""The verdict of a proof."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from vctune.model.device import Device
from vctune.model.hands import Hand
from vctune.model.numbers.units import hertz

ENCLOSED = 1.02  # Greatest quotient, either way, of a least ratio that was found and one that is proved


class Verdict(StrEnum):
    """The verdict of a proof."""

    PROVED = "proved"
    REFUTED = "refuted"
    UNDECIDED = "undecided"


def worst_verdict(verdicts: Iterable[Verdict]) -> Verdict:
    """Return refuted if any verdict is refuted, else undecided if any is undecided, else proved."""
    found = set(verdicts)
    return next(verdict for verdict in (Verdict.REFUTED, Verdict.UNDECIDED, Verdict.PROVED) if verdict in found)


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of a proof."""

    verdict: Verdict  # proved, refuted, or undecided
    boxes: int  # number of evaluated boxes
    witness: float | None = None  # frequency where the claim is refuted or undecided, rad/s
    device: Device | None = None  # device of the box for which the claim is refuted or undecided
    hand: Hand | None = None  # hand of the box in which the claim is refuted or undecided
    cut: bool = False  # whether the claim is undecided because the time limit ended the proof

    @property
    def witness_hz(self) -> float | None:
        """The witness in Hz; None without a witness."""
        return None if self.witness is None else hertz(self.witness)


def enclosed(ratio: float | str, proved: float | None) -> bool:
    """Return whether a least ratio, found in double precision at some place, is next to one that is proved.

    "none" stands for a ratio that does not exist.
    """
    if ratio == "none" or proved is None:
        return False
    return proved / ENCLOSED <= float(ratio) <= ENCLOSED * proved
