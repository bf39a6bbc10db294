"""Reduce a box to the part that a problem file can state, or refuse the log with a message that states the reason."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from vctune.document.recording import Recording
from vctune.document.schema.device_contradictions import MAX_DELAY_SAMPLES
from vctune.document.text.codes import Note
from vctune.document.text.errors import InputError
from vctune.identification.box import Bounded

LIGHTER = 1 - 1e-3  # Greatest permitted mass of the handle, relative to the least mass of the device


def readable(bounds: Sequence[Bounded], recording: Recording, sample_time: float) -> tuple[Bounded, ...]:
    """Return a box that the reader of problem files accepts."""
    for each in bounds:
        if each.key.endswith("delay"):
            _check_delay(each, recording, sample_time)
    masses = {each.key: each for each in bounds if each.key.endswith("mass")}
    return tuple(
        _lighter(each, masses["mass"], recording) if each.key == "structure.handle_mass" else each for each in bounds
    )


def _check_delay(delay: Bounded, recording: Recording, T: float) -> None:
    """Refuse a delay that is certainly negative, or greater than the greatest supported delay."""
    latest = max(each.value for each in delay.estimates)
    name = "command" if delay.key == "servo.delay" else recording.units.force_name
    widest = 4 * max(each.sigma for each in delay.estimates)
    remedy = f"the columns were not sampled together; shift the {name}'s column, or log both in the same interrupt"
    if delay.key in ("delay", "servo.delay") and latest + widest < -0.5 * T:
        message = f"the position is {-latest:.3g} s ahead of the {name}: {remedy}"
    elif delay.high > MAX_DELAY_SAMPLES * T:
        message = (
            f"{delay.key} is up to {delay.high:.3g} s, {delay.high / T:.3g} sample times, and at most "
            f"{MAX_DELAY_SAMPLES} are supported: {remedy}"
        )
    else:
        return
    raise InputError.of(recording.source, "log-unexplained", message)


def _lighter(handle: Bounded, mass: Bounded, recording: Recording) -> Bounded:
    """Return the mass of a handle with an interval that ends below the least mass of the device."""
    most = mass.low * LIGHTER
    if handle.high < most:
        return handle
    if handle.value >= most:
        units = recording.units
        message = (
            f"the handle's {units.mass_name}, {handle.low:.3g} to {handle.high:.3g} {units.mass}, is not told from the "
            f"device's, {mass.low:.3g} to {mass.high:.3g}: record longer, or excite more lines around the resonance"
        )
        raise InputError.of(recording.source, "log-unexplained", message)
    limits = (*handle.limits, Note("limit-handle", "lighter than the device"))
    return replace(handle, value=0.5 * (handle.low + most), high=most, limits=limits)
