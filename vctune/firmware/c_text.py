"""Write numbers and comments of C."""

from __future__ import annotations

from math import inf
from typing import Literal

import numpy as np

from vctune.document.text.errors import printable

Precision = Literal["double", "single"]


def literal(number: float, precision: Precision) -> str:
    """Return the shortest C constant that a compiler reads as exactly the given number."""
    if number in (inf, -inf):
        return "VCTUNE_NONE" if number > 0 else "-VCTUNE_NONE"
    text = repr(number) if precision == "double" else str(np.float32(number))
    if not set(text) & set(".en"):
        text += ".0"
    return text if precision == "double" else f"{text}f"


def comment(text: str, width: int = 110) -> list[str]:
    """Return a text as lines for a comment in C, in ASCII. The text cannot begin or end a comment."""
    lines, line = [], ""
    plain_text = printable(text).encode("ascii", "replace").decode()
    for word in plain_text.replace("/", " / ").split() if "*" in text else plain_text.split():
        if line and len(line) + 1 + len(word) > width:
            lines.append(line)
            line = ""
        line = f"{line} {word}" if line else word
    return [*lines, line] if line else lines
