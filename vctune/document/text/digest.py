"""Digests of the meaning of a document. They are equal for every spelling, and different if a number differs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, fields, replace
from hashlib import sha256
from typing import Any

from vctune.model.display import ADMITTANCE
from vctune.model.experiment import Experiment
from vctune.model.hands import Hand
from vctune.model.parts import OF_FIRMWARE, PARTS
from vctune.model.problem import Problem


def problem_digest(problem: Problem) -> str:
    """Return the digest of all that a design depends on: the problem without name, description and experiments."""
    stated = asdict(replace(problem, name="", description="", experiments=()))
    # absent parts are not included, so that digests from before the parts existed remain valid
    absent = {key for key in (*PARTS, "unmodelled") if stated["device"][key] is None}
    stated["device"] = {key: value for key, value in stated["device"].items() if key not in absent}
    for part, key in (path.split(".") for path in OF_FIRMWARE):
        if (table := stated["device"].get(part)) is not None and table[key] is None:
            del table[key]
    for end in stated["hands"].values():  # the same for the numbers of a hand that have a default
        for known in (each for each in fields(Hand) if end[each.name] == each.default):
            del end[known.name]
    if problem.device.kind is ADMITTANCE:
        del stated["device"]["display"], stated["bounds"]["stiffness"]
    if problem.device.units == "linear":
        del stated["device"]["units"]
    if problem.worlds is None:
        del stated["worlds"]
    else:
        stated["worlds"] = _without_defaults(stated["worlds"])
    if problem.hands_met is None:
        del stated["hands"], stated["stability"]["criterion"]
    return digest(stated)


def _without_defaults(worlds: dict[str, Any]) -> dict[str, Any]:
    """Return environments without walls, a corner, a rule and a lateness that are not stated."""
    return {key: value for key, value in worlds.items() if value not in (False, None, "trapezoid")}


def experiments_digest(experiments: Sequence[Experiment]) -> str:
    """Return the digest of experiments."""
    stated = [asdict(experiment) for experiment in experiments]
    for environment in (each["environment"] for each in stated):
        if not environment["late"]:  # a digest of before there was any lateness still holds
            del environment["late"]
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
