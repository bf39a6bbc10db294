"""The design variables by their keys in a problem file; light enough for the command line."""

KEYS = ("gains.velocity", "gains.position", "coupling.damping", "coupling.mass", "coupling.drag")
"""K_v, K_p, b_c, m_c, b_0 of an admittance display."""
SPRING_KEYS = ("gains.velocity", "gains.position", "coupling.damping", "coupling.stiffness")
"""K_v, K_p, which is 0, b_c, k_c of an impedance display."""
SYMBOLS = dict(zip(KEYS, ("K_v", "K_p", "b_c", "m_c", "b_0"), strict=True)) | {SPRING_KEYS[3]: "k_c"}
UNITS = dict(zip(KEYS, ("N s/m", "N/m", "N s/m", "kg", "N s/m"), strict=True)) | {SPRING_KEYS[3]: "N/m"}
"""What stands for each variable in equations, and its unit."""


def keys_of(count: int) -> tuple[str, ...]:
    """Return the keys of a design that has so many numbers."""
    return KEYS if count == len(KEYS) else SPRING_KEYS
