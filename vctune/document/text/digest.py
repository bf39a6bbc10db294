"""Compute digests of the meaning of a document."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from hashlib import sha256
from typing import Any

from vctune.model.experiment import Experiment
from vctune.model.problem import Problem


def problem_digest(problem: Problem) -> str:
    """Return the digest of everything on which a design depends: the problem without name, description and
    experiments."""
    stated = asdict(replace(problem, name="", description="", experiments=()))
    if problem.hands_met is None:
        del stated["hands"]
    velocity = stated["device"]["velocity"] or {}
    if resolution := velocity.pop("resolution", None):
        stated["device"]["resolution"] = resolution
    return digest(stated)


def experiments_digest(experiments: Sequence[Experiment]) -> str:
    """Return the digest of a list of experiments."""
    return digest([asdict(experiment) for experiment in experiments])


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
