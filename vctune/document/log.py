"""Read logs. The map in a log.toml assigns a role, such as position or command, to each column."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vctune.document.log_table import read_table
from vctune.document.recording import ROLES, SERVO_COMMANDS, SERVO_ROLES, Channel, Floats, Recording
from vctune.document.schema.log_schema import UNITS, ColumnTable, LogDocument
from vctune.document.schema.validation import Contradiction, shown, validated
from vctune.document.text import toml
from vctune.document.text.errors import InputError, Mistake

# Units that a column may have, by its role
KINDS = {
    "time": ("s", "ms", "us"),
    "position": ("m", "mm", "um", "rad", "mrad", "deg"),
    "command": ("N", "mN", "kN", "Nm", "mNm"),
    "velocity_command": ("m/s", "mm/s", "rad/s", "deg/s"),
}
# Roles that have the same units as another role
KIND_OF = {
    "force": "command", "hand": "command", "handle": "position", "position_command": "position"
}  # fmt: skip
# Units of angles, torques and angular velocities, which only the log of a rotary device has
ANGLES = ("rad", "mrad", "deg", "Nm", "mNm", "rad/s", "deg/s")


@dataclass(frozen=True, slots=True)
class LogMap:
    """The content of a log.toml."""

    document: LogDocument  # the checked document
    source: str = "--config LOG.toml"  # path of the file; the option that names one without a file
    text: str = ""  # text of the file; "" without a file
    servo: bool = False  # whether the logs show a servo and its command

    @property
    def roles(self) -> tuple[str, ...]:
        """The roles that a column can have."""
        return SERVO_ROLES if self.servo else ROLES


def read_log_map(path: Path | None, *, servo: bool = False) -> LogMap:
    """Read a log.toml. Without a file, return the map for logs whose headers state their roles."""
    if path is None:
        return LogMap(LogDocument.model_validate({}), servo=servo)
    text = toml.read_text(path)
    return LogMap(validated(LogDocument, text, str(path), _contradictions), str(path), text, servo)


def read_log(path: Path, log_map: LogMap) -> Recording:
    """Read a log."""
    table = read_table(path)
    headers = table.headers
    columns = _columns(path, headers, log_map)
    channels = {
        role: _channel(path, table.numbers[:, headers.index(stated.column)], stated, log_map, role)
        for role, stated in columns.items()
    }
    used = {stated.column for stated in columns.values()}
    return Recording(
        source=str(path),
        sha256=table.sha256,
        first_line=table.first_line,
        channels=channels,
        ignored=tuple(header for header in headers if header not in used),
        rotary=log_map.document.rotary,
    )


def _columns(path: Path, headers: list[str], log_map: LogMap) -> dict[str, ColumnTable]:
    """Return the column of each role that the log contains: the column in the map, or one whose header states the
    role."""
    stated = {
        role: _table(entry) for role in log_map.roles if (entry := getattr(log_map.document.columns, role)) is not None
    }
    faults = [
        Mistake(
            "log-columns",
            f"columns.{role}",
            f"{path}: has no column {shown(table.column)}; it has {', '.join(headers)}",
        )
        for role, table in stated.items()
        if table.column not in headers
    ]
    if faults:
        raise InputError(log_map.source, faults)
    used_headers = {table.column for table in stated.values()}
    possible_roles = [role for role in log_map.roles if role in stated or role not in _roles_only_by_map(stated)]
    columns = {
        role: table
        for role in possible_roles
        if (table := stated.get(role) or _column_by_header(role, headers, used_headers)) is not None
    }
    _check_needed(path, headers, columns, log_map)
    return columns


def _roles_only_by_map(stated: Mapping[str, ColumnTable]) -> tuple[str, ...]:
    """Return the roles that no header gives to a column."""
    return SERVO_COMMANDS if set(SERVO_COMMANDS) & set(stated) else ()


def _table(entry: str | ColumnTable) -> ColumnTable:
    return entry if isinstance(entry, ColumnTable) else ColumnTable(column=entry)


def _column_by_header(role: str, headers: list[str], used_headers: set[str]) -> ColumnTable | None:
    """Return the first column whose header states the role and a unit, as in position_mm; None if there is none."""
    ends = [f"{role}_{_in_header(unit)}" for unit in KINDS[KIND_OF.get(role, role)]]
    return next(
        (ColumnTable(column=header) for header in headers if header in ends and header not in used_headers), None
    )


def _in_header(unit: str) -> str:
    return unit.replace("/", "_")


def _check_needed(path: Path, headers: list[str], columns: dict[str, ColumnTable], log_map: LogMap) -> None:
    """Refuse a log without a position, without times and sample time, or without what moves the device."""
    missing = []
    if "position" not in columns:
        missing.append(("columns.position", "without a position nothing can be identified; name its column"))
    if log_map.servo:
        missing += _servo_command_faults(columns)
    elif not {"command", "force", "hand"} & set(columns):
        missing.append(("columns.command", "without a force nothing can be identified; name the column of the command"))
    if "time" not in columns and log_map.document.sample_time is None:
        missing.append(("sample_time", "there is no column time; name it in [columns], or write sample_time"))
    if missing:
        here = f"{path} has the columns {', '.join(headers)}"
        raise InputError(
            log_map.source, [Mistake("log-columns", key, f"{message} ({here})") for key, message in missing]
        )


def _servo_command_faults(columns: Mapping[str, ColumnTable]) -> list[tuple[str, str]]:
    """Return the fault of a servo's log without a command, or with both."""
    sent = [role for role in SERVO_COMMANDS if role in columns]
    if len(sent) == 1:
        return []
    if sent:
        both = " and ".join(columns[role].column for role in sent)
        return [
            ("columns", f"a servo is sent a velocity or a position, and {both} are there; name the one that is sent")
        ]
    return [("columns.velocity_command", "without a command nothing can be identified; name its column")]


def _channel(path: Path, values: Floats, stated: ColumnTable, log_map: LogMap, role: str) -> Channel:
    """Return a column in SI units."""
    scale = stated.scale if stated.scale is not None else UNITS[_unit(path, stated, log_map, role)]
    quantum = None if stated.quantum is None else stated.quantum * abs(scale)
    limit = None if stated.limit is None else stated.limit * abs(scale)
    return Channel(stated.column, values * scale, scale, quantum, limit)


def _unit(path: Path, stated: ColumnTable, log_map: LogMap, role: str) -> str:
    """Return the unit of a column: the stated unit, or the end of its header."""
    fitting = KINDS[KIND_OF.get(role, role)]
    if role != "time":
        fitting = tuple(unit for unit in fitting if (unit in ANGLES) == log_map.document.rotary)
    ends = [unit for unit in fitting if stated.column.endswith(f"_{_in_header(unit)}")]
    unit: str = stated.unit or (ends or [stated.column.rpartition("_")[2]])[0]
    if unit in fitting:
        return unit
    fault = f"its unit {unit} is none" if stated.unit else "its header does not end with a unit"
    other = ""
    if role != "time" and (unit in ANGLES) != log_map.document.rotary and unit in UNITS:
        other = "; write rotary = true" if unit in ANGLES else "; or is the device not rotary?"
    fault = f"column {shown(stated.column)} of {path}: {fault} of {', '.join(fitting)}"
    message = f"{fault}; write its unit, or scale = SI units per unit{other}"
    raise InputError.of(log_map.source, "log-columns", message, key=f"columns.{role}")


def _contradictions(raw: dict[str, Any]) -> list[Contradiction]:
    """Return the faults: a column with two roles, a column with both unit and scale, a delay without its value."""
    faults: list[Contradiction] = []
    columns, roles = raw.get("columns"), dict[str, str]()
    for role, entry in columns.items() if isinstance(columns, dict) else ():
        header = entry.get("column") if isinstance(entry, dict) else entry
        if isinstance(header, str) and (other := roles.setdefault(header, role)) != role:
            message = f"is column {shown(header)}, as columns.{other} is; a column has one role: leave one of them out"
            faults.append((("columns", role), message))
        if isinstance(entry, dict) and "unit" in entry and "scale" in entry:
            faults.append((("columns", role, "scale"), "says the same as unit; leave one of them out"))
    device = raw.get("device")
    if isinstance(device, dict) and device.get("delay_uncertainty") and "delay" not in device:
        faults.append((("device", "delay_uncertainty"), "there is no device.delay that is known; write it, or neither"))
    return faults
