"""Step a design's own firmware sample by sample in one precision."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any, Literal

import numpy as np

from vctune.model.experiment import Environment
from vctune.simulation.firmware import equations
from vctune.simulation.firmware.coefficient_values import environment_coefficients, limit_coefficients
from vctune.simulation.firmware.controller import Law, parts_of
from vctune.simulation.firmware.equations import STATE, Parts
from vctune.simulation.firmware.expression import Symbol, value
from vctune.simulation.firmware.operations import FLOATS

Precision = Literal["double", "single"]
# Functions that round a float to a precision
NUMBERS: dict[Precision, Callable[[Any], Any]] = {"double": float, "single": np.float32}


@dataclass(frozen=True, slots=True)
class Start:
    """The values with which a firmware starts."""

    environment: Environment  # the rendered environment
    limit: float | None  # greatest force, N; None without a limit, as for a servo
    position: float  # position of the motor, rounded to the encoder's steps, and x_e, both m
    reference: float


def exported_parts(law: Law) -> Parts:
    """Return the parts of an exported firmware: any built-in environment, no rounding of the position, and a limit on a
    commanded force."""
    of = parts_of(law)
    return Parts(
        difference=of.difference,
        low_passes=of.low_passes,
        spring=of.spring,
        limit=of.command == "force",
        command=of.command,
    )


class SteppedFirmware:
    """A firmware with its state. The object rounds the result of every operation to one precision."""

    def __init__(self, parts: Parts, coefficients: Mapping[str, float], start: Start, precision: Precision) -> None:
        """Set up the firmware before the first sample."""
        self._number = number = NUMBERS[precision]
        blocks = (equations.estimate, equations.drive, equations.environment, equations.law)
        self._written = [equation for block in blocks for equation in block(parts)]
        constants = {name: number(constant) for name, constant in coefficients.items()}
        names = ("mass", "damping", "stiffness", "zero")
        environment = replace(start.environment, **{name: number(getattr(start.environment, name)) for name in names})
        constants |= environment_coefficients(environment, constants["sample_time"])
        limit = inf if start.limit is None else start.limit
        constants |= limit_coefficients(number(limit), constants.get("position_gain", number(0.0)), 0.0)
        self._values = {Symbol(name): number(constant) for name, constant in constants.items()}
        self._values |= {Symbol(name, before=True): number(0.0) for name in STATE}
        self._values[Symbol("reference", before=True)] = number(start.reference)
        self._values[Symbol("measured", before=True)] = number(start.position)

    def command(self, measured: Sequence[float]) -> float:
        """Return the command, N, or m/s or m for a servo, and update the state."""
        values = self._values
        for name, read in zip(("position", "velocity", "force"), measured, strict=True):
            values[Symbol(f"measured_{name}")] = self._number(read)
        for equation in self._written:
            values[Symbol(equation.quantity.name)] = value(equation.right, values, FLOATS)
        for name in STATE:
            if Symbol(name) in values:
                values[Symbol(name, before=True)] = values[Symbol(name)]
        return float(values[Symbol("command")])
