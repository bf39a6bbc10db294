"""Handle discrete states by name. The next value of each state is a weighted sum of states and input."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.analysis.responses.transfer import StateSpace

Row = dict[str, float]  # A weighted sum of states and of the input: coefficients by name
INPUT = "input"  # Name of the input in a row


@dataclass(frozen=True, slots=True)
class Signal:
    """A name with its unit, such as "velocity" and "m/s"."""

    name: str
    unit: str

    def __str__(self) -> str:
        return f"{self.name}, {self.unit}"


def total(terms: Iterable[tuple[float, Mapping[str, float]]]) -> Row:
    """Return a weighted sum of rows, without zero coefficients."""
    found: Row = {}
    for factor, row in terms:
        for name, x in row.items():
            found[name] = found.get(name, 0.0) + factor * x
    return {name: x for name, x in found.items() if x != 0}


def late(states: dict[str, Row], name: str, row: Row, samples: int) -> Row:
    """Return a row delayed by a number of samples, and add the states that store the row."""
    for ago in range(1, samples + 1):
        kept = f"{name}[k-{ago}]"
        states.setdefault(kept, row)
        row = {kept: 1.0}
    return row


def filtered(states: dict[str, Row], name: str, row: Row, coefficient: float, order: int) -> Row:
    """Return the present value of a row after low-passes y[k] = a x[k] + (1 - a) y[k-1] in series."""
    for number in range(1, order + 1):
        kept = f"{name} low-pass {number}[k-1]"
        row = total([(coefficient, row), (1 - coefficient, {kept: 1.0})])
        states[kept] = row
    return row


def closed(states: Mapping[str, Row], command: Row) -> dict[str, Row]:
    """Return states after replacing their input by a sum of states and another input."""
    return {name: substituted(row, command) for name, row in states.items()}


def substituted(row: Row, command: Row) -> Row:
    """Return a row after replacing its input by a sum."""
    rest = {name: x for name, x in row.items() if name != INPUT}
    return total([(1.0, rest), (row.get(INPUT, 0.0), command)])


def matrices(
    states: Mapping[str, Row], output: Row, units: Mapping[str, str], signals: tuple[Signal, Signal], sample_time: float
) -> StateSpace:
    """Return the matrices of the states that depend on the input and that affect the output."""
    names = _between(states, output)
    coefficients = [np.array([states[name].get(other, 0.0) for other in (*names, INPUT)]) for name in names]
    next_values = np.array(coefficients).reshape(len(names), len(names) + 1)
    output_row: Floats = np.array([[output.get(other, 0.0) for other in (*names, INPUT)]])
    return StateSpace(
        A=next_values[:, :-1],
        B=next_values[:, -1:],
        C=output_row[:, :-1],
        D=output_row[:, -1:],
        sample_time=sample_time,
        states=tuple(f"{name}, {units[name]}" for name in names),
        inputs=(str(signals[0]),),
        outputs=(str(signals[1]),),
    )


def _between(states: Mapping[str, Row], output: Row) -> list[str]:
    """Return the states that the input reaches and that affect the output, in their order."""
    seen: set[str] = set()
    ahead = [name for name in output if name != INPUT]
    while ahead:
        name = ahead.pop()
        if name not in seen:
            seen.add(name)
            ahead += [other for other in states[name] if other != INPUT]
    moved = {INPUT}
    while grown := {name for name, row in states.items() if name not in moved and moved & row.keys()}:
        moved |= grown
    return [name for name in states if name in seen & moved]
