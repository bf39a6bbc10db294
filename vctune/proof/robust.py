"""The claims of a certificate for every device of a box, given that they hold for the nominal one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from math import floor, inf, pi

import numpy as np

from vctune.model.arithmetic import Number
from vctune.model.quantities import Device
from vctune.proof.batch import NEAR, STEP, stiffest
from vctune.proof.blocks import Found, Look, missing, over_band, positive, prove_blocks, together
from vctune.proof.cells import Cells, Margin, Values, all_pairs
from vctune.proof.claims import HALF_TURN, Design, outwards
from vctune.proof.devices import DeviceBox
from vctune.proof.enclosed import Claims, Demands, claims_of
from vctune.proof.enclosures import Enclosure, Floats, decimal
from vctune.proof.exact import is_rational
from vctune.proof.interval import Outcome, Verdict
from vctune.proof.llewellyn import LOWEST_EDGE, MARCH_BOXES, march

DESIGN = 5
"""Numbers of a design, before the uncertain ones among a claim's values."""
LITTLE_PHASE = 0.5
"""Angle omega tau up to which the margin that is regular at omega = 0 is worth a look, rad."""
FEW_SAMPLES = 4
"""Whole samples of a box's delays that are looked at one by one anyway."""
ANGLES, LEAST_ANGLE = 400, 1e-6
"""Angles at which the size of a loop is estimated, and the least of them."""
MOST, MOST_OF_CURVES = 400_000, 40_000
"""Blocks looked at for one claim before it is left open; a curve that is not nearly 0 anywhere takes some dozens."""


@dataclass(frozen=True, slots=True)
class Family:
    """One design on every device of a box.

    Attributes
    ----------
    design : with the nominal device
    box : of devices
    demands : on each of them
    """

    design: Design
    box: DeviceBox
    demands: Demands

    @property
    def integrator(self) -> bool:
        """Whether the law has its K_p/s term."""
        return bool(self.design.gains.position > 0)

    @property
    def values(self) -> list[Enclosure]:
        """The five numbers of the design, enclosed."""
        gains, coupling = self.design.gains, self.design.coupling
        five = (gains.velocity, gains.position, coupling.damping, coupling.mass, coupling.drag)
        return [decimal(x) for x in five]

    def loops(self) -> list[Family]:
        """Return the design on the boxes of devices whose loops must be stable by themselves."""
        design = self.design
        return [replace(self, design=replace(design, device=box.nominal), box=box) for box in self.box.loops]

    def ends(self) -> tuple[Floats, Floats]:
        """Return the least and the greatest of the uncertain numbers."""
        low, high = (
            np.array([getattr(end, name) for name in self.box.moving]) for end in (self.box.low, self.box.high)
        )
        return low, high

    def claims(self) -> Claims:
        """Return the claims as functions of the uncertain numbers too."""
        demands = replace(self.demands, device=self.box.nominal)
        return claims_of(demands, integrator=self.integrator, uncertain=self.box.moving)

    def device(self, numbers: Floats) -> Device:
        """Return a device of the box from its uncertain numbers."""
        within = np.clip(numbers, *self.ends())
        return replace(self.box.nominal, **dict(zip(self.box.moving, within.tolist(), strict=True)))


Alone = Callable[[Device], Outcome]
"""Judges a claim for one device."""


def conditions_over(family: Family, alone: Alone) -> Outcome:
    """Prove Llewellyn's conditions for every device."""
    return _outcome(family, _conditions(family, *outwards(family.demands.band), MOST), alone)


def _conditions(family: Family, low: float, high: float, most: int) -> list[Found]:
    claims, turning = family.claims(), _turning(family)
    beyond = max(1 / family.box.nominal.sample_time, low)
    look = positive(claims.conditions, family.values, claims.low, LITTLE_PHASE / family.box.high.lag)
    parts, finite = [], beyond if high == inf else high
    if low < turning:
        parts.append(_part(family, look, low, min(turning, finite), most))
    if turning < finite:
        parts.append(_whatever_phase(family, claims.conditions, max(low, turning), finite, most))
    if high == inf:
        parts.append(_part(family, positive(claims.high, family.values), 0.0, 1 / beyond, most))
    return parts


def _turning(family: Family) -> float:
    """Return the frequency from which on the delays of the box turn the phase fully, rad/s; inf for one delay."""
    range_ = family.box.high.delay - family.box.low.delay
    return 2 * pi / range_ * (1 + NEAR) if range_ > 0 else inf


def _whatever_phase(family: Family, margin: Margin, low: float, high: float, most: int) -> Found:
    """Prove a margin of the frequency model positive where every phase omega delay occurs, of a full turn of it."""
    (least, greatest), row = family.ends(), family.box.moving.index("delay")

    def of_phase(omega: Number, values: Values) -> Number:
        numbers = [*values]
        numbers[DESIGN + row] = values[DESIGN + row] / omega
        return margin(omega, numbers)

    shortest = least[row]
    least[row], greatest[row] = 2 * pi * (1 - NEAR), 4 * pi * (1 + NEAR)
    blocks = over_band(all_pairs(1, low, high, STEP), least, greatest)
    found = prove_blocks(positive(of_phase, family.values), blocks, most)
    if found.point is not None:
        omega = found.point[0]
        found.point[1 + row] = shortest + np.mod(found.point[1 + row] / omega - shortest, 2 * pi / omega)
    return found


def widest_band_over(family: Family) -> tuple[float, float]:
    """Return the widest band around a proved one on which the conditions are proved for every device, rad/s."""
    (low, high), device = family.demands.band, family.box.nominal

    def holds(low: float, high: float) -> bool:
        return all(part.verdict is Verdict.PROVED for part in _conditions(family, low, high, MARCH_BOXES))

    endless = is_rational(device)
    first = 0.0 if low == 0 or holds(0.0, low) else march(holds, low, low * LOWEST_EDGE)
    if high == inf or (endless and holds(high, inf)):
        return first, inf
    return first, march(holds, high, high / LOWEST_EDGE if endless else pi / device.sample_time)


def sensitivity_over(family: Family, alone: Alone) -> Outcome:
    """Prove |S| < max_sensitivity of the sampled loop for every device."""
    claims = family.claims()
    look = positive(claims.sensitivity, family.values)
    return _outcome(family, _around_circle(family, look, claims.quiet_gain, MOST), alone)


def _around_circle(family: Family, look: Look, gain: Margin, most: int) -> list[Found]:
    """Look at all of theta = omega T, at the whole samples that delays of the box have one by one.

    Where they are many, not so at high frequencies, where the loop is so small that its phase does not matter.
    """
    samples, small, parts = _whole_samples(family), HALF_TURN, []
    if len(samples) > FEW_SAMPLES:
        small = _small_from(family, gain)
    if small < HALF_TURN:
        blocks = over_band(all_pairs(1, small, HALF_TURN, STEP), *_within_a_sample(family))
        parts = [prove_blocks(positive(gain, family.values), blocks, most)]
        if parts[0].verdict is not Verdict.PROVED:
            small, parts = HALF_TURN, []
    if small > 0:
        pairs = all_pairs(1, 0.0, small, STEP)
        blocks = together([over_band(pairs, low, high, whole) for whole, low, high in samples])
        parts.append(prove_blocks(look, blocks, most * len(samples)))
    return parts


def _within_a_sample(family: Family) -> tuple[Floats, Floats]:
    """Return the ends of the box without the whole samples of its delays."""
    (low, high), row = family.ends(), family.box.moving.index("delay")
    low[row], high[row] = 0.0, family.box.nominal.sample_time
    return low, high


def _small_from(family: Family, gain: Margin) -> float:
    """Return an estimate of the theta from which on a loop is small, a little on the safe side; 0 if it always is."""
    theta = np.geomspace(LEAST_ANGLE, HALF_TURN, ANGLES)
    corners = product(*zip(*_within_a_sample(family), strict=True))
    margins = [gain(Enclosure(theta), [*family.values, *map(Enclosure, corner), 0]).mid for corner in corners]
    large = np.flatnonzero(np.min(margins, axis=0) <= 0)
    return min(float(theta[large[-1]]) * STEP, HALF_TURN) if len(large) else 0.0


def model_poles_over(family: Family, alone: Alone) -> Outcome:
    """Prove that no pole of the frequency model crosses the imaginary axis from one device to another."""
    gains = family.design.gains
    law, parts = np.array([[gains.velocity], [gains.position]]), []
    for loop in family.loops():
        claims = loop.claims()
        look = missing(claims.model_poles, loop.values, claims.model_floor)
        parts.append(_part(loop, look, 0.0, stiffest(loop.box.low, Cells(law, law)), MOST_OF_CURVES))
    return _outcome(family, parts, alone)


def sampled_poles_over(family: Family, alone: Alone) -> Outcome:
    """Prove that no pole of the sampled loop crosses the unit circle from one device to another.

    The loop depends continuously on the delay where a whole sample is added to it.
    """
    parts = []
    for loop in family.loops():
        claims = loop.claims()
        look = missing(claims.sampled_poles, loop.values, claims.sampled_floor)
        parts += _around_circle(loop, look, claims.gain, MOST_OF_CURVES)
    return _outcome(family, parts, alone)


def _whole_samples(family: Family) -> list[tuple[int, Floats, Floats]]:
    """Return the whole samples that delays of the box have, each with the ends of that part of the box."""
    (low, high), T, names = family.ends(), family.box.nominal.sample_time, family.box.moving
    if "delay" not in names:
        return [(0, low, high)]
    row, parts = names.index("delay"), []
    for whole in range(floor(low[row] / T), floor(high[row] / T) + 1):
        least, most = low.copy(), high.copy()
        least[row], most[row] = max(low[row], whole * T), min(high[row], (whole + 1) * T)
        if least[row] <= most[row]:
            parts.append((whole, least, most))
    return parts


def _part(family: Family, look: Look, low: float, high: float, most: int = MOST) -> Found:
    return prove_blocks(look, over_band(all_pairs(1, low, high, STEP), *family.ends()), most)


def _outcome(family: Family, parts: list[Found], alone: Alone) -> Outcome:
    """Return what the parts of a claim come to; where one is open, a device that fails by itself refutes it."""
    boxes = sum(part.boxes for part in parts)
    open_ = next((part for part in parts if part.verdict is not Verdict.PROVED), None)
    if open_ is None:
        return Outcome(Verdict.PROVED, boxes)
    assert open_.point is not None
    for device in (family.device(open_.point[1:]), *family.box.corners()):
        judged = alone(device)
        boxes += judged.boxes
        if judged.verdict is Verdict.REFUTED:
            return Outcome(Verdict.REFUTED, boxes, judged.witness, device)
    return Outcome(Verdict.UNDECIDED, boxes, None, family.device(open_.point[1:]))
