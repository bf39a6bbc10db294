"""Find the unit of every number in a problem file from its quantity and the motion of the device."""

from __future__ import annotations

from typing import Any

from vctune.document.schema.validation import KeyPath
from vctune.model.hands import QUANTITIES as OF_HAND
from vctune.model.numbers.units import OF_KEYS, UNITS, Units

# Last parts of the keys of numbers, in any table, by their quantity (`vctune.model.numbers.units`)
QUANTITIES = {
    "mass": ("mass", "handle_mass"),
    "damping": ("damping", "drag", "kd", "reference_impedance"),
    "stiffness": ("stiffness", "kp"),
    "integral_gain": ("ki",),
    "force": ("friction", "coulomb", "stiction", "limit", "force_noise"),
    "position": ("zero", "from", "to", "position_resolution", "resolution"),
    "speed": ("stribeck_velocity", "speed"),
    "time": ("sample_time", "delay"),
    "frequency": ("band_hz", "bandwidth_hz", "filter_hz", "frequency_hz", "corner_hz"),
}
# Quantity of each number whose quantity depends on the whole key, not only on the last part of the key
BY_KEY = (
    OF_KEYS
    | {"device.force_sensor.resolution": "force", "device.force_sensor.noise": "force"}
    | {f"operator.{name}": quantity for name, quantity in OF_HAND.items()}
)
WITHOUT_UNIT = ("uncertainty", "weights")  # Tables of numbers that have no unit


def units_stated(raw: dict[str, Any]) -> Units:
    """Return the units that a problem's tables state. The tables may be invalid."""
    device = raw.get("device")
    return UNITS["rotary" if isinstance(device, dict) and device.get("units") == "rotary" else "linear"]


def unit_of(path: KeyPath, units: Units) -> str:
    """Return the unit of a number in a problem file; "" for a number without a unit."""
    if path[0] == "uncertainty" and path[-1] in ("min", "max"):
        path = ("device", *str(path[1]).split("."))
    names = [step for step in path if isinstance(step, str) and step not in ("min", "max")]
    if not names or any(name in WITHOUT_UNIT for name in names):
        return ""
    quantity = BY_KEY.get(".".join(names)) or next((each for each, keys in QUANTITIES.items() if names[-1] in keys), "")
    return units.of(quantity)


def heading(name: str, unit: str) -> str:
    """Return the heading of a column: its name with its unit, unless the name contains "_hz"."""
    return f"{name} [{unit}]" if unit and "_hz" not in name else name
