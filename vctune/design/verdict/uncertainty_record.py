"""Record the errors of a design on the devices of an uncertain box, which show the cost of the uncertainty."""

from __future__ import annotations

from math import degrees
from typing import Any

from vctune.analysis.demands import transparency_error
from vctune.design.prepared import pose
from vctune.design.verdict.judge import Judgement
from vctune.document.records.certificate_json import DeviceRecord, PerturbationRecord
from vctune.document.records.design_json import UncertaintyRecord
from vctune.model.device import Device
from vctune.model.problem import Problem


def device_record(device: Device, problem: Problem) -> DeviceRecord:
    """Return mass, damping and delay of a device, and its other parameters for which the problem states an
    uncertainty."""
    widths = dict(problem.uncertainty.half_widths) if problem.uncertainty is not None else {}
    known = device.numbers()
    others = {key: number for key, number in known.items() if "." in key and key in widths}
    found: dict[str, Any] = {"parts": others} if others else {}
    if device.unmodelled is not None and device.unmodelled.share > 0:
        share, phase = float(device.unmodelled.share), degrees(device.unmodelled.phase)
        found["unmodelled"] = PerturbationRecord(share=share, phase_deg=phase)
    own = {key: known[key] for key in ("mass", "damping", "delay") if key in known}
    return DeviceRecord(**own, **found)


def uncertainty_record(problem: Problem, judgement: Judgement, nominal_error: float | None) -> UncertaintyRecord:
    """Return the box, the errors that show the cost of robustness, and the devices on which the design is worst."""
    posed, design = pose(problem), (judgement.gains, judgement.coupling)
    box, uncertainty = posed.box, problem.uncertainty
    assert box is not None and uncertainty is not None
    worst = max(posed.cases, key=lambda case: transparency_error(case, *design).error)
    return UncertaintyRecord(
        box={key: [box.low.number(key), box.high.number(key)] for key in box.modelled.uncertain},
        **({"unmodelled": [list(point) for point in uncertainty.unmodelled]} if uncertainty.unmodelled else {}),
        objective=uncertainty.objective,
        nominal_error=nominal_error,
        robust_error=judgement.transparency.error,
        worst_error=transparency_error(worst, *design).error,
        worst_device=device_record(worst.device, problem),
        min_ratio_device=device_record(judgement.tightest, problem),
    )
