"""The gains file: [gains] and [coupling] to paste into a problem, [design] to say where they come from.

See document/README.md, section 2.
"""

from __future__ import annotations

from dataclasses import astuple

from vctune.document.toml_text import quoted
from vctune.model.keys import SYMBOLS, UNITS, keys_of
from vctune.model.quantities import AnyCoupling, Gains, SpringDamper


def gains_text(gains: Gains, coupling: AnyCoupling, origin: dict[str, str]) -> str:
    """Return the text of a gains file.

    Parameters
    ----------
    gains, coupling : plain floats, written in their shortest exact decimals
    origin : keys and texts of the [design] table
    """
    numbers = astuple(gains) + astuple(coupling)
    written: dict[str, list[str]] = {"gains": [], "coupling": []}
    for key, value in zip(keys_of(len(numbers)), numbers, strict=True):
        table, name = key.split(".")
        if not (key == "gains.position" and isinstance(coupling, SpringDamper)):
            written[table].append(f"{name} = {value!r}  # {SYMBOLS[key]}, {UNITS[key]}")
    lines = [
        "# Paste [gains] and [coupling] into a problem file to fix them.",
        "[gains]",
        *written["gains"],
        "",
        "[coupling]",
        *written["coupling"],
        "",
        "[design]",
        *(f"{key} = {quoted(text)}" for key, text in origin.items()),
    ]
    return "\n".join(lines) + "\n"
