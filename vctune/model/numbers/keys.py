"""Define the keys of the design variables in a problem file.

This module imports little, so that the command line starts fast.
"""

from __future__ import annotations

from vctune.model.numbers.units import Units

KEYS = ("gains.velocity", "gains.position", "coupling.damping", "coupling.mass", "coupling.drag")
"""Keys of K_v, K_p, b_c, m_c and b_0, the design variables of an admittance display and of a servo, whose K_v and K_p
are 0."""
SPRING_KEYS = ("gains.velocity", "gains.position", "coupling.damping", "coupling.stiffness")
"""Keys of K_v, K_p (which is 0), b_c and k_c, the design variables of an impedance display."""
SYMBOLS = dict(zip(KEYS, ("K_v", "K_p", "b_c", "m_c", "b_0"), strict=True)) | {SPRING_KEYS[3]: "k_c"}
QUANTITIES = dict(zip(KEYS, ("damping", "stiffness", "damping", "mass", "damping"), strict=True)) | {
    SPRING_KEYS[3]: "stiffness"
}
"""Symbol of each design variable in equations, and its quantity (`vctune.model.numbers.units`)."""
WORLD = ("environment.mass", "environment.damping", "environment.stiffness")
"""Keys of the parameters of a rendered environment that can be the axes of a plane."""
IN_WORDS = dict(zip(WORLD, ("mass of the tool", "least damping", "stiffness of the wall"), strict=True))
"""Names of the parameters of a rendered environment on an axis of a figure."""


def labelled(key: str, units: Units) -> str:
    """Return a variable's symbol and unit, such as "K_v, N s/m", or the name and unit of an environment's number.

    Parameters
    ----------
    key : a design variable's key in the problem file, one of `KEYS` or `SPRING_KEYS`, or one of `WORLD`
    units : units of the problem, linear or rotary

    Returns
    -------
    str
        The label of an axis or of a column.
    """
    if key in IN_WORDS:
        return f"{units.translated(IN_WORDS[key])}, {units.of(key.partition('.')[2])}"
    return f"{SYMBOLS[key]}, {units.of(QUANTITIES[key])}"


def keys_of(count: int) -> tuple[str, ...]:
    """Return the keys of a design that has this many numbers: `KEYS` for five numbers, `SPRING_KEYS` for four."""
    return KEYS if count == len(KEYS) else SPRING_KEYS
