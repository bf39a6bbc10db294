"""Define the keys of the design variables in a problem file."""

from __future__ import annotations

from vctune.model.numbers.units import Units

# Keys of K_v, K_p, b_c, m_c and b_0, the design variables of an admittance display and of a servo, whose K_v and K_p
# are 0
KEYS = ("gains.velocity", "gains.position", "coupling.damping", "coupling.mass", "coupling.drag")
# Keys of K_v, K_p (which is 0), b_c and k_c, the design variables of an impedance display
SPRING_KEYS = ("gains.velocity", "gains.position", "coupling.damping", "coupling.stiffness")
SYMBOLS = dict(zip(KEYS, ("K_v", "K_p", "b_c", "m_c", "b_0"), strict=True)) | {SPRING_KEYS[3]: "k_c"}
# Symbol of each design variable in equations, and its quantity (`vctune.model.numbers.units`)
QUANTITIES = dict(zip(KEYS, ("damping", "stiffness", "damping", "mass", "damping"), strict=True)) | {
    SPRING_KEYS[3]: "stiffness"
}


def labelled(key: str, units: Units) -> str:
    """Return a variable's symbol and unit, such as "K_v, N s/m"."""
    return f"{SYMBOLS[key]}, {units.of(QUANTITIES[key])}"


def keys_of(count: int) -> tuple[str, ...]:
    """Return the keys of a design that has this many numbers: `KEYS` for five numbers, `SPRING_KEYS` for four."""
    return KEYS if count == len(KEYS) else SPRING_KEYS
