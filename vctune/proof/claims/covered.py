"""The devices and designs that a proof covers: rows of numbers for several owners.

One design, one design for every device of a box, and cells of designs are the same proof with other rows
(proof/README.md, sections 4, 5, 8 and 9).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass, replace
from math import floor

import numpy as np

from vctune.model.demands import Demands
from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.hands import PlacesInHands
from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.units import KEYS, keys_of
from vctune.model.worlds import PlacesInWorlds
from vctune.proof.box_tests import Margin, lower_bound_over
from vctune.proof.boxes import HALF_TURN, Boxes, Cells, Integers, Values, band_of, joined, over_band, over_each
from vctune.proof.claims.cases import Case, over
from vctune.proof.device_box import DeviceBox
from vctune.proof.enclosures.intervals import Flags, Floats, decimal_or_inf
from vctune.proof.halving import Effort
from vctune.proof.outcome import Outcome, Verdict
from vctune.proof.prover import Test, prove

BAND_RATIO = 1.4  # Ratio of the edges of the first intervals of frequency
DESIGN = Effort(max_halvings=80, max_boxes=400_000)  # twenty halvings in each of four rows
CELL = Effort(max_halvings=10, max_boxes=4_000, few=0)  # the verdict on a cell must not depend on the other cells
POINT = Effort(max_halvings=24, max_boxes=4_000, few=0)


@dataclass(frozen=True, slots=True)
class Covered:
    """The devices and designs that a proof covers: rows of numbers for n owners, and the numbers that all have."""

    demands: Demands  # constraints on each device
    names: tuple[str, ...]  # names of the rows
    low: Floats  # ends of the rows, shape (rows, n)
    high: Floats
    fixed: Values  # the other numbers of the design by name
    box: DeviceBox | None = None  # box whose uncertain parameters are the rows

    @property
    def owners(self) -> int:
        """The number of owners."""
        return int(self.low.shape[1])

    @property
    def extended(self) -> bool:
        """Whether an owner has more than one device or design."""
        return bool(np.any(self.low < self.high))

    @property
    def integral(self) -> bool:
        """Whether K_p > 0, for all owners or for none."""
        return bool(self.high[1].any()) if KEYS[1] in self.names else bool(self.fixed[KEYS[1]].mid != 0)

    def margin(self, of: Callable[[Case, Number], Number]) -> Margin:
        """Return a margin of cases, or a curve, as a function of a frequency and of the numbers by name."""
        if self.box is None:
            return over(of, self.demands)
        return over(of, replace(self.demands, device=self.box.low), self.box.uncertain)

    def effort(self, of_design: Effort = DESIGN) -> Effort:
        """Return how long a proof goes on."""
        return (CELL if self.extended else POINT) if KEYS[0] in self.names else of_design

    def subset(self, at: Integers) -> Covered:
        """Return some of the owners."""
        return replace(self, low=self.low[:, at], high=self.high[:, at])

    def centres(self) -> Covered:
        """Return the centre of each owner; of a box of devices the nominal one."""
        if self.box is not None:
            return Covered(self.demands, (), np.empty((0, 1)), np.empty((0, 1)), self.fixed)
        middle = 0.5 * (self.low + self.high)
        return replace(self, low=middle, high=middle)

    def loops(self) -> list[Covered]:
        """Return the same owners for each velocity loop that must be stable: without a hand and in the operator's."""
        devices = self.demands.device.loops
        boxes = self.box.loops if self.box is not None else (None,) * len(devices)
        each = zip(devices, boxes, strict=True)
        return [replace(self, demands=replace(self.demands, device=device), box=box) for device, box in each]

    def over(self, low: float, high: float) -> Boxes:
        """Return the first boxes of each owner over a band."""
        return over_band(self.names, self.low, self.high, band_of(low, high, BAND_RATIO))

    def around_circle(self) -> Boxes:
        """Return the first boxes over all theta = omega T, for each number of whole samples in a box's delays."""
        if "device.delay" not in self.names:
            return self.over(0.0, HALF_TURN)
        row, T, parts = self.names.index("device.delay"), self.demands.device.sample_time, []
        for whole in range(floor(self.low[row, 0] / T), floor(self.high[row, 0] / T) + 1):
            least, most = self.low.copy(), self.high.copy()
            least[row], most[row] = np.maximum(least[row], whole * T), np.minimum(most[row], (whole + 1) * T)
            if least[row, 0] <= most[row, 0]:
                parts.append(over_band(self.names, least, most, band_of(0.0, HALF_TURN, BAND_RATIO), whole))
        return joined(*parts)


def of_design(design: Design, demands: Demands, box: DeviceBox | None = None) -> Covered:
    """Return a design with its own device, or with every device of a box."""
    numbers = (*astuple(design.gains), *astuple(design.coupling))
    fixed = dict(zip(keys_of(len(numbers)), map(decimal_or_inf, numbers), strict=True))
    demands = replace(demands, device=design.device)
    if box is None or not box.uncertain:
        return Covered(demands, (), np.empty((0, 1)), np.empty((0, 1)), fixed)
    low, high = (np.array([[end.number(key)] for key in box.uncertain], float) for end in (box.low, box.high))
    return Covered(demands, tuple(f"device.{key}" for key in box.uncertain), low, high, fixed, box)


def of_cells(demands: Demands, cells: Cells) -> Covered:
    """Return cells of designs of one device; either all have an integrator or none has."""
    return Covered(demands, cells.keys, cells.low, cells.high, {})


@dataclass(frozen=True, slots=True)
class Held:
    """Whether a claim holds for each of n owners."""

    proved: Flags
    point: Floats  # frequency and rows of a place where the claim fails or is open, shape (1 + rows, n)
    boxes: Integers


def held(covered: Covered, effort: Effort, parts: list[tuple[Test, Boxes]]) -> Held:
    """Prove a claim by the tests of its parts, all of which must hold."""
    n = covered.owners
    proved, point, boxes = np.ones(n, bool), np.full((1 + len(covered.names), n), np.nan), np.zeros(n, np.intp)
    for test, first in parts:
        found = prove(test, first, n, effort)
        lost = proved & ~found.proved
        point[:, lost] = np.where(np.isnan(found.failing), found.open, found.failing)[:, lost]
        proved, boxes = proved & found.proved, boxes + found.boxes
    return Held(proved, point, boxes)


# A function that returns the frequency, rad/s or rad, at which a claim certainly fails for a device
Failure = Callable[[Device, float], float | None]


def outcome_of(covered: Covered, found: Held, failure: Failure) -> Outcome:
    """Return the outcome of a claim about one design: where it is open, the margin at that place may decide."""
    boxes, box = int(found.boxes[0]), covered.box
    if found.proved[0]:
        return Outcome(Verdict.PROVED, boxes)
    place, doubtful = float(found.point[0, 0]), device_at(covered, found.point[:, 0])
    if (witness := failure(covered.demands.device, place)) is not None:
        return Outcome(Verdict.REFUTED, boxes, witness)
    for device in (doubtful, *(box.modelled.corners() if box is not None else ())):
        if (witness := failure(device, place)) is not None:
            return Outcome(Verdict.REFUTED, boxes, witness, device if box is not None else None)
    return Outcome(Verdict.UNDECIDED, boxes, place, doubtful if box is not None else None)


def device_at(covered: Covered, point: Floats) -> Device:
    """Return the device at a point of the rows."""
    if covered.box is None:
        return covered.demands.device
    within = np.clip(point[1:], covered.low[:, 0], covered.high[:, 0]).tolist()
    return covered.box.device(dict(zip(covered.box.uncertain, within, strict=True)))


def in_rad_per_s(outcome: Outcome, device: Device) -> Outcome:
    """Return an outcome with its witness theta = omega T converted to omega."""
    witness = outcome.witness / device.sample_time if outcome.witness is not None else None
    return replace(outcome, witness=witness)


# Estimated places of n cells: frequencies, rad/s, or angles omega T, rad, some with a hand; None without any
Place = Floats | PlacesInHands | PlacesInWorlds | None


def negative(*margins: Callable[[Case, Number], Number]) -> Callable[[Covered, Place], Flags]:
    """Return the function that tells throughout which cells one of some margins is negative, at a place of each."""

    def lost(cells: Covered, places: Place) -> Flags:
        if places is None:
            return np.zeros(cells.owners, bool)
        assert not isinstance(places, PlacesInWorlds)
        return np.any([most(cells, each, places) < 0 for each in margins], axis=0)

    return lost


def most(cells: Covered, of: Callable[[Case, Number], Number], places: Floats | PlacesInHands) -> Floats:
    """Return an upper bound of a margin over each cell, at a place of each."""
    margin, boxes = cells.margin(of), over_each(Cells(cells.low, cells.high), places)
    return -lower_bound_over(lambda at, values: -margin(at, values), boxes, {})
