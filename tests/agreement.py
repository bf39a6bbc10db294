"""How an oracle's value is held against a number that is printed: to every digit of it."""

from __future__ import annotations

from decimal import Decimal
from typing import Any


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
