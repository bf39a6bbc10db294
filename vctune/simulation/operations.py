"""Name the operations of controller and friction, which run on floats, on numbers of 32 bits and on symbols."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple


class Operations(NamedTuple):
    """Elementary functions of one kind of number."""

    exp: Callable[[Any], Any]
    expm1: Callable[[Any], Any]
    absolute: Callable[[Any], Any]
    floor: Callable[[Any], Any]
    minimum: Callable[[Any, Any], Any]
    maximum: Callable[[Any, Any], Any]
    where: Callable[[Any, Any, Any], Any]  # (condition, yes, no); the caller evaluates both numbers


FLOATS = Operations(
    math.exp, math.expm1, abs, math.floor, min, max, lambda condition, yes, no: yes if condition else no
)
