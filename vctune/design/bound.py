"""How much better any design could be: a lower bound on the error of all of them, by branch and bound.

See design/README.md, section 10.

Boxes of (K_v, K_p, tau_c, b_0) are halved, the most promising first, and fall when even their lower bound is within
the gap of the best design known, when no design in them meets the demands, or when their loops are unstable.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from math import inf
from time import perf_counter

import numpy as np

from vctune.analysis.demands import ratio_minima, sensitivity_maxima, slowest_resonance
from vctune.design.boxes import Axis, axes_of, flattened, halved, settled
from vctune.design.judge import Judgement
from vctune.design.leaves import Leaves, Unfinished, joined, root
from vctune.design.prepared import Posed
from vctune.model.problem import Problem
from vctune.model.quantities import Coupling, Device, Gains
from vctune.proof.enclosures import Flags
from vctune.proof.least import floors, least_coupling
from vctune.proof.quadratics import Boxes
from vctune.proof.relaxation import Relaxation, at_frequencies, relaxation

FREQUENCIES, PLACES = 40, 48
"""Frequencies to begin with, of the conditions and of |S|; intervals of the transparency band."""
MOST_FREQUENCIES = 160
CHUNK = 1024
"""Boxes halved together."""
LOOK_EVERY = 8
"""After how many rounds the best box is looked at: for frequencies that it violates, for a better design."""
VIOLATED = 1e-4
SECOND, TIE = 0.1, 1e-2
"""What the better half of a box counts when an axis is chosen, and its length, against the worse half's bound."""
DIGITS = 9
"""Beyond which scores are the same, so that rounding does not choose an axis."""
BETTER = 1e-3
"""A design counts as better than the incumbent when its error is lower by this share."""

Improve = Callable[[Gains, float], Judgement | None]
"""Return a certified design found from given gains with an error below a limit, or None."""


@dataclass(frozen=True, slots=True)
class Glance:
    """Where the search stood: boxes worked out, lower bound, error of the best design known, open boxes."""

    boxes: int
    bound: float
    incumbent: float
    open: int

    @property
    def gap(self) -> float:
        """By which share the incumbent's error is above the bound at most."""
        return self.incumbent / self.bound - 1 if 0 < self.bound < inf else inf

    def __str__(self) -> str:
        return f"error {self.incumbent:.5g}, bound {self.bound:.5g}, gap {self.gap:.2%}, {self.open} boxes open"


@dataclass(frozen=True, slots=True)
class Optimality:
    """What is proved of the error of every admissible design.

    Attributes
    ----------
    bound : no admissible design has a lower error; inf if there is none
    incumbent : error of the best design known, inf if none is
    proved : whether the bound is within the gap that was asked for
    improved : a better design than the one given, if the search has met one
    history : of the search, the last of it now
    rest : what is left to do; no leaves when it is proved
    """

    bound: float
    incumbent: float
    proved: bool
    improved: Judgement | None
    history: list[Glance]
    rest: Unfinished

    @property
    def gap(self) -> float:
        """By which share the incumbent's error is above the bound at most."""
        return self.history[-1].gap


@dataclass(slots=True)
class _Search:
    """What changes as the search goes on.

    Attributes
    ----------
    relaxed : the relaxation, with the frequencies known so far
    incumbent : error of the best design known
    improved : that design, if the search has found it
    fallen : the least lower bound of the boxes that have fallen
    boxes : lower bounds worked out
    history : so far
    """

    relaxed: Relaxation
    incumbent: float
    improved: Judgement | None
    fallen: float
    boxes: int
    history: list[Glance]


def bound(
    posed: Posed,
    best: Judgement | None,
    improve: Improve,
    *,
    gap: float,
    most_boxes: float = inf,
    time_limit: float = inf,
    jobs: int = 1,
    rest: Unfinished | None = None,
    stopped: Callable[[], bool] = lambda: False,
    progress: Callable[[Glance], None] = lambda glance: None,
) -> Optimality:
    """Prove a lower bound on the error of every admissible design of a problem.

    The bound is valid whenever the search ends.

    Parameters
    ----------
    posed : a problem in SI units that leaves something free
    best : the best design known; None if none is
    improve : looks for a design with a lower error near given gains
    gap : stop when the incumbent's error is at most 1 + gap times the bound
    most_boxes, time_limit : when to give up; s, from when the problem is relaxed on
    jobs : threads
    rest : of an earlier search of the same problem, taken up unless it has let fall what this gap does not allow
    stopped : whether to give up now
    progress : told where the search stands, every round
    """
    axes = axes_of(posed.problem)
    incumbent = best.error if best else inf
    leaves, fallen, boxes = root(axes), inf, 0
    if rest is not None and rest.fallen >= incumbent / (1 + gap):
        leaves, fallen, boxes = rest.leaves, rest.fallen, rest.boxes
    search = _Search(_relaxed(posed, best), incumbent, None, fallen, boxes, [])
    rounds, ready = 0, perf_counter()
    with ThreadPoolExecutor(jobs) as pool, np.errstate(all="ignore"):
        while True:
            leaves = _pruned(leaves, search, gap)
            search.history.append(_glance(search, leaves))
            progress(search.history[-1])
            late = perf_counter() - ready > time_limit
            if not len(leaves.bound) or search.boxes > most_boxes or late or stopped():
                break
            if rounds % LOOK_EVERY == 0:
                _look(posed, search, leaves, improve)
            leaves = _halved(posed, axes, search, leaves, pool)
            rounds += 1
    last, proved = search.history[-1], not len(leaves.bound)
    rest = Unfinished(leaves, search.fallen, search.boxes)
    return Optimality(last.bound, search.incumbent, proved, search.improved, search.history, rest)


def _relaxed(posed: Posed, best: Judgement | None) -> Relaxation:
    """Relax the problem to a grid of frequencies, and those at which the best design known is at its limits."""
    problem, omega = posed.problem, [np.geomspace(*posed.span, FREQUENCIES)]
    slowest = slowest_resonance(problem, problem.bounds.velocity.min)
    omega_S = [np.geomspace(slowest, problem.nyquist, FREQUENCIES)]
    if best is not None:
        for case in posed.cases:
            omega.append(ratio_minima(case, best.gains, best.coupling).omega)
            omega_S.append(sensitivity_maxima(case, best.gains).omega)
    first, first_S = np.unique(np.concatenate(omega)), np.unique(np.concatenate(omega_S))
    return relaxation(problem, _devices(posed.cases), _devices(posed.objective), first, first_S, PLACES)


def _devices(cases: tuple[Problem, ...]) -> list[Device]:
    return [case.device for case in cases]


def _pruned(leaves: Leaves, search: _Search, gap: float) -> Leaves:
    """Let fall what cannot hold a design better than the incumbent by more than the gap."""
    open_ = leaves.bound < search.incumbent / (1 + gap)
    search.fallen = min(search.fallen, float(leaves.bound[~open_].min(initial=inf)))
    return leaves.taken(open_)


def _glance(search: _Search, leaves: Leaves) -> Glance:
    reached = min(search.fallen, float(leaves.bound.min(initial=inf)), search.incumbent)
    return Glance(search.boxes, reached, search.incumbent, len(leaves.bound))


def _halved(posed: Posed, axes: tuple[Axis, ...], search: _Search, leaves: Leaves, pool: ThreadPoolExecutor) -> Leaves:
    """Halve the most promising boxes, each along the axis that raises the lower bound most.

    While no design is known that the bound could exclude, what counts is how near the boxes are to having none.
    """
    chosen = np.zeros(len(leaves.bound), bool)
    chosen[np.argsort(leaves.bound, kind="stable")[:CHUNK]] = True
    parents, rest = leaves.taken(chosen), leaves.taken(~chosen)
    free = [index for index, axis in enumerate(axes) if axis.low < axis.high]
    halves = [
        flattened(posed.problem, half) for index in free for half in halved(axes[index], index, parents.boxes)
    ]  # two for each of the free axes
    found = list(pool.map(lambda boxes: floors(search.relaxed, boxes), halves))
    search.boxes += len(found) * len(parents.bound)
    least = [np.maximum(floor.error, parents.bound) for floor in found]
    worth, cap = (least, 2 * search.incumbent) if search.incumbent < inf else ([floor.strain for floor in found], 1.0)
    scores = []
    for k, index in enumerate(free):
        one, two = (np.minimum(value, cap) for value in worth[2 * k : 2 * k + 2])
        share = axes[index].share(parents.boxes.low[index], parents.boxes.high[index])
        scores.append(np.minimum(one, two) + SECOND * np.maximum(one, two) + TIE * cap * share)
    best = np.argmax(np.round(np.array(scores) / cap, DIGITS), axis=0)
    children = [
        Leaves(half.taken(best == k // 2), bounds[best == k // 2], parents.settled[best == k // 2])
        for k, (half, bounds) in enumerate(zip(halves, least, strict=True))
    ]
    turned = np.concatenate([np.full(len(child.bound), free[k // 2] < 2) for k, child in enumerate(children)])
    young = _checked(posed, search, joined(children), turned)
    return joined([rest, young])


def _checked(posed: Posed, search: _Search, young: Leaves, turned: Flags) -> Leaves:
    """Let fall the boxes whose loops have just become provably unstable, and mark those that are all stable."""
    at = np.flatnonzero(turned & ~young.settled & (young.bound < search.incumbent))
    if not len(at):
        return young
    stable, unstable = settled(posed, young.boxes.taken(at))
    young.settled[at] = stable
    young.bound[at[unstable]] = inf
    return young


def _look(posed: Posed, search: _Search, leaves: Leaves, improve: Improve) -> None:
    """Look at the middle of the most promising box: which demands does it break, and is there a better design?"""
    axes, first = axes_of(posed.problem), int(np.argmin(leaves.bound))
    low, high = leaves.boxes.low[:, [first]], leaves.boxes.high[:, [first]]
    middle = np.array([axis.middle(low[i], high[i]) for i, axis in enumerate(axes)])
    bounds = posed.problem.bounds
    least = least_coupling(search.relaxed, Boxes(middle, middle))
    b_c = float(np.clip(least.damping[0], bounds.damping.min, bounds.damping.max))
    K_v, K_p, tau_c, b_0 = (float(value[0]) for value in middle)
    K_p = 0.0 if high[1, 0] <= axes[1].scale else K_p
    _know_more(posed, search, Gains(K_v, K_p), Coupling(b_c, b_c * tau_c, b_0))
    found = improve(Gains(K_v, K_p), search.incumbent * (1 - BETTER))
    if found is not None:
        search.improved, search.incumbent = found, found.error


def _know_more(posed: Posed, search: _Search, gains: Gains, coupling: Coupling) -> None:
    """Add the frequencies at which a design breaks a demand to those that the relaxation knows."""
    relaxed, stability = search.relaxed, posed.problem.stability
    known, known_S = np.unique(relaxed.demand.omega), relaxed.omega_S
    more, more_S = known, known_S
    for case in posed.cases:
        ratio, peaks = ratio_minima(case, gains, coupling), sensitivity_maxima(case, gains)
        more = np.union1d(more, ratio.omega[ratio.value < stability.safety_factor * (1 - VIOLATED)])
        more_S = np.union1d(more_S, peaks.omega[-peaks.value > stability.max_sensitivity * (1 + VIOLATED)])
    if len(known) < MOST_FREQUENCIES and len(more) + len(more_S) > len(known) + len(known_S):
        search.relaxed = at_frequencies(relaxed, more, more_S)
