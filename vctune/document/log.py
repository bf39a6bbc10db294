"""Read logs. The map in a log.toml assigns a role, such as position or command, to each column."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vctune.document.recording import (
    RESPONSE_ROLES,
    ROLES,
    SERVO_COMMANDS,
    SERVO_ROLES,
    Channel,
    Floats,
    Recording,
    headers_of,
    read_table,
)
from vctune.document.schema.log_schema import UNITS, ColumnTable, LogDocument
from vctune.document.schema.validation import Contradiction, shown, validated
from vctune.document.text import toml
from vctune.document.text.errors import InputError, Mistake, Note

# Units that a column may have, by its role
PLACES, FORCES = ("m", "mm", "um", "rad", "mrad", "deg"), ("N", "mN", "kN", "Nm", "mNm")
KINDS = {
    "time": ("s", "ms", "us"),
    **dict.fromkeys(("position", "handle", "position_command"), PLACES),
    **dict.fromkeys(("command", "force", "hand"), FORCES),
    **dict.fromkeys(("velocity", "velocity_command"), ("m/s", "mm/s", "rad/s", "deg/s")),
    "frequency": ("Hz",),
    "real": (),
    "imag": (),
    "gain": ("dB",),
    "phase": ("deg", "rad"),
}
# Headers of a response that are a role without a unit
BARE = {"hertz": "frequency", "real": "real", "imag": "imag", "gain_db": "gain"}
# Units of angles, torques and angular velocities, which only the log of a rotary device has
ANGLES = ("rad", "mrad", "deg", "Nm", "mNm", "rad/s", "deg/s")


@dataclass(frozen=True, slots=True)
class LogMap:
    """The content of a log.toml."""

    document: LogDocument
    source: str = "--config LOG.toml"  # path of the file; the option that names one without a file
    text: str = ""  # text of the file; "" without a file
    servo: bool = False  # whether the logs show a servo and its command


def read_log_map(path: Path | None, *, servo: bool = False) -> LogMap:
    """Read a log.toml. Without a file, return the map for logs whose headers state their roles."""
    if path is None:
        return LogMap(LogDocument.model_validate({}), servo=servo)
    text = toml.read_text(path)
    return LogMap(validated(LogDocument, text, str(path), _contradictions), str(path), text, servo)


def read_logs(paths: Sequence[Path], log_map: LogMap) -> list[Recording]:
    """Read the logs of one device; a column that the map names may be missing in some of them, but not in all."""
    somewhere = {header for path in paths for header in headers_of(path)} if len(paths) > 1 else set[str]()
    return [read_log(path, log_map, somewhere) for path in paths]


def read_log(path: Path, log_map: LogMap, elsewhere: Collection[str] = ()) -> Recording:
    """Read a log, of which other logs have the columns `elsewhere`."""

    def columns_of(headers: list[str]) -> dict[str, ColumnTable]:
        return _columns(path, headers, log_map, elsewhere)

    table = read_table(path, lambda headers: {stated.column for stated in columns_of(headers).values()})
    columns, rotary = columns_of(table.headers), log_map.document.rotary
    channels = {
        role: _channel(path, table.numbers[:, table.headers.index(stated.column)], stated, log_map, role)
        for role, stated in columns.items()
    }
    ignored = tuple(each for each in table.headers if each not in {stated.column for stated in columns.values()})
    guessed = [role for role in columns if getattr(log_map.document.columns, role) is None]
    notes = []
    if guessed:
        said = ", ".join(f"{columns[role].column} as {role}" for role in guessed)
        notes.append(Note("remark-columns", f"{path.name}: read by their names: {said}"))
    return Recording(str(path), table.sha256, table.first_line, channels, ignored, rotary, tuple(notes))


def _columns(path: Path, headers: list[str], log_map: LogMap, elsewhere: Collection[str]) -> dict[str, ColumnTable]:
    """Return the column of each role: the one in the map, or the first whose header states role and unit."""
    roles = (*(SERVO_ROLES if log_map.servo else ROLES), *RESPONSE_ROLES)
    stated = {
        role: ColumnTable(column=entry) if isinstance(entry, str) else entry
        for role in roles
        if (entry := getattr(log_map.document.columns, role)) is not None
    }
    used, here = {table.column for table in stated.values()}, ", ".join(headers)
    faults = [
        Mistake("log-columns", f"columns.{role}", f"{path}: has no column {shown(table.column)}; it has {here}")
        for role, table in stated.items()
        if table.column not in headers and table.column not in elsewhere
    ]
    stated = {role: table for role, table in stated.items() if table.column in headers}
    named = set(SERVO_COMMANDS) & set(stated)  # a command that the map names is the only one
    columns = dict[str, ColumnTable]()
    for role in roles:
        possible = {f"{role}_{unit.replace('/', '_')}" for unit in KINDS[role]} - used
        bare = next((header for header in headers if BARE.get(header) == role and header not in used), None)
        header = next((header for header in headers if header in possible), None)
        if role in stated:
            columns[role] = stated[role]
        elif bare is not None:
            columns[role] = ColumnTable(column=bare, scale=1.0)
        elif header is not None and not (named and role in SERVO_COMMANDS):
            columns[role] = ColumnTable(column=header)
    faults = faults or [
        Mistake("log-columns", key, f"{message} ({path} has the columns {here})")
        for key, message in _missing(columns, log_map)
    ]
    if faults:
        raise InputError(log_map.source, faults)
    return columns


def _missing(columns: dict[str, ColumnTable], log_map: LogMap) -> Iterator[tuple[str, str]]:
    """Yield what a log lacks: a motion, times and sample time, or what moves the device."""
    has, sent = set(columns), [columns[role].column for role in SERVO_COMMANDS if role in columns]
    untimed = log_map.document.sample_time is None
    if "frequency" in has:
        if not ({"real", "imag"} <= has or {"gain", "phase"} <= has):
            yield "columns.real", "a response has real and imag, or gain_dB and phase_deg; name its columns"
        if untimed:
            yield "sample_time", "a response does not show the sample time of the loop; write sample_time"
        return
    if not {"position", "velocity"} & has:
        yield "columns.position", "without a position or a velocity nothing can be identified; name its column"
    if log_map.servo and len(sent) == 2:
        both = f"a servo is sent a velocity or a position, and {' and '.join(sent)} are there"
        yield "columns", f"{both}; name the one that is sent"
    elif log_map.servo and not sent:
        yield "columns.velocity_command", "without a command nothing can be identified; name its column"
    elif not log_map.servo and not {"command", "force", "hand"} & has:
        yield "columns.command", "without a force nothing can be identified; name the column of the command"
    if "time" not in has and untimed:
        yield "sample_time", "there is no column time; name it in [columns], or write sample_time"


def _channel(path: Path, values: Floats, stated: ColumnTable, log_map: LogMap, role: str) -> Channel:
    """Return a column in SI units."""
    scale = UNITS[_unit(path, stated, log_map, role)] if stated.scale is None else stated.scale
    quantum, limit = (None if each is None else each * abs(scale) for each in (stated.quantum, stated.limit))
    return Channel(stated.column, values * scale, scale, quantum, limit)


def _unit(path: Path, stated: ColumnTable, log_map: LogMap, role: str) -> str:
    """Return the unit of a column: the stated unit, or the end of its header."""
    rotary = log_map.document.rotary
    either = role in ("time", *RESPONSE_ROLES)
    fitting = [unit for unit in KINDS[role] if either or (unit in ANGLES) == rotary]
    ends = [unit for unit in fitting if stated.column.endswith(f"_{unit.replace('/', '_')}")]
    unit: str = stated.unit or (ends or [stated.column.rpartition("_")[2]])[0]
    if unit in fitting:
        return unit
    fault = f"its unit {unit} is none" if stated.unit else "its header does not end with a unit"
    other = ""
    if not either and (unit in ANGLES) != rotary and unit in UNITS:
        other = "; write rotary = true" if unit in ANGLES else "; or is the device not rotary?"
    fault = f"column {shown(stated.column)} of {path}: {fault} of {', '.join(fitting)}"
    message = f"{fault}; write its unit, or scale = SI units per unit{other}"
    raise InputError.of(log_map.source, "log-columns", message, key=f"columns.{role}")


def _contradictions(raw: dict[str, Any]) -> Iterator[Contradiction]:
    """Yield the faults: a column with two roles, a column with both unit and scale, a delay without its value."""
    columns, roles = raw.get("columns"), dict[str, str]()
    for role, entry in columns.items() if isinstance(columns, dict) else ():
        header = entry.get("column") if isinstance(entry, dict) else entry
        if isinstance(header, str) and (other := roles.setdefault(header, role)) != role:
            message = f"is column {shown(header)}, as columns.{other} is; a column has one role: leave one of them out"
            yield ("columns", role), message
        if isinstance(entry, dict) and "unit" in entry and "scale" in entry:
            yield ("columns", role, "scale"), "says the same as unit; leave one of them out"
    uncertain, stated = (toml.value_at(raw, ("device", key)) for key in ("delay_uncertainty", "delay"))
    if uncertain and stated is None:
        yield ("device", "delay_uncertainty"), "there is no device.delay that is known; write it, or neither"
