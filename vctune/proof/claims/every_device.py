"""Prove the claims of a certificate for every device of a box, given that they hold for the nominal device."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass, replace
from itertools import product
from math import floor, inf, pi

import numpy as np

from vctune.model.device import Device
from vctune.model.numbers.arithmetic import Number
from vctune.model.numbers.keys import keys_of
from vctune.model.problem import Demands
from vctune.proof.boxes import WHOLE_SAMPLES, Boxes, Cells, Values, band_of, joined, over_band
from vctune.proof.claims.array_claims import Claims, claims_of
from vctune.proof.claims.encirclements import model_curve_end
from vctune.proof.claims.llewellyn.conditions import EXTENSION_BOXES, LOWEST_EDGE
from vctune.proof.claims.llewellyn.polynomials import is_rational
from vctune.proof.claims.margins_of_claims import HALF_TURN, Design, outwards, resistance_apart
from vctune.proof.claims.model_poles import NEAR
from vctune.proof.device_box import DeviceBox
from vctune.proof.enclosures.intervals import ENCLOSURES, Enclosure, Floats, between, decimal, decimal_or_inf
from vctune.proof.engine.bands import STEP, extend_band
from vctune.proof.engine.interval import Outcome, Verdict
from vctune.proof.prover import Margin, Proofs, Test, misses_zero, positive, prove

FEW_SAMPLES = 4  # Number of whole samples in a box's delays up to which the prover tries them one by one
# Number of angles, and least of these angles, at which the code estimates the size of a loop
ANGLES, LEAST_ANGLE = 400, 1e-6
MAX_BOXES, MAX_BOXES_OF_CURVES = 1_600_000, 40_000  # Greatest number of boxes for one claim, and for one curve
MAX_HALVINGS = 80  # Greatest number of halvings of a box: twenty in each of four rows


@dataclass(frozen=True, slots=True)
class RobustDesign:
    """One design for every device of a box."""

    design: Design  # design with the nominal device
    box: DeviceBox  # box of devices
    demands: Demands  # constraints on each device

    @property
    def values(self) -> Values:
        """Enclosures of the design's parameters."""
        numbers = astuple(self.design.gains) + astuple(self.design.coupling)
        return dict(zip(keys_of(len(numbers)), map(decimal_or_inf, numbers), strict=True))

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the rows of the uncertain parameters."""
        return tuple(f"device.{name}" for name in self.box.uncertain)

    def loops(self) -> list[RobustDesign]:
        """Return this design for each box of devices whose velocity loops must be stable."""
        design = self.design
        return [replace(self, design=replace(design, device=box.nominal), box=box) for box in self.box.loops]

    def ends(self) -> tuple[Floats, Floats]:
        """Return the least and the greatest values of the uncertain parameters."""
        low, high = (
            np.array([end.number(key) for key in self.box.uncertain], float).reshape(-1, 1)
            for end in (self.box.low, self.box.high)
        )
        return low, high

    def claims(self) -> Claims:
        """Return the claims as functions that also take the uncertain parameters."""
        demands = replace(self.demands, device=self.box.low)
        return claims_of(demands, self.box.uncertain)

    def device(self, numbers: Floats) -> Device:
        """Return the device of the box with given uncertain parameters."""
        within = np.clip(numbers[:, None], *self.ends())
        return self.box.device(dict(zip(self.box.uncertain, within[:, 0].tolist(), strict=True)))

    def enclosed(self) -> Device:
        """Return the nominal device in which each uncertain parameter is an enclosure of its range."""
        low, high = self.ends()
        numbers = dict(zip(self.box.uncertain, map(between, low[:, 0], high[:, 0]), strict=True))
        return self.box.nominal.converted(decimal).with_numbers(numbers)


# Function that judges a claim for one device at a doubtful frequency, rad/s or rad
NominalProof = Callable[[Device, float], Outcome]


def prove_conditions_for_all(robust: RobustDesign, alone: NominalProof) -> Outcome:
    """Prove Llewellyn's conditions for every device of the box."""
    return outcome_for_all(robust, _conditions(robust, *outwards(robust.demands.band), MAX_BOXES), alone)


def _conditions(robust: RobustDesign, low: float, high: float, max_boxes: int) -> list[Proofs]:
    """Prove the conditions."""
    claims, turning = robust.claims(), _turning(robust)
    beyond = max(1 / robust.box.nominal.sample_time, low)
    test = positive(claims.conditions, robust.values, claims.conditions_near_zero)
    parts, finite = [], beyond if high == inf else high
    if robust.box.nominal.unmodelled is not None:
        parts += [
            part_over_band(robust, positive(margin, robust.values), low, finite, max_boxes) for margin in claims.clamped
        ]
    if resistance_apart(robust.box.nominal):
        parts.append(part_over_band(robust, positive(claims.resistance, robust.values), low, finite, max_boxes))
    if low < turning:
        parts.append(part_over_band(robust, test, low, min(turning, finite), max_boxes))
    if turning < finite:
        parts.append(_whatever_phase(robust, claims.conditions, max(low, turning), finite, max_boxes))
    if high == inf:
        parts.append(
            part_over_band(robust, positive(claims.conditions_near_infinity, robust.values), 0.0, 1 / beyond, max_boxes)
        )
    return parts


def _turning(robust: RobustDesign) -> float:
    """Return the frequency, rad/s, above which the phases of the box's delays cover a full turn; inf for one delay."""
    range_ = robust.box.high.delay - robust.box.low.delay
    return 2 * pi / range_ * (1 + NEAR) if range_ > 0 else inf


def _whatever_phase(robust: RobustDesign, margin: Margin, low: float, high: float, max_boxes: int) -> Proofs:
    """Prove a margin of the frequency model positive at frequencies at which omega times the delay covers a full
    turn."""
    (least, greatest), row, name = robust.ends(), robust.box.uncertain.index("delay"), "device.delay"

    def of_phase(omega: Number, values: Values) -> Number:
        return margin(omega, {**values, name: values[name] / omega})

    shortest = least[row, 0]
    # the phase omega delay covers one full turn; this is the second turn, so that no delay is 0
    least[row], greatest[row] = 2 * pi * (1 - NEAR), 4 * pi * (1 + NEAR)
    boxes = over_band(robust.names, least, greatest, band_of(low, high, STEP))
    found = _proved(positive(of_phase, robust.values), boxes, max_boxes)
    for point in (found.failing, found.open):
        point[1 + row] = shortest + np.mod(point[1 + row] / point[0] - shortest, 2 * pi / point[0])
    return found


def widest_band_for_all(robust: RobustDesign) -> tuple[float, float]:
    """Return the widest band around a proved band on which the conditions are proved for every device, rad/s."""
    (low, high), device = robust.demands.band, robust.box.nominal

    def holds(low: float, high: float) -> bool:
        return all(part.proved[0] for part in _conditions(robust, low, high, EXTENSION_BOXES))

    endless = is_rational(device)
    first = 0.0 if low == 0 or holds(0.0, low) else extend_band(holds, low, low * LOWEST_EDGE)
    if high == inf or (endless and holds(high, inf)):
        return first, inf
    return first, extend_band(holds, high, high / LOWEST_EDGE if endless else pi / device.sample_time)


def prove_sensitivity_for_all(robust: RobustDesign, alone: NominalProof) -> Outcome:
    """Prove |S| < max_sensitivity of the sampled loop for every device of the box."""
    claims = robust.claims()
    test = positive(claims.sensitivity, robust.values)
    return outcome_for_all(robust, _around_circle(robust, test, claims.sensitivity_any_phase, MAX_BOXES), alone)


def _around_circle(robust: RobustDesign, test: Test, gain: Margin, max_boxes: int) -> list[Proofs]:
    """Test all theta = omega T for each number of whole samples in the box's delays."""
    samples, small, parts = _whole_samples(robust), HALF_TURN, []
    if len(samples) > FEW_SAMPLES:
        small = _small_from(robust, gain)
    if small < HALF_TURN:
        boxes = over_band(robust.names, *_within_a_sample(robust), band_of(small, HALF_TURN, STEP))
        parts = [_proved(positive(gain, robust.values), boxes, max_boxes)]
        if not parts[0].proved[0]:
            small, parts = HALF_TURN, []
    if small > 0:
        circle = band_of(0.0, small, STEP)
        boxes = joined(*(over_band(robust.names, low, high, circle, whole) for whole, low, high in samples))
        parts.append(_proved(test, boxes, max(max_boxes, MAX_BOXES_OF_CURVES * len(samples))))
    return parts


def _within_a_sample(robust: RobustDesign) -> tuple[Floats, Floats]:
    """Return the ends of the box, with each range of delays replaced by one sample, from 0 to T."""
    (low, high), row = robust.ends(), robust.box.uncertain.index("delay")
    low[row], high[row] = 0.0, robust.box.nominal.sample_time
    return low, high


def _small_from(robust: RobustDesign, gain: Margin) -> float:
    """Return an estimate of the theta above which a loop gain is small, rounded upwards; 0 if the gain is always
    small."""
    theta = np.geomspace(LEAST_ANGLE, HALF_TURN, ANGLES)
    ends = np.hstack(_within_a_sample(robust))
    margins = []
    for corner in product(*ends):
        numbers = dict(zip(robust.names, map(Enclosure, corner), strict=True))
        margins.append(gain(Enclosure(theta), {**robust.values, **numbers, WHOLE_SAMPLES: 0}).mid)
    large = np.flatnonzero(np.min(margins, axis=0) <= 0)
    return min(float(theta[large[-1]]) * STEP, HALF_TURN) if len(large) else 0.0


def prove_unmodelled(robust: RobustDesign, alone: NominalProof) -> Outcome:
    """Prove |1 - S| r < 1 of the sampled loop for every device, where r is the radius of the unmodelled dynamics."""
    modelled = replace(robust, box=robust.box.modelled)
    claims = claims_of(replace(robust.demands, device=robust.box.nominal), modelled.box.uncertain)
    test = positive(claims.unmodelled, robust.values)
    parts = [
        _proved(test, over_band(modelled.names, low, high, band_of(0.0, HALF_TURN, STEP), whole), MAX_BOXES)
        for whole, low, high in _whole_samples(modelled)
    ]
    return outcome_for_all(modelled, parts, alone)


def prove_model_poles_for_all(robust: RobustDesign, alone: NominalProof) -> Outcome:
    """Prove that no pole of the frequency model crosses the imaginary axis from one device to another."""
    gains = robust.design.gains
    law, parts = np.array([[gains.velocity], [gains.position]]), []
    for loop in robust.loops():
        claims = loop.claims()
        test = misses_zero(claims.model_poles, loop.values, claims.model_any_position)
        end = model_curve_end(loop.enclosed(), Cells(law, law), ENCLOSURES)
        parts.append(part_over_band(loop, test, 0.0, end, MAX_BOXES_OF_CURVES))
    return outcome_for_all(robust, parts, alone)


def prove_sampled_poles_for_all(robust: RobustDesign, alone: NominalProof) -> Outcome:
    """Prove that no pole of the sampled loop crosses the unit circle from one device to another."""
    parts = []
    for loop in robust.loops():
        claims = loop.claims()
        test = misses_zero(claims.sampled_poles, loop.values, claims.sampled_any_position)
        parts += _around_circle(loop, test, claims.sampled_any_phase, MAX_BOXES_OF_CURVES)
    return outcome_for_all(robust, parts, alone)


def _whole_samples(robust: RobustDesign) -> list[tuple[int, Floats, Floats]]:
    """Return the numbers of whole samples in the delays of the box, each with the ends of its part of the box."""
    (low, high), T, names = robust.ends(), robust.box.nominal.sample_time, robust.box.uncertain
    if "delay" not in names:
        return [(0, low, high)]
    row, parts = names.index("delay"), []
    for whole in range(floor(low[row, 0] / T), floor(high[row, 0] / T) + 1):
        least, most = low.copy(), high.copy()
        least[row], most[row] = np.maximum(low[row], whole * T), np.minimum(high[row], (whole + 1) * T)
        if least[row, 0] <= most[row, 0]:
            parts.append((whole, least, most))
    return parts


def part_over_band(robust: RobustDesign, test: Test, low: float, high: float, max_boxes: int) -> Proofs:
    """Prove a test for all devices of the box over a band."""
    boxes = over_band(robust.names, *robust.ends(), band_of(low, high, STEP))
    return _proved(test, boxes, max_boxes)


def _proved(test: Test, boxes: Boxes, max_boxes: int) -> Proofs:
    """Prove a margin positive, or prove that a curve misses 0."""
    return prove(test, boxes, max_halvings=MAX_HALVINGS, max_boxes=max_boxes)


def outcome_for_all(robust: RobustDesign, parts: list[Proofs], alone: NominalProof) -> Outcome:
    """Return the outcome of a claim for all devices from the proofs of its parts."""
    boxes = sum(int(part.boxes[0]) for part in parts)
    open_ = next((part for part in parts if not part.proved[0]), None)
    if open_ is None:
        return Outcome(Verdict.PROVED, boxes)
    point = open_.open[:, 0] if np.isnan(open_.failing[0, 0]) else open_.failing[:, 0]
    doubtful = robust.device(point[1:])
    for device in (doubtful, *robust.box.modelled.corners()):
        judged = alone(device, float(point[0]))
        boxes += judged.boxes
        if judged.verdict is Verdict.REFUTED:
            return Outcome(Verdict.REFUTED, boxes, judged.witness, device)
    return Outcome(Verdict.UNDECIDED, boxes, None, doubtful)
