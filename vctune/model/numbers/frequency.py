"""Convert frequencies: files and output use hertz, the code uses rad/s."""

from __future__ import annotations

from math import inf, pi


def hertz(omega: float) -> float:
    """Return an angular frequency in hertz."""
    return float(f"{omega / (2 * pi):.12g}")


def finite_hertz(omega: float | None) -> float | None:
    """Return a frequency in hertz, or None if it is infinite or None."""
    return None if omega is None or omega == inf else hertz(omega)
