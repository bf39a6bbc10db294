"""Define a recording of a device: columns of equal length in SI units, each with its header, resolution and limit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vctune.model.numbers.units import UNITS, Units

Floats = NDArray[np.float64]
ROLES = ("time", "position", "command", "force", "hand", "handle", "reference")
"""Roles of the columns in a device's log."""
SERVO_COMMANDS = ("velocity_command", "position_command")
"""Roles of a servo's command. A log has one of them."""
SERVO_ROLES = ("time", "position", *SERVO_COMMANDS, "force", "hand")
"""Roles of the columns in a servo's log."""


@dataclass(frozen=True, slots=True)
class Channel:
    """One column of a recording.

    Attributes
    ----------
    header : header of the column in the file
    values : numbers in SI units, shape (n,)
    scale : SI units per unit of the column; negative if the column has the opposite sign
    quantum : resolution that the map states, SI units; None if it states none
    limit : value at which the column saturates, SI units; None if it is not known
    """

    header: str
    values: Floats
    scale: float
    quantum: float | None
    limit: float | None


@dataclass(frozen=True, slots=True)
class Recording:
    """One log as columns.

    Attributes
    ----------
    source : path of its file
    sha256 : SHA-256 digest of the file, in hexadecimal
    first_line : line of the file that contains the first sample
    channels : columns by their role, one of `ROLES` or `SERVO_ROLES`
    ignored : headers of unused columns
    rotary : whether positions are angles
    """

    source: str
    sha256: str
    first_line: int
    channels: Mapping[str, Channel]
    ignored: tuple[str, ...]
    rotary: bool

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
