"""The claims of a certificate for every device of a box, given that they hold for the nominal one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import floor, inf, pi

import numpy as np

from vctune.model.quantities import Device
from vctune.proof.batch import STEP, stiffest
from vctune.proof.blocks import Found, Look, missing, over_band, positive, prove_blocks, together
from vctune.proof.cells import Cells, all_pairs
from vctune.proof.claims import HALF_TURN, Design, outwards
from vctune.proof.devices import DeviceBox
from vctune.proof.enclosed import Claims, Demands, claims_of
from vctune.proof.enclosures import Enclosure, Floats, decimal
from vctune.proof.exact import is_rational
from vctune.proof.interval import Outcome, Verdict
from vctune.proof.llewellyn import LOWEST_EDGE, MARCH_BOXES, march

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
    claims = family.claims()
    beyond = max(1 / family.box.nominal.sample_time, low)
    look = positive(claims.conditions, family.values, claims.low if low == 0 else None)
    parts = [_part(family, look, low, beyond if high == inf else high, most)]
    if high == inf:
        parts.append(_part(family, positive(claims.high, family.values), 0.0, 1 / beyond, most))
    return parts


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
    look = positive(family.claims().sensitivity, family.values)
    return _outcome(family, [_around_circle(family, look, MOST)], alone)


def _around_circle(family: Family, look: Look, most: int) -> Found:
    """Look at all of theta = omega T; `most` for each of the whole samples that delays of the box have."""
    pairs = all_pairs(1, 0.0, HALF_TURN, STEP)
    parts = [over_band(pairs, low, high, whole) for whole, low, high in _whole_samples(family)]
    return prove_blocks(look, together(parts), most * len(parts))


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
        parts.append(_around_circle(loop, look, MOST_OF_CURVES))
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
