"""Prove that no coupling can render a box of environments with the gains of a cell."""

from __future__ import annotations

from functools import partial

import numpy as np

from vctune.analysis.hardest_hands import hardest_near
from vctune.design.prepared import pose
from vctune.design.variables import coupling_from
from vctune.model.gains import Gains
from vctune.model.hand_arrays import PlacesInHands
from vctune.model.problem import Problem
from vctune.proof.claims.encirclements import by_integrator
from vctune.proof.claims.many_designs import fails_in_hands
from vctune.proof.enclosures.array_intervals import Flags, Floats
from vctune.proof.engine.boxes import FREQUENCY, Boxes, Cells
from vctune.proof.engine.branching import Decided, prove
from vctune.study.estimate_in_worlds import worst_places

COUPLING = slice(2, None)  # Rows of the coupling among the variables of a design
# Need (1/ratio) in the worst hand of a grid, relative to the limit, above which the proof refines the hand and its
# angle
NEAR_MISS = 0.97
# Greatest number of halvings of a box of couplings, and greatest number of boxes of a cell
MAX_HALVINGS, MAX_BOXES = 24, 200


def no_coupling(problem: Problem, cells: Cells, free: Flags) -> Flags:
    """Return the cells in which no design can render the environments of a problem."""
    lost = np.zeros(len(cells), bool)
    for at in by_integrator(cells):
        part = cells.subset(at)
        lost[at] = _every_box_fails(problem, part, free) if free.any() else _fails(problem, part)
    return lost


def _every_box_fails(problem: Problem, cells: Cells, free: Flags) -> Flags:
    """Return the cells in which every box of couplings fails. The proof halves only the ranges of free variables."""
    n = len(cells)
    no_frequency = np.zeros((1, n))
    names, owner = (FREQUENCY, *cells.keys), np.arange(n)
    boxes = Boxes(
        names, np.vstack((no_frequency, cells.low)), np.vstack((no_frequency, cells.high)), owner, np.zeros_like(owner)
    )
    proof = prove(
        partial(_decided, problem, free),
        boxes,
        n,
        halved=[False, *free.tolist()],
        max_halvings=MAX_HALVINGS,
        max_boxes=MAX_BOXES,
        only_whole=True,
    )
    return proof.proved


def _decided(problem: Problem, free: Flags, boxes: Boxes) -> Decided:
    """Return the boxes of couplings that fail throughout, and the cost by which the prover selects the variable to
    halve."""
    low, high = boxes.low[1:], boxes.high[1:]
    shape = boxes.low.shape
    cost = np.zeros(shape)
    with np.errstate(divide="ignore"):
        cost[1:][free] = np.log(np.maximum(high, 1e-12) / np.maximum(low, 1e-12))[free]
    zeros, n = np.zeros(shape), len(boxes)
    return Decided(
        proved=_fails(problem, Cells(low, high)),
        fails=np.zeros(n, bool),
        point=(boxes.low + boxes.high) / 2,
        cost=cost,
        known=np.zeros(n, bool),
        side=zeros,
        room=np.zeros(n),
    )


def _fails(problem: Problem, cells: Cells) -> Flags:
    """Return the cells throughout which the constraint fails. The function tests each cell at the place that is worst
    for its middle design."""
    demands, middle = pose(problem).demands, _middle(cells)
    needs, places = worst_places(problem, middle)
    lost = fails_in_hands(demands, cells, places)
    unproved = np.flatnonzero(~lost & (needs * demands.factor > NEAR_MISS))
    if unproved.size:
        closer = _refined_places(problem, middle.subset(unproved), places[unproved])
        lost[unproved] = fails_in_hands(demands, cells.subset(unproved), closer)
    return lost


def _refined_places(problem: Problem, points: Cells, places: PlacesInHands) -> PlacesInHands:
    """Return the hands and angles near given places that require the most of each design."""
    assert problem.hands_met is not None
    gains, coupling = points.low[:2, :, None, None], coupling_from([*points.low[COUPLING, :, None, None]])
    return hardest_near(problem.device, problem.hands_met, Gains(*gains), coupling, places, problem.worlds_met)[1]


def _middle(cells: Cells) -> Cells:
    """Return the design in the middle of each cell."""
    numbers: Floats = cells.centres().low
    low, high = np.maximum(cells.low[COUPLING], cells.high[COUPLING] * 1e-6), cells.high[COUPLING]
    numbers[COUPLING] = np.where(high > 0, np.sqrt(low) * np.sqrt(high), 0.0)
    return Cells(numbers, numbers)
