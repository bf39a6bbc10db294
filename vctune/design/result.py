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
from vctune.document.records.design_json import Price, Repair
from vctune.document.text.errors import Note
from vctune.model.hands import Hand
from vctune.model.problem import Problem

if TYPE_CHECKING:
    from vctune.design.bound.search import Optimality


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
    prices : list[Price], optional
        Prices of the device's parameters, the greatest gain first; None if not requested, without an optimum,
        or if the design is not certified, IPOPT has not converged or the time limit ended the work.
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
    prices: list[Price] | None = None
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
