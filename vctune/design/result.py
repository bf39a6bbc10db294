"""The results of each stage of a design, as plain data for a report."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from vctune.analysis.responses import Loop
from vctune.design.judging.judge import Judgement, Status
from vctune.design.judging.said import said_of
from vctune.design.nlp.solution import Polished
from vctune.design.search.first_proved import LookedAt
from vctune.design.search.infeasible import Infeasibility
from vctune.design.search.scan import ScanResult
from vctune.document.records.part import Nullable, RecordPart, text
from vctune.document.schema.number_units import unit_of
from vctune.document.text.errors import Note
from vctune.model.hands import Hand
from vctune.model.numbers.units import Units
from vctune.model.problem import Problem

if TYPE_CHECKING:
    from vctune.design.bound.search import Optimality


# Relative change of the error, for a number that improves by 1 %, below which a price counts as zero
NO_DIFFERENCE = 5e-5


def _in_words(change: float) -> str:
    return "no difference" if abs(change) < NO_DIFFERENCE else f"{100 * change:+.2f} %"


class Price(RecordPart):
    """The effect on the least error of improving one parameter of the device while the rest of the problem stays."""

    key: str  # key of the parameter in the problem file
    old: float  # the value, and a value that is better by 1 %, in SI units and hertz
    new: float
    change: float  # first-order change of the least error as a share of this error; at most 0
    free: float | None = None  # relative change of the terms that the error does not count; null if it counts all

    @property
    def worth(self) -> str:
        """The effect of improving the number on the error, in words."""
        return _in_words(self.change)

    @property
    def worth_free(self) -> str:
        """The effect on what is felt of the device itself when free, in words."""
        return "" if self.free is None else _in_words(self.free)

    def cells(self, units: Units) -> tuple[str, str, str]:
        """Return the value, a better value, and their unit."""
        return text(self.old, 4), text(self.new, 4), unit_of(tuple(self.key.split(".")), units)


class Repair(RecordPart):
    """A change of one value of the problem file after which there is a design."""

    key: str  # dotted key
    old: Nullable  # old and new value, in the unit of the file; 1 and 0 for true and false. An infinite value is null
    new: Nullable
    change: str  # meaning of the change, in words
    needs: str  # the new line of the file, in TOML
    assumes: bool  # whether it changes what is assumed of hands, environments or the demands, not the design
    chooses: bool  # whether it changes a gain or the coupling, not the device
    size: float  # change relative to the greater of the two values, by which repairs are ordered
    error: float  # transparency error of the repaired design
    reference_impedance: float | None = None  # Z_0 of this error, N s/m, if it is not the problem's

    @property
    def told_error(self) -> str:
        """The error in words, with its yardstick if it is another than the problem's."""
        own = "" if self.reference_impedance is None else f" of its own Z_0 = {text(self.reference_impedance, 4)}"
        return f"error {text(self.error, 4)}{own}"

    def __str__(self) -> str:
        whole = self.turns_off or self.needs.startswith(f"{self.key}:")  # a line of YAML
        told = self.needs if whole else f"{self.key} = {text(self.new, 12)}"
        return f"{told} instead of {self.told_old}"

    @property
    def told_old(self) -> str:
        """The old value in words."""
        return "true" if self.turns_off else "inf" if self.old is None else text(self.old, 12)

    @property
    def turns_off(self) -> bool:
        """Whether the repair turns off what the file turns on; `old` and `new` are then 1 and 0."""
        return self.needs == f"{self.key} = false"


class Relaxation(RecordPart):
    """A demand or a bound of the problem file without which the design would be of more use."""

    needs: str  # the new line of the file, in TOML
    error: float  # transparency error of the design of the relaxed problem
    instead_of: float  # transparency error of the design of the problem, on the same yardstick

    def __str__(self) -> str:
        return f"{self.needs} would give error {text(self.error, 3)} for {text(self.instead_of, 3)}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Solved:
    """The result of a problem.

    Attributes
    ----------
    problem : Problem
        The problem.
    judgement : Judgement, optional
        Judgement of the best design; None without a design.
    polished : Polished, optional
        The local optimum before rounding; None if the optimiser did not find the design.
    seen : LookedAt, optional
        Where the search along the limit of the coupling had looked; None if it did not find the design.
    optima : int
        Number of local optima.
    infeasibility : Infeasibility, optional
        Reason why there is no design; else None.
    scanned : ScanResult, optional
        Result of the scan; None without a scan.
    seconds : dict[str, float]
        Seconds by stage.
    optimality : Optimality, optional
        Proved bound on the error of any design; None if not requested.
    repairs : list[Repair], optional
        Changes of the problem that would make a design possible; None if not requested, or if the search for them
        was cut short without one.
    tried : list[str]
        Without repairs: the keys that were changed alone in vain, each with the value up to which it was tried.
    together : list[Repair]
        Without repairs: two changes that suffice together; empty without any.
    relaxations : list[Relaxation]
        For a certified design of little use: relaxed demands and bounds that give a better one, the best first.
    prices : list[Price], optional
        Prices of the device's parameters, the greatest gain first; None if not requested, without an optimum,
        or if the design is not certified, IPOPT has not converged or the time limit ended the work.
    notes : list[Note]
        What else was found that a user should know.
    cut : tuple[str, ...]
        Stages that the time limit cut short, in words.
    """

    problem: Problem
    judgement: Judgement | None = None
    polished: Polished | None = None
    seen: LookedAt | None = None
    optima: int = 0
    infeasibility: Infeasibility | None = None
    scanned: ScanResult | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    optimality: Optimality | None = None
    repairs: list[Repair] | None = None
    tried: list[str] = field(default_factory=list)
    together: list[Repair] = field(default_factory=list)
    relaxations: list[Relaxation] = field(default_factory=list)
    prices: list[Price] | None = None
    notes: list[Note] = field(default_factory=list)
    cut: tuple[str, ...] = ()

    @property
    def status(self) -> Status:
        """The status: certified, violated, undecided or infeasible."""
        if self.judgement is not None:
            return self.judgement.status
        proved = self.infeasibility is not None and self.infeasibility.proved
        return Status.INFEASIBLE if proved else Status.UNDECIDED

    @property
    def known(self) -> str:
        """The outcome in words: the status and, if there is a design, its error."""
        judgement = self.judgement
        return self.status.value if judgement is None else f"{self.status.value} with error {judgement.error:.3g}"

    @property
    def cut_short(self) -> list[Note]:
        """Notes on the stages that a time limit, their own or the user's, or Ctrl-C cut short."""
        if not self.cut:
            return []
        *others, last = dict.fromkeys(self.cut)
        what = f"{', '.join(others)} and {last}" if others else last
        ended = f"the end of the time cut {what} short; what is stated was known by then, and --time-limit gives more"
        return [Note("time-limit", ended)]

    def loop(self, hand: Hand | None = None) -> Loop:
        """Return the sampled loop with the design, for arrays, state space and python-control.

        Parameters
        ----------
        hand : Hand, optional
            Hand at the handle; None for a device without a hand.

        Raises
        ------
        ValueError
            If there is no design.
        """
        if self.judgement is None:
            found = f"{self.problem.name}: {self.status.value}"
            raise ValueError(f"{found}, there is no design; Loop(device, gains, coupling) takes any gains")
        return self.judgement.loop(hand)

    def __repr__(self) -> str:
        return f"Solved({self.problem.name}: {self.judgement or self.status.value})"

    @property
    def reason(self) -> str | None:
        """The reason why there is no design, with the least repair; what fails of a given design; else None."""
        if self.infeasibility is None:
            open_ = self.judgement is not None and self.status is not Status.CERTIFIED
            return said_of(self.judgement) if self.judgement is not None and open_ else None
        if self.repairs:
            return f"{self.infeasibility.cause}; the least change that gives a design: {self.repairs[0]}"
        return self.infeasibility.reason
