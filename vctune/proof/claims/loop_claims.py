"""Prove the margins that do not depend on a box of hands: Llewellyn's conditions, |S| and the unmodelled dynamics.

One design, one design for every device of a box, and cells of designs are the same proof with other rows
(proof/README.md, sections 4, 5, 8 and 9).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass, replace
from functools import partial
from math import floor, inf

import numpy as np

from vctune.model.design import Design
from vctune.model.device import Device
from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.units import KEYS, keys_of
from vctune.model.problem import Demands
from vctune.proof.box_tests import Margin, beside_zero, positive, sufficient
from vctune.proof.boxes import HALF_TURN, Boxes, Cells, Integers, Values, band_of, joined, over_band
from vctune.proof.claims.cases import Case, exact_case, over
from vctune.proof.claims.margins_of_claims import (
    clamped_margin,
    conditions_margin,
    high_margin,
    low_margin,
    outwards,
    resistance_apart,
    resistance_margin,
    sensitivity_margin,
    sensitivity_sufficient_margin,
    unmodelled_margin,
)
from vctune.proof.device_box import DeviceBox
from vctune.proof.enclosures.intervals import (
    Enclosure,
    Flags,
    Floats,
    decimal_or_inf,
    surely_negative,
)
from vctune.proof.halving import Effort
from vctune.proof.outcome import Outcome, Verdict
from vctune.proof.prover import Test, prove

BAND_RATIO = 1.4  # Ratio of the edges of the first intervals of frequency
DESIGN = Effort(max_halvings=80, max_boxes=400_000)  # twenty halvings in each of four rows
CELL = Effort(max_halvings=10, max_boxes=4_000, few=0)  # the verdict on a cell must not depend on the other cells
POINT = Effort(max_halvings=24, max_boxes=4_000, few=0)
TRIES = 400  # Number of frequencies, each a fourth of the last, tried where the proof fails at the band's low end


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


def conditions(covered: Covered, low: float, high: float) -> Held:
    """Prove Re G_hh > 0 and Re Z_c >= factor R on a band, in the hand of the least operator."""
    effort, beyond = covered.effort(), max(1 / covered.demands.device.sample_time, low)
    found = _conditions(covered, covered.over(low, beyond if high == inf else high), effort)
    if high == inf:  # as a function of 1/omega
        test = positive(covered.margin(high_margin), covered.fixed)
        above = held(covered, effort, [(test, covered.over(0.0, 1 / beyond))])
        above.point[0] = 1 / np.maximum(above.point[0], 1e-300)
        point = np.where(found.proved, above.point, found.point)
        found = Held(found.proved & above.proved, point, found.boxes + above.boxes)
    return found


def _conditions(covered: Covered, band: Boxes, effort: Effort) -> Held:
    """Prove the conditions on the boxes of a band."""
    fixed, near_zero = covered.fixed, sufficient(covered.margin(low_margin), covered.fixed)
    asked = []
    if covered.box is not None and covered.box.nominal.unmodelled is not None:
        asked += [lambda case, omega: 1 - case.radius(omega), clamped_margin]
    if resistance_apart(covered.demands.device):
        asked.append(resistance_margin)
    parts = [(beside_zero(near_zero, positive(covered.margin(conditions_margin), fixed)), band)]
    parts += [(positive(covered.margin(margin), fixed), band) for margin in asked]
    return held(covered, effort, parts)


def sensitivity(covered: Covered) -> Held:
    """Prove |S| < max_sensitivity of the sampled loop at every frequency."""

    def one_of(case: Case, theta: Number) -> tuple[Number, Number]:
        return sensitivity_margin(case, theta), sensitivity_sufficient_margin(case, theta)

    test = positive(covered.margin(sensitivity_margin), covered.fixed)
    if KEYS[1] in covered.names:
        test = beside_zero(sufficient(covered.margin(one_of), covered.fixed), test)
    return held(covered, covered.effort(), [(test, covered.around_circle())])


# A function that returns the frequency, rad/s or rad, at which a claim certainly fails for a device
Failure = Callable[[Device, float], float | None]


def prove_conditions(design: Design, demands: Demands, box: DeviceBox | None) -> Outcome:
    """Prove Llewellyn's conditions on the band for every device of the box."""
    low, high = outwards(demands.band)
    if not design.gains.closed and (box is None or box.nominal.unmodelled is None):
        return _without_loop(design, demands, low)
    covered = of_design(design, demands, box)
    failure = partial(_conditions_fail, design, demands)
    return _outcome(covered, conditions(covered, low, high), failure)


def prove_sensitivity(design: Design, demands: Demands, box: DeviceBox | None) -> Outcome:
    """Prove |S| < max_sensitivity of the sampled loop for every device of the box."""
    covered = of_design(design, demands, box)

    def failure(device: Device, theta: float) -> float | None:
        there = exact_case(replace(design, device=device), demands)
        return theta if surely_negative(sensitivity_margin(there, Enclosure(theta))) else None

    return in_rad_per_s(_outcome(covered, sensitivity(covered), failure), design.device)


def prove_unmodelled(design: Design, demands: Demands, box: DeviceBox) -> Outcome:
    """Prove |1 - S| r < 1 of the sampled loop for every device, where r is the radius of the unmodelled dynamics."""
    assert box.nominal.unmodelled is not None
    covered, with_disc = of_design(design, demands, box.modelled), replace(demands, device=box.nominal)

    def failure(device: Device, theta: float) -> float | None:
        there = exact_case(replace(design, device=device), with_disc)
        return theta if surely_negative(unmodelled_margin(there, Enclosure(theta))) else None

    margin = over(unmodelled_margin, with_disc, box.modelled.uncertain)
    found = held(covered, DESIGN, [(positive(margin, covered.fixed), covered.around_circle())])
    return in_rad_per_s(_outcome(covered, found, failure), design.device)


def _outcome(covered: Covered, found: Held, failure: Failure) -> Outcome:
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


def _without_loop(design: Design, demands: Demands, low: float) -> Outcome:
    """Return the outcome of the conditions without feedback, where R = 0: the damping must be positive, and Re Z_c if
    environments are behind it."""
    coupling = design.series
    resistive = demands.alone or coupling.drag > 0 or (0 < coupling.damping < inf and coupling.mass > 0)
    holds = design.device.least_damping > 0 and resistive
    return Outcome(Verdict.PROVED, 1) if holds else Outcome(Verdict.UNDECIDED, 1, low)


def _conditions_fail(design: Design, demands: Demands, device: Device, omega: float) -> float | None:
    """Return where the conditions certainly fail: at a frequency or towards an endless end of the band; else None."""
    there = exact_case(replace(design, device=device), demands)

    def fails(omega: float) -> bool:
        if surely_negative(conditions_margin(there, Enclosure(omega))):
            return True
        return resistance_apart(device) and surely_negative(resistance_margin(there, Enclosure(omega)))

    (low, high), tried = demands.band, [omega]
    if low == 0 and omega < 1 / device.sample_time:
        tried += [min(high, 1.0) * 0.25**k for k in range(TRIES)]
    if high == inf and omega > 1 / device.sample_time:
        tried += [max(low, 1.0) * 4.0**k for k in range(TRIES)]
    return next((each for each in tried if each > 0 and fails(each)), None)


def in_rad_per_s(outcome: Outcome, device: Device) -> Outcome:
    """Return an outcome with its witness theta = omega T converted to omega."""
    witness = outcome.witness / device.sample_time if outcome.witness is not None else None
    return replace(outcome, witness=witness)


def is_rational(device: Device) -> bool:
    """Return whether a device has a model at every frequency: whether it is ideal, with hold "lag" and no delay."""
    return device.ideal and device.hold == "lag" and device.delay == 0
