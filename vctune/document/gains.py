"""The gains file: [gains] and [coupling] to paste into a problem, [design] to say where they come from.

See document/README.md, section 2.
"""

from __future__ import annotations

from vctune.document.toml_text import quoted
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
        *(f"{key} = {quoted(text)}" for key, text in origin.items()),
    ]
    return "\n".join(lines) + "\n"
