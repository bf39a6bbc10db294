"""What a design comes to on the devices of its box, and what that costs: plain data for the record."""

from __future__ import annotations

from vctune.analysis.demands import transparency_error
from vctune.design.judge import Judgement
from vctune.design.prepared import pose
from vctune.document.record import DeviceRecord, UncertaintyRecord
from vctune.model.problem import Problem
from vctune.model.quantities import Device


def device_record(device: Device) -> DeviceRecord:
    """Return the numbers of a device that may be uncertain."""
    return DeviceRecord(mass=device.mass, damping=device.damping, delay=device.delay)


def uncertainty_record(problem: Problem, judgement: Judgement, nominal_error: float | None) -> UncertaintyRecord:
    """Return the box, the errors that say what robustness costs, and the devices on which the design is worst.

    Parameters
    ----------
    problem : one with an uncertain device
    judgement : of the robust design
    nominal_error : of the best design for the nominal device alone, None if it was not looked for
    """
    posed, design = pose(problem), (judgement.gains, judgement.coupling)
    box, uncertainty = posed.box, problem.uncertainty
    assert box is not None and uncertainty is not None
    worst = max(posed.cases, key=lambda case: transparency_error(case, *design).error)
    return UncertaintyRecord(
        box={name: [getattr(box.low, name), getattr(box.high, name)] for name in box.uncertain},
        objective=uncertainty.objective,
        nominal_error=nominal_error,
        robust_error=judgement.transparency.error,
        worst_error=transparency_error(worst, *design).error,
        worst_device=device_record(worst.device),
        min_ratio_device=device_record(judgement.tightest),
    )
