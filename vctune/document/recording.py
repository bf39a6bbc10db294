"""A recording of a device: equally long columns in SI units, each with its header, resolution and limit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vctune.model.numbers.units import UNITS, Units

Floats = NDArray[np.float64]
ROLES = ("time", "position", "command", "force", "hand", "handle", "reference")
"""The roles of a column in a device's log."""
SERVO_COMMANDS = ("velocity_command", "position_command")
SERVO_ROLES = ("time", "position", *SERVO_COMMANDS, "force", "hand")
"""The roles of a column in a servo's log."""


@dataclass(frozen=True, slots=True)
class Channel:
    """One column.

    Attributes
    ----------
    header : header of the column in the file
    values : shape (n,), SI units
    scale : SI units per unit of the column
    quantum : resolution as the map states it, SI units; None if it does not
    limit : value at which it saturates, SI units; None if not known
    """

    header: str
    values: Floats
    scale: float
    quantum: float | None
    limit: float | None


@dataclass(frozen=True, slots=True)
class Recording:
    """One log.

    Attributes
    ----------
    source : path of its file
    sha256 : digest of the file
    first_line : line of the file with its first sample
    channels : by role, one of `ROLES` or `SERVO_ROLES`
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
        """The file's name, without its folder."""
        return Path(self.source).name

    @property
    def units(self) -> Units:
        """The units of its numbers."""
        return UNITS["rotary" if self.rotary else "linear"]

    def __len__(self) -> int:
        return next((channel.values.size for channel in self.channels.values()), 0)

    def values(self, role: str) -> Floats | None:
        """Return a column by its role; None if the log does not have it."""
        return self.channels[role].values if role in self.channels else None
