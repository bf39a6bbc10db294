"""The simulation file: the object that `vctune simulate --json` prints, read back for a report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

SCHEMA = "vctune/simulation/1"
FILE = "simulation.json"


def simulation_beside(folder: Path, design: dict[str, Any]) -> dict[str, Any] | None:
    """Return the object of a folder's simulation.json if it is of this very design, else None.

    Parameters
    ----------
    folder : where design.json is
    design : the object of design.json
    """
    try:
        record = json.loads((folder / FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return record if isinstance(record, dict) and is_of(record, design) else None


def is_of(record: dict[str, Any], design: dict[str, Any]) -> bool:
    """Whether the object of a simulation.json is of the very design of a design.json."""
    same = all(record.get(key) == design[key] for key in ("gains", "coupling"))
    problem = record.get("problem")
    return (
        record.get("schema") == SCHEMA
        and same
        and isinstance(problem, dict)
        and problem.get("sha256") == design["problem"]["sha256"]
    )
