"""Define the permitted ranges of arguments of functions and commands. This module imports nothing heavy."""

from __future__ import annotations

from typing import Literal

from vctune.document.text.toml import STDIN as STDIN
from vctune.model.numbers.units import KEYS, SPRING_KEYS

Format = Literal["c", "ros2"]  # Formats of an exported design
GAPS = (1e-4, 10.0)  # Least and greatest permitted gap
# Least and greatest permitted side of a region's smallest cell, as a share of the plane's side
RESOLUTIONS = (1 / 2048, 1 / 8)
VARIABLES = (*KEYS, *SPRING_KEYS[3:])  # Keys of the design variables of all displays
