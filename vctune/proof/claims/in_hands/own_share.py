"""Omit boxes near rest that contain no hand, because their share of the stiffness belongs to no pair of angle and
hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vctune.model.device import Device
from vctune.model.hands import STIFFNESS
from vctune.proof.claims.array_claims import SHARES
from vctune.proof.claims.delay_parts import row_of
from vctune.proof.enclosures.array_intervals import Floats
from vctune.proof.engine.boxes import Boxes
from vctune.proof.engine.branching import Decided, Test

# Least relative distance between a box's share and the shares of its angles and hands at which the test omits the box
WITHIN = 1e-9


def with_own_share(test: Test, device: Device, names: tuple[str, ...]) -> Test:
    """Return a test that reports a box as proved if its share of the stiffness belongs to none of its angles and
    hands."""
    share, stiffness = (1 + names.index(name) for name in (SHARES[1], STIFFNESS))
    heavy = 1 + names.index(row_of("mass")) if row_of("mass") in names else None

    def of(frequency: Floats, stiffness: Floats, mass: Floats | float) -> Floats:
        spring = stiffness * (device.sample_time**2 / mass)
        return np.asarray(spring / (2 * np.sin(np.minimum(frequency, np.pi) / 2) + spring))

    def tested(boxes: Boxes) -> Decided:
        decided, low, high = test(boxes), boxes.low, boxes.high
        lightest, heaviest = (device.mass,) * 2 if heavy is None else (low[heavy], high[heavy])
        with np.errstate(invalid="ignore"):  # at rest the share may have any value
            least, most = of(high[0], low[stiffness], heaviest), of(low[0], high[stiffness], lightest)
            beside = (low[share] > most * (1 + WITHIN)) | (high[share] < least * (1 - WITHIN))
        return replace(decided, proved=decided.proved | beside)

    return tested
