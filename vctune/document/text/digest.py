"""Compute digests of the meaning of a document."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, replace
from hashlib import sha256
from typing import Any

from vctune.model.display import ADMITTANCE
from vctune.model.experiment import Experiment
from vctune.model.hands import Hand
from vctune.model.parts import OF_FIRMWARE, PARTS
from vctune.model.problem import Problem

# Defaults of the keys that are newer than the digests, by table
LATER: Mapping[str, Mapping[str, Any]] = {
    "stability": {"changing": None, "changing_mass_min": None},
    "worlds": {"walls": False, "corner": None, "rule": "trapezoid", "late": 0, "resistive": False},
    "environment": {"late": 0},
}


def problem_digest(problem: Problem) -> str:
    """Return the digest of everything on which a design depends: the problem without name, description and
    experiments."""
    stated = asdict(replace(problem, name="", description="", experiments=()))
    # absent parts are not included, so that digests from before the parts existed remain valid
    absent = {key for key in (*PARTS, "unmodelled") if stated["device"][key] is None}
    stated["device"] = {key: value for key, value in stated["device"].items() if key not in absent}
    for part, key in (path.split(".") for path in OF_FIRMWARE):
        if (table := stated["device"].get(part)) is not None and table[key] is None:
            del table[key]
    for end in stated["hands"].values():  # numbers of a hand at their defaults are not included either
        for field_at_default in (each for each in fields(Hand) if end[each.name] == each.default):
            del end[field_at_default.name]
    if problem.device.kind is ADMITTANCE:
        del stated["device"]["display"], stated["bounds"]["stiffness"]
    if problem.device.units == "linear":
        del stated["device"]["units"]
    stated["stability"] = _without_defaults(stated["stability"], LATER["stability"])
    if problem.worlds is None:
        del stated["worlds"]
    else:
        stated["worlds"] = _without_defaults(stated["worlds"], LATER["worlds"])
    if problem.hands_met is None:
        del stated["hands"], stated["stability"]["criterion"]
    return digest(stated)


def _without_defaults(stated: dict[str, Any], later: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table without those keys of later versions that have their defaults, so that earlier digests still
    hold."""
    return {key: value for key, value in stated.items() if key not in later or value != later[key]}


def experiments_digest(experiments: Sequence[Experiment]) -> str:
    """Return the digest of a list of experiments."""
    stated = [asdict(experiment) for experiment in experiments]
    for each in stated:
        each["environment"] = _without_defaults(each["environment"], LATER["environment"])
    return digest(stated)


def digest(value: Any) -> str:
    """Return the SHA-256 of tables, lists, texts and numbers as JSON with sorted keys and shortest exact decimals."""
    return sha256(json.dumps(_canonical(value), sort_keys=True, allow_nan=False).encode()).hexdigest()


def _canonical(value: Any) -> Any:
    """Return a value with floats as texts, because JSON lacks infinity, and with 0 instead of -0."""
    if isinstance(value, dict):
        return {key: _canonical(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_canonical(entry) for entry in value]
    return repr(value + 0.0) if isinstance(value, float) else value
