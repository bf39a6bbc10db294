"""From a problem file to a `Problem`, or to everything that is wrong with the file."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from hashlib import sha256
from math import inf, isfinite, isnan, pi
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from vctune.document import toml
from vctune.document.defaults import resolve
from vctune.document.errors import InputError, Mistake
from vctune.document.problem import Problem
from vctune.document.schema import ProblemDocument

MAX_DELAY_SAMPLES = 200
MAX_DECADES = 12
MAX_MISTAKES = 25
LONG = 60
VARIABLES = ("gains.velocity", "gains.position", "coupling.damping", "coupling.mass", "coupling.drag")


@dataclass(frozen=True, slots=True)
class ProblemFile:
    """A problem and the text it was read from."""

    problem: Problem
    text: str

    @property
    def sha256(self) -> str:
        """The digest that ties a design to its problem."""
        return sha256(self.text.encode()).hexdigest()


def read_problem(path: Path) -> ProblemFile:
    """Read a problem file.

    Raises
    ------
    InputError
        Listing every mistake, each with line, dotted key, value and remedy.
    """
    text = toml.read_text(path)
    name = path.stem.encode("utf-8", "replace").decode()
    return ProblemFile(parse_problem(text, str(path), name), text)


def parse_problem(text: str, source: str, default_name: str) -> Problem:
    """Return the problem that a TOML text states. Raises `InputError` like `read_problem`."""
    raw = toml.parse(text, source)
    document, faults = None, []
    try:
        document = ProblemDocument.model_validate(raw)
    except ValidationError as error:
        faults = [_fault(raw, details) for details in error.errors(include_url=False)]
    faults += _contradictions(raw)
    if document is None or faults:
        mistakes = _located(faults[:MAX_MISTAKES], text)
        more = [Mistake("", f"and {len(faults) - MAX_MISTAKES} more")] if len(faults) > MAX_MISTAKES else []
        raise InputError(source, [*sorted(mistakes, key=lambda mistake: mistake.line or 0), *more])
    problem = resolve(document, default_name)
    if problem.stability.band.min >= problem.stability.band.max:
        raise InputError(source, _located([_empty_default_band(problem)], text))
    return problem


Fault = tuple[tuple[str | int, ...], str]


def _located(faults: list[Fault], text: str) -> list[Mistake]:
    lines = toml.Lines(text)
    return [Mistake(_dotted(path), message, _line(lines, path)) for path, message in faults]


def _line(lines: toml.Lines, path: tuple[str | int, ...]) -> int:
    """Return the line of a key, or of the nearest table that should have held it."""
    while path:
        line = lines.locate(path)
        if line is not None:
            return line
        path = path[:-1]
    return 1


def _dotted(path: tuple[str | int, ...]) -> str:
    dotted = ""
    for step in path:
        name = step if isinstance(step, int) or re.fullmatch(r"[\w-]+", step) else json.dumps(step, ensure_ascii=False)
        dotted += f"[{name}]" if isinstance(step, int) else f".{name}" if dotted else str(name)
    return _short(dotted)


def _fault(raw: dict[str, Any], details: Any) -> Fault:
    path = tuple(step for step in details["loc"] if step not in ("<number>", "<range>"))
    value, context, kind = details["input"], details.get("ctx", {}), details["type"]
    if kind == "extra_forbidden":
        return path, f"unknown key{_suggestion(path)}"
    if isinstance(value, float) and isnan(value):
        return path, "nan is not a number; write a number"
    if kind == "value_error":
        return path, str(context["error"])
    if kind == "missing":
        return path, f"is missing; {_documentation(path)}"
    messages: dict[str, Callable[[], str]] = {
        "greater_than_equal": lambda: f"{_show(value)} is too small: must be at least {context['ge']:g}",
        "less_than_equal": lambda: f"{_show(value)} is out of range: must be at most {context['le']:g}",
        "float_type": lambda: f"{_show(value)} is not a number; write a number{_or_range(path)}",
        "string_type": lambda: f"{_show(value)} is not a text; put it in quotes",
        "literal_error": lambda: f"{_show(value)} is not one of {context['expected']}",
        "model_type": lambda: f"{_show(value)} is not a table",
        "tuple_type": lambda: f"{_show(value)} is not a pair of numbers [lower, upper]",
        "too_long": lambda: f"{_show(value)} has more than two numbers; write [lower, upper]",
        "string_too_short": lambda: "is empty; leave it out to use the file's name",
        "string_too_long": lambda: f"{_show(value)} is too long: at most {context['max_length']}",
    }
    return path, messages[kind]() if kind in messages else f"{_show(value)}: {details['msg']}"


def _show(value: Any) -> str:
    try:
        text = json.dumps(value, ensure_ascii=False, default=str)
    except ValueError:  # an integer of thousands of digits
        return "this integer"
    return _short(text)


def _short(text: str) -> str:
    return text if len(text) <= LONG else text[: LONG - 3] + "..."


def _or_range(path: tuple[str | int, ...]) -> str:
    return " or { min = ..., max = ... }" if _dotted(path) in VARIABLES else ""


def _table_at(path: tuple[str | int, ...]) -> type[BaseModel] | None:
    table: type[BaseModel] = ProblemDocument
    for step in path:
        field = table.model_fields.get(step) if isinstance(step, str) else None
        annotation = field.annotation if field else None
        if not (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
            return None
        table = annotation
    return table


def _suggestion(path: tuple[str | int, ...]) -> str:
    table = _table_at(path[:-1])
    known = list(table.model_fields) if table else ["min", "max"]
    meant = get_close_matches(str(path[-1]), known, n=1, cutoff=0.6)
    if meant:
        return f"; did you mean {meant[0]}?"
    owner = next((name for name, field in _tables() if path[-1] in field), None)
    return f"; it belongs in [{owner}]" if owner else f"; known here: {', '.join(known)}"


def _tables() -> Iterator[tuple[str, set[str]]]:
    for name in ProblemDocument.model_fields:
        table = _table_at((name,))
        if table:
            yield name, set(table.model_fields)


def _documentation(path: tuple[str | int, ...]) -> str:
    table = _table_at(path[:-1])
    if table is None or not isinstance(path[-1], str):
        return "write two numbers [lower, upper]" if isinstance(path[-1], int) else "both min and max are needed"
    text = table.model_fields[path[-1]].description or (_table_at(path) or table).__doc__ or ""
    return f"it is required: {text}"


def _contradictions(raw: dict[str, Any]) -> list[Fault]:
    """Return what is wrong between values that are each right; works on whatever part of the document is valid."""
    return [*_empty_ranges(raw), *_impossible_bands(raw), *_impossible_numbers(raw)]


def _number(raw: dict[str, Any], *path: str | int) -> float | None:
    node: Any = raw
    for step in path:
        try:
            node = node[step]
        except (KeyError, IndexError, TypeError):
            return None
    return float(node) if isinstance(node, int | float) and not isinstance(node, bool) and abs(node) < 1e300 else None


def _empty_ranges(raw: dict[str, Any]) -> Iterator[Fault]:
    for key in VARIABLES:
        path = tuple(key.split("."))
        low, high = _number(raw, *path, "min"), _number(raw, *path, "max")
        if low is not None and high is not None and low > high:
            yield path, f"min = {low:g} is above max = {high:g}; swap them"


def _impossible_bands(raw: dict[str, Any]) -> Iterator[Fault]:
    sample_time, delay = _number(raw, "device", "sample_time"), _number(raw, "device", "delay") or 0.0
    to_infinity = raw.get("device", {}).get("hold") == "lag" if isinstance(raw.get("device"), dict) else False
    to_infinity = to_infinity and delay == 0
    for table in ("transparency", "stability"):
        path = (table, "band_hz")
        low, high = _number(raw, *path, 0), _number(raw, *path, 1)
        endless = _is_infinite(raw, table, 1)
        if low is not None and high is not None and low >= high:
            yield path, f"the lower edge {low:g} Hz is not below the upper edge {high:g} Hz; a band needs a width"
        if _is_infinite(raw, table, 0):
            yield path, "the lower edge is infinite; use a finite one"
        if low and high and high > low * 10.0**MAX_DECADES > 0:
            yield path, f"from {low:g} to {high:g} Hz are more than {MAX_DECADES} decades; narrow it"
        if high is not None and sample_time and sample_time > 0 and high > 0.5 / sample_time * (1 + 1e-12):
            nyquist = 0.5 / sample_time
            yield path, f"the upper edge {high:g} Hz is above the Nyquist frequency {nyquist:g} Hz; lower it"
        if table == "stability" and not to_infinity:
            for edge, there in (("the lower edge 0", low == 0), ("the upper edge inf", endless)):
                if there:
                    yield path, f'{edge} needs hold = "lag" and delay = 0; use a finite, positive edge'


def _is_infinite(raw: dict[str, Any], table: str, edge: int) -> bool:
    try:
        return bool(raw[table]["band_hz"][edge] == inf)
    except (KeyError, IndexError, TypeError):
        return False


def _impossible_numbers(raw: dict[str, Any]) -> Iterator[Fault]:
    factor = _number(raw, "stability", "safety_factor")
    if factor is not None and isfinite(factor) and 0 < factor < 1:
        yield ("stability", "safety_factor"), f"{factor:g} is below 1, where the handle is not absolutely stable"
    weights = [_number(raw, "transparency", "weights", term) for term in ("admittance", "tracking", "coupling")]
    if all(weight == 0 for weight in weights):
        yield ("transparency", "weights"), "all three are 0: nothing is left to optimise; give one a positive weight"
    sample_time, delay = _number(raw, "device", "sample_time"), _number(raw, "device", "delay")
    if sample_time and delay and delay > MAX_DELAY_SAMPLES * sample_time > 0:
        samples = delay / sample_time
        yield (
            ("device", "delay"),
            f"{delay:.12g} s is {samples:.12g} sample times; at most {MAX_DELAY_SAMPLES} are supported",
        )


def _empty_default_band(problem: Problem) -> Fault:
    low, high = problem.transparency.band.min / (2 * pi), 0.1 / problem.device.sample_time
    message = (
        f"with the lower edge {low:g} Hz the default stability band, from there to a tenth of the sampling rate "
        f"({high:g} Hz), is empty; set stability.band_hz"
    )
    return ("transparency", "band_hz"), message
