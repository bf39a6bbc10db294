"""Compute a lower bound on the error of all feasible designs, by branch and bound.

See design/bound/README.md.

The search halves boxes of (K_v, K_p, tau_c, b_0), or of (K_v, tau_c) for an impedance display. The search begins with
the boxes with the least lower bounds. It prunes a box in three cases: the lower bound is within the gap of the best
known error, no design of the box meets the constraints, or all loops of the box are unstable.
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
from vctune.design.prepared import Posed, acting_terms, with_acting_terms
from vctune.design.search.shapes import coupling_of
from vctune.design.verdict.judge import Judgement
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hand_arrays import PlacesInHands
from vctune.model.problem import Problem
from vctune.model.transparency import TermName
from vctune.running import OutOfTimeError, out_of_time

FREQUENCIES, INTERVALS = 40, 48
"""Number of frequencies of the first relaxation, and number of intervals of the transparency band. The time of a bound
is proportional to both. With smaller numbers, the bounds are weaker and the search needs more boxes."""
MOST_FREQUENCIES = 160
"""Number of frequencies at which the search stops adding places. Up to this number, it adds the places at which the
design in the middle of a box violates a constraint. A bound with this number of frequencies takes four times as long as
a bound of the first relaxation. Near the end of a search, the middles of boxes violate no constraint at a new place.
"""
LOWEST_ANGLE = 1e-3
"""Least angle above 0 for any passive hand, relative to pi. At smaller angles R differs from its limit at 0 by at most
1e-5."""
SHARES_IN_HANDS, ANGLES_IN_HANDS = (0.0, 0.1, 1.0), 12
"""Positions in the range of each parameter of a hand, from 0 to 1, and number of angles per decade, for the first
places in hands."""
LITTLE = 1e-3
"""Substitute for a gain of 0, relative to its upper bound, when the search tries the design in the middle of a box."""
CHUNK = 1024
"""Number of boxes that the search halves in one round. With this number NumPy's calls have little overhead, and the
arrays for all halves (4 axes, 2 halves, 160 frequencies) take tens of MB. With half this number, the search needs
slightly fewer boxes and slightly more time for each box. With twice this number, the reverse is true."""
TRY_EVERY = 8
"""Number of rounds after which the search tries the box with the least bound: it adds violated places and looks for a
better design. With half as many rounds, it finds better designs earlier; with twice as many, fewer attempts fail."""
VIOLATED = 1e-4
"""Relative violation of a constraint above which the search adds its place. With a smaller violation, the new place
would raise the bound only negligibly."""
BETTER = 1e-3
"""Share by which the error of a design must be below that of the incumbent for the design to count as better. This
share is less than the usual gap of 1 %, and more than the difference between two results of the optimiser for one
optimum."""

Improve = Callable[[Gains, float], Judgement | None]
"""Function that returns a certified design found from given gains with an error below a limit, or None."""


@dataclass(frozen=True, slots=True)
class SearchState:
    """State of the search: number of computed lower bounds, proved bound, error of the best known design, and number of
    open boxes."""

    boxes: int
    bound: float
    incumbent: float
    open: int

    @property
    def gap(self) -> float:
        """The share by which the incumbent's error exceeds the bound."""
        return self.incumbent / self.bound - 1 if 0 < self.bound < inf else inf

    def __str__(self) -> str:
        return f"error {self.incumbent:.5g}, bound {self.bound:.5g}, gap {self.gap:.2%}, {self.open} boxes open"


@dataclass(frozen=True, slots=True)
class Optimality:
    """The proved bound on the error of every feasible design.

    The error contains only the terms that can differ between designs; usually these are all terms.

    Attributes
    ----------
    bound : the lower bound; inf if no design is feasible
    incumbent : error of the best known design; inf without one
    proved : whether the bound is within the required gap
    improved : a better design than the given one; None if the search found none
    terms : terms of the error that the bound covers; empty if it covers all
    history : states of the search; the last entry is the current one
    resume : the remaining work; it has no open node if the gap is proved
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
        """The share by which the incumbent's error exceeds the bound."""
        return self.history[-1].gap


@dataclass(slots=True)
class _Search:
    """The state that changes during the search.

    Attributes
    ----------
    relaxed : the relaxation with all places so far
    incumbent : error of the best known design
    improved : the best known design, if the search found it; else None
    pruned_bound : the least lower bound of the pruned boxes
    boxes : number of lower bounds computed
    history : states so far
    stability_boxes : number of boxes of frequency and gains in the proofs of stable loops
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
    best : the best known design; None without one
    improve : function that looks for a design with a lower error near given gains
    gap : the search ends when the incumbent's error is at most 1 + gap times the bound
    most_boxes : number of lower bounds after which the search ends without a proof of the gap
    most_stability_boxes : the same limit for the boxes in the proofs of stable or unstable loops
    jobs : number of threads
    resume : state of an earlier search of the same problem; the function ignores it if the earlier search pruned boxes
        that a search with this gap must keep open
    stopped : function that returns whether to end the search now
    progress : function that receives the state of the search in every round

    Returns
    -------
    Optimality
        The bound, which is valid even if the search ends early, for example at the time limit.

    Raises
    ------
    OutOfTimeError
        If the time limit ends the search before it has a relaxation.
    """
    given, posed = posed, with_acting_terms(posed)
    axes = axes_of(posed.problem)
    incumbent = best.acting_error if best else inf
    nodes, pruned_bound, boxes = root(axes), inf, 0
    if resume is not None and resume.pruned_bound >= incumbent / (1 + gap):
        nodes, pruned_bound, boxes = resume.nodes, resume.pruned_bound, resume.boxes
    search = _Search(_relaxed(posed, best), incumbent, None, pruned_bound, boxes, [])
    with suppress(OutOfTimeError):
        if all(axis.low == axis.high for axis in axes[:TAU_C]):  # the search never halves fixed gains
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
            with suppress(OutOfTimeError):  # at the time limit the open nodes stay open
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
    """Return whether the last round did not raise the bound. For a single box, no further round would raise it."""
    return len(search.history) > 2 and search.history[-1].bound == search.history[-2].bound


def _relaxed(posed: Posed, best: Judgement | None) -> Relaxation:
    """Relax the problem: impose the constraints on a grid and where the best known design is closest to its limits."""
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
    """Return angles, each with the worst hand for the best known design or, without one, for the middles of the gains'
    ranges."""
    if problem.hands_met is None:
        return PlacesInHands.of(())
    at, bounds = loops_in_hands(problem.device, problem.hands_met, SHARES_IN_HANDS, ANGLES_IN_HANDS), problem.bounds
    middle = (sqrt(b.max) * sqrt(b.min or LITTLE * b.max) for b in (bounds.velocity, bounds.position))
    gains = best.gains if best is not None else Gains(*middle)
    worst = np.argmax(np.nan_to_num(at.required(gains), nan=-inf), axis=0)
    return PlacesInHands(at.theta / problem.device.sample_time, at.hands.mapped(lambda number: number[worst]))


def _tight_places(problem: Problem, gains: Gains, coupling: AnyCoupling, *, broken: bool = False) -> Places:
    """Return the places at which a design has the least reserve or, if `broken`, at which it violates a constraint."""
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
    """Return the devices of some problems without unmodelled responses, and without duplicates.

    Without an unmodelled response, the constraints can only be easier to meet, so the relaxation stays valid.
    """
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
    """Return the nodes with the least bounds, and the other nodes."""
    chosen = np.zeros(len(nodes), bool)
    chosen[np.argsort(nodes.bound, kind="stable")[:CHUNK]] = True
    return nodes.subset(chosen), nodes.subset(~chosen)


def _with_stability(posed: Posed, search: _Search, young: Halved) -> OpenNodes:
    """Mark the new boxes whose loops are all proved stable, and set the bound of boxes with only unstable loops to
    inf."""
    nodes = young.nodes
    unknown = np.flatnonzero(young.along_gains & ~nodes.stable & (nodes.bound < search.incumbent))
    if len(unknown):
        found = proved_stability(posed, nodes.boxes.subset(unknown))
        search.stability_boxes += found.boxes
        nodes.stable[unknown] = found.stable
        nodes.bound[unknown[found.unstable]] = inf
    return nodes


def _try_best_node(posed: Posed, search: _Search, nodes: OpenNodes, improve: Improve) -> None:
    """Evaluate the middle of the most promising box: find the constraints that it violates, and look for a better
    design."""
    axes, first = axes_of(posed.problem), int(np.argmin(nodes.bound))
    low, high = nodes.boxes.low[:, [first]], nodes.boxes.high[:, [first]]
    middle = np.array([axis.middle(low[row], high[row]) for row, axis in enumerate(axes)])
    least = least_coupling(search.relaxed, DesignBoxes(middle, middle))
    K_v, K_p, tau_c, b_0 = (float(middle[row, 0]) for row in (K_V, K_P, TAU_C, B_0))
    if high[K_P, 0] <= axes[K_P].scale:  # a box of very small position gains: try K_p = 0
        K_p = 0.0
    _add_places(posed, search, Gains(K_v, K_p), coupling_of(posed.problem, float(least.first[0]), tau_c, b_0))
    better = improve(Gains(K_v, K_p), search.incumbent * (1 - BETTER))
    if better is not None:
        search.improved, search.incumbent = better, better.acting_error


def _add_places(posed: Posed, search: _Search, gains: Gains, coupling: AnyCoupling) -> None:
    """Add the places at which a design violates a constraint to the places of the relaxation."""
    known = more = search.relaxed.places
    for case in posed.cases:
        more = more.joined(_tight_places(case, gains, coupling, broken=True))
    if known.most < MOST_FREQUENCIES and more.number > known.number:
        search.relaxed = at_places(search.relaxed, more)
