"""A device of vctune as the tables that the oracles read, and the other way round."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import vctune
from vctune.model.device import Device

Tables = dict[str, Any]


def _stated(known: Tables) -> Tables:
    """Return a table without what is not there."""
    return {k: _stated(v) if isinstance(v, dict) else v for k, v in known.items() if v is not None}


def tables_of(device: Device) -> Tables:
    """Return the tables of a device and of its least operator."""
    known = _stated(asdict(device))
    operator = known.pop("operator", {})
    if "source" in known.get("velocity", {}):
        known["velocity"]["from"] = known["velocity"].pop("source")
    return {"device": known, "operator": operator}


def device_of(table: Tables) -> Device:
    """Return the device of a problem file."""
    in_hands = table.get("velocity", {}).get("at") == "handle"  # which is proved in no other hands
    stability = {"stability": {"criterion": "hands"}} if in_hands else {}
    return vctune.problem({"device": table, **stability}).problem.device
