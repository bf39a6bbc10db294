"""Keys that mean nothing on one of the displays, each with the reason."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from vctune.document.schema.number_units import units_stated
from vctune.document.schema.validation import Contradiction
from vctune.document.text.raw import number_at

OF_ADMITTANCE: dict[tuple[str, ...], str] = {
    ("device", "force_sensor"): "it senses no force",
    ("gains", "position"): "it has no velocity loop, whose error an integrator would add up",
    ("coupling", "mass"): "its coupling is coupling.damping beside coupling.stiffness",
    ("coupling", "drag"): "its coupling is coupling.damping beside coupling.stiffness",
    ("stability", "band_hz"): "its demands are proved at every frequency up to the Nyquist frequency",
    ("uncertainty", "unmodelled"): "its demands are not proved of a response that is not known",
}
"""What an impedance display has not got."""


def impossible_display(raw: dict[str, Any]) -> Iterator[Contradiction]:
    """Return what a problem says that its display does not have."""
    device = raw.get("device")
    if not isinstance(device, dict):
        return
    if device.get("display", "admittance") != "impedance":
        if _stated(raw, ("coupling", "stiffness")):
            yield (
                ("coupling", "stiffness"),
                'is of an impedance display; write device.display = "impedance", or leave it out',
            )
        lowest: tuple[tuple[str, ...], ...] = ("coupling", "damping"), ("coupling", "damping", "min")
        for path in lowest:
            if number_at(raw, *path) == 0:
                yield (
                    path,
                    "0 is too small on an admittance display, whose coupling it would open; write a positive one",
                )
        return
    for path, reason in OF_ADMITTANCE.items():
        if _stated(raw, path):
            why = units_stated(raw).translated(reason)
            yield path, f'means nothing with device.display = "impedance": {why}; leave it out'
    velocity = device.get("velocity")
    if isinstance(velocity, dict) and velocity.get("from") == "measured":
        yield (
            ("device", "velocity", "from"),
            '"measured" is not what an impedance display\'s coupling runs on; write "difference", or leave it out',
        )
    if device.get("hold") == "lag":
        yield ("device", "hold"), '"lag" is not proved on an impedance display; write "zoh", or leave it out'


def _stated(raw: dict[str, Any], path: tuple[str, ...]) -> bool:
    at: Any = raw
    for key in path:
        if not isinstance(at, dict) or key not in at:
            return False
        at = at[key]
    return True
