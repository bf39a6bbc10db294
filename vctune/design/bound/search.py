"""A lower bound on the error of all designs, by branch and bound.

See design/bound/README.md.

The search halves boxes of (K_v, K_p, tau_c, b_0), for an impedance display of (K_v, tau_c), the most promising first.
It prunes them if even their lower bound is within the gap of the best known design, if no design in them meets the
constraints, or if their loops are unstable.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from math import inf, sqrt

import numpy as np

from vctune.analysis.demands import ratio_minima, sensitivity_maxima, slowest_resonance
from vctune.analysis.in_hands import least_ratios
from vctune.analysis.loops_in_hands import loops_in_hands
from vctune.design.bound.design_boxes import B_0, K_P, K_V, TAU_C, DesignBoxes, axes_of
from vctune.design.bound.lower_bounds import least_coupling
from vctune.design.bound.nodes import OpenNodes, joined, root
from vctune.design.bound.relaxation import Places, Relaxation, at_places, relaxation
from vctune.design.bound.resume import ResumeState
from vctune.design.bound.stability_bound import proved_stability
from vctune.design.bound.strong_branching import Halved, halved
from vctune.design.prepared import Posed, acting_terms, compared
from vctune.design.search.shapes import coupling_of
from vctune.design.verdict.judge import Judgement
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hand_arrays import PlacesInHands
from vctune.model.problem import Problem
from vctune.model.transparency import TermName
from vctune.running import OutOfTimeError, out_of_time

FREQUENCIES, INTERVALS = 40, 48
"""Frequencies to begin with, of the conditions and of |S|; intervals of the transparency band. They cost time in
proportion; fewer make the bounds weaker, so that more boxes are needed."""
MOST_FREQUENCIES = 160
"""Frequencies up to which those that a box's middle violates are added: four times the first, and four times the cost
of a bound. Near the end of a search no other constraint is broken than those that are known."""
LOWEST_ANGLE = 1e-3
"""Least first angle for any passive hand beside 0, relative to pi: below it R is at its limit to 1e-5."""
SHARES_IN_HANDS, ANGLES_IN_HANDS = (0.0, 0.1, 1.0), 12
"""Shares of the ranges of hands, and angles per decade, of the first places in hands."""
LITTLE = 1e-3
"""Stand-in for a gain of 0, relative to its upper bound, where a design in the middle of a box is tried first."""
CHUNK = 1024
"""Boxes halved together: enough that NumPy's calls cost little, few enough that the bounds of all halves (4 axes, 2
halves, 160 frequencies) take tens of MB. Half as many are chosen a little better and take a
little more time each; twice as many the other way round."""
TRY_EVERY = 8
"""Number of rounds after which the best box is tried: for frequencies that it violates, for a better design. Half finds
better designs earlier, twice wastes less."""
VIOLATED = 1e-4
"""Relative violation of a constraint from which on its frequency is added; less would not raise a bound that matters.
"""
BETTER = 1e-3
"""A design is better than the incumbent if its error is lower by this share. It is below a usual gap of 1 %, and above
the difference between polishing one optimum from two starts."""

Improve = Callable[[Gains, float], Judgement | None]
"""Return a certified design found from given gains with an error below a limit, or None."""


@dataclass(frozen=True, slots=True)
class SearchState:
    """State of the search: boxes computed, lower bound, error of the best known design, open boxes."""

    boxes: int
    bound: float
    incumbent: float
    open: int

    @property
    def gap(self) -> float:
        """Greatest share by which the incumbent's error is above the bound."""
        return self.incumbent / self.bound - 1 if 0 < self.bound < inf else inf

    def __str__(self) -> str:
        return f"error {self.incumbent:.5g}, bound {self.bound:.5g}, gap {self.gap:.2%}, {self.open} boxes open"


@dataclass(frozen=True, slots=True)
class Optimality:
    """The proved bound on the error of every feasible design.

    The error has only the terms that can differ between designs, mostly all of them.

    Attributes
    ----------
    bound : no feasible design has a lower error; inf if there is none
    incumbent : error of the best design known, inf if none is
    proved : whether the bound is within the gap that was required
    improved : a better design than the given one, if the search has found one
    terms : terms of the error that it counts; empty if it counts all
    history : history of the search, the last entry now
    resume : the remaining work; no open node if it is proved
    """

    bound: float
    incumbent: float
    proved: bool
    improved: Judgement | None
    terms: tuple[TermName, ...]
    history: list[SearchState]
    resume: ResumeState

    @property
    def gap(self) -> float:
        """Greatest share by which the incumbent's error is above the bound."""
        return self.history[-1].gap


@dataclass(slots=True)
class _Search:
    """The state that changes during the search.

    Attributes
    ----------
    relaxed : the relaxation, with the frequencies known so far
    incumbent : error of the best design known
    improved : that design, if the search has found it
    pruned_bound : the least lower bound of the boxes that were pruned
    boxes : lower bounds computed
    history : states so far
    stability_boxes : boxes of frequency and gains that it took to prove loops stable
    """

    relaxed: Relaxation
    incumbent: float
    improved: Judgement | None
    pruned_bound: float
    boxes: int
    history: list[SearchState]
    stability_boxes: int = 0


def bound(
    posed: Posed,
    best: Judgement | None,
    improve: Improve,
    *,
    gap: float,
    most_boxes: float = inf,
    most_stability_boxes: float = inf,
    jobs: int = 1,
    resume: ResumeState | None = None,
    stopped: Callable[[], bool] = lambda: False,
    progress: Callable[[SearchState], None] = lambda state: None,
) -> Optimality:
    """Prove a lower bound on the error of every feasible design of a problem (design/bound/README.md).

    Parameters
    ----------
    posed : a problem in SI units in which some variable is free
    best : the best design known; None if there is none
    improve : looks for a design with a lower error near given gains
    gap : the search stops when the incumbent's error is at most 1 + gap times the bound
    most_boxes : number of lower bounds after which the search gives up
    most_stability_boxes : number of boxes that prove loops stable or unstable after which it gives up
    jobs : number of threads
    resume : state of an earlier search of the same problem; ignored if that search pruned boxes that this gap must keep
    stopped : whether to give up now
    progress : function that receives the state of the search, every round

    Returns
    -------
    Optimality
        The bound is valid however the search ends, at the time limit too.

    Raises
    ------
    OutOfTimeError
        If the time limit ends it before it has imposed its relaxation.
    """
    given, posed = posed, compared(posed)
    axes = axes_of(posed.problem)
    incumbent = best.compared if best else inf
    nodes, pruned_bound, boxes = root(axes), inf, 0
    if resume is not None and resume.pruned_bound >= incumbent / (1 + gap):
        nodes, pruned_bound, boxes = resume.nodes, resume.pruned_bound, resume.boxes
    search = _Search(_relaxed(posed, best), incumbent, None, pruned_bound, boxes, [])
    with suppress(OutOfTimeError):
        if all(axis.low == axis.high for axis in axes[:TAU_C]):  # gains that are fixed are never halved
            nodes = _with_stability(posed, search, Halved(nodes, np.ones(len(nodes), bool), 0))
    rounds, single = 0, all(axis.low == axis.high for axis in axes)
    with ThreadPoolExecutor(jobs) as pool, np.errstate(all="ignore"):
        while True:
            nodes = _pruned(nodes, search, gap)
            search.history.append(_state(search, nodes))
            progress(search.history[-1])
            stop = stopped() or out_of_time()
            stop |= search.boxes > most_boxes or search.stability_boxes > most_stability_boxes
            if not len(nodes) or stop or (single and _stands(search)):
                break
            with suppress(OutOfTimeError):  # the nodes stay as they are
                if single or rounds % TRY_EVERY == 0:
                    _try_best_node(posed, search, nodes, improve)
                promising, others = _most_promising(nodes)
                young = halved(search.relaxed, axes, promising, search.incumbent, pool)
                search.boxes += young.worked_out
                nodes = joined([others, _with_stability(posed, search, young)])
            rounds += 1
    last, proved = search.history[-1], not len(nodes)
    left = ResumeState(nodes, search.pruned_bound, search.boxes)
    return Optimality(
        bound=last.bound,
        incumbent=search.incumbent,
        proved=proved,
        improved=search.improved,
        terms=acting_terms(posed.problem) if posed is not given else (),
        history=search.history,
        resume=left,
    )


def _stands(search: _Search) -> bool:
    """Return whether the last round has raised no bound; if there is only one box, no further round will."""
    return len(search.history) > 2 and search.history[-1].bound == search.history[-2].bound


def _relaxed(posed: Posed, best: Judgement | None) -> Relaxation:
    """Relax the problem to a grid of frequencies, and those at which the best design known is at its limits."""
    problem = posed.problem
    band = np.geomspace(*posed.span, FREQUENCIES) if problem.passive else np.zeros(0)
    slowest = slowest_resonance(problem, problem.bounds.velocity.min)
    upto = np.geomspace(slowest, problem.nyquist, FREQUENCIES)
    angles = np.append(0.0, problem.nyquist * np.geomspace(LOWEST_ANGLE, 1.0, FREQUENCIES))
    places = Places(band, upto, _in_worst_hands(problem, best), angles if problem.any_hand else np.zeros(0))
    if best is not None:
        for case in posed.cases:
            places = places.joined(_tight_places(case, best.gains, best.coupling))
    return relaxation(problem, _devices(posed.cases), _devices(posed.objective), places, INTERVALS)


def _in_worst_hands(problem: Problem, best: Judgement | None) -> PlacesInHands:
    """Return some angles with the hand that is worst for the best design known, or for one in the middle."""
    if problem.hands_met is None:
        return PlacesInHands.of(())
    at, bounds = loops_in_hands(problem.device, problem.hands_met, SHARES_IN_HANDS, ANGLES_IN_HANDS), problem.bounds
    middle = (sqrt(b.max) * sqrt(b.min or LITTLE * b.max) for b in (bounds.velocity, bounds.position))
    gains = best.gains if best is not None else Gains(*middle)
    worst = np.argmax(np.nan_to_num(at.required(gains), nan=-inf), axis=0)
    return PlacesInHands(at.theta / problem.device.sample_time, at.hands.mapped(lambda number: number[worst]))


def _tight_places(problem: Problem, gains: Gains, coupling: AnyCoupling, *, broken: bool = False) -> Places:
    """Return the places at which the constraints are hardest for a design, or violated."""
    stability, omega = problem.stability, np.zeros(0)
    least = stability.safety_factor * (1 - VIOLATED) if broken else inf
    if problem.passive:
        ratio = ratio_minima(problem, gains, coupling)
        omega = ratio.omega[ratio.value < least]
    peaks = sensitivity_maxima(problem, gains)
    most = stability.max_sensitivity * (1 + VIOLATED) if broken else 0.0
    tight = [each for each in least_ratios(problem, gains, coupling) if each.ratio < least]
    hands = PlacesInHands.of([(each.omega, each.hand) for each in tight if each.hand is not None])
    any_hand = [each.omega for each in tight if each.hand is None]
    # `sensitivity_maxima` gives minima of -|S|
    return Places(omega, peaks.omega[-peaks.value > most], hands, np.array(any_hand))


def _devices(cases: tuple[Problem, ...]) -> list[Device]:
    """Return the devices with their own responses: with any other the constraints can only be harder."""
    return list(dict.fromkeys(case.device.modelled for case in cases))


def _pruned(nodes: OpenNodes, search: _Search, gap: float) -> OpenNodes:
    """Drop the boxes that cannot contain a design better than the incumbent by more than the gap."""
    open_ = nodes.bound < search.incumbent / (1 + gap)
    search.pruned_bound = min(search.pruned_bound, nodes.subset(~open_).lowest)
    return nodes.subset(open_)


def _state(search: _Search, nodes: OpenNodes) -> SearchState:
    reached = min(search.pruned_bound, nodes.lowest, search.incumbent)
    return SearchState(search.boxes, reached, search.incumbent, len(nodes))


def _most_promising(nodes: OpenNodes) -> tuple[OpenNodes, OpenNodes]:
    """Return the nodes with the least bounds, and the others."""
    chosen = np.zeros(len(nodes), bool)
    chosen[np.argsort(nodes.bound, kind="stable")[:CHUNK]] = True
    return nodes.subset(chosen), nodes.subset(~chosen)


def _with_stability(posed: Posed, search: _Search, young: Halved) -> OpenNodes:
    """Mark the boxes whose loops have just become provably stable, and close those whose loops are all unstable."""
    nodes = young.nodes
    unknown = np.flatnonzero(young.along_gains & ~nodes.stable & (nodes.bound < search.incumbent))
    if len(unknown):
        found = proved_stability(posed, nodes.boxes.subset(unknown))
        search.stability_boxes += found.boxes
        nodes.stable[unknown] = found.stable
        nodes.bound[unknown[found.unstable]] = inf
    return nodes


def _try_best_node(posed: Posed, search: _Search, nodes: OpenNodes, improve: Improve) -> None:
    """Look at the middle of the most promising box: which constraints does it break, and is there a better design?"""
    axes, first = axes_of(posed.problem), int(np.argmin(nodes.bound))
    low, high = nodes.boxes.low[:, [first]], nodes.boxes.high[:, [first]]
    middle = np.array([axis.middle(low[row], high[row]) for row, axis in enumerate(axes)])
    least = least_coupling(search.relaxed, DesignBoxes(middle, middle))
    K_v, K_p, tau_c, b_0 = (float(middle[row, 0]) for row in (K_V, K_P, TAU_C, B_0))
    if high[K_P, 0] <= axes[K_P].scale:  # so little position gain is none
        K_p = 0.0
    _add_places(posed, search, Gains(K_v, K_p), coupling_of(posed.problem, float(least.first[0]), tau_c, b_0))
    better = improve(Gains(K_v, K_p), search.incumbent * (1 - BETTER))
    if better is not None:
        search.improved, search.incumbent = better, better.compared


def _add_places(posed: Posed, search: _Search, gains: Gains, coupling: AnyCoupling) -> None:
    """Add the places at which a design violates a constraint to those of the relaxation."""
    known = more = search.relaxed.places
    for case in posed.cases:
        more = more.joined(_tight_places(case, gains, coupling, broken=True))
    if known.most < MOST_FREQUENCIES and more.number > known.number:
        search.relaxed = at_places(search.relaxed, more)
