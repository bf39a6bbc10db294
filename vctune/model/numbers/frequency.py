"""Frequencies for people: hertz outside, rad/s inside."""

from __future__ import annotations

from math import inf, pi


def hertz(omega: float) -> float:
    """Return an angular frequency in hertz, without the rounding of 2 pi if it was a decimal.

    Parameters
    ----------
    omega : rad/s, may be 0 or inf

    Returns
    -------
    float
        Hz, to 12 digits.
    """
    return float(f"{omega / (2 * pi):.12g}")


def finite_hertz(omega: float | None) -> float | None:
    """Return a frequency in hertz, None if it is infinite.

    Parameters
    ----------
    omega : rad/s, or None
    """
    return None if omega is None or omega == inf else hertz(omega)
