"""Compute a lower bound on the error of all feasible designs, by branch and bound (README.md, section 2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import inf, sqrt

import numpy as np

from vctune.analysis.demands import ratio_minima, sensitivity_maxima, slowest_resonance
from vctune.analysis.in_hands import least_ratios
from vctune.analysis.loops_in_hands import loops_in_hands
from vctune.design.bound.quadratics import K_P, K_V
from vctune.design.bound.relaxation import (
    ImposedPlaces,
    Relaxation,
    least_coupling,
    lower_bounds,
    objective_of,
    relaxation,
    without_integrator,
)
from vctune.design.judging.judge import Judgement
from vctune.design.prepared import Posed
from vctune.design.search.shapes import SLACK, coupling_of
from vctune.design.variables import coordinates
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.hands import PlacesInHands
from vctune.model.problem import Problem, Range
from vctune.proof.boxes import Cells, Integers
from vctune.proof.cells import by_integrator
from vctune.proof.claims.covered import of_cells
from vctune.proof.claims.poles import pole_turns
from vctune.proof.enclosures.intervals import Flags, Floats
from vctune.running import OutOfTimeError, out_of_time

BETTER_HALF = 0.1  # Weight of the greater bound of two halves relative to the smaller one
LENGTH = 1e-2  # Weight, in the score, of the share of an axis that a box spans
DIGITS = 9  # Number of decimals to which the code rounds scores before it compares them


@dataclass(frozen=True, slots=True)
class Axes:
    """The variables K_v, K_p, tau_c and b_0, with the coordinate log(scale + x) in which the search halves them."""

    whole: Cells  # the box of all designs, SI units
    scale: Floats  # >= 0, shape (4, 1)

    @property
    def free(self) -> list[int]:
        """The rows of the variables that are not fixed."""
        return np.flatnonzero(self.whole.low < self.whole.high).tolist()

    def middle(self, boxes: Cells) -> Floats:
        """Return the points at which the search halves boxes: their midpoints in the coordinate."""
        root = np.sqrt(self.scale + boxes.low) * np.sqrt(self.scale + boxes.high)
        return np.clip(root - self.scale, boxes.low, boxes.high)

    def share(self, boxes: Cells) -> Floats:
        """Return the share of each axis that the boxes span; nan for a fixed variable."""
        length, whole = (np.log((self.scale + x.high) / (self.scale + x.low)) for x in (boxes, self.whole))
        return np.asarray(length / whole)


def axes_of(problem: Problem) -> Axes:
    """Return the variables of a problem in SI units."""
    impedance, time, bounds = problem.transparency.reference_impedance, problem.device.sample_time, problem.bounds
    scaled = coordinates(problem.in_units(impedance, time), integrator=True)
    scale = {c.name: c.scale * impedance for c in scaled}
    above, below = (bounds.damping, bounds.stiffness) if problem.device.kind.inverse else (bounds.mass, bounds.damping)
    tau_c = Range(above.min / below.max, above.max / below.min)
    ranges = bounds.velocity, bounds.position, tau_c, bounds.drag
    scales = [
        scale.get("velocity", 0.0),
        scale.get("position", 0.0) / time,
        SLACK * time if tau_c.min == 0 < tau_c.max else 0.0,
        scale.get("drag", 0.0),
    ]
    low, high, scale_ = np.array([(of.min, of.max, size) for of, size in zip(ranges, scales, strict=True)]).T[
        :, :, None
    ]
    return Axes(Cells(low, high), scale_)


@dataclass(frozen=True, slots=True)
class OpenNodes:
    """Boxes that the search has neither pruned nor halved."""

    boxes: Cells  # n boxes: [low, high] in each of K_v, K_p, tau_c and b_0, SI units
    bound: Floats  # a lower bound on the error in each box, shape (n,)
    stable: Flags  # whether all loops of the box are proved stable, shape (n,)

    def __len__(self) -> int:
        return len(self.bound)

    def subset(self, which: Flags | Integers) -> OpenNodes:
        """Return some of the nodes."""
        return OpenNodes(self.boxes.subset(which), self.bound[which], self.stable[which])

    @property
    def lowest(self) -> float:
        """The least lower bound; inf if no node is open."""
        return float(self.bound.min(initial=np.inf))


def joined(parts: Sequence[OpenNodes]) -> OpenNodes:
    """Return several sets of nodes as one set."""
    boxes = Cells(*(np.hstack([getattr(part.boxes, edge) for part in parts]) for edge in ("low", "high")))
    return OpenNodes(boxes, *(np.concatenate([getattr(part, of) for part in parts]) for of in ("bound", "stable")))


def halved(relaxed: Relaxation, axes: Axes, parents: OpenNodes, incumbent: float) -> tuple[OpenNodes, Flags, int]:
    """Return nodes halved along the axis that raises their bounds most, whether that is a gain's, and the number of
    computed bounds. The worse half counts most, because it becomes the bound of the box."""
    n, rows = len(parents), axes.free
    if not rows:
        bound = np.maximum(lower_bounds(relaxed, parents.boxes)[0], parents.bound)
        return replace(parents, bound=bound), np.zeros(n, bool), n
    middle = axes.middle(parents.boxes)
    tried = [_halves(relaxed, parents, row, middle[row]) for row in rows]
    # a half far above the incumbent is pruned, however far; without one, a half goes whose designs exceed a limit
    gained = [each.bound / (2 * incumbent) if incumbent < inf else excess for each, excess in tried]
    worth = np.minimum(np.reshape(gained, (len(rows), 2, n)), 1.0)
    score = worth.min(axis=1) + BETTER_HALF * worth.max(axis=1) + LENGTH * axes.share(parents.boxes)[rows]
    best = np.tile(np.argmax(np.round(score, DIGITS), axis=0), 2)
    chosen = joined([each.subset(best == k) for k, (each, _) in enumerate(tried)])
    return chosen, np.sort(best) < sum(row <= K_P for row in rows), 2 * n * len(rows)


def _halves(relaxed: Relaxation, parents: OpenNodes, row: int, middle: Floats) -> tuple[OpenNodes, Floats]:
    """Return the lower and then the upper halves of nodes along an axis, and their excess over limits. A half that
    contains K_p = 0, but no feasible design with K_p > 0, shrinks to K_p = 0."""
    low, high = np.tile(parents.boxes.low, 2), np.tile(parents.boxes.high, 2)
    low[row, len(parents) :] = high[row, : len(parents)] = middle
    high[K_P, (low[K_P] == 0) & without_integrator(relaxed.problem, Cells(low, high))] = 0.0
    boxes = Cells(low, high)
    bound, excess = lower_bounds(relaxed, boxes)
    return OpenNodes(boxes, np.maximum(bound, np.tile(parents.bound, 2)), np.tile(parents.stable, 2)), excess


def proved_stability(posed: Posed, boxes: Cells) -> tuple[Flags, Flags, int]:
    """Return the boxes whose loops are all proved stable, those whose loops are all proved unstable, and the number of
    boxes in the proofs."""
    gains = np.concatenate((boxes.low[: K_P + 1], boxes.high[: K_P + 1]))
    rectangles, rectangle_of = np.unique(gains, axis=1, return_inverse=True)  # many boxes have the same gains
    face = np.flatnonzero((rectangles[K_P] == 0) & (rectangles[2 + K_P] > 0))
    faces = rectangles[:, face].copy()
    faces[2 + K_P] = 0.0  # without an integrator the loop has another order
    stable, unstable, count = _of_rectangles(posed, np.hstack((rectangles, faces)))
    for flags in (stable, unstable):
        flags[face] &= flags[rectangles.shape[1] :]
    return stable[rectangle_of.ravel()], unstable[rectangle_of.ravel()], count


def _of_rectangles(posed: Posed, edges: Floats) -> tuple[Flags, Flags, int]:
    """Return the same for rectangles, given as the low and then the high K_v and K_p."""
    number, boxes = edges.shape[1], 0
    cells = Cells(*(np.concatenate((end, np.ones((3, number)))) for end in (edges[:2], edges[2:])))  # any coupling
    stable, unstable = np.zeros(number, bool), np.zeros(number, bool)
    demands = [replace(posed.demands, device=device) for device in {case.device.modelled: None for case in posed.cases}]
    for which in by_integrator(cells):
        found = [x for each in demands for x in pole_turns(of_cells(each, cells.subset(which)))]
        turns = np.reshape([x.number for x in found], (len(found), len(which)))  # around 0; nan if undecided
        stable[which] = (turns == 0).all(axis=0)
        unstable[which] = (np.isfinite(turns) & (turns != 0)).any(axis=0)
        boxes += sum(int(x.boxes.sum()) for x in found)
    return stable, unstable, boxes


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
    axes = axes_of(posed.problem)
    root = OpenNodes(axes.whole, np.zeros(1), np.zeros(1, bool))
    search = _Search(posed, axes, _relaxed(posed, best), root, best.error if best else inf)
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
    proved = not len(search.nodes)
    return Optimality(reached, search.incumbent, proved, search.improved, search.boxes, search.nodes)


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
    places = ImposedPlaces(band, upto, _in_worst_hands(problem, best), angles if problem.any_hand else np.zeros(0))
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


def _tight_places(problem: Problem, gains: Gains, coupling: AnyCoupling, *, broken: bool = False) -> ImposedPlaces:
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
    return ImposedPlaces(omega, peaks.omega[-peaks.value > most], hands, np.array(any_hand))


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
        search.improved, search.incumbent = better, better.error


def _add_places(search: _Search, gains: Gains, coupling: AnyCoupling) -> None:
    """Add the places at which a design violates a constraint to the places of the relaxation."""
    known = more = search.relaxed.places
    for case in search.posed.cases:
        more = more.joined(_tight_places(case, gains, coupling, broken=True))
    if max(known.counts[:3]) < MOST_FREQUENCIES and sum(more.counts) > sum(known.counts):
        relaxed = search.relaxed
        search.relaxed = relaxation(relaxed.problem, relaxed.devices, more, relaxed.objective)
