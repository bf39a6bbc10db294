"""Write the files that accompany the controller: vectors.csv and replay.c, and a Makefile."""

from __future__ import annotations

from typing import Any

from vctune.firmware.c_source import names_and_numbers, rendered_template
from vctune.firmware.c_text import comment
from vctune.firmware.firmware import Firmware, certified
from vctune.firmware.preamble import not_proved, statement
from vctune.firmware.vectors import Replay, experiment_line, greatest_difference, vectors_text

ALLOWED_ULP = 0  # Permitted difference in double precision, in units in the last place


def replay_files(firmware: Firmware, simulated: list[Replay]) -> dict[str, str]:
    """Return the texts of vectors.csv, replay.c and Makefile."""
    given: dict[str, Any] = {
        **names_and_numbers(firmware),
        "experiments": [experiment_line(one, firmware.parts) for one in simulated],
        "ulp": ALLOWED_ULP,
        "hash_top": commented(statement(firmware)),
    }
    if firmware.precision == "single":
        measured = greatest_difference(firmware, simulated)
        given |= {"measured": f"{measured:.3g}", "allowed": f"{2 * measured:.3g}"}
    written = {name: rendered_template(name, given) for name in ("replay.c", "Makefile")}
    doubt = "" if certified(firmware) else commented([not_proved(firmware)]) + "\n"
    return {"vectors.csv": doubt + vectors_text(simulated, firmware.units, firmware.parts.command), **written}


def commented(texts: list[str]) -> str:
    """Return texts as lines that begin with #."""
    return "\n".join(f"# {line}".rstrip() for text in texts for line in comment(text) or [""])
