"""Read JSON files strictly: numbers must be finite, and the size must be plausible. Compute digests of documents."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from copy import deepcopy
from dataclasses import asdict, fields, replace
from hashlib import sha256
from math import isfinite
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError
from pydantic_core import to_jsonable_python

from vctune.document.records.part import Document
from vctune.document.schema.validation import MAX_MISTAKES, dotted, untagged
from vctune.document.text.errors import InputError, Mistake
from vctune.model.device import Device
from vctune.model.experiment import Experiment
from vctune.model.problem import Problem


class SealedDocument(Document):
    """A file that vctune reads again. The last key of its object is the digest of the others, which every reader
    checks; a file of an earlier version has none."""

    sha256: str | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the object, with its digest."""
        return sealed(super().to_json())

    def contradictions(self, source: str) -> Iterator[Mistake]:
        """Yield the parts that do not belong together."""
        yield from ()


Record = TypeVar("Record", bound=SealedDocument)
UNKNOWN = "unexpected_keyword_argument"  # pydantic's name of the fault that a dataclass has no such field


def read_json(path: Path, kind: str, max_bytes: int) -> Any:
    """Return the content of a JSON file."""
    try:
        with path.open("rb") as file:
            data = file.read(max_bytes + 1)
    except OSError as error:
        raise InputError.of(str(path), "unreadable-file", f"cannot be read: {error.strerror}") from None
    if len(data) > max_bytes:
        message = f"is longer than {max_bytes} bytes; this is not {kind}"
        raise InputError.of(str(path), "unreadable-file", message)
    try:
        return json.loads(data.decode("utf-8-sig"), parse_constant=_finite, parse_float=_finite)
    except RecursionError:
        raise InputError.of(str(path), "not-json", "is not JSON: nested too deeply") from None
    except ValueError as error:
        raise InputError.of(str(path), "not-json", f"is not JSON: {error}") from None


def as_record(value: Any, part: type[Record], source: str, *, kind: str, remedy: str, by_hand: bool = False) -> Record:
    """Return the record that the object of a JSON file states. In a file that users also write by hand, an unknown key
    of gains may be a slip and is refused; in another file it is another version's."""
    if not isinstance(value, dict) or value.get("schema") != part.SCHEMA:
        raise InputError.of(source, "other-document", f"is not {part.SCHEMA}; name {kind}", key="schema")
    record = _validated(value, part, source, remedy, by_hand=by_hand)
    mistakes = [*record.contradictions(source)]
    if not mistakes and record.sha256 is not None and record.sha256 != sealed(value)["sha256"]:
        message = "does not belong to the rest of the file, of which a number or a word was changed"
        mistakes = [Mistake("damaged-document", "sha256", message)]
    if mistakes:
        raise _damaged(source, mistakes, remedy)
    return record


def _validated(value: dict[str, Any], part: type[Record], source: str, remedy: str, *, by_hand: bool) -> Record:
    try:
        return part.model_validate(value)
    except ValidationError as error:
        unknown = [untagged(each["loc"]) for each in error.errors(include_url=False) if each["type"] == UNKNOWN]
        if unknown and not by_hand:  # of gains or a hand, which are tables of a file as well
            return _validated(_without(value, unknown), part, source, remedy, by_hand=by_hand)
        faults = error.errors(include_url=False)[:MAX_MISTAKES]
        mistakes = [Mistake("damaged-document", dotted(untagged(fault["loc"])), fault["msg"]) for fault in faults]
        raise _damaged(source, mistakes, remedy) from None


def _damaged(source: str, mistakes: list[Mistake], remedy: str) -> InputError:
    return InputError(source, [*mistakes, Mistake("damaged-document", "", f"is damaged; {remedy}")])


def _without(value: dict[str, Any], places: Iterable[Sequence[str | int]]) -> dict[str, Any]:
    """Return the object of a JSON file without some keys."""
    left = deepcopy(value)
    for *path, key in places:
        at: Any = left
        for step in path:
            at = at[step]
        del at[key]
    return left


def printed(kind: str, **fields: Any) -> dict[str, Any]:
    """Return the object that a command only prints. Every number in it is finite or null."""
    found: dict[str, Any] = to_jsonable_python({"schema": f"vctune/{kind}/1", **fields}, inf_nan_mode="null")
    return found


def _finite(text: str) -> float:
    number = float(text)
    if not isfinite(number):
        raise ValueError(f"{text} is no finite number")
    return number


def sealed(value: dict[str, Any]) -> dict[str, Any]:
    """Return the object of a file with the digest of its other keys at its end. For the digest 1 is 1.0, since other
    programs write one for the other."""
    rest = {key: entry for key, entry in value.items() if key != "sha256"}
    return {**rest, "sha256": digest(json.loads(json.dumps(rest, default=str), parse_int=float))}


def problem_digest(problem: Problem) -> str:
    """Return the digest of everything on which a design depends: the problem without name, description and
    experiments."""
    stated = asdict(replace(problem, name="", description="", experiments=()))
    del stated["hands"]["tool"]  # the hands include it
    if problem.hands_met is None:
        del stated["hands"]
    _drop_defaults(stated["stability"], problem.stability, kept=("criterion",))
    if problem.uncertainty is not None:
        _drop_defaults(stated["uncertainty"], problem.uncertainty, kept=("unmodelled",))
    if not problem.rigid:
        del stated["rigid"]
    _drop_from_device(stated["device"], problem.device)
    return digest(stated)


def _drop_from_device(stated: dict[str, Any], device: Device) -> None:
    """Delete what no design depends on, and the keys at their defaults that an earlier version did not have."""
    _drop_defaults(stated, device, kept=[each.name for each in fields(device) if each.name not in ADDED_KEYS])
    for key in ("structure", "structure_2", "structure_3"):
        if (spring := getattr(device, key)) is not None and spring.stiffness is None:
            del stated[key]["stiffness"]
    (stated["servo"] or {}).pop("max_acceleration", None)
    sensor, velocity = (stated[part] or {} for part in ("force_sensor", "velocity"))
    for name in ("resolution", "noise"):
        sensor.pop(name, None)
    if resolution := velocity.pop("resolution", None):
        stated["resolution"] = resolution
    if velocity and velocity["source"] is None:
        velocity["source"] = "measured"
    for part, key in ((velocity, "filter_coefficient"), (velocity, "sections"), (sensor, "sections")):
        if part and part[key] is None:
            del part[key]
    if velocity and not device.at_handle:
        del velocity["at"]


ADDED_KEYS = ("rule", "summed", "friction", "structure_2", "structure_3")  # of a device, which the first files lacked


def _drop_defaults(stated: dict[str, Any], table: Any, kept: Sequence[str]) -> None:
    """Delete the fields at their defaults: a key that a later version adds does not change the digest of a file that
    does not have it. Those to be kept were always counted."""
    for each in fields(table):
        if each.name not in kept and getattr(table, each.name) == each.default:
            del stated[each.name]


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
