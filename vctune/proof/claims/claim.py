"""A claim of a certificate: its statement, how it is proved for a design, and how for cells of designs.

Each claim is a row in the module of its margin; `vctune.proof.claims.registry` lists them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.display import Display
from vctune.model.hands import Hand
from vctune.model.numbers.arithmetic import Number
from vctune.proof.claims.cases import Case
from vctune.proof.claims.covered import Covered, Place
from vctune.proof.device_box import DeviceBox
from vctune.proof.enclosures.intervals import Flags
from vctune.proof.outcome import Outcome

ClaimId = str  # public name of a claim in design.json; once a file contains it, it never changes
Quantity = Literal["ratio", "in_hand", "sensitivity", "unmodelled", "poles", "rest", "damping_ratio"]


class Suspect(NamedTuple):
    """A device and a hand of their boxes in which a pole seems to be on the unit circle between two angles."""

    device: Device
    hand: Hand
    angles: tuple[float, float]  # omega T, rad; twice the same if it seems to be there


# A function that says where to look for a failure in hands. Whatever it returns, a verdict is proved
Suspects = Callable[[Design, Demands, Sequence[Device]], Iterable[Suspect]]


def no_suspects(_design: Design, _demands: Demands, _devices: Sequence[Device]) -> Iterable[Suspect]:
    """Return no place to look at."""
    return ()


@dataclass(frozen=True, slots=True)
class Question:
    """The data for the proof of a claim."""

    design: Design  # design with plain numbers
    demands: Demands  # the constraints on the design
    box: DeviceBox | None = None  # box of devices for which the claim is to be proved; None for the design's own device
    suspects: Suspects = no_suspects  # says where to look for a failure in hands
    ringing: Suspects = no_suspects  # says in which hands the loop seems to be damped least

    @property
    def covered(self) -> DeviceBox | None:
        """The devices for which the conditions on the band differ; without gains and unmodelled dynamics none does."""
        alike = self.box is not None and not self.design.gains.closed and self.box.nominal.unmodelled is None
        return None if alike else self.box

    @property
    def modelled(self) -> tuple[Design, Demands, DeviceBox | None]:
        """The same data without unmodelled dynamics: each device has its nominal response."""
        return self.design, self.demands, self.covered and self.covered.modelled


Outcomes = Mapping[ClaimId, Outcome]


@dataclass(frozen=True, slots=True)
class Claim:
    """A statement about a design that a certificate proves or refutes."""

    id: ClaimId
    # the statement; {couples} stands for Z_c or 1/Z_c, {spring} for k_c or K_p, {passive} for "any passive hand"
    sentence: str
    # the limited quantity, by the name that the search's constraints use; "ratio" and "in_hand" are of the coupling
    quantity: Quantity
    margin: Callable[..., Any]  # function that is positive, or a curve that makes no turn around 0
    witness: str  # description of the place where the claim fails
    label: str  # heading of the claim's row in a report
    explain: str  # meaning of the claim for the reader
    when: str  # the condition `asked` in words: "A certificate makes it ..."
    asked: Callable[[Demands, DeviceBox | None], bool]
    prove: Callable[[Question, Outcomes], Outcome]  # also takes the outcomes of the claims before it
    cells: Callable[[Covered], Flags] | None = None  # the cells in which it is proved; None if it is not for cells
    # the cells throughout which no design meets it, with an estimated place of each where it is hardest to meet
    lost: Callable[[Covered, Place], Flags] | None = None
    required: Callable[[Case, Number], Number] | None = None  # the least feasible Re Z_c, N s/m

    def said_of(self, kind: Display, passive: str = "any passive hand") -> str:
        """Return the claim's statement about a kind of display, with any passive hand in words."""
        return self.sentence.format(couples=kind.couples, passive=passive, spring="k_c" if kind.inverse else "K_p")
