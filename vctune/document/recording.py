"""Define a recording of a device: columns of equal length in SI units, each with its header, resolution and limit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vctune.model.numbers.units import UNITS, Units

Floats = NDArray[np.float64]
# Roles of the columns in a device's log
ROLES = ("time", "position", "command", "force", "hand", "handle")
SERVO_COMMANDS = ("velocity_command", "position_command")  # Roles of a servo's command
SERVO_ROLES = ("time", "position", *SERVO_COMMANDS, "force", "hand")  # Roles of the columns in a servo's log


@dataclass(frozen=True, slots=True)
class Channel:
    """One column of a recording."""

    header: str  # header of the column in the file
    values: Floats  # numbers in SI units, shape (n,)
    scale: float  # SI units per unit of the column; negative if the column has the opposite sign
    quantum: float | None  # resolution that the map states, SI units; None if it states none
    limit: float | None  # value at which the column saturates, SI units; None if it is not known


@dataclass(frozen=True, slots=True)
class Recording:
    """One log as columns."""

    source: str  # path of its file
    sha256: str  # SHA-256 digest of the file, in hexadecimal
    first_line: int  # line of the file that contains the first sample
    channels: Mapping[str, Channel]  # columns by their role, one of `ROLES` or `SERVO_ROLES`
    ignored: tuple[str, ...]  # headers of unused columns
    rotary: bool  # whether positions are angles

    @property
    def name(self) -> str:
        """The name of the file without its folder."""
        return Path(self.source).name

    @property
    def units(self) -> Units:
        """The units of the recording."""
        return UNITS["rotary" if self.rotary else "linear"]

    def __len__(self) -> int:
        return next((channel.values.size for channel in self.channels.values()), 0)

    def values(self, role: str) -> Floats | None:
        """Return a column by its role; None if the log lacks it."""
        return self.channels[role].values if role in self.channels else None
