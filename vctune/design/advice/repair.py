"""Find repairs: the least changes of one value after which a problem has a certified design, each sufficient alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import reduce
from math import inf, isclose, nan
from time import perf_counter
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from vctune.design.advice.pairs import SIZES, Pair, pairs
from vctune.design.advice.parameter_changes import ParameterChange, change_of_gain, parameter_changes
from vctune.design.advice.reserve import reserve
from vctune.design.judging.judge import Judgement, Status, certified, judgement_of, with_best_corner
from vctune.design.prepared import pose
from vctune.design.result import Repair, Solved
from vctune.document.gains_file import design_numbers, design_tables
from vctune.document.reading import ProblemFile, problem_at
from vctune.document.text import toml
from vctune.model.design import Design
from vctune.model.hands import Hand
from vctune.model.numbers.units import SYMBOLS
from vctune.model.problem import Problem
from vctune.proof.outcome import Verdict
from vctune.running import (
    OutOfTimeError,
    boxes_at_most,
    check_time,
    ended_by_interrupt,
    out_of_time,
    seconds_left,
    time_limit,
)

REPAIRS = "the repairs"  # Name of a stage that a time limit may cut short
SAME_YARDSTICK = 1e-6  # Relative difference of two Z_0 up to which errors are on one yardstick
TOLD = 3  # Greatest number of changes that are listed because none of them suffices alone
MOST, ASSUMED = 4, 1  # Greatest number of repairs, and number of them that may change an assumption if others are found
# Greatest number of designs that a search proves, and number of them for which a solved problem counts; greatest number
# of boxes of each proof and of all. They bound its time and, unlike seconds, give the same answer on every machine
MOST_PROVED, SOLVED = 24, 2
MOST_BOXES, MOST_BOXES_IN_ALL = 20_000, 60_000
# Greatest time, s, of the search for repairs of a problem without a design. A time limit that the user gives takes its
# place
MOST_SECONDS = 10.0
CLOSE, NEAR = 0.01, 0.05  # Shares of a change within which its limit is estimated, and found by proofs where it must be
BACK = (0.0, 0.01, 0.03)  # Shares of a change beyond its estimated limit at which a proof is tried
# Greatest number of halvings between a value that fails and one that passes, for a given design and for a problem that
# is solved again with each value
HALVINGS, HALVINGS_SOLVED = 24, 6
PEAK_STEPS, NEARLY = 4, 0.8  # in which a maximum between two steps is looked for, if the reserve of a step exceeds this

Progress = Callable[[str], None]
AnyChange = ParameterChange | Pair
ProblemOf = Callable[[dict[str, Any]], Problem | None]


class Found(NamedTuple):
    """Repairs, None if the search was cut short or not begun; without any, some of what was tried in vain to its ends;
    and two changes that suffice together, of the law if no single one of the law does."""

    repairs: list[Repair] | None = None
    tried: Sequence[str] = ()
    together: Sequence[Repair] = ()


def with_repairs(file: ProblemFile, solved: Solved, progress: Progress = lambda stage: None) -> Solved:
    """Return the result of a problem with repairs if it has no design, or if its design is refuted."""
    problem, judgement, began = file.problem, solved.judgement, perf_counter()
    if judgement is not None and solved.status is not Status.VIOLATED:
        return solved
    if out_of_time():
        return replace(solved, cut=(*solved.cut, REPAIRS))
    document = toml.parse(file.text, problem.name)
    with time_limit(MOST_SECONDS if seconds_left() == inf else inf), ended_by_interrupt():
        found = find_repairs(document, parameter_changes(document, problem), hands_of(judgement), progress)
        cut = (REPAIRS,) * out_of_time()
    seconds = perf_counter() - began
    return replace(
        solved,
        repairs=found.repairs,
        tried=list(found.tried),
        together=list(found.together),
        seconds={**solved.seconds, "repairs": seconds},
        cut=(*solved.cut, *cut),
    )


def edits(problem: Problem, judgement: Judgement, solved: Mapping[str, float]) -> list[ParameterChange]:
    """Return one change for each variable that differs from the solved design, with the solved value as its limit."""
    given = design_numbers(judgement.kind, judgement.gains, judgement.coupling)
    return [change_of_gain(problem, key, given[key], new) for key, new in solved.items() if new != given[key]]


def repairs_of_design(
    stated: dict[str, Any],
    judgement: Judgement,
    changed: Sequence[ParameterChange],
    progress: Progress = lambda stage: None,
) -> tuple[Found, bool]:
    """Return the changes of one value after which a refuted design passes, and whether only all edits together undo
    it."""
    pasted = stated | design_tables(judgement.kind, judgement.gains, judgement.coupling)
    problem = _posed(pasted)
    assert problem is not None, "a valid problem with valid gains is one"
    solved = {change.key: change.limit for change in changed}
    with time_limit(MOST_SECONDS if problem.stability.calm else inf):  # each value that is tried is kicked
        found = find_repairs(pasted, parameter_changes(pasted, problem), hands_of(judgement), progress, solved=solved)
    with suppress(OutOfTimeError):
        if len(changed) > 1 and not any(repair.key in SYMBOLS for repair in found.repairs or []):
            undone = reduce(lambda document, edit: edit.applied(document, edit.limit), changed, pasted)
            return found, _proved(_posed(undone)).error is not None
    return found, False


def hands_of(judgement: Judgement | None) -> list[Hand]:
    """Return the hands in which a design was refuted, or has its least ratio."""
    if judgement is None:
        return []
    refuted = (found.hand for found in judgement.certificate.outcomes.values())
    hands = [*refuted, *(margin.hand for margin in judgement.margins)]
    return list(dict.fromkeys(hand for hand in hands if hand is not None))


def _posed(document: dict[str, Any]) -> Problem | None:
    return problem_at(document, "")[0]


class _Proof(NamedTuple):
    error: float | None  # of the certified design; None if there is none
    boxes: int = 0
    hand: Hand | None = None  # in which the given design is refuted


def _proved(problem: Problem | None) -> _Proof:
    """Judge the design that a problem fixes, or solve the problem."""
    if problem is None:
        return _Proof(None)
    with boxes_at_most(MOST_BOXES):
        if not problem.bounds.fixed:
            from vctune.design.solve import solve

            solved = solve(problem, exhaustive=False)  # without the search of every box, which can take half a minute
            check_time()
            found = solved.judgement if solved.status is Status.CERTIFIED else None
            return _Proof(None if found is None else found.transparency.error)
        law = problem.fixed_design
        posed = with_best_corner(pose(problem), *law)
        certificate = certified(Design(posed.demands.device, *law), posed.demands, posed.box)
    check_time()  # at the time limit the proof may be incomplete
    if certificate.verdict is Verdict.PROVED:
        calm = not problem.stability.calm or judgement_of(posed, *law, certificate).status is Status.CERTIFIED
        return _Proof(posed.error(*law) if calm else None, certificate.boxes)
    refuted = (found.hand for found in certificate.outcomes.values() if found.verdict is Verdict.REFUTED)
    return _Proof(None, certificate.boxes, next((hand for hand in refuted if hand is not None), None))


@np.errstate(all="ignore")
def find_repairs(
    document: dict[str, Any],
    changes: Iterable[ParameterChange],
    hands: Sequence[Hand] = (),
    progress: Progress = lambda stage: None,
    posed: ProblemOf = _posed,
    solved: Mapping[str, float] = MappingProxyType({}),
) -> Found:
    """Return the least changes that repair a problem alone, those of the design before those of what it assumes.

    Parameters
    ----------
    document : dict
        Tables of the problem.
    changes : Iterable[ParameterChange]
        The changes to try, each from the value in the file to its limit.
    hands : Sequence[Hand]
        Hands in which the given design is known to fail.
    progress : Progress
        Function that receives the current stage.
    posed : ProblemOf
        Function that makes a problem of tables; None for tables that are none.
    solved : Mapping[str, float]
        Values with which some changes are known to suffice, together at least.

    Returns
    -------
    Found
        At most `MOST` repairs, each next to the least change of its value that suffices.
    """
    asked = list(changes)
    search = _Search(document, posed, list(hands), progress, solved)
    with suppress(OutOfTimeError):
        search.run(asked)
        whole = search.within_budget
        together = list[Repair]()
        if not any(repair.chooses for repair in search.found):
            of_law = [change for change in asked if change.chooses]
            again = _Search(document, posed, search.hands, progress, solved)
            with suppress(OutOfTimeError):
                together = again.pair(of_law)
                if not together and not search.found:
                    together = again.pair(asked)
        if search.found:
            return Found(_offered(search.found, solved), together=together)
        if not whole and not together:
            return Found()
        tried = sorted(asked, key=lambda change: (change.assumes, not change.chooses))
        named = dict.fromkeys(f"{change.key} to {change.limit:.3g}" for change in tried)
        return Found([], list(named)[:TOLD], together)
    return Found(_offered(search.found, solved) or None)


def _offered(found: Iterable[Repair], solved: Mapping[str, float]) -> list[Repair]:
    """Return the least changes of the law, a number that was edited first, then those of the device, then those of what
    is assumed."""
    ordered = sorted(found, key=lambda repair: (repair.key not in solved, not repair.chooses, repair.size))
    own, assumed = ([each for each in ordered if each.assumes == kind] for kind in (False, True))
    kept = own[: MOST - min(ASSUMED, len(assumed))]
    return [*kept, *assumed[: MOST - len(kept)]]


@dataclass(slots=True)
class _Search:
    """A search for repairs, and what it has found so far."""

    document: dict[str, Any]
    posed: ProblemOf
    hands: list[Hand]  # in which designs were refuted
    progress: Progress
    solved: Mapping[str, float]
    found: list[Repair] = field(default_factory=list)
    proofs: int = 0
    boxes: int = 0

    @property
    def within_budget(self) -> bool:
        """Whether the search may prove or solve more."""
        return self.proofs < MOST_PROVED and self.boxes < MOST_BOXES_IN_ALL

    def run(self, changes: Sequence[ParameterChange]) -> None:
        """Try small steps of every change before great steps of any."""
        # a change that only relaxes a constraint suffices at most at its limit
        hopeful = [change for change in changes if not change.eases or self.reserve(change, change.limit) >= 1]
        posed = self.posed(self.document)
        solves = (
            posed is not None and not posed.bounds.fixed
        )  # each step may take seconds: those of the design come first
        steps = sorted(
            (solves and change.assumes, size, k, new)
            for k, change in enumerate(hopeful)
            for size, new in change.steps(self.solved)
        )
        tried: list[list[tuple[float, float]]] = [[(change.old, 0.0)] for change in hopeful]
        settled = set[int]()
        for _, _, k, new in steps:
            change = hopeful[k]
            if k in settled or not self.wants(change):
                continue
            self.progress(f"looking for repairs: {change.meaning}{f', {len(self.found)} found' * bool(self.found)}")
            known = new == self.solved.get(change.key)
            room = 1.0 if known else self.reserve(change, new)
            if room >= 1 and self.limit_found(change, tried[k][-1][0], new):
                settled.add(k)
            tried[k].append((new, room))
        for k, change in enumerate(hopeful):
            if k not in settled and self.wants(change) and (place := self.between_steps(change, tried[k])) is not None:
                self.limit_found(change, *place)

    def pair(self, changes: Sequence[ParameterChange]) -> list[Repair]:
        """Return the two changes of least relative size that are proved to suffice together; none without any."""
        places = list[tuple[float, float, Pair]]()
        for pair in pairs(changes):
            self.progress(f"looking for repairs: {pair.meaning}")
            below = 0.0
            for size in SIZES:
                if places and size > min(places, key=lambda place: place[0])[0]:
                    break
                if self.reserve(pair, size) >= 1:
                    places.append((size, below, pair))
                    break
                below = size
        close = [(*self.bracket(pair, below, size), pair) for size, below, pair in places]
        for _, size, pair in sorted(close, key=lambda place: place[1]):
            for share in BACK:
                if not self.within_budget:
                    return []
                more = size * (1 + share)
                if (error := self.proved(pair, more)) is not None:
                    values = zip(pair.both, pair.values(more), strict=True)
                    return [self.repair(change, new, error, pair, more) for change, new in values]
        return []

    def wants(self, change: ParameterChange) -> bool:
        """Return whether another change of this kind would be offered."""
        assumed = sum(each.assumes for each in self.found)
        if change.assumes or not self.within_budget:
            return self.within_budget and assumed < ASSUMED
        few = len(self.found) - assumed < MOST - min(assumed, ASSUMED)
        return few or change.key in self.solved or (change.chooses and not any(each.chooses for each in self.found))

    def problem(self, change: AnyChange, new: float) -> Problem | None:
        """Return the changed problem; None if the value is not a valid one."""
        check_time()
        return self.posed(change.applied(self.document, new))

    def reserve(self, change: AnyChange, new: float) -> float:
        """Estimate how far the changed problem is from its limit: at least 1 where it seems to have a design."""
        problem = self.problem(change, new)
        if problem is None:
            return 0.0
        if problem.bounds.fixed:
            return reserve(problem, self.hands)
        from vctune.design.search.optimum import within_reach

        return float(within_reach(problem) is not None)

    def limit_found(self, change: ParameterChange, bad: float, good: float) -> bool:
        """Find the least change between one that fails and one that seems to suffice; list it if it is proved."""
        if (problem := self.problem(change, good)) is not None and not problem.bounds.fixed:
            return self.solved_within(change, bad, good)
        while self.within_budget:
            bad, least = self.bracket(change, bad, good)
            known = len(self.hands)
            for share in BACK:
                exact = share == 0 and least == self.solved.get(change.key)
                new = least if exact else change.rounded(least + share * (least - change.old))
                if (error := self.proved(change, new)) is not None:
                    self.found.append(self.repair(change, new, error, change, new))
                    return True
                if len(self.hands) > known:
                    break
            else:
                return self.limit_proved(change, new, good)
            if self.reserve(change, good) < 1:
                return False
        return False

    def solved_within(self, change: ParameterChange, bad: float, good: float) -> bool:
        """List a change with which the problem has a design, and if it is solved there too a change near the least.

        At the limit itself the proof of a design may take long, and from 0 it has no least change.
        """
        new = change.rounded(good)
        if (error := self.proved(change, new)) is None:
            return False
        known = len(self.found)
        self.found.append(self.repair(change, new, error, change, new))
        if bad > 0 and not change.switch:
            _, least = self.bracket(change, bad, good, HALVINGS_SOLVED)
            near = change.rounded(least + NEAR * (least - change.old))
            if abs(near - change.old) < abs(new - change.old) and (error := self.proved(change, near)) is not None:
                self.found[known] = self.repair(change, near, error, change, near)
        return True

    def limit_proved(self, change: ParameterChange, bad: float, good: float) -> bool:
        """Halve the distance between two values by proofs, where the estimate is too coarse."""
        new = change.rounded(good)
        if abs(new - change.old) <= abs(bad - change.old) or (error := self.proved(change, new)) is None:
            return False
        while abs(new - bad) > NEAR * min(abs(new - change.old), new) and self.within_budget:
            middle = change.rounded(change.between(bad, new))
            if middle in (bad, new):
                break
            if (other := self.proved(change, middle)) is None:
                bad = middle
            else:
                new, error = middle, other
        self.found.append(self.repair(change, new, error, change, new))
        return True

    def proved(self, change: AnyChange, new: float) -> float | None:
        """Return the error of the proved design of the changed problem; None if there is none. Keep the hand in which
        a given design is refuted."""
        problem = self.problem(change, new)
        proof = _proved(problem)
        self.proofs += 1 if problem is None or problem.bounds.fixed else SOLVED
        self.boxes += proof.boxes
        if proof.hand is not None and proof.hand not in self.hands:
            self.hands.append(proof.hand)
        return proof.error

    def bracket(self, change: AnyChange, bad: float, good: float, halvings: int = HALVINGS) -> tuple[float, float]:
        """Halve the distance between a value that fails and one that seems to suffice until it is small."""
        for _ in range(0 if change.switch else halvings):
            if abs(good - bad) <= CLOSE * min(abs(good - change.old), good):
                break
            middle = change.between(bad, good)
            bad, good = (bad, middle) if self.reserve(change, middle) >= 1 else (middle, good)
        return bad, good

    def between_steps(
        self, change: ParameterChange, tried: Sequence[tuple[float, float]]
    ) -> tuple[float, float] | None:
        """Return a step that fails, and a value beyond it that seems to suffice where the reserve of the steps has a
        maximum."""
        for (low, before), (at, room), (high, after) in zip(tried, tried[1:], tried[2:], strict=False):
            if not max(before, after, NEARLY) < room < 1:
                continue
            ends, middle, most = [low, high], at, room
            for _ in range(PEAK_STEPS):
                inner = [change.between(ends[0], middle), change.between(middle, ends[1])]
                rooms = [self.reserve(change, new) for new in inner]
                best = int(np.argmax(rooms))
                if rooms[best] >= 1:
                    return low, inner[best]
                if rooms[best] > most:
                    ends[1 - best], middle, most = middle, inner[best], rooms[best]
                else:
                    ends = inner
        return None

    def repair(self, change: ParameterChange, new: float, error: float, whole: AnyChange, size: float) -> Repair:
        """Return a change that suffices, as a part of a whole one of some size, with the Z_0 of its error where that is
        another than the problem's."""
        before = self.posed(self.document)
        after = self.problem(whole, size)
        impedances = [nan if each is None else each.transparency.reference_impedance for each in (before, after)]
        same = isclose(*impedances, rel_tol=SAME_YARDSTICK)
        return Repair(
            key=change.key,
            old=change.old,
            new=new,
            change=change.meaning,
            needs=change.line(new),
            assumes=change.assumes,
            chooses=change.chooses,
            size=change.size(new),
            error=error,
            **({} if same else {"reference_impedance": impedances[1]}),
        )
