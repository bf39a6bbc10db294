"""The simulation file: the object that `vctune simulate --json` prints, read back for a report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from vctune.document.digest import experiments_digest
from vctune.document.reading import parse_problem
from vctune.document.record import DesignRecord

SCHEMA = "vctune/simulation/1"
FILE = "simulation.json"


def simulation_beside(folder: Path, design: DesignRecord) -> dict[str, Any] | None:
    """Return the object of a folder's simulation.json if it is of this very design, else None.

    Parameters
    ----------
    folder : where design.json is
    design : its record
    """
    try:
        record = json.loads((folder / FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return record if isinstance(record, dict) and is_of(record, design) else None


def is_of(record: dict[str, Any], design: DesignRecord) -> bool:
    """Whether the object of a simulation.json is of the very design and experiments of a design.json."""
    made_for, given, numbers = record.get("problem"), design.problem, design.to_json()
    if record.get("schema") != SCHEMA or not isinstance(made_for, dict) or made_for.get("sha256") != given.sha256:
        return False
    experiments = parse_problem(given.text, given.name, given.name).experiments
    return made_for.get("experiments_sha256") == experiments_digest(experiments) and all(
        record.get(key) == numbers[key] for key in ("gains", "coupling")
    )
