"""The gains file: [gains] and [coupling] to paste into a problem, [design] to say where they come from (DESIGN 2.2)."""

from __future__ import annotations

import json

from vctune.model.quantities import Coupling, Gains


def gains_text(gains: Gains, coupling: Coupling, origin: dict[str, str]) -> str:
    """Return the text of a gains file.

    Parameters
    ----------
    gains, coupling : plain floats, written in their shortest exact decimals
    origin : keys and texts of the [design] table
    """
    lines = [
        "# Paste [gains] and [coupling] into a problem file to fix them.",
        "[gains]",
        f"velocity = {gains.velocity!r}  # K_v, N s/m",
        f"position = {gains.position!r}  # K_p, N/m",
        "",
        "[coupling]",
        f"damping = {coupling.damping!r}  # b_c, N s/m",
        f"mass = {coupling.mass!r}  # m_c, kg",
        f"drag = {coupling.drag!r}  # b_0, N s/m",
        "",
        "[design]",
        *(f"{key} = {_quoted(text)}" for key, text in origin.items()),
    ]
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    """Return a TOML basic string; JSON's escapes are TOML's, but for DEL, which TOML wants escaped."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
