"""How an oracle's value is held against a number that is printed, to every digit of it, and against an enclosure."""

from __future__ import annotations

from decimal import Decimal
from typing import Any

import numpy as np
from mpmath import mp


def to_all_digits(printed: str, value: Any) -> bool:
    """Return whether the value rounds to the printed decimal: within half a unit of its last digit."""
    decimal = Decimal(printed)
    unit = Decimal(1).scaleb(decimal.as_tuple().exponent)
    return abs(float(decimal) - float(value)) <= 0.5000001 * float(unit)


def all_to_all_digits(printed: str, values: list[Any]) -> bool:
    """Return whether a row of printed decimals, parted by commas, agrees with the values."""
    decimals = printed.replace(" ", "").split(",")
    pairs = zip(decimals, values, strict=True)
    return all(to_all_digits(decimal, value) for decimal, value in pairs)


def contains(enclosure: Any, true: Any) -> bool:
    """Return whether an enclosure contains a number of many digits; one that is not finite does."""
    mid, rad = float(enclosure.mid), float(enclosure.rad)
    with mp.workdps(60):
        return not np.isfinite(mid + rad) or bool(abs(mp.mpf(mid) - true) <= mp.mpf(rad))
