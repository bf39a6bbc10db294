"""Shares of what the margin vanishes with next to rest: boxes that no hand has at any angle are left out."""

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

WITHIN = 1e-9
"""Share by which a box lies apart from the shares of its angles and hands before it is left out: beyond rounding."""


def with_own_share(test: Test, device: Device, names: tuple[str, ...]) -> Test:
    """Return a test that reports boxes as proved that contain no share of the stiffness of their own angles and hands.

    Next to rest the share of K in rho = 2 s + K T^2/m is a row of its own. At any angle and in any hand beside rest it
    is known, and the boxes with another share hold no hand at all.

    Parameters
    ----------
    test : of boxes with a row for that share, without an integrator
    device : has T, and m if it is not a row
    names : names of the boxes' rows, but the frequency
    """
    share, stiffness = (1 + names.index(name) for name in (SHARES[1], STIFFNESS))
    heavy = 1 + names.index(row_of("mass")) if row_of("mass") in names else None

    def of(frequency: Floats, stiffness: Floats, mass: Floats | float) -> Floats:
        spring = stiffness * (device.sample_time**2 / mass)
        return np.asarray(spring / (2 * np.sin(np.minimum(frequency, np.pi) / 2) + spring))

    def tested(boxes: Boxes) -> Decided:
        decided, low, high = test(boxes), boxes.low, boxes.high
        lightest, heaviest = (device.mass,) * 2 if heavy is None else (low[heavy], high[heavy])
        with np.errstate(invalid="ignore"):  # at rest the share may be any
            least, most = of(high[0], low[stiffness], heaviest), of(low[0], high[stiffness], lightest)
            beside = (low[share] > most * (1 + WITHIN)) | (high[share] < least * (1 - WITHIN))
        return replace(decided, proved=decided.proved | beside)

    return tested
