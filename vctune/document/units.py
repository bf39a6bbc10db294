"""The unit of every number of a problem file, by what the number is."""

from __future__ import annotations

from vctune.document.validation import KeyPath

UNITS = {
    "mass": "kg",
    "damping": "N s/m",
    "stiffness": "N/m",
    "integral gain": "N/(m s)",
    "force": "N",
    "position": "m",
    "speed": "m/s",
    "time": "s",
    "frequency": "Hz",
}
"""Of each quantity."""
QUANTITIES = {
    "mass": ("mass", "handle_mass"),
    "damping": ("damping", "drag", "kd", "reference_impedance"),
    "stiffness": ("stiffness", "kp"),
    "integral gain": ("ki",),
    "force": ("coulomb", "stiction", "limit", "force_noise"),
    "position": ("zero", "from", "to", "position_resolution"),
    "speed": ("stribeck_velocity", "speed"),
    "time": ("sample_time", "delay"),
    "frequency": ("band_hz", "bandwidth_hz", "filter_hz", "frequency_hz"),
}
"""Which keys are which quantity, whatever table they stand in."""
GAINS = {"velocity": "damping", "position": "stiffness"}
"""Of the table [gains], by key."""
SHARES = ("uncertainty", "weights")
"""Tables of numbers without a unit."""


def unit_of(path: KeyPath) -> str:
    """Return the unit of a number of a problem file, "" for one without.

    Parameters
    ----------
    path : of its key
    """
    names = [step for step in path if isinstance(step, str) and step not in ("min", "max")]
    if not names or any(name in SHARES for name in names):
        return ""
    of_gains = GAINS.get(names[-1]) if names[0] == "gains" else None
    quantity = of_gains or next((each for each, keys in QUANTITIES.items() if names[-1] in keys), None)
    return UNITS[quantity] if quantity else ""


def heading(name: str, unit: str) -> str:
    """Return what heads a column: the name with its unit, unless the name itself says it.

    Parameters
    ----------
    name : of the column
    unit : "" for none
    """
    return f"{name} [{unit}]" if unit and "_hz" not in name else name
