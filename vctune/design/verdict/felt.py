"""Record the mass and damping that the hand feels, the stiffest wall, and the tracking bandwidth of a design."""

from __future__ import annotations

from math import inf

from vctune.analysis.feel import feel
from vctune.document.records.rows_json import FeltRecord
from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains


def felt_record(device: Device, gains: Gains, coupling: AnyCoupling) -> FeltRecord:
    """Return the mass and damping that the hand feels, the stiffest wall, and the tracking bandwidth."""
    felt = feel(device, gains, coupling)
    return FeltRecord(
        felt_mass_1hz=felt.mass[0],
        felt_mass_10hz=felt.mass[1],
        felt_damping_1hz=felt.damping[0],
        felt_damping_10hz=felt.damping[1],
        stiffest_wall=None if felt.stiffness == inf else felt.stiffness,
        tracking_bandwidth_hz=felt.tracking_bandwidth,
    )
