"""Decide for many boxes of environments at once which of them leave a design stable in every hand."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

import numpy as np

from vctune.model.hands import HAND
from vctune.model.problem import Demands
from vctune.model.sampled.plant_in_hand import delays_of
from vctune.model.worlds import World, Worlds
from vctune.proof.claims.array_claims import WORLD_ENDS, hands_margins
from vctune.proof.claims.delay_parts import Part, parts_of
from vctune.proof.claims.every_hand import (
    MAX_HALVINGS,
    Asked,
    boxes_over,
    fixed_of,
    prove_stable_in_middle,
)
from vctune.proof.claims.margins_of_claims import Design
from vctune.proof.claims.worlds.walls import COUPLING_SHARE
from vctune.proof.device_box import DeviceBox, in_longer_hands, in_one_delay, late_as_one, moved_as_one
from vctune.proof.enclosures.array_intervals import Flags, Floats
from vctune.proof.engine.box_tests import Margins, positive
from vctune.proof.engine.boxes import FREQUENCY, Boxes, Integers, Values
from vctune.proof.engine.branching import left_open, prove
from vctune.proof.engine.interval import Verdict
from vctune.proof.engine.polynomial_tests import FEW

# Number of boxes after which the proof that uses only the condition on the real part ends, and number of boxes after
# which the prover leaves a cell of environments open
MAX_BOXES, CELL_BOXES = 60_000, 5_000
FAILING = 0.8  # Share of the open boxes in which the condition on the real part certainly fails somewhere
FEW_BOXES = 1000  # Number of intervals of angles after which the prover leaves a witness open


@dataclass(frozen=True, slots=True)
class WorldCells:
    """Boxes of environments; each box is a column of the arrays."""

    low: Floats  # least and greatest mass, damping and stiffness, SI units, shape (3, n)
    high: Floats

    def __len__(self) -> int:
        return int(self.low.shape[1])

    def subset(self, at: Flags | Integers) -> WorldCells:
        """Return some of the boxes."""
        return WorldCells(self.low[:, at], self.high[:, at])

    @property
    def hull(self) -> Worlds:
        """The environments of all boxes. Their least damping is 0 only if it is 0 in each box."""
        low, high = self.low.min(axis=1), self.high.max(axis=1)
        low[1] = self.low[1].max()
        return Worlds(World(*low.tolist()), World(*high.tolist()))


@dataclass(frozen=True, slots=True)
class OpenInHands:
    """The boxes of angle and hand that the condition on the real part does not decide. In these boxes the environment
    decides."""

    asked: Asked  # the claim with a box of all masses and stiffnesses
    stable: bool  # whether the loop is proved stable with one of these environments
    parts: tuple[tuple[Part, Boxes], ...]  # parts of the boxes, each with the boxes that stay open

    @property
    def nothing(self) -> bool:
        """Whether no box is open. The design is then stable with all environments."""
        return self.stable and not any(len(boxes) for _, boxes in self.parts)

    def proved(self, cells: WorldCells) -> Flags:
        """Return the boxes of environments that certainly leave the design stable in every hand."""
        proved = np.full(len(cells), self.stable)
        if not proved.any():
            return proved
        ends = dict(zip((*WORLD_ENDS[0], *WORLD_ENDS[1]), (*cells.low, *cells.high), strict=True))
        ends = {name: end for name, end in ends.items() if np.isfinite(end).all()}
        asked = replace(self.asked, demands=replace(self.asked.demands, worlds=cells.hull))
        for part, boxes in self.parts:
            left = np.flatnonzero(proved)
            if not len(boxes) or not left.size:
                continue
            names, tied = (*asked.names, *ends), np.array([end[left] for end in ends.values()])
            ends_too = replace(part, names=names, low=_with(part.low, tied), high=_with(part.high, tied))
            (test,) = asked.tests(ends_too, fixed_of(asked.design))
            found = prove(
                part.within(test),
                _each(boxes, names, tied),
                left.size,
                halved=[True] * (1 + len(asked.names)) + [False] * len(ends),
                max_halvings=MAX_HALVINGS,
                max_boxes=CELL_BOXES,
                at_ends=True,
                few=FEW,
            )
            proved[left] = found.proved
        return proved


def open_in_hands(design: Design, demands: Demands, box: DeviceBox | None, damping: float) -> OpenInHands:
    """Return the boxes of angle and hand that the condition on the real part does not decide."""
    hands = demands.hands
    assert hands is not None
    demands = replace(demands, worlds=Worlds(World(0.0, damping, 0.0), World(inf, inf, inf)))
    if box is not None and (parts := moved_as_one(box)):
        least = {key: box.low.number(key) for key in parts}
        design = replace(design, device=design.device.with_numbers(least))
        box, longer = in_longer_hands(box, hands, parts)
        demands = replace(demands, device=demands.device.with_numbers(least), hands=longer)
    if box is not None and late_as_one(box):
        box = in_one_delay(box)
        design, demands = replace(design, device=box.nominal), replace(demands, device=box.nominal)
    asked = Asked(design, demands, box)
    if prove_stable_in_middle(design, demands).verdict is not Verdict.PROVED:
        return OpenInHands(asked, stable=False, parts=())
    found = tuple(
        (
            part,
            left_open(part.within(test), boxes_over(part), max_boxes=MAX_BOXES, share=FAILING)[0],
        )
        for part in parts_of(design.device, asked.ends())
        for test in asked.tests(part, fixed_of(design))
    )
    return OpenInHands(asked, stable=True, parts=found)


def _with(numbers: Floats, tied: Floats) -> Floats:
    """Return the numbers of rows with the numbers of the environments appended, which are the same in all boxes."""
    return np.vstack((numbers, tied[:, :1]))


def _each(boxes: Boxes, names: tuple[str, ...], tied: Floats) -> Boxes:
    """Return the boxes of each owner: the common rows and the owner's own numbers."""
    owners, count = tied.shape[1], len(boxes)
    low, high = (np.vstack((np.tile(edge, owners), np.repeat(tied, count, axis=1))) for edge in (boxes.low, boxes.high))
    owner = np.repeat(np.arange(owners), count)
    return Boxes((FREQUENCY, *names), low, high, owner, np.tile(boxes.whole_samples, owners))


@dataclass(frozen=True, slots=True)
class Witnesses:
    """Witnesses that refute boxes of environments, one for each box."""

    start: Floats  # angles, rad, shape (n,)
    end: Floats
    hand: Floats  # mass, damping and stiffness of the hand, shape (3, n)
    share: Floats  # share of the coupling, from 1/g to 1, shape (n,)


def refuted_in_worlds(design: Design, demands: Demands, cells: WorldCells, witnesses: Witnesses) -> Flags:
    """Return the boxes of environments in which no member leaves a design stable in the witness's hand."""
    one = replace(demands, factor=1.0, worlds=cells.hull)
    margins = hands_margins(one, (), delays_of(design.device))
    fixed = fixed_of(design)
    ends = dict(zip((*WORLD_ENDS[0], *WORLD_ENDS[1]), (*cells.low, *cells.high), strict=True))
    del ends[WORLD_ENDS[1][1]]
    names = (*HAND, COUPLING_SHARE, *ends)
    rows = np.vstack((witnesses.hand, witnesses.share, *ends.values()))
    passed = np.zeros(len(cells), bool)
    first, last = (_margins_at(margins, names, theta, rows, fixed) for theta in (witnesses.start, witnesses.end))
    passed = (first[1] & last[2]) | (first[2] & last[1])
    least, most = np.minimum(witnesses.start, witnesses.end), np.maximum(witnesses.start, witnesses.end)
    negative = positive(lambda theta, v: -margins(theta, v)[0], fixed)
    at = np.flatnonzero(passed)
    boxes = Boxes(
        (FREQUENCY, *names),
        np.vstack((least, rows))[:, at],
        np.vstack((most, rows))[:, at],
        np.arange(at.size),
        np.zeros(at.size, np.intp),
    )
    halved = [True] + [False] * len(names)
    found = prove(negative, boxes, at.size, halved=halved, max_halvings=MAX_HALVINGS, max_boxes=FEW_BOXES)
    passed[at] = found.proved
    return passed


def _margins_at(margins: Margins, names: tuple[str, ...], theta: Floats, rows: Floats, fixed: Values) -> list[Flags]:
    """Return which of the margins are positive at single points."""
    at = np.vstack((theta, rows))
    owner = np.arange(theta.size)
    boxes = Boxes((FREQUENCY, *names), at, at, owner, np.zeros_like(owner))
    numbers = boxes.rows()
    with np.errstate(all="ignore"):
        found = margins(numbers[0], boxes.named(numbers, fixed))
        return [np.broadcast_to(each.positive(), theta.shape) for each in found]
