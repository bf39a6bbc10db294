"""Frequencies for people: hertz outside, rad/s inside."""

from __future__ import annotations

from math import pi


def hertz(omega: float) -> float:
    """Return an angular frequency in hertz, free of the rounding of 2 pi where it was a decimal.

    Parameters
    ----------
    omega : rad/s, may be 0 or inf

    Returns
    -------
    float
        Hz, to 12 digits.
    """
    return float(f"{omega / (2 * pi):.12g}")
