"""Compute a lower bound on the error of all feasible designs, by branch and bound. See README.md, section 2."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from math import inf, sqrt

import numpy as np

from vctune.analysis.demands import ratio_minima, sensitivity_maxima, slowest_resonance
from vctune.analysis.in_hands import least_ratios
from vctune.analysis.loops_in_hands import loops_in_hands
from vctune.design.bound.nodes import Axes, OpenNodes, axes_of, halved, joined, proved_stability
from vctune.design.bound.objective import objective_of
from vctune.design.bound.quadratics import K_P, K_V
from vctune.design.bound.relaxation import Places, Relaxation, least_coupling, relaxation
from vctune.design.prepared import Posed, acting_terms, with_acting_terms
from vctune.design.search.shapes import coupling_of
from vctune.design.verdict.judge import Judgement
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import PlacesInHands
from vctune.model.problem import Problem
from vctune.model.transparency import TermName
from vctune.proof.boxes import Cells
from vctune.proof.enclosures.intervals import Flags
from vctune.running import OutOfTimeError, out_of_time

# Number of frequencies of the first relaxation, and number of intervals of the transparency band
FREQUENCIES, INTERVALS = 40, 48
MOST_FREQUENCIES = 160  # Number of frequencies at which the search stops adding places
LOWEST_ANGLE = 1e-3  # Least angle above 0 for any passive hand, relative to pi
# Positions in the range of each parameter of a hand, from 0 to 1, and number of angles per decade, for the first places
# in hands
SHARES_IN_HANDS, ANGLES_IN_HANDS = (0.0, 0.1, 1.0), 12
# Substitute for a gain of 0, relative to its upper bound, when the search tries the design in the middle of a box
LITTLE = 1e-3
CHUNK = 1024  # Number of boxes that the search halves in one round
# Number of rounds after which the search tries the box with the least bound: it adds violated places and looks for a
# better design
TRY_EVERY = 8
VIOLATED = 1e-4  # Relative violation of a constraint above which the search adds its place
# Share by which the error of a design must be below that of the incumbent for the design to count as better
BETTER = 1e-3

# Function that returns a certified design found from given gains with an error below a limit, or None
Improve = Callable[[Gains, float], Judgement | None]


@dataclass(frozen=True, slots=True)
class SearchState:
    """State of the search: number of computed lower bounds, proved bound, error of the best known design, and number of
    open boxes."""

    boxes: int
    bound: float
    incumbent: float
    open: int

    def __str__(self) -> str:
        gap = _gap(self.incumbent, self.bound)
        return f"error {self.incumbent:.5g}, bound {self.bound:.5g}, gap {gap:.2%}, {self.open} boxes open"


@dataclass(frozen=True, slots=True)
class Optimality:
    """The proved bound on the error of every feasible design."""

    bound: float  # the lower bound; inf if no design is feasible
    incumbent: float  # error of the best known design; inf without one
    proved: bool  # whether the bound is within the required gap
    improved: Judgement | None  # a better design than the given one; None if the search found none
    terms: tuple[TermName, ...]  # terms of the error that the bound covers; empty if it covers all
    boxes: int  # number of computed lower bounds
    open: OpenNodes  # the remaining boxes; none if the gap is proved

    @property
    def gap(self) -> float:
        """The share by which the incumbent's error exceeds the bound."""
        return _gap(self.incumbent, self.bound)


def _gap(error: float, bound: float) -> float:
    return error / bound - 1 if 0 < bound < inf else inf


@dataclass(slots=True)
class _Search:
    """The state that changes during the search."""

    posed: Posed
    axes: Axes
    relaxed: Relaxation  # the relaxation with all places so far
    nodes: OpenNodes
    incumbent: float  # error of the best known design
    improved: Judgement | None = None  # the best known design, if the search found it; else None
    pruned_bound: float = inf  # the least lower bound of the pruned boxes
    boxes: int = 0  # number of lower bounds computed
    stability_boxes: int = 0  # number of boxes of frequency and gains in the proofs of stable loops


def bound(
    posed: Posed,
    best: Judgement | None,
    improve: Improve,
    *,
    gap: float,
    most_boxes: float = inf,
    most_stability_boxes: float = inf,
    stopped: Callable[[], bool] = lambda: False,
    progress: Callable[[SearchState], None] = lambda state: None,
) -> Optimality:
    """Prove a lower bound on the error of every feasible design of a problem (README.md, section 2)."""
    given, posed = posed, with_acting_terms(posed)
    axes = axes_of(posed.problem)
    root = OpenNodes(axes.whole, np.zeros(1), np.zeros(1, bool))
    search = _Search(posed, axes, _relaxed(posed, best), root, best.acting_error if best else inf)
    rounds, reached = 0, 0.0
    with suppress(OutOfTimeError):
        if not {K_V, K_P} & set(axes.free):  # the search never halves fixed gains
            _prove_stability(search, search.nodes, np.ones(1, bool))
    with np.errstate(all="ignore"):
        while True:
            _prune(search, gap)
            before, reached = reached, min(search.pruned_bound, search.nodes.lowest, search.incumbent)
            progress(SearchState(search.boxes, reached, search.incumbent, len(search.nodes)))
            stop = stopped() or out_of_time()
            stop |= search.boxes > most_boxes or search.stability_boxes > most_stability_boxes
            # a further round would not raise the bound of a single box
            stop |= not axes.free and rounds > 1 and reached == before
            if stop or not len(search.nodes):
                break
            with suppress(OutOfTimeError):  # at the time limit the open nodes stay open
                if not axes.free or rounds % TRY_EVERY == 0:
                    _try_best_node(search, improve)
                _branch(search)
            rounds += 1
    terms = acting_terms(posed.problem) if posed is not given else ()
    proved = not len(search.nodes)
    return Optimality(reached, search.incumbent, proved, search.improved, terms, search.boxes, search.nodes)


def _prune(search: _Search, gap: float) -> None:
    """Drop the boxes that cannot contain a design better than the incumbent by more than the gap."""
    nodes, open_ = search.nodes, search.nodes.bound < search.incumbent / (1 + gap)
    search.pruned_bound = min(search.pruned_bound, nodes.subset(~open_).lowest)
    search.nodes = nodes.subset(open_)


def _branch(search: _Search) -> None:
    """Halve the boxes with the least bounds."""
    order = np.argsort(search.nodes.bound, kind="stable")
    young, along_gains, boxes = halved(
        search.relaxed, search.axes, search.nodes.subset(order[:CHUNK]), search.incumbent
    )
    search.boxes += boxes
    _prove_stability(search, young, along_gains)
    search.nodes = joined((search.nodes.subset(order[CHUNK:]), young))


def _prove_stability(search: _Search, nodes: OpenNodes, asked: Flags) -> None:
    """Mark the boxes whose loops are all proved stable, and set the bound of boxes with only unstable loops to inf."""
    unknown = np.flatnonzero(asked & ~nodes.stable & (nodes.bound < search.incumbent))
    if len(unknown):
        stable, unstable, boxes = proved_stability(search.posed, nodes.boxes.subset(unknown))
        search.stability_boxes += boxes
        nodes.stable[unknown] = stable
        nodes.bound[unknown[unstable]] = inf


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
    terms = objective_of(problem, _devices(posed.objective), INTERVALS)
    return relaxation(problem, _devices(posed.cases), places, terms)


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
    """Return the devices of some problems without unmodelled responses, and without duplicates."""
    return list(dict.fromkeys(case.device.modelled for case in cases))


def _try_best_node(search: _Search, improve: Improve) -> None:
    """Evaluate the middle of the most promising box: find the constraints that it violates, and look for a better
    design."""
    boxes = search.nodes.boxes.subset(np.array([np.argmin(search.nodes.bound)]))
    middle = search.axes.middle(boxes)
    first, _, _ = least_coupling(search.relaxed, Cells(middle, middle))
    K_v, K_p, tau_c, b_0 = middle[:, 0].tolist()
    if boxes.high[K_P, 0] <= search.axes.scale[K_P, 0]:  # a box of very small position gains: try K_p = 0
        K_p = 0.0
    _add_places(search, Gains(K_v, K_p), coupling_of(search.posed.problem, float(first[0]), tau_c, b_0))
    better = improve(Gains(K_v, K_p), search.incumbent * (1 - BETTER))
    if better is not None:
        search.improved, search.incumbent = better, better.acting_error


def _add_places(search: _Search, gains: Gains, coupling: AnyCoupling) -> None:
    """Add the places at which a design violates a constraint to the places of the relaxation."""
    known = more = search.relaxed.places
    for case in search.posed.cases:
        more = more.joined(_tight_places(case, gains, coupling, broken=True))
    if max(known.counts[:3]) < MOST_FREQUENCIES and sum(more.counts) > sum(known.counts):
        relaxed = search.relaxed
        search.relaxed = relaxation(relaxed.problem, relaxed.devices, more, relaxed.objective)
